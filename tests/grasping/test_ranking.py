from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from bt_dualarm.core.pose import Pose
from bt_dualarm.grasping.candidates import (
    Obstacle,
    cup_grasps,
    finger_points,
    jaw_grasps,
    ranked,
)
from bt_dualarm.grasping.grasp import Box, CupMeasures, JawMeasures, Load, solid_of
from bt_dualarm.sim.object_body import body_of
from bt_dualarm.spec.document import ObjectSpec
from bt_dualarm.spec.values import PoseSpec
from tests.grasping.families import JAW, JAWS, SIZES

TABLE = Obstacle(Box(np.array([1.0, 1.0, 0.5])), Pose.from_rpy((0.0, 0.0, -0.5)))
CUP = CupMeasures(0.02, 2e-3, 60.0, 0.5)
LOAD = Load(0.3, np.array([0.0, 0.0, -9.81]), 8.0, np.zeros(3))


def no_cost(_: Pose) -> float:
    return 0.0


@settings(
    max_examples=8,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow],
    phases=[Phase.generate],
)
@given(st.sampled_from(["box", "cylinder", "sphere"]), SIZES, st.floats(-3.1, 3.1), JAWS)
def test_object_on_a_table_is_grasped_without_touching_the_table(
    shape: str, edge: float, yaw: float, jaw: JawMeasures
) -> None:
    """An object of 20 to 70 mm on a table has grasps in which no finger is inside the table."""
    size = {"box": (edge,) * 3, "cylinder": (edge / 2, edge), "sphere": (edge / 2,)}[shape]
    pose = Pose.from_rpy((0.2, -0.1, edge / 2), (0.0, 0.0, yaw))
    found = ranked(jaw_grasps(solid_of(shape, size), jaw, LOAD, 0.8), pose, jaw, [TABLE], no_cost)
    assert found
    assert [one.cost for one in found] == sorted(one.cost for one in found)
    for one in found[::9]:
        assert one.clearance >= -1e-4
        for opening in (jaw.widest_opening, one.grasp.width):
            assert one.tool.apply(finger_points(jaw, opening))[:, 2].min() >= -1e-4
        assert np.allclose(one.tool.matrix, (pose @ one.grasp.tool).matrix)


def test_unreachable_grasps_are_left_out() -> None:
    grasps = jaw_grasps(solid_of("box", (0.04, 0.04, 0.04)), JAW, LOAD, 0.8)
    pose = Pose.from_rpy((0.0, 0.0, 0.02))
    assert ranked(grasps, pose, JAW, [TABLE], lambda _: math.inf) == ()
    from_above = ranked(
        grasps, pose, JAW, [TABLE], lambda tool: 0.5 * (1.0 + tool.rotation_matrix[2, 2])
    )
    assert from_above[0].tool.rotation_matrix[2, 2] == pytest.approx(-1.0)


def test_fingers_do_not_collide_with_walls() -> None:
    """Between two low walls only fingers in line with them have room."""
    grasps = jaw_grasps(solid_of("box", (0.04, 0.04, 0.04)), JAW, LOAD, 0.8)
    walls = [
        Obstacle(Box(np.array([0.01, 1.0, 0.015])), Pose.from_rpy((side * 0.035, 0.0, 0.015)))
        for side in (-1, 1)
    ]
    found = ranked(grasps, Pose.from_rpy((0.0, 0.0, 0.02)), JAW, [TABLE, *walls], no_cost)
    assert found
    assert all(abs(one.tool.rotation_matrix[0, 1]) < 0.8 for one in found)


def test_a_cup_below_an_object_on_a_table_has_no_room() -> None:
    """Its axis leads into the table; the balls that stand for it, which are wider, do not count."""
    grasps = cup_grasps(solid_of("box", (0.06, 0.06, 0.03)), CUP, LOAD)
    pose = Pose.from_rpy((0.0, 0.0, 0.015))
    found = ranked(grasps, pose, CUP, [TABLE], no_cost)
    assert len(found) == 4
    assert all(one.tool.rotation_matrix[2, 2] == pytest.approx(-1.0) for one in found)
    walls = [
        Obstacle(Box(np.array([0.01, 1.0, 0.1])), Pose.from_rpy((side * 0.021, 0.0, 0.15)))
        for side in (-1, 1)
    ]
    assert len(ranked(grasps, pose, CUP, [TABLE, *walls], no_cost)) == 4
    assert len(ranked(grasps, pose, None, [TABLE], no_cost)) == len(grasps)


def test_a_cup_prefers_faces_with_room_for_the_wrist() -> None:
    """Beside a box on a table, the wrist has none; an arm that hangs head first is turned so."""
    grasps = cup_grasps(solid_of("box", (0.12, 0.08, 0.07)), CUP, LOAD)
    pose = Pose.from_rpy((0.0, 0.0, 0.035))
    found = ranked(
        grasps, pose, CUP, [TABLE], lambda tool: 0.4 * (1.0 - tool.rotation_matrix[2, 2])
    )
    assert found[0].tool.rotation_matrix[2, 2] == pytest.approx(-1.0)
    assert found[0].clearance > 0.02
    sides = [one for one in found if abs(one.tool.rotation_matrix[2, 2]) < 0.1]
    assert sides[0].clearance == 0.0


def test_fingertips_keep_a_distance_from_the_floor_of_a_tray() -> None:
    """Grasps of its wall that reach less deep than the whole pads are preferred."""
    size = (0.3, 0.2, 0.03)
    spec = ObjectSpec(shape="tray", size=size, mass=0.3, pose=PoseSpec(xyz=(0, 0, 0.015)))
    grasps = jaw_grasps(body_of(spec).solid, JAW, LOAD, 0.8)
    found = ranked(grasps, Pose.from_rpy((0.0, 0.0, 0.015)), JAW, [TABLE], no_cost)
    assert min(one.grasp.ahead for one in found) < 2e-3  # otherwise the test shows nothing
    assert found[0].grasp.ahead >= 5e-3
