"""How much of what a servo wants the limits of the joints allow."""

from __future__ import annotations

import math

import numpy as np

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.motion.chains.kernel_rows import (
    LOWER,
    MOST_ACCELERATION,
    MOST_JERK,
    MOST_VELOCITY,
    UPPER,
)
from bt_dualarm.motion.setpoints.kernel_rows import HOLD, NOW_A, NOW_Q, RATES
from bt_dualarm.pose import Matrix, Vector

_BRAKE_SHARE = 0.5  # of the acceleration is planned for slowing down before the target
_TOP_SHARE = 0.95  # of the velocity limits is planned for


@kernel
def passable_share(work: Matrix, velocity: Vector) -> float:
    """Share of a plane velocity that the joints can stop from."""
    share = math.inf
    for i in range(work.shape[1]):
        turning = work[RATES, i] * velocity[0] + work[RATES + 1, i] * velocity[1]
        q = work[NOW_Q, i]
        room = work[UPPER, i] - q if turning > 0.0 else q - work[LOWER, i]
        braking = math.sqrt(2.0 * _BRAKE_SHARE * work[MOST_ACCELERATION, i] * max(room, 0.0))
        most = min(braking, _TOP_SHARE * work[MOST_VELOCITY, i])
        share = min(share, most / max(abs(turning), 1e-9))
    return share


@kernel
def keep_within(
    work: Matrix, now: Vector, wanted: Vector, share: float, period: float, a: Vector
) -> None:
    """Enter joint accelerations that hold, and move as far as the limits allow.

    Args:
        work: What the servo works with.
        now: Acceleration in the plane that was sent last, of shape (2,).
        wanted: The one that is wanted.
        share: Part of the way from one to the other that is to be gone.
        period: Seconds between set-points.
        a: Accelerations, of shape (dof,).
    """
    dof = len(a)
    way, low, high = np.empty(dof), np.empty(dof), np.empty(dof)
    for i in range(dof):
        high[i] = work[MOST_ACCELERATION, i]
        low[i] = -high[i]
        way[i] = work[RATES, i] * wanted[0] + work[RATES + 1, i] * wanted[1]
    step = share * (wanted * _passable(work[HOLD], way, low, high) - now)
    for i in range(dof):
        change = work[MOST_JERK, i] * period
        low[i], high[i] = work[NOW_A, i] - change, work[NOW_A, i] + change
        way[i] = work[RATES, i] * step[0] + work[RATES + 1, i] * step[1]
        a[i] = work[HOLD, i] + work[RATES, i] * now[0] + work[RATES + 1, i] * now[1]
    a += _passable(a, way, low, high) * way
    most = 1.0
    for i in range(dof):
        most = max(most, abs(a[i]) / work[MOST_ACCELERATION, i])
    a /= most
    most = 1.0
    for i in range(dof):
        most = max(most, abs(a[i] - work[NOW_A, i]) / (work[MOST_JERK, i] * period))
    for i in range(dof):
        a[i] = work[NOW_A, i] + (a[i] - work[NOW_A, i]) / most


@kernel
def _passable(start: Vector, way: Vector, low: Vector, high: Vector) -> float:
    """Largest share, from 0 to 1, of a way of shape (dof,) on which no joint leaves its bounds."""
    share = 1.0
    for i in range(len(way)):
        room = high[i] - start[i] if way[i] > 0.0 else start[i] - low[i]
        share = min(share, room / max(abs(way[i]), 1e-9))
    return max(share, 0.0)
