"""A long way that is said to be clear is: MuJoCo finds nothing on it, however closely it looks."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from bt_dualarm.collision.checker import CollisionChecker, interpolated
from bt_dualarm.collision.swept import is_clear
from bt_dualarm.core.pose import Matrix
from bt_dualarm.robots.robot_description import load_robot
from tests.collision.cluttered import anywhere, checker_in
from tests.families import some
from tests.sim.worlds import WIDE

SPAN_M = 1e-3
"""Most that the arm moves between two looks of the judge."""


def free_everywhere(checker: CollisionChecker, corners: Matrix) -> bool:
    pieces = (interpolated(a, b, checker.radii, SPAN_M) for a, b in itertools.pairwise(corners))
    return all(checker.free(q) for rows in pieces for q in rows)


@pytest.mark.parametrize("robot", some((*WIDE[1:], WIDE[0]), 2))
def test_what_is_clear_is_free_at_every_millimeter(robot: str) -> None:
    """Among shapes of every kind; and most of what is free is found to be clear."""
    rng = np.random.default_rng(4)
    clear = 0
    free = 0
    for seed in range(2):
        checker = checker_in(robot, seed)
        limits = load_robot(robot).limits
        for _ in range(25):
            corners = anywhere(limits, rng) + np.cumsum(
                rng.normal(0.0, 0.4, (4, checker.present.size)), axis=0
            )
            if not all(checker.free(q) for q in corners):
                continue
            strict = checker.without_new_contacts(corners[[0, -1]])
            said = is_clear(strict, corners)
            if said is not None or free < 4:
                true = free_everywhere(strict, corners)
                assert said is None or said == true
                free += true
                clear += said is True
    assert clear > 0
    assert clear > 0.5 * free


def test_a_short_way_is_left_to_mujoco() -> None:
    """Whatever there is on it: to gather the shapes would take longer."""
    checker = checker_in("ur5", 0)
    assert is_clear(checker, np.array((checker.present, checker.present))) is None
