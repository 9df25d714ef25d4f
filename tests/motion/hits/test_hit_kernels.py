"""The thresholds of hits, worked out for all joints at once by what the class says of them."""

from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.motion.hits.collision_watch import CollisionWatch
from bt_dualarm.motion.hits.kernel_rows import (
    DEVIATIONS,
    LATE,
    LEAST_DEVIATION,
    MODEL_SHARE,
    MOST_MEASURED,
    SPAN,
    TURN_PERIODS,
    TURN_SPEED,
    VARIANCE,
)
from bt_dualarm.motion.setpoints.set_point import SetPoint
from bt_dualarm.motion.setpoints.stopping_distance import Flags
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.robots.catalogue import load_robot

FRICTION = load_robot("panda").friction
DOF = len(FRICTION.coulomb)


class Told:
    """The same watch, of all that was ever told it."""

    def __init__(self) -> None:
        self.torques: list[Vector] = []
        self.asked: list[Vector] = []
        self.still: list[Flags] = []
        self.variance, self.measured = np.full(DOF, 1.2**2), np.full(DOF, 10.0)

    def take(self, inertia: Matrix, sent: SetPoint, torque: Vector) -> tuple[Vector, Vector]:
        """Change and threshold of a period; zeros while it is too early."""
        self.torques.append(torque)
        self.asked.append(inertia @ sent.a)
        self.still.append(np.abs(sent.v) < TURN_SPEED)
        if len(self.torques) <= SPAN:
            return np.zeros(DOF), np.zeros(DOF)
        change = torque - self.torques[-1 - SPAN]
        meant = np.abs(np.diff(self.asked[-1 - SPAN - LATE :], axis=0)).sum(axis=0)
        turns = np.any(self.still[-TURN_PERIODS:], axis=0)
        turns |= len(self.still) < TURN_PERIODS  # it stood before
        dry = 2.0 * np.maximum(FRICTION.static, FRICTION.coulomb)
        allowed, lever = MODEL_SHARE * meant + turns * dry, np.linalg.norm(inertia, axis=1)
        deviation = lever * np.sqrt(self.variance)
        if (len(self.torques) - SPAN) % SPAN == 0:
            self.learn(np.square(change / lever), ~turns & (allowed <= deviation))
        return change, allowed + DEVIATIONS * deviation

    def learn(self, square: Vector, counts: Flags) -> None:
        """Running mean of squares, of joints that count."""
        self.measured = np.minimum(self.measured + counts, MOST_MEASURED)
        usual = np.minimum(square, 25.0 * self.variance)
        step = counts * (usual - self.variance) / self.measured
        self.variance = np.maximum(self.variance + step, LEAST_DEVIATION**2)


def test_thresholds_are_what_is_said_of_them() -> None:
    """Of an arm that turns to and fro, is accelerated now and then, and is hit once."""
    rng, told, watch = np.random.default_rng(3), Told(), CollisionWatch(FRICTION, 1.0)
    mixed = rng.normal(size=(DOF, DOF))
    inertia, hits = mixed @ mixed.T + np.eye(DOF), []
    for period in range(400):
        swing = np.sin(0.02 * period + np.arange(DOF))
        a = 0.2 * rng.normal(size=DOF) * (period % 50 < 5)
        torque = 0.1 * inertia @ rng.normal(size=DOF) + 500.0 * (period == 300)
        sent = SetPoint(np.zeros(DOF), swing, a)
        was_hit = watch.take(inertia, sent, torque)
        change, threshold = told.take(inertia, sent, torque)
        assert watch.change == pytest.approx(change)
        assert watch.threshold == pytest.approx(threshold)
        assert was_hit == bool((np.abs(change) > threshold).any())
        hits += [period] * was_hit
    assert hits[0] == 300
    assert told.variance == pytest.approx(watch._known[0][VARIANCE])  # it was learnt at all
    assert (told.measured > 11.0).all()
