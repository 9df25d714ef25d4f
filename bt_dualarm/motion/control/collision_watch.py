"""Hits: torques from outside that come faster than anything that is off in the arm's model."""

from __future__ import annotations

from typing import Final

import numpy as np

from bt_dualarm.motion.setpoints.set_point import SetPoint
from bt_dualarm.motion.setpoints.stopping_distance import Flags, every
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.robots.friction import JointFriction

SPAN: Final = 8
"""Periods over which a torque is compared with itself: a hit is there within them, and what masses
and friction are off changes little."""

LATE: Final = 16
"""Periods by which what a change of acceleration does may come later: drives and observer lag."""

DEVIATIONS: Final = 8.0
"""Standard deviations of what was measured without a hit that count as one."""

MODEL_SHARE: Final = 0.25
"""Share of the torques of a change of acceleration by which inertia and delays may be off."""

_TURN: Final = 0.04  # rad/s; slower, a joint's dry friction may change sides
_AFTER: Final = SPAN + 17  # periods that this is remembered for
_GRACE: Final = 75  # periods of motion after a grasp: what lay on something is borne now
_KEPT: Final = 100  # numbers that deviations are measured over
_FIRST: Final = 1.2  # rad/s², before anything was measured: of encoders of 17 bit; it counts as
_FIRST_COUNTS: Final = 10  # so many numbers
_LEAST: Final = 0.1  # rad/s²


class CollisionWatch:
    """Tells a hit from what is off in the model, by how fast it comes.

    The torque of the observer's disturbance is everything that the nominal arm does not explain. Of
    each joint its change over ``SPAN`` periods is held against a threshold that has three parts:

    - deviations of this very number as measured on this arm so far. It is the encoders' noise: of
      an acceleration, which is as many N m as the posture's inertia makes of it;
    - the share of a change of acceleration that inertia and delays may be off, of all changes that
      were meant in these periods, and so long before them as it takes to show. What comes of one
      adds to what comes of the next, so they count without their signs;
    - while a joint turns back or stands, the dry friction that may change sides.

    Thresholds of this kind: Haddadin, De Luca, Albu-Schäffer, Robot collisions: a survey, T-RO
    2017, section V.

    Args:
        friction: Friction of the joints, as far as that is known.
        factor: Factor of all thresholds.

    Attributes:
        change: Change of the torques from outside, of shape (dof,), N m.
        threshold: What counts as a hit, likewise.
    """

    def __init__(self, friction: JointFriction, factor: float) -> None:
        dry = np.maximum(friction.static, friction.coulomb)
        self._turning = 2.0 * dry
        self._variance = np.full(len(dry), _FIRST**2)
        self._measured = np.full(len(dry), _FIRST_COUNTS)
        self._torques: Matrix = np.zeros((SPAN + 1, len(dry)))  # newest first, both
        self._changes: Matrix = np.zeros((SPAN + LATE, len(dry)))
        self._asked = np.zeros(len(dry))
        self._since_turn = np.zeros(len(dry))
        self._grace = self._seen = self._count = 0
        self._factor = factor
        self.change, self.threshold = np.zeros((2, len(dry)))

    def take(self, inertia: Matrix, sent: SetPoint, torque: Vector) -> bool:
        """Take up a period; whether the arm was hit.

        Args:
            inertia: Inertia matrix of now, of shape (dof, dof), kg m².
            sent: Set-point of now.
            torque: Torques that nobody has asked for, of shape (dof,), N m.
        """
        self._remember(torque, inertia @ sent.a)
        self._since_turn = np.where(np.abs(sent.v) < _TURN, 0.0, self._since_turn + 1.0)
        if self._seen <= SPAN:
            return False
        self.change = torque - self._torques[-1]
        if self._grace:
            self._grace -= bool(sent.v.any())
            return False
        turns = self._since_turn < _AFTER
        allowed = MODEL_SHARE * self._changes.sum(axis=0) + turns * self._turning
        lever = np.sqrt(np.einsum("ij,ij->i", inertia, inertia))
        deviation = lever * np.sqrt(self._variance)
        self.threshold = self._factor * (allowed + DEVIATIONS * deviation)
        size = np.abs(self.change)
        self._count += 1
        if self._count % SPAN == 0:
            self._learn(size / lever, ~turns & (allowed <= deviation))
        return not every(size <= self.threshold)

    def forget(self, *, grace: bool) -> None:
        """Begin anew: the arm's model has changed.

        Args:
            grace: Whether it holds something else now, which may lie on something still.
        """
        self._seen = 0
        if grace:
            self._grace = _GRACE

    def _remember(self, torque: Vector, asked: Vector) -> None:
        """Keep torques of this period, and forget the oldest."""
        if not self._seen:
            self._torques[:], self._asked, self._changes[:] = torque, asked, 0.0
        self._seen += 1
        self._torques[1:], self._changes[1:] = self._torques[:-1], self._changes[:-1]
        self._torques[0], self._changes[0] = torque, np.abs(asked - self._asked)
        self._asked = asked

    def _learn(self, size: Vector, counts: Flags) -> None:
        """Measure deviations, in rad/s², of joints that turn evenly; no hit is taken for one."""
        usual = np.minimum(np.square(size), 25.0 * self._variance)
        self._measured = np.minimum(self._measured + counts, _KEPT)
        step = np.where(counts, (usual - self._variance) / self._measured, 0.0)
        self._variance = np.maximum(self._variance + step, _LEAST**2)
