"""What one measurement tells a Kalman filter of axes that are independent of each other."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.pose import Matrix, Vector


@kernel
def correct(
    state: Matrix, covariance: npt.NDArray[np.float64], position: Vector, variance: Vector
) -> None:
    """Bring states and covariances up to date with a measurement of the first numbers.

    Args:
        state: States of shape (n, 4); they are changed.
        covariance: Their covariances, of shape (n, 4, 4); they are changed, and stay symmetric.
        position: What was measured, of shape (n,).
        variance: Its variance, of shape (n,).
    """
    for axis in range(len(state)):
        own = covariance[axis]
        row = own[0].copy()
        gain = row / (row[0] + variance[axis])
        innovation = position[axis] - state[axis, 0]
        for number in range(4):
            state[axis, number] += gain[number] * innovation
            for other in range(4):
                own[number, other] -= gain[number] * row[other]
        # Joseph's form would cost twice as much; four states in doubles stay symmetric enough.
        for number in range(4):
            for other in range(number):
                own[number, other] = 0.5 * (own[number, other] + own[other, number])
                own[other, number] = own[number, other]
