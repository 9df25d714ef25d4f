"""Colors of arms and targets: a search for a named color must not find an arm."""

from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.perception.detection import ColorFilter
from bt_dualarm.robots.robot_description import robot_names
from bt_dualarm.spec.colors import NAMED_COLORS
from bt_dualarm.spec.values import Color
from tests.sim.worlds import world_with

TARGETS = ("red", "orange", "yellow", "green", "blue")


@pytest.mark.parametrize("robot", robot_names())
def test_no_part_of_an_arm_has_a_target_color(robot: str) -> None:
    """The blue joints of a UR5 were once tracked instead of a blue cube."""
    model = world_with(robot).model
    for geom in range(model.ngeom):
        material = int(model.geom_matid[geom])
        rgba = model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]
        for light in (0.4, 0.7, 1.0):
            pixel = np.round(255 * light * rgba[:3]).astype(np.uint8)[None, None]
            taken = [name for name in TARGETS if ColorFilter(Color.named(name)).mask(pixel).any()]
            body = model.body(int(model.geom_bodyid[geom])).name
            assert not taken, f"{body} looks {taken[0]} to a camera"


@pytest.mark.parametrize("name", TARGETS)
def test_object_of_a_named_color_matches_only_that_color(name: str) -> None:
    """In the shade and in full light."""
    for light in (0.4, 0.7, 1.0):
        pixel = np.round(255 * light * np.array(NAMED_COLORS[name])).astype(np.uint8)[None, None]
        taken = [other for other in TARGETS if ColorFilter(Color.named(other)).mask(pixel).any()]
        assert taken == [name]
