"""Camera images show the true positions of the fingers, not those of the encoder."""

from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.robots.gripper import FINGERS
from bt_dualarm.robots.mjspec import LOOP_GROUPS
from bt_dualarm.sim.frame import Viewpoint
from bt_dualarm.sim.renderers import RayScene, fan_of
from tests.grippers.fingers import FINGERED, opened
from tests.sim.worlds import world_with

AWAY_M = 0.30
PIXELS = 200
FOV_DEG = 40.0
PIXEL_M = 2.0 * AWAY_M * np.tan(np.deg2rad(FOV_DEG / 2.0)) / PIXELS


@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("gripper", FINGERED)
def test_image_shows_the_true_finger_positions(gripper: str, share: float) -> None:
    """From the side, the inner edges of the two fingers are as far apart as the pads."""
    world = world_with("ur5", gripper=gripper)
    stroke = world.grippers["arm1"].gripper.stroke
    opened(world, share * stroke, sensed=(1.0 - share) * stroke)
    tool = world.arms["arm1"].tool_pose
    x, y, _ = tool.rotation_matrix.T
    view = Viewpoint(tool.position + AWAY_M * x, tool.position, FOV_DEG)
    fan = fan_of(view, PIXELS, PIXELS)
    hits = RayScene(world.model, LOOP_GROUPS).trace(world.data, fan)
    bodies = np.where(hits.geoms >= 0, world.model.geom_bodyid[hits.geoms], -1)
    edges = []
    for finger in FINGERS:
        seen = bodies == world.model.body(f"arm1/{finger}").id
        assert seen.sum() > 100
        points = view.eye[:, None] + view.axes @ (fan.rays[:, seen] * hits.distances[seen])
        edges.append(np.abs((points.T - tool.position) @ y).min())
    assert sum(edges) == pytest.approx(share * stroke, abs=2.0 * PIXEL_M)
