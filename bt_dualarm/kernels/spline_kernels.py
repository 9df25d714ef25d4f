"""Cubic splines: the slopes at their knots, and their values between them."""

from __future__ import annotations

import numpy as np

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.kernels.kernel_arrays import Stack
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
    beyond = np.zeros(len(diagonal))
    _eliminate(lower, diagonal, upper, beyond, right)
    n = len(diagonal)
    for i in range(n - 1, -1, -1):
        for k in range(right.shape[1]):
            value = right[i, k]
            if i < n - 1:
                value -= upper[i] * right[i + 1, k]
            if i < n - 2:
                value -= beyond[i] * right[i + 2, k]
            right[i, k] = value / diagonal[i]


@kernel
def _eliminate(
    lower: Vector, diagonal: Vector, upper: Vector, beyond: Vector, right: Matrix
) -> None:
    """Take what is below the diagonal out; where rows are exchanged, there is more above it."""
    n = len(diagonal)
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


@kernel
def evaluate(knots: Vector, pieces: Stack, places: Vector, order: int, found: Matrix) -> None:
    """Enter values, or derivatives; beyond its ends those of the first and the last piece.

    Args:
        knots: Places at which the pieces meet, of shape (m + 1,), rising.
        pieces: Coefficients over the distance from each piece's first knot, that of the cube first,
            of shape (4, m, k).
        places: Places, of shape (n,).
        order: Order of the derivative, 0 to 3.
        found: Takes them, of shape (n, k).
    """
    last = len(knots) - 2
    for row in range(len(places)):
        place = places[row]
        low, high = 0, last + 1
        while high - low > 1:  # knots[low] <= place < knots[high], but at the ends
            middle = (low + high) // 2
            if knots[middle] <= place:
                low = middle
            else:
                high = middle
        away = place - knots[low]
        for k in range(pieces.shape[2]):
            total, power = 0.0, 1.0
            for degree in range(order, 4):
                factor = 1.0
                for i in range(degree, degree - order, -1):
                    factor *= i
                total += pieces[3 - degree, low, k] * power * factor
                power *= away
            found[row, k] = total
