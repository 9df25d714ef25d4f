"""A gripper does not block the view of its arm's camera."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from bt_dualarm.robots.gripper import gripper_names
from bt_dualarm.robots.robot_description import load_robot, robot_names
from bt_dualarm.sim.frame import Exposure, Image
from bt_dualarm.sim.renderers import RayRenderer
from bt_dualarm.sim.world import World
from bt_dualarm.spec.document import CameraSpec
from tests.families import some
from tests.sim.worlds import WORLD as FOLDER
from tests.sim.worlds import arm, file_of


def _seen(robot: str, mount: str, gripper: str | None) -> Image:
    camera = CameraSpec(mount=mount)
    held = arm(robot, (0.0, 0.0, 1.0), camera=camera, gripper=gripper)
    world = World(file_of({"arm1": held}))
    width, height = camera.resolution
    exposure = Exposure(world.model.camera("arm1/camera").id, width, height)
    return RayRenderer().render(world.model, world.data, exposure)


@pytest.mark.parametrize(("robot", "gripper"), some(product(robot_names(), gripper_names()), 2))
def test_middle_of_the_image_is_free(robot: str, gripper: str) -> None:
    """The gripper hides only the image's edge: nothing of its middle half, and less than 20 %.

    Arms center objects in the image. Open fingers extend farthest to the sides.
    """
    for mount in load_robot(robot, FOLDER).cameras:
        differs = (_seen(robot, mount, gripper) != _seen(robot, mount, None)).any(axis=2)
        height, width = differs.shape
        middle = differs[height // 4 : -height // 4, width // 4 : -width // 4]
        assert not middle.any()
        assert np.mean(differs) < 0.2
