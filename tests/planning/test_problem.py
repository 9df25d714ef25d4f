from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from bt_dualarm.collision.checker import CollisionChecker, interpolated
from bt_dualarm.collision.swept import SampledEdges
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Vector
from bt_dualarm.planning.path_search import PLANNERS, ArmChecks, Budget, OmplSearch, Planner
from bt_dualarm.planning.problem import (
    PlanningProblem,
    admitted,
    is_free,
    motion_around,
    path_around,
    refuse_contact,
    rounded,
    straight_motion,
)
from bt_dualarm.sim.world import World
from bt_dualarm.spec.document import ObjectSpec
from bt_dualarm.spec.values import PoseSpec
from bt_dualarm.trajectory.trajectory import use_of_limits
from tests.control.walls import ABOVE, LEFT, RIGHT, locked_world, problem_in, walled_world
from tests.sim.worlds import arm, file_of

IN_THE_WALL = np.deg2rad((0.0, -60.0, 90.0, -120.0, -90.0, 0.0))


@pytest.fixture(scope="module")
def world() -> World:
    return walled_world()


@pytest.fixture
def checker(world: World) -> CollisionChecker:
    return CollisionChecker(world, "arm1")


def test_a_free_path_is_straight(world: World) -> None:
    motion = straight_motion(problem_in(world, RIGHT, ABOVE))
    assert motion is not None
    direction = (ABOVE - RIGHT) / np.linalg.norm(ABOVE - RIGHT)
    deviations = motion.q - RIGHT
    assert np.abs(deviations - np.outer(deviations @ direction, direction)).max() < 1e-12
    np.testing.assert_array_equal(motion.q[-1], ABOVE)


def test_no_path_leads_through_a_thin_wall(world: World, checker: CollisionChecker) -> None:
    """A wall of 10 mm is not stepped through, on any line between corners."""
    problem = problem_in(world, RIGHT, LEFT)
    assert straight_motion(problem) is None
    corners = path_around(problem).corners
    assert len(corners) > 2
    np.testing.assert_allclose(corners[[0, -1]], [RIGHT, LEFT], atol=1e-12)
    for before, after in itertools.pairwise(corners):
        fine = interpolated(before, after, checker.radii, 0.001)
        assert checker.first_contact(fine) is None
    assert np.all(corners >= problem.limits.lower)
    assert np.all(corners <= problem.limits.upper)


def test_a_seed_determines_the_path(world: World) -> None:
    problem = problem_in(world, RIGHT, LEFT, seed=3)
    first = path_around(problem).corners
    path_around(problem_in(world, LEFT, RIGHT, seed=4))
    np.testing.assert_array_equal(path_around(problem).corners, first)
    other = path_around(problem_in(world, RIGHT, LEFT, seed=4)).corners
    assert other.shape != first.shape or not np.allclose(other, first)


@pytest.mark.parametrize("planner", PLANNERS)
def test_every_planner_finds_a_path_and_repeats_it(planner: Planner) -> None:
    """Planners that optimize use all their checks, so they get few."""
    problem = problem_in(walled_world(), RIGHT, LEFT, planner=planner, checks=4000)
    corners = path_around(problem).corners
    assert is_free(problem.checker, corners)
    np.testing.assert_array_equal(path_around(problem).corners, corners)


def test_a_search_that_has_ended_does_not_go_on() -> None:
    """A search in which no more states are checked is over, even if more follow; the next can run.

    AORRTC loops forever once it has a straight path to one of several goals.
    """
    budget = Budget(lambda: False)
    budget.limit = 100_000
    budget.count_checks(1)
    assert not budget.is_over()
    assert any(budget.is_over() for _ in range(10_000))
    budget.count_checks(1)
    assert budget.is_over()
    assert not budget.is_spent()
    budget.begin()
    assert not budget.is_over()


def rounds_of(problem: PlanningProblem) -> int:
    """Rounds of its planner, in steps of 16, until it has a free path."""
    polls = itertools.count()
    corners = path_around(problem, lambda: next(polls) < 0).corners
    assert is_free(problem.checker, corners)
    return 16 * next(polls)


