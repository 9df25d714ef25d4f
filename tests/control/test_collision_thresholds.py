"""Thresholds of the collision detector, compared with a reference in NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.control.collision_detection import CollisionDetector
from bt_dualarm.control.kernel_rows import (
    DELAY,
    DEVIATIONS,
    MAX_SAMPLES,
    MIN_DEVIATION,
    MODEL_ERROR,
    REVERSAL_PERIODS,
    REVERSAL_SPEED,
    SPAN,
    VARIANCE,
)
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.robots.robot_description import load_robot
from bt_dualarm.trajectory.set_points import Flags, SetPoint

FRICTION = load_robot("panda").friction
DOF = len(FRICTION.coulomb)


class Reference:
    """The same detector, computed from its whole history."""

    def __init__(self) -> None:
        self.torques: list[Vector] = []
        self.inertial: list[Vector] = []
        self.still: list[Flags] = []
        self.variance = np.full(DOF, 1.2**2)
        self.measured = np.full(DOF, 10.0)

    def take(self, inertia: Matrix, sent: SetPoint, torque: Vector) -> tuple[Vector, Vector]:
        """Change and threshold of a period, N m; zeros in the first periods."""
        self.torques.append(torque)
        self.inertial.append(inertia @ sent.a)
        self.still.append(np.abs(sent.v) < REVERSAL_SPEED)
        if len(self.torques) <= SPAN:
            return np.zeros(DOF), np.zeros(DOF)
        change = torque - self.torques[-1 - SPAN]
        commanded = np.abs(np.diff(self.inertial[-1 - SPAN - DELAY :], axis=0)).sum(axis=0)
        turns = np.any(self.still[-REVERSAL_PERIODS:], axis=0)
        turns |= len(self.still) < REVERSAL_PERIODS  # it was at rest before
        dry = 2.0 * np.maximum(FRICTION.static, FRICTION.coulomb)
        allowed = MODEL_ERROR * commanded + turns * dry
        lever = np.linalg.norm(inertia, axis=1)
        deviation = lever * np.sqrt(self.variance)
        if (len(self.torques) - SPAN) % SPAN == 0:
            self.learn(np.square(change / lever), ~turns & (allowed <= deviation))
        return change, allowed + DEVIATIONS * deviation

    def learn(self, square: Vector, counts: Flags) -> None:
        """Updates the running mean of squares of joints that count."""
        self.measured = np.minimum(self.measured + counts, MAX_SAMPLES)
        usual = np.minimum(square, 25.0 * self.variance)
        step = counts * (usual - self.variance) / self.measured
        self.variance = np.maximum(self.variance + step, MIN_DEVIATION**2)


def test_thresholds_agree_with_the_reference() -> None:
    """The arm swings, is accelerated at times, and is hit once."""
    rng = np.random.default_rng(3)
    reference = Reference()
    detector = CollisionDetector(FRICTION, 1.0)
    mixed = rng.normal(size=(DOF, DOF))
    inertia = mixed @ mixed.T + np.eye(DOF)
    detections = []
    for period in range(400):
        swing = np.sin(0.02 * period + np.arange(DOF))
        a = 0.2 * rng.normal(size=DOF) * (period % 50 < 5)
        torque = 0.1 * inertia @ rng.normal(size=DOF) + 500.0 * (period == 300)
        sent = SetPoint(np.zeros(DOF), swing, a)
        detected = detector.update(inertia, sent, torque)
        change, threshold = reference.take(inertia, sent, torque)
        assert detector.change == pytest.approx(change)
        assert detector.threshold == pytest.approx(threshold)
        assert detected == bool((np.abs(change) > threshold).any())
        detections += [period] * detected
    assert detections[0] == 300
    assert reference.variance == pytest.approx(detector._state[0][VARIANCE])  # it was learned
    assert (reference.measured > 11.0).all()
