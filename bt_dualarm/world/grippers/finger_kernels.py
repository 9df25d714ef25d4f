"""What moves fingers: compiled, for each step of physics."""

from __future__ import annotations

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.pose import Vector
from bt_dualarm.world.grippers.kernel_columns import (
    ASKED_FORCE,
    ASKED_SPEED,
    ASKED_WIDTH,
    DAMPING,
    FORCE,
    GAIN,
    MOST,
    REFERENCE,
    SHUT,
    STIFFNESS,
    WOUND_UP,
)


@kernel
def push(q: Vector, v: Vector, drive: Vector, step: float, motor: Vector) -> None:
    """The speed loop: a reference runs ahead at the speed asked for, as far as force allows.

    Args:
        q: Ways of both fingers, of shape (2,), m.
        v: Their speeds, of shape (2,), m/s.
        drive: What is known of the drive, see `kernel_columns`; changed.
        step: Seconds of a step of physics.
        motor: Takes the force on each finger, of shape (1,), N.
    """
    asked, stiffness = drive[ASKED_FORCE], drive[STIFFNESS]
    width, rate = q[0] + q[1], v[0] + v[1]
    ahead = WOUND_UP * asked / stiffness
    goal = SHUT if drive[ASKED_WIDTH] <= 0.0 else drive[ASKED_WIDTH]
    stride = drive[ASKED_SPEED] * step
    reference = drive[REFERENCE]
    way = min(max(goal - reference, -stride), stride)
    force = stiffness * (reference - width) + drive[DAMPING] * (way / step - rate)
    drive[REFERENCE] = min(max(reference + way, width - ahead), width + ahead)
    drive[FORCE] = min(max(force, -asked), asked)
    motor[0] = min(max(drive[FORCE] * drive[GAIN], -drive[MOST]), drive[MOST])
