"""Boxes of two hands that are too close are found even where MuJoCo reports no contact."""

from __future__ import annotations

import mujoco
import numpy as np

from bt_dualarm.collision.checker import CollisionChecker, Contact
from bt_dualarm.collision.group import GroupChecker
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.sim.world import World
from bt_dualarm.spec.document import ObjectSpec
from bt_dualarm.spec.values import PoseSpec
from tests.sim.worlds import arm, file_of

MARGIN_M = 0.045
_ROUNDING_M = 1e-15  # two ways to compute the same distance; depends on the processor
BALL = PoseSpec(xyz=(0.0, 0.6, 0.02))


def two_hands() -> World:
    """Two arms whose hands can meet, and a ball that either may hold."""
    first = arm("panda", gripper="robotiq_2f85")
    second = arm("panda", (0.9, 0.0, 0.4), 180.0, gripper="robotiq_2f85")
    ball = ObjectSpec(shape="sphere", size=(0.02,), mass=0.05, pose=BALL)
    return World(file_of({"arm1": first, "arm2": second}, {"ball": ball}))


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


def nearest_boxes(model: mujoco.MjModel, data: mujoco.MjData, world: World) -> float:
    """Smallest distance of two boxes of both arms, at most `MARGIN_M`, m, by brute force."""
    boxes = np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_BOX)
    first, second = (
        [one for one in boxes if one in world.arms[name].geom_ids] for name in ("arm1", "arm2")
    )
    distances = [
        float(mujoco.mj_geomDistance(model, data, one, other, MARGIN_M, None))
        for one in first
        for other in second
    ]
    return min(distances)


def names_both_arms(contact: Contact) -> bool:
    """Whether a contact is one between the arms."""
    return {one.partition("/")[0] for one in (contact.first, contact.second)} == {"arm1", "arm2"}


def test_close_boxes_are_found_where_no_contact_is_reported() -> None:
    """Boxes nearer than the margin are never free; contacts miss some of them."""
    world = two_hands()
    checker = CollisionChecker(world, "arm1", MARGIN_M)
    missed = apart = 0
    for q in beside(world, 60):
        contact = checker.contact(q)
        nearest = nearest_boxes(checker.model, checker.data, world)
        assert checker.free(q) == (contact is None)
        if nearest >= MARGIN_M:
            apart += contact is None
            continue
        assert contact is not None
        assert -contact.depth <= nearest + _ROUNDING_M
        assert names_both_arms(contact)
        found = checker.data.contact
        missed += not (found.dist < checker.least[found.geom[:, 0], found.geom[:, 1]]).any()
    assert missed > 0
    assert apart > 0


def test_arms_that_carry_together_keep_their_boxes_from_others() -> None:
    """A group of arms keeps its margin from the hand of an arm outside it."""
    world = two_hands()
    grasp = {"arm1": Pose.from_rpy((0.0, 0.0, 0.0))}
    group = GroupChecker(world, {"arm1": slice(0, 7)}, "ball", grasp, MARGIN_M, {"arm1": 0.04})
    checker = CollisionChecker(world, "arm1")
    checker.open_fingers(0.04)
    near = 0
    for q in beside(world, 60):
        checker.place(q)
        if nearest_boxes(checker.model, checker.data, world) < MARGIN_M:
            near += 1
            contact = group.contact(q)
            assert contact is not None
    assert near > 0
