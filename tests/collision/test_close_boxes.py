"""Boxes of two hands that are too close are found even where MuJoCo reports no contact."""

from __future__ import annotations

import mujoco
import numpy as np

from bt_dualarm.collision.checker import CollisionChecker
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.sim.world import World
from tests.sim.worlds import arm, file_of

MARGIN_M = 0.045


def two_hands() -> World:
    """Two arms whose hands can meet."""
    first = arm("panda", gripper="robotiq_2f85")
    second = arm("panda", (0.9, 0.0, 0.4), 180.0, gripper="robotiq_2f85")
    return World(file_of({"arm1": first, "arm2": second}))


def beside(world: World, count: int) -> list[Vector]:
    """Configurations of the first arm in which its hand is near the second arm's."""
    kinematics = Kinematics(world.robots["arm1"], world.arms["arm1"].base)
    there = world.arms["arm2"].tool_pose
    rng = np.random.default_rng(0)
    found: list[Vector] = []
    while len(found) < count:
        away = rng.normal(size=3)
        away *= rng.uniform(0.1, 0.22) / np.linalg.norm(away)
        # Contacts miss boxes whose edges are parallel.
        turn = there @ Pose.from_rpy((0, 0, 0), tuple(0.5 * np.pi * rng.integers(0, 4, 3)))
        goal = Pose(there.position + away, turn.quaternion)
        try:
            found.append(kinematics.solve(goal, world.arms["arm1"].q))
        except Failure:
            continue
    return found


def test_close_boxes_are_found_where_no_contact_is_reported() -> None:
    """All boxes nearer than the margin are found; contacts miss some of them."""
    world = two_hands()
    checker = CollisionChecker(world, "arm1", MARGIN_M)
    missed = 0
    for q in beside(world, 60):
        contact = checker.contact(q)
        close = checker.close_boxes(q)
        model, data = checker.model, checker.data
        boxes = np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_BOX)
        hands = [
            [one for one in boxes if one in world.arms[name].geom_ids] for name in ("arm1", "arm2")
        ]
        nearest = min(
            mujoco.mj_geomDistance(model, data, one, other, MARGIN_M, None)
            for one in hands[0]
            for other in hands[1]
        )
        assert (close is not None) == (nearest < MARGIN_M)
        if close is not None:
            assert {close.first.partition("/")[0], close.second.partition("/")[0]} == {
                "arm1",
                "arm2",
            }
            missed += contact is None
    assert missed > 0
