from __future__ import annotations

import itertools

import numpy as np
import pytest

from bt_dualarm.errors import Failure
from bt_dualarm.motion.collision import CollisionChecker
from bt_dualarm.motion.joint_motion import free_motion, refuse_contact
from bt_dualarm.motion.planning import is_free, plan
from bt_dualarm.motion.rounding import rounded
from bt_dualarm.motion.sweep import interpolated, sweep_radii
from bt_dualarm.motion.trajectory import use_of_limits
from bt_dualarm.spec.document import ObjectSpec
from bt_dualarm.spec.values import PoseSpec
from bt_dualarm.world.catalogue import JointLimits
from bt_dualarm.world.world import World
from tests.world.worlds import arm, file_of

DT = 0.002


def walled_world(thickness: float = 0.01) -> World:
    """A UR5 and a wall beside it, through which its straight way to the other side leads."""
    wall = ObjectSpec(
        shape="box",
        size=(1.0, thickness, 0.9),
        mass=1.0,
        fixed=True,
        pose=PoseSpec(xyz=(0.8, 0.0, 0.45)),
    )
    return World(file_of({"arm1": arm("ur5")}, {"wall": wall}))


@pytest.fixture(scope="module")
def world() -> World:
    return walled_world()


@pytest.fixture
def checker(world: World) -> CollisionChecker:
    return CollisionChecker(world, "arm1")


@pytest.fixture
def limits(world: World) -> JointLimits:
    return world.arms["arm1"].robot.limits


RIGHT = np.deg2rad((-50.0, -60.0, 90.0, -120.0, -90.0, 0.0))
LEFT = np.deg2rad((50.0, -60.0, 90.0, -120.0, -90.0, 0.0))
ABOVE = np.deg2rad((-50.0, -120.0, 60.0, -30.0, -90.0, 0.0))


def test_a_way_that_is_free_is_straight(checker: CollisionChecker, limits: JointLimits) -> None:
    way = plan(checker, RIGHT, ABOVE, limits)
    np.testing.assert_array_equal(way, [RIGHT, ABOVE])


def test_no_way_leads_through_a_thin_wall(checker: CollisionChecker, limits: JointLimits) -> None:
    """A wall of 10 mm is not stepped through, on any line between corners."""
    radii = sweep_radii(checker)
    assert not is_free(checker, np.array((RIGHT, LEFT)), radii)
    corners = plan(checker, RIGHT, LEFT, limits)
    assert len(corners) > 2
    np.testing.assert_allclose(corners[[0, -1]], [RIGHT, LEFT], atol=1e-12)
    for before, after in itertools.pairwise(corners):
        fine = interpolated(before, after, radii, 0.001)
        assert checker.first_contact(fine) is None
    assert np.all(corners >= limits.lower)
    assert np.all(corners <= limits.upper)


def test_one_seed_gives_one_way(checker: CollisionChecker, limits: JointLimits) -> None:
    first = plan(checker, RIGHT, LEFT, limits, seed=3)
    plan(checker, LEFT, RIGHT, limits, seed=4)
    np.testing.assert_array_equal(plan(checker, RIGHT, LEFT, limits, seed=3), first)


@pytest.mark.parametrize("swapped", [False, True])
def test_ends_that_touch_are_refused(
    checker: CollisionChecker, limits: JointLimits, swapped: bool
) -> None:
    rows = np.linspace(RIGHT, LEFT, 200)
    found = checker.first_contact(rows)
    assert found is not None
    touching = rows[found[0] + 1]
    start, goal = (touching, RIGHT) if swapped else (RIGHT, touching)
    with pytest.raises(Failure) as caught:
        plan(checker, start, goal, limits)
    assert caught.value.code == "IN_COLLISION"
    assert caught.value.numbers["second"] == "wall"


def test_an_end_beyond_a_limit_is_refused_by_the_joint_s_name(
    checker: CollisionChecker, limits: JointLimits
) -> None:
    beyond = LEFT.copy()
    beyond[2] = 4.0
    with pytest.raises(Failure, match="elbow_joint") as caught:
        plan(checker, RIGHT, beyond, limits)
    assert caught.value.code == "JOINT_LIMIT"


def test_the_motion_around_a_wall_keeps_the_limits_and_touches_nothing(
    checker: CollisionChecker, limits: JointLimits
) -> None:
    slower = limits.scaled(0.5)
    motion = free_motion(checker, RIGHT, LEFT, slower, DT)
    assert use_of_limits(motion, slower).within
    assert checker.first_contact(motion.q) is None
    np.testing.assert_allclose(motion.q[[0, -1]], [RIGHT, LEFT], atol=1e-9)


def test_where_nothing_is_in_the_way_the_motion_is_straight(
    checker: CollisionChecker, limits: JointLimits
) -> None:
    motion = free_motion(checker, RIGHT, ABOVE, limits, DT)
    way = (ABOVE - RIGHT) / np.linalg.norm(ABOVE - RIGHT)
    off = motion.q - RIGHT
    assert np.abs(off - np.outer(off @ way, way)).max() < 1e-12


def test_corners_are_rounded_without_touching(
    checker: CollisionChecker, limits: JointLimits
) -> None:
    radii = sweep_radii(checker)
    corners = plan(checker, RIGHT, LEFT, limits)
    pieces = rounded(corners, checker, radii)
    np.testing.assert_array_equal(pieces[0][0], corners[0])
    np.testing.assert_array_equal(pieces[-1][-1], corners[-1])
    for piece in pieces:
        assert checker.first_contact(piece) is None
    for one, two in itertools.pairwise(pieces):
        np.testing.assert_array_equal(one[-1], two[0])


def test_a_motion_through_a_wall_is_refused(checker: CollisionChecker) -> None:
    rows = np.linspace(RIGHT, LEFT, 2000)
    with pytest.raises(Failure, match="wall"):
        refuse_contact(checker, rows, sweep_radii(checker))
