"""What the compiled search takes for free is free: MuJoCo says so wherever one looks."""

from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.collision.checker import CollisionChecker, interpolated
from bt_dualarm.collision.swept import CompiledEdges, is_path_free, swept_arm
from bt_dualarm.collision.swept_kernels import WHOLE, first_too_near, free_share
from bt_dualarm.core.pose import Vector
from bt_dualarm.robots.robot import JointLimits
from bt_dualarm.robots.robot_description import load_robot
from tests.collision.cluttered import anywhere, checker_in
from tests.families import some
from tests.sim.worlds import WIDE

SPAN_M = 1e-3
"""Most that the arm moves between two looks of the judge."""


@pytest.mark.parametrize("robot", WIDE)
def test_configurations_are_judged_as_mujoco_does(robot: str) -> None:
    """Nothing that touches is free; what is free is taken for it, but for what is very near."""
    rng = np.random.default_rng(1)
    tried = 0
    alarms = 0
    for seed in range(3):
        checker = checker_in(robot, seed)
        limits = load_robot(robot).limits
        edges = CompiledEdges(swept_arm(checker))
        for _ in range(150):
            q = anywhere(limits, rng)
            near = np.array(
                (q, q + 0.02, q)
            )  # so far from the ends that the whole clearance is kept
            free = is_path_free(edges, near)
            theirs = checker.free(q)
            assert theirs or not free
            tried += theirs
            alarms += theirs and not free
    assert tried > 60
    assert alarms < 0.2 * tried


@pytest.mark.parametrize("robot", some((*WIDE[1:], WIDE[0]), 2))
def test_a_way_that_is_free_is_free_at_every_millimeter(robot: str) -> None:
    """So is the share of it that is said to be free; and the same by many configurations on it."""
    rng = np.random.default_rng(2)
    whole = 0
    parts = 0
    for seed in range(3):
        checker = checker_in(robot, seed)
        arm = swept_arm(checker)
        radii = checker.radii
        hints = arm.pairs.directions.copy()
        spent = np.zeros(1, np.int64)
        for _ in range(20):
            start = anywhere(load_robot(robot).limits, rng)
            if not checker.free(start):
                continue
            end = start + rng.normal(0.0, 0.6, len(start))
            share = free_share(arm, start, end, 0.1, hints, spent)
            rows = interpolated(start, start + share * (end - start), radii, SPAN_M)
            assert all(checker.free(q) for q in rows)
            whole = whole + (share == 1.0)
            parts = parts + (0.0 < share < 1.0)
            assert (free_share(arm, start, end, WHOLE, hints, spent) == 1.0) == (share == 1.0)
            if share == 1.0:
                assert first_too_near(arm, rows, radii, hints, spent) == len(rows)
    assert whole > 2
    assert parts > 2


@pytest.mark.parametrize("robot", some(WIDE, 2))
def test_an_arm_that_stands_in_touch_gets_away(robot: str) -> None:
    """Where it may touch something, it may go on to do so as deep as that, and no deeper."""
    rng = np.random.default_rng(3)
    away = 0
    limits = load_robot(robot).limits
    for seed in range(3):
        checker = checker_in(robot, seed)
        for _ in range(8):
            start = _in_touch(checker, limits, rng)
            strict = checker.without_new_contacts((start,))
            arm = swept_arm(strict, (start,))
            radii = checker.radii
            assert (arm.pairs.least < 0.0).any()
            hints = arm.pairs.directions.copy()
            spent = np.zeros(1, np.int64)
            for _ in range(12):
                end = start + rng.normal(0.0, 0.3, len(start))
                if free_share(arm, start, end, WHOLE, hints, spent) == 1.0:
                    away += 1
                    rows = interpolated(start, end, radii, SPAN_M)
                    assert all(strict.free(q) for q in rows)
    assert away > 24


def _in_touch(checker: CollisionChecker, limits: JointLimits, rng: np.random.Generator) -> Vector:
    """A configuration in which the arm is in something by a little less than it may be."""
    while True:
        inside = anywhere(limits, rng)
        outside = anywhere(limits, rng)
        if checker.free(inside) or not checker.free(outside):
            continue
        for _ in range(50):
            middle = 0.5 * (inside + outside)
            free = checker.free(middle)
            inside, outside = (inside, middle) if free else (middle, outside)
        checker.place(outside)
        if (checker.data.contact.dist < 0.0).any():
            return outside
