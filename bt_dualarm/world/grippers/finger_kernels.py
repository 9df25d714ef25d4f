"""What moves fingers and tells their width: compiled, for each step of physics."""

from __future__ import annotations

import numpy as np

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.pose import Matrix, Vector
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


@kernel
def read_width(
    q: Vector, noise: float, resolution: float, past: Matrix, count: int, time: float
) -> tuple[float, float]:
    """Opening by the encoder in m, and its speed in m/s since the first reading that is kept.

    Args:
        q: Ways of both fingers, of shape (2,), m.
        noise: Noise of this reading, m.
        resolution: Steps in which it is read, m; 0 for none.
        past: Times and openings of earlier readings, of shape (n, 2): rows go round; changed.
        count: Number of earlier readings.
        time: Time of this one, s.
    """
    width = q[0] + q[1] + noise
    if resolution > 0.0:
        width = resolution * np.rint(width / resolution)
    newest = count % len(past)
    past[newest, 0], past[newest, 1] = time, width
    oldest = (count + 1) % len(past) if count >= len(past) else 0
    began = past[oldest, 0]
    return width, (width - past[oldest, 1]) / (time - began) if time > began else 0.0
