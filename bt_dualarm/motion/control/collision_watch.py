"""Hits: torques from outside that come faster than anything that is off in the arm's model."""

from __future__ import annotations

from collections import deque
from typing import Final

import numpy as np

from bt_dualarm.motion.setpoints.set_point import SetPoint
from bt_dualarm.motion.setpoints.stopping_distance import Flags, every
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.robots.friction import JointFriction

SPAN: Final = 8
"""Periods over which a torque is compared with itself: a hit is there within them, and what masses
and friction are off changes little."""

DEVIATIONS: Final = 8.0
"""Standard deviations of what was measured without a hit that count as one."""

MODEL_SHARE: Final = 0.25
"""Share of the torques of a change of acceleration by which inertia may be off."""

_TURN: Final = 0.04  # rad/s; slower, a joint's dry friction may change sides
_AFTER: Final = SPAN + 17  # periods that this is remembered for
_GRACE: Final = 75  # periods of motion after a grasp: what lay on something is borne now
_KEPT: Final = 100  # numbers that deviations are measured over
_FIRST: Final = 0.015  # of effort: deviation before anything was measured, which counts as
_FIRST_COUNTS: Final = 5  # so many numbers
_LEAST: Final = 0.004  # of effort


class CollisionWatch:
    """Tells a hit from what is off in the model, by how fast it comes.

    The torque of the observer's disturbance is everything that the nominal arm does not explain. Of
    each joint its change over ``SPAN`` periods is held against a threshold that has three parts:
    deviations of this very number as measured on this arm so far, the share of a change of
    acceleration that inertia may be off, and, while a joint turns back or stands, the dry friction
    that may change sides. Thresholds of this kind: Haddadin, De Luca, Albu-Schäffer, Robot
    collisions: a survey, T-RO 2017, section V.

    Args:
        effort: Effort limits of the joints, of shape (dof,), N m.
        friction: Friction of the joints, as far as that is known.
        factor: Factor of all thresholds.

    Attributes:
        change: Change of the torques from outside, of shape (dof,), N m.
        threshold: What counts as a hit, likewise.
    """

    def __init__(self, effort: Vector, friction: JointFriction, factor: float) -> None:
        dry = np.maximum(friction.static, friction.coulomb)
        self._turning = 2.0 * dry
        self._variance = np.square(_FIRST * effort)
        self._measured = np.full(len(effort), _FIRST_COUNTS)
        self._least = np.square(_LEAST * effort)
        self._torques: deque[Vector] = deque(maxlen=SPAN + 1)
        self._asked: deque[Vector] = deque(maxlen=SPAN + 1)
        self._since_turn = np.zeros(len(effort))
        self._grace = 0
        self._factor = factor
        self._count = 0
        self.change, self.threshold = np.zeros((2, len(effort)))

    def take(self, inertia: Matrix, sent: SetPoint, torque: Vector) -> bool:
        """Take up a period; whether the arm was hit.

        Args:
            inertia: Inertia matrix of now, of shape (dof, dof), kg m².
            sent: Set-point of now.
            torque: Torques that nobody has asked for, of shape (dof,), N m.
        """
        self._torques.append(torque)
        self._asked.append(sent.a)
        slow = np.abs(sent.v) < _TURN
        self._since_turn = np.where(slow, 0.0, self._since_turn + 1.0)
        if len(self._torques) <= SPAN:
            return False
        self.change = torque - self._torques[0]
        if self._grace:
            self._grace -= bool(sent.v.any())
            return False
        turns = self._since_turn < _AFTER
        changing = np.abs(inertia @ (sent.a - self._asked[0]))
        allowed = MODEL_SHARE * changing + turns * self._turning
        self.threshold = self._factor * (allowed + DEVIATIONS * np.sqrt(self._variance))
        size = np.abs(self.change)
        self._count += 1
        if self._count % SPAN == 0:
            self._learn(np.maximum(size - allowed, 0.0), ~turns)
        return not every(size <= self.threshold)

    def forget(self, *, grace: bool) -> None:
        """Begin anew: the arm's model has changed.

        Args:
            grace: Whether it holds something else now, which may lie on something still.
        """
        self._torques.clear()
        self._asked.clear()
        if grace:
            self._grace = _GRACE

    def _learn(self, size: Vector, counts: Flags) -> None:
        """Measure deviations, of joints that turn evenly; no hit is taken for one."""
        usual = np.minimum(np.square(size), 25.0 * self._variance)
        self._measured = np.minimum(self._measured + counts, _KEPT)
        step = np.where(counts, (usual - self._variance) / self._measured, 0.0)
        self._variance = np.maximum(self._variance + step, self._least)
