"""Results of `benchmarks/planning.py`, on fewer problems."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np

from benchmarks.box_problems import problems
from benchmarks.planning import OVERLAP_M, is_solvable, replayed, solve, survey, table
from bt_dualarm.planning.problem import admitted
from tests.control.walls import LEFT, RIGHT, locked_world, problem_in, walled_world


def test_paths_are_found_and_are_collision_free_in_replay() -> None:
    outcomes, _ = survey(4, seed=2)
    assert all(one.solved for one in outcomes)
    assert any(not one.straight for one in outcomes)
    assert all(one.ratio >= 1.0 for one in outcomes)
    assert "100.0 %" in table(outcomes, 0)


def test_replay_detects_a_motion_through_a_thin_wall() -> None:
    """It is independent of the planner's checks: it looks for contacts in the world's physics."""
    world = walled_world()
    problem = problem_in(world, RIGHT, LEFT)
    radii = problem.checker.radii
    before = world.data.qpos.copy()
    overlap, count = replayed(world, "arm1", np.array((RIGHT, LEFT)), radii)
    assert overlap > OVERLAP_M
    assert count > 1000
    np.testing.assert_array_equal(world.data.qpos, before)


def test_an_unsolved_problem_is_reported_as_unsolved() -> None:
    world = locked_world()
    outcome = solve(world, "arm1", problem_in(world, RIGHT, LEFT, checks=100))
    assert not outcome.solved
    assert not outcome.straight
    assert outcome.replayed == 0


def test_a_problem_counts_as_solvable_only_if_a_planner_solves_it() -> None:
    locked = locked_world()
    few = replace(problem_in(locked, RIGHT, LEFT), checks=100)
    assert not is_solvable(locked, "arm1", few)
    world = walled_world()
    assert is_solvable(world, "arm1", problem_in(world, RIGHT, LEFT))


def test_problems_have_a_plate_of_10_mm_and_repeat_with_their_seed() -> None:
    first = list(itertools.islice(problems(4), 3))
    second = list(itertools.islice(problems(4), 3))
    assert [name for _, name, _ in first] == ["arm1", "arm2", "arm1"]
    for (world, _, problem), (_, _, again) in zip(first, second, strict=True):
        assert 5 <= len(world.objects) <= 10
        assert min(world.objects["box0"].size) == 0.01
        np.testing.assert_array_equal(problem.straight, again.straight)
        admitted(problem)
