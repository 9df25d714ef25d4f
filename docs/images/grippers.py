"""Draw the picture of docs/grippers.md: each gripper of the catalog on a UR5, before its cube.

    .venv/bin/python docs/images/grippers.py

Fingers are drawn around a cube of 50 mm. It needs no OpenGL: rays are cast, as in the loop.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import cv2
import numpy as np

from bt_dualarm.core.pose import Pose
from bt_dualarm.robots.gripper import FINGERS, gripper_names
from bt_dualarm.sim.frame import Image, Viewpoint
from bt_dualarm.sim.painter import StillRenderer
from bt_dualarm.sim.world import World
from bt_dualarm.spec.document import ArmSpec, ObjectSpec, TreeFile, WorldSpec
from bt_dualarm.spec.node_types import NodeSpec
from bt_dualarm.spec.values import PoseSpec

TARGET: Final = Path(__file__).with_suffix(".png")
SIZE: Final = (400, 400)
EDGE_M: Final = 0.05
FINER: Final = 2
"""Pixels drawn for one of the picture, along each edge: rays have no smooth edges."""

EYE_M: Final = (0.45, 0.20, 0.25)
"""From the tool frame's origin to the eye, in the tool frame: aside and before the fingers."""

MIDDLE_M: Final = (0.0, 0.0, -0.06)
"""Likewise to the point in the middle of the picture."""

FOV_DEG: Final = 34.0


def world_with(gripper: str) -> World:
    """A UR5 with a gripper, and a cube between its pads or before its cup."""
    tree = NodeSpec(kind="succeed", name="succeed", ports={})
    arm = ArmSpec(robot="ur5", gripper=gripper, base=PoseSpec(xyz=(0.0, 0.0, 0.4)), tree=tree)
    file = TreeFile(name="grippers", world=WorldSpec(scene="empty"), objects={}, arms={"arm1": arm})
    bare = World(file)
    fingered = bool(bare.grippers["arm1"].gripper.fingers)
    ahead = Pose.from_rpy((0.0, 0.0, 0.0 if fingered else 0.5 * EDGE_M))
    at = bare.arms["arm1"].tool_pose @ ahead
    pose = PoseSpec(xyz=tuple(at.position.tolist()), quat=tuple(at.quaternion.tolist()))
    cube = ObjectSpec(shape="box", size=(EDGE_M,) * 3, mass=0.2, pose=pose, color="yellow")
    world = World(file.model_copy(update={"objects": {"cube": cube}}))
    if fingered:
        for finger in FINGERS:
            world.data.joint(f"arm1/{finger}").qpos[0] = 0.5 * EDGE_M
        world.restore(world.state())
    return world


def picture(gripper: str) -> Image:
    """The gripper and what is before it, of shape (height, width, 3), its name below."""
    world = world_with(gripper)
    tool = world.arms["arm1"].tool_pose
    (width, height) = SIZE
    eye, middle = (tool.apply(np.array(point)) for point in (EYE_M, MIDDLE_M))
    fine = StillRenderer.of(world).draw(
        Viewpoint(eye, middle, FOV_DEG), FINER * width, FINER * height
    )
    image = cv2.resize(fine, SIZE, interpolation=cv2.INTER_AREA)
    cv2.putText(
        image, gripper, (12, height - 14), cv2.FONT_HERSHEY_SIMPLEX, 0.7, (0, 0, 0), 2, cv2.LINE_AA
    )
    return np.asarray(image, np.uint8)


def pictures() -> Image:
    """All of them side by side, in OpenCV's order of colors."""
    row = np.hstack([picture(name) for name in gripper_names()])
    return np.asarray(cv2.cvtColor(row, cv2.COLOR_RGB2BGR), np.uint8)


def main() -> None:
    """Write the picture; the same bytes for the same pages."""
    cv2.imwrite(str(TARGET), pictures(), [cv2.IMWRITE_PNG_COMPRESSION, 9])


if __name__ == "__main__":
    main()
