"""Collision detection: disturbance torques that change faster than model errors can explain."""

from __future__ import annotations

from typing import Final

import numpy as np

from bt_dualarm.control.kernel_rows import (
    CHANGE,
    COLLISION,
    COMPARE,
    DELAY,
    DETECTOR_ROWS,
    FIRST,
    JUDGE,
    LEARN,
    MOVING,
    REVERSAL_TORQUE,
    SAMPLES,
    SPAN,
    THRESHOLD,
    VARIANCE,
)
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.robots.robot import JointFriction
from bt_dualarm.trajectory.set_points import SetPoint

_GRACE: Final = 75
"""Periods of motion after a grasp without detection: the load is transferred from its support."""

_PRIOR_DEVIATION: Final = 1.2
"""Standard deviation before the first sample, rad/s²: that of 17-bit encoders."""

_PRIOR_SAMPLES: Final = 10
"""Number of samples that this prior is worth."""


class CollisionDetector:
    """Distinguishes collisions from model errors by the rate at which torques change.

    The disturbance torque contains everything that the nominal model does not explain. The change
    of each joint's disturbance torque over `SPAN` periods is compared with a threshold of three
    terms:

    - `DEVIATIONS` standard deviations of this change, measured on this arm without a collision. The
      noise is that of encoders, an acceleration; it is converted to torque with the inertia of the
      current posture.
    - `MODEL_ERROR` times all changes of the commanded inertial torque within the span and within
      the delay before it. Errors of successive changes may add up, so their magnitudes are summed.
    - While a joint reverses or rests, the dry friction that may change sign.

    Thresholds of this kind: Haddadin, De Luca, Albu-Schäffer, Robot collisions: a survey, T-RO
    2017, section V.

    Args:
        friction: Joint friction of the nominal model.
        factor: Multiplies all thresholds.

    Attributes:
        change: Change of the disturbance torques, of shape (dof,), N m.
        threshold: Changes that count as a collision, of shape (dof,), N m.
    """

    def __init__(self, friction: JointFriction, factor: float) -> None:
        from bt_dualarm.control.control_kernels import detect_collision

        self._detect = detect_collision
        dry = np.maximum(friction.static, friction.coulomb)
        joints = np.zeros((DETECTOR_ROWS, len(dry)))
        joints[REVERSAL_TORQUE] = 2.0 * dry  # from +dry to -dry
        joints[VARIANCE] = _PRIOR_DEVIATION**2
        joints[SAMPLES] = _PRIOR_SAMPLES
        torques = np.zeros((SPAN + 1, len(dry)))
        changes = np.zeros((SPAN + DELAY, len(dry)))
        self._state = joints, torques, changes
        self._sent = np.zeros((2, len(dry)))
        self._grace = 0  # remaining periods of motion without detection
        self._periods = 0  # since the last reset
        self._judged = 0  # periods in which changes were compared with thresholds
        self._factor = float(factor)
        self.change = joints[CHANGE]
        self.threshold = joints[THRESHOLD]

    def update(self, inertia: Matrix, sent: SetPoint, torque: Vector) -> bool:
        """Process one period; return whether a collision is detected.

        Args:
            inertia: Inertia matrix, of shape (dof, dof), kg m².
            sent: Current set-point.
            torque: Disturbance torques, of shape (dof,), N m.
        """
        self._periods += 1
        compares = self._periods > SPAN
        judges = compares and not self._grace
        self._judged += judges
        # Changes whose spans do not overlap are independent samples.
        learns = judges and self._judged % SPAN == 0
        flags = FIRST * (self._periods == 1) | COMPARE * compares | JUDGE * judges | LEARN * learns
        self._sent[0] = sent.v
        self._sent[1] = sent.a
        result = self._detect(inertia, self._sent, torque, self._factor, flags, *self._state)
        if compares and self._grace and result & MOVING:
            self._grace -= 1
        return result & COLLISION != 0

    def reset(self, *, grace: bool) -> None:
        """Discard the history because the model changed.

        Args:
            grace: Whether the payload changed: it may still rest on something.
        """
        self._periods = 0
        if grace:
            self._grace = _GRACE


def warm_up_collision_detection() -> None:
    """Compile the detection kernel."""
    from bt_dualarm.control.control_kernels import detect_collision

    one = np.ones((1, 1))
    joints = np.ones((DETECTOR_ROWS, 1))
    detect_collision(
        one, np.ones((2, 1)), np.ones(1), 1.0, FIRST, joints, np.ones((2, 1)), np.ones((2, 1))
    )
