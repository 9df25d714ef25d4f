"""Hits: torques from outside that come faster than anything that is off in the arm's model."""

from __future__ import annotations

from typing import Final

import numpy as np

from bt_dualarm.motion.hits.kernel_rows import (
    CHANGE,
    COMPARES,
    FIRST,
    HIT_ROWS,
    JUDGES,
    LATE,
    LEARNS,
    MEASURED,
    MOVES,
    SPAN,
    THRESHOLD,
    TURNING,
    VARIANCE,
    WAS_HIT,
)
from bt_dualarm.motion.setpoints.set_point import SetPoint
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.robots.friction import JointFriction

_GRACE: Final = 75  # periods of motion after a grasp: what lay on something is borne now
_FIRST: Final = 1.2  # rad/s², before anything was measured: of encoders of 17 bit; it counts as
_FIRST_COUNTS: Final = 10  # so many numbers


class CollisionWatch:
    """Tells a hit from what is off in the model, by how fast it comes.

    The torque of the observer's disturbance is everything that the nominal arm does not explain. Of
    each joint its change over `SPAN` periods is held against a threshold that has three parts:

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
        from bt_dualarm.motion.hits.hit_kernels import compare

        self._compare = compare
        dry = np.maximum(friction.static, friction.coulomb)
        joints = np.zeros((HIT_ROWS, len(dry)))
        joints[TURNING], joints[VARIANCE] = 2.0 * dry, _FIRST**2
        joints[MEASURED] = _FIRST_COUNTS
        torques, changes = np.zeros((SPAN + 1, len(dry))), np.zeros((SPAN + LATE, len(dry)))
        self._known = joints, torques, changes
        self._sent = np.zeros((2, len(dry)))
        self._grace = self._seen = self._count = 0
        self._factor = float(factor)
        self.change, self.threshold = joints[CHANGE], joints[THRESHOLD]

    def take(self, inertia: Matrix, sent: SetPoint, torque: Vector) -> bool:
        """Take up a period; whether the arm was hit.

        Args:
            inertia: Inertia matrix of now, of shape (dof, dof), kg m².
            sent: Set-point of now.
            torque: Torques that nobody has asked for, of shape (dof,), N m.
        """
        self._seen += 1
        compares = self._seen > SPAN
        judges = compares and not self._grace
        self._count += judges
        learns = judges and self._count % SPAN == 0
        how = FIRST * (self._seen == 1) | COMPARES * compares | JUDGES * judges | LEARNS * learns
        self._sent[0], self._sent[1] = sent.v, sent.a
        outcome = self._compare(inertia, self._sent, torque, self._factor, how, *self._known)
        if compares and self._grace and outcome & MOVES:
            self._grace -= 1
        return outcome & WAS_HIT != 0

    def forget(self, *, grace: bool) -> None:
        """Begin anew: the arm's model has changed.

        Args:
            grace: Whether it holds something else now, which may lie on something still.
        """
        self._seen = 0
        if grace:
            self._grace = _GRACE


def be_hit_by_something() -> None:
    """Have the kernel that tells hits compiled."""
    from bt_dualarm.motion.hits.hit_kernels import compare

    one, joints = np.ones((1, 1)), np.ones((HIT_ROWS, 1))
    compare(one, np.ones((2, 1)), np.ones(1), 1.0, FIRST, joints, np.ones((2, 1)), np.ones((2, 1)))