@pytest.mark.parametrize("planner", PLANNERS)
def test_a_search_for_one_of_several_goals_ends(planner: Planner) -> None:
    """No path leads to the first one; the straight path to the second one is free."""
    near = RIGHT + np.array((-0.2, 0.0, 0.0, 0.0, 0.3, 0.0))
    problem = problem_in(locked_world(), RIGHT, LEFT, near, planner=planner, checks=4000)
    assert rounds_of(problem) <= 10_000


@pytest.mark.parametrize("goals", [(LEFT,), (LEFT, ABOVE)])
def test_rounds_with_few_checks_end_a_search_too(goals: tuple[Vector, ...]) -> None:
    """The first search has a tenth of all checks; BITstar's round counts for four."""
    problem = problem_in(walled_world(), RIGHT, *goals, planner="BITstar", checks=160_000)
    assert rounds_of(problem) <= 4000


def test_goals_in_collision_are_left_out(world: World) -> None:
    problem = admitted(problem_in(world, RIGHT, IN_THE_WALL, LEFT))
    np.testing.assert_array_equal(problem.goals, [LEFT])


@pytest.mark.parametrize("planner", PLANNERS)
def test_a_search_with_all_goals_in_collision_does_not_begin(
    world: World, planner: Planner
) -> None:
    """OMPL would wait for goals to become free, 10 ms in each round: a minute in total."""
    problem = problem_in(world, RIGHT, IN_THE_WALL, planner=planner)
    polls = itertools.count()
    budget = Budget(lambda: next(polls) < 0)
    arm = ArmChecks(problem.checker, SampledEdges(problem.checker), problem.limits, budget)
    budget.limit = 1000
    assert OmplSearch(arm, problem.start, problem.goals, 1).run(planner, 0.1) is None
    assert next(polls) == 0


def test_the_reachable_one_of_several_goals_is_reached() -> None:
    """No path leads to the first one; the straight path to the second one is free."""
    near = RIGHT + np.array((-0.2, 0.0, 0.0, 0.0, 0.3, 0.0))
    corners = path_around(problem_in(locked_world(), RIGHT, LEFT, near, checks=3000)).corners
    np.testing.assert_allclose(corners, [RIGHT, near], atol=1e-12)


def test_a_joint_rotates_the_other_way_around_if_the_nearer_way_is_blocked() -> None:
    """Past the wall there is no way below the roof, but one around the back of the arm."""
    boxes: dict[str, Any] = {
        "roof": {"size": (3.0, 3.0, 0.01), "pose": PoseSpec(xyz=(0, 0, 0.7))},
        "wall": {"size": (2.0, 0.01, 0.69), "pose": PoseSpec(xyz=(1.24, 0, 0.345))},
    }
    objects = {name: ObjectSpec(shape="box", fixed=True, **one) for name, one in boxes.items()}
    world = World(file_of({"arm1": arm("ur5", (0.0, 0.0, 0.0))}, objects))
    limits = world.arms["arm1"].robot.limits
    # So that the arm cannot fold to pass the wall: shoulder, elbow and wrist keep their branch.
    limits = replace(
        limits,
        lower=np.array((-2 * np.pi, -2.0, 1.2, -2 * np.pi, -3.1, -2 * np.pi)),
        upper=np.array((2 * np.pi, 0.3, 2.1, 2 * np.pi, -0.05, 2 * np.pi)),
    )
    start, goal = np.deg2rad(((-41, -94, 113, -109, -90, 0), (12, -94, 113, -109, -90, 0)))
    blocked = admitted(problem_in(world, start, goal, limits=limits, checks=20_000))
    with pytest.raises(Failure) as caught:
        motion_around(blocked)
    assert caught.value.code == "NO_PLAN"
    turned = goal - np.array((2 * np.pi, 0, 0, 0, 0, 0))
    motion = motion_around(replace(blocked, turned=(turned,)))
    np.testing.assert_allclose(motion.end, turned, atol=1e-12)
    refuse_contact(blocked.checker, motion)


def test_a_motion_to_the_goal_itself_does_not_depend_on_turned_goals(world: World) -> None:
    problem = admitted(problem_in(world, RIGHT, LEFT))
    turned = (LEFT - np.array((2 * np.pi, 0, 0, 0, 0, 0)), RIGHT)
    one, other = (motion_around(replace(problem, turned=those)) for those in ((), turned))
    np.testing.assert_array_equal(one.q, other.q)


