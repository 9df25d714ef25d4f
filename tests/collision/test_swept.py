"""Configurations and edges that the compiled checks call free are free by MuJoCo."""

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
"""Largest motion of the arm between two of MuJoCo's checks, m."""


@pytest.mark.parametrize("robot", WIDE)
def test_compiled_check_of_configurations_agrees_with_mujoco(robot: str) -> None:
    """No configuration with a contact is free; the reverse fails only for very near ones."""
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
            )  # far enough from the ends that the whole clearance applies
            free = is_path_free(edges, near)
            true = checker.free(q)
            assert true or not free
            tried += true
            alarms += true and not free
    assert tried > 60
    assert alarms < 0.2 * tried


@pytest.mark.parametrize("robot", some((*WIDE[1:], WIDE[0]), 2))
def test_free_share_of_an_edge_is_free_at_every_millimeter(robot: str) -> None:
    """Edges agree with dense paths of many configurations on them."""
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
def test_arm_that_starts_in_contact_can_leave(robot: str) -> None:
    """It may touch objects that it touches at the start, and no deeper than there."""
    rng = np.random.default_rng(3)
    away = 0
    limits = load_robot(robot).limits
    for seed in range(3):
        checker = checker_in(robot, seed)
        for _ in range(8):
            start = _in_contact(checker, limits, rng)
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


def _in_contact(checker: CollisionChecker, limits: JointLimits, rng: np.random.Generator) -> Vector:
    """A configuration with a contact that is slightly less deep than allowed."""
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
