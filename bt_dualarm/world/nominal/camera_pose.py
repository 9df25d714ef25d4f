"""Where a camera of a MuJoCo model is, in the convention of everybody else."""

from __future__ import annotations

import mujoco
import numpy as np

from bt_dualarm.pose import Pose


def camera_pose(data: mujoco.MjData, camera_id: int) -> Pose:
    """The camera in the world, x right, y down, z forward; MuJoCo's own looks along -z, y up."""
    axes = data.cam_xmat[camera_id].reshape(3, 3) * np.array([1.0, -1.0, -1.0])
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = axes, data.cam_xpos[camera_id]
    return Pose.from_matrix(transform)
