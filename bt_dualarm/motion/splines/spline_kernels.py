"""The slopes of cubic splines at their knots."""

from __future__ import annotations

import numpy as np

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.pose import Matrix, Vector


@kernel
def solve(lower: Vector, diagonal: Vector, upper: Vector, right: Matrix) -> None:
    """Solve a system of three diagonals, by elimination with exchange of rows.

    Golub and Van Loan, Matrix Computations, 4.3.

    Args:
        lower: Below the diagonal, of shape (n - 1,); used up, as the next two.
        diagonal: The diagonal, of shape (n,).
        upper: Above it, of shape (n - 1,).
        right: Right hand sides, of shape (n, k); takes the solutions.
    """
    n = len(diagonal)
    beyond = np.zeros(n)  # above the upper one, where rows were exchanged
    for i in range(n - 1):
        if abs(diagonal[i]) >= abs(lower[i]):
            factor = lower[i] / diagonal[i]
            diagonal[i + 1] -= factor * upper[i]
            for k in range(right.shape[1]):
                right[i + 1, k] -= factor * right[i, k]
            continue
        factor = diagonal[i] / lower[i]
        diagonal[i], below = lower[i], diagonal[i + 1]
        diagonal[i + 1], upper[i] = upper[i] - factor * below, below
        if i < n - 2:
            beyond[i] = upper[i + 1]
            upper[i + 1] = -factor * upper[i + 1]
        for k in range(right.shape[1]):
            above = right[i, k]
            right[i, k] = right[i + 1, k]
            right[i + 1, k] = above - factor * right[i, k]
    for i in range(n - 1, -1, -1):
        for k in range(right.shape[1]):
            value = right[i, k]
            if i < n - 1:
                value -= upper[i] * right[i + 1, k]
            if i < n - 2:
                value -= beyond[i] * right[i + 2, k]
            right[i, k] = value / diagonal[i]