@pytest.mark.parametrize("swapped", [False, True])
def test_a_start_or_goal_in_collision_is_refused(world: World, swapped: bool) -> None:
    start, goal = (IN_THE_WALL, RIGHT) if swapped else (RIGHT, IN_THE_WALL)
    with pytest.raises(Failure) as caught:
        admitted(problem_in(world, start, goal))
    assert caught.value.code == "IN_COLLISION"
    assert caught.value.numbers["second"] == "wall"


def test_a_goal_beyond_a_limit_is_refused_with_the_joint_s_name(world: World) -> None:
    beyond = LEFT.copy()
    beyond[2] = 4.0
    with pytest.raises(Failure, match="elbow_joint") as caught:
        admitted(problem_in(world, RIGHT, beyond))
    assert caught.value.code == "JOINT_LIMIT"


def test_a_failed_search_reports_planner_and_checks() -> None:
    problem = problem_in(locked_world(), RIGHT, LEFT, planner="RRT", checks=2000)
    with pytest.raises(Failure) as caught:
        path_around(problem)
    assert caught.value.code == "NO_PLAN"
    assert caught.value.numbers["planner"] == "RRT"
    assert 2000 <= int(caught.value.numbers["states"]) < 2100


def test_an_abandoned_search_ends_early() -> None:
    polls: Iterator[int] = itertools.count()
    with pytest.raises(Failure) as caught:
        path_around(problem_in(locked_world(), RIGHT, LEFT), lambda: next(polls) > 2)
    assert caught.value.code == "INTERRUPTED"
    assert next(polls) == 4  # the poll that says so, the fourth, is the last


def test_the_motion_around_a_wall_is_within_limits_and_collision_free(
    world: World, checker: CollisionChecker
) -> None:
    slower = world.arms["arm1"].robot.limits.scaled(0.5)
    motion = motion_around(problem_in(world, RIGHT, LEFT, limits=slower))
    assert use_of_limits(motion, slower).within
    assert checker.first_contact(motion.q) is None
    np.testing.assert_allclose(motion.q[[0, -1]], [RIGHT, LEFT], atol=1e-9)


def test_corners_are_rounded_without_collision(world: World, checker: CollisionChecker) -> None:
    corners = path_around(problem_in(world, RIGHT, LEFT)).corners
    pieces = rounded(corners, checker.radii, lambda rows: is_free(checker, rows))
    np.testing.assert_array_equal(pieces[0][0], corners[0])
    np.testing.assert_array_equal(pieces[-1][-1], corners[-1])
    for piece in pieces:
        assert checker.first_contact(piece) is None
    for one, two in itertools.pairwise(pieces):
        np.testing.assert_array_equal(one[-1], two[0])


def test_a_motion_through_a_wall_is_refused(checker: CollisionChecker) -> None:
    rows = np.linspace(RIGHT, LEFT, 2000)
    with pytest.raises(Failure, match="wall"):
        refuse_contact(checker, rows)


def test_a_motion_must_not_end_in_self_contact() -> None:
    """Even the depth that is tolerated for a held object is refused; moving away is allowed."""
    world = World(file_of({"arm1": arm("ur5", (0.0, 0.0, 1.0))}))
    checker = CollisionChecker(world, "arm1")
    free, folded = np.deg2rad(
        ((0.0, -90.0, 90.0, 0.0, 90.0, 0.0), (0.0, -90.0, 175.0, 0.0, 90.0, 0.0))
    )
    for _ in range(40):  # until only a tolerated contact is left
        middle = (free + folded) / 2
        free, folded = (free, middle) if checker.contact(middle) else (middle, folded)
    folded = free
    rows = interpolated(np.deg2rad((0.0, -90.0, 90.0, 0.0, 90.0, 0.0)), folded, checker.radii, 0.01)
    assert checker.contact(folded) is None
    with pytest.raises(Failure, match="IN_COLLISION: arm1/"):
        refuse_contact(checker, rows)
    refuse_contact(checker, rows[::-1])
