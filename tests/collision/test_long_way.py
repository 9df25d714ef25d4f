"""A long path that the swept check calls clear is free by MuJoCo at every millimeter."""

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
"""Largest motion of the arm between two of MuJoCo's checks, m."""


def free_everywhere(checker: CollisionChecker, corners: Matrix) -> bool:
    pieces = (interpolated(a, b, checker.radii, SPAN_M) for a, b in itertools.pairwise(corners))
    return all(checker.free(q) for rows in pieces for q in rows)


@pytest.mark.parametrize("robot", some((*WIDE[1:], WIDE[0]), 2))
def test_clear_path_is_free_at_every_millimeter(robot: str) -> None:
    """Also, most free paths among objects of all shapes are found to be clear."""
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
            verdict = is_clear(strict, corners)
            if verdict is not None or free < 4:
                true = free_everywhere(strict, corners)
                assert verdict is None or verdict == true
                free += true
                clear += verdict is True
    assert clear > 0
    assert clear > 0.5 * free


def test_short_path_is_left_to_mujoco() -> None:
    """Gathering the shapes would take longer than MuJoCo's check."""
    checker = checker_in("ur5", 0)
    assert is_clear(checker, np.array((checker.present, checker.present))) is None
