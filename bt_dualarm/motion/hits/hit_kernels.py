"""Torques held against thresholds that grow with what they may be without a hit: one call."""

from __future__ import annotations

import math

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.motion.hits.kernel_rows import (
    ASKED,
    CHANGE,
    COMPARES,
    DEVIATIONS,
    FIRST,
    JUDGES,
    LEARNS,
    LEAST_DEVIATION,
    MEASURED,
    MODEL_SHARE,
    MOST_MEASURED,
    MOVES,
    SINCE_TURN,
    THRESHOLD,
    TURN_PERIODS,
    TURN_SPEED,
    TURNING,
    VARIANCE,
    WAS_HIT,
)
from bt_dualarm.pose import Matrix, Vector


@kernel
def compare(
    inertia: Matrix,
    sent: Matrix,
    torque: Vector,
    factor: float,
    how: int,
    joints: Matrix,
    torques: Matrix,
    changes: Matrix,
) -> int:
    """Take up a period.

    Args:
        inertia: Inertia matrix of now, of shape (dof, dof), kg m².
        sent: Velocities and accelerations that are meant, of shape (2, dof), rad/s, rad/s².
        torque: Torques that nobody has asked for, of shape (dof,), N m.
        factor: Factor of all thresholds.
        how: Bits: `FIRST`, `COMPARES`, `JUDGES`, `LEARNS`.
        joints: What is known of the joints, see `kernel_rows`.
        torques: Torques of this period and of those before, the newest first, of shape (n, dof).
        changes: Changes of the torques that were meant, likewise.

    Returns:
        Bits: `MOVES`, `WAS_HIT`.
    """
    outcome, v = 0, sent[0]
    for i in range(len(v)):
        _remember(inertia, sent[1], torque[i], how & FIRST != 0, joints, torques, changes, i)
        joints[SINCE_TURN, i] = 0.0 if abs(v[i]) < TURN_SPEED else joints[SINCE_TURN, i] + 1.0
        if v[i] != 0.0:
            outcome |= MOVES
        if how & COMPARES:
            joints[CHANGE, i] = torque[i] - torques[-1, i]
        if how & JUDGES and _is_hit(inertia, factor, how & LEARNS != 0, joints, changes, i):
            outcome |= WAS_HIT
    return outcome


@kernel
def _remember(
    inertia: Matrix,
    a: Vector,
    torque: float,
    is_first: bool,
    joints: Matrix,
    torques: Matrix,
    changes: Matrix,
    i: int,
) -> None:
    """Keep a joint's torques of this period, and forget the oldest."""
    asked = 0.0
    for j in range(len(a)):
        asked += inertia[i, j] * a[j]
    if is_first:
        torques[:, i], changes[:, i] = torque, 0.0
        joints[ASKED, i] = asked
    for row in range(len(torques) - 1, 0, -1):
        torques[row, i] = torques[row - 1, i]
    for row in range(len(changes) - 1, 0, -1):
        changes[row, i] = changes[row - 1, i]
    torques[0, i], changes[0, i] = torque, abs(asked - joints[ASKED, i])
    joints[ASKED, i] = asked


@kernel
def _is_hit(
    inertia: Matrix, factor: float, learns: bool, joints: Matrix, changes: Matrix, i: int
) -> bool:
    """Enter a joint's threshold; whether the change of its torque is above it."""
    allowed, square = 0.0, 0.0
    for row in range(len(changes)):
        allowed += changes[row, i]
    allowed *= MODEL_SHARE
    turns = joints[SINCE_TURN, i] < TURN_PERIODS
    if turns:
        allowed += joints[TURNING, i]
    for j in range(len(inertia)):
        square += inertia[i, j] * inertia[i, j]
    lever = math.sqrt(square)
    deviation = lever * math.sqrt(joints[VARIANCE, i])
    joints[THRESHOLD, i] = factor * (allowed + DEVIATIONS * deviation)
    size = abs(joints[CHANGE, i])
    if learns and not turns and allowed <= deviation:
        _learn(size / lever, joints, i)
    return not size <= joints[THRESHOLD, i]


@kernel
def _learn(size: float, joints: Matrix, i: int) -> None:
    """Measure the deviation, in rad/s², of a joint that turns evenly; no hit is taken for one."""
    variance = joints[VARIANCE, i]
    usual = min(size * size, 25.0 * variance)
    joints[MEASURED, i] = min(joints[MEASURED, i] + 1.0, MOST_MEASURED)
    variance += (usual - variance) / joints[MEASURED, i]
    joints[VARIANCE, i] = max(variance, LEAST_DEVIATION * LEAST_DEVIATION)
