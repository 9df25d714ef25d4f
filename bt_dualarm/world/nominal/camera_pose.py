"""Where a camera of a MuJoCo model is, in the convention of everybody else."""

from __future__ import annotations

import mujoco

from bt_dualarm.pose import Pose


def camera_pose(data: mujoco.MjData, camera_id: int) -> Pose:
    """The camera in the world, x right, y down, z forward; MuJoCo's own looks along -z, y up."""
    a, b, c, d, e, f, g, h, i = data.cam_xmat[camera_id].tolist()
    axes = (a, -b, -c), (d, -e, -f), (g, -h, -i)
    return Pose.from_axes(data.cam_xpos[camera_id].copy(), axes)
