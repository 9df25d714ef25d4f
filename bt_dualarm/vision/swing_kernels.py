"""Whether a camera swings to and fro, told by its places."""

from __future__ import annotations

import math

import numpy as np

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.pose import Matrix, Vector

_SURELY_NO_LEG = 1.0 - 1e-9
"""Share of a leg that what spreads less surely has not, whatever the rounding."""

_TURNS = 30
"""Turns after which the axes of three by three products are known to the last bit."""


@kernel
def last_swing(places: Matrix, leg: float, legs: int) -> int:
    """Index of the place at which the last legs to and fro began; -1 if there are fewer.

    Legs are those along the axis along which the places spread most.

    Args:
        places: Places, of shape (n, 3), in m; one at least.
        leg: Least length of a leg in m.
        legs: Number of them.
    """
    middle, products = np.empty(3), np.empty((3, 3))
    # Along no direction do they reach farther than the diagonal of their box.
    if spread(places, middle, products) < _SURELY_NO_LEG * leg:
        return -1
    return swing_begin(places, middle, longest_axis(products), leg, legs)


@kernel
def longest_axis(products: Matrix) -> Vector:
    """Unit eigenvector of the largest eigenvalue of a symmetric matrix, of shape (3, 3).

    Jacobi's method (Golub and Van Loan, Matrix Computations, 8.5): turn the largest of the
    elements beside the diagonal to zero, until none is left.

    Args:
        products: The matrix; it becomes diagonal.
    """
    axes = np.eye(3)
    for _ in range(_TURNS):
        p, q = 0, 1
        for i, j in ((0, 2), (1, 2)):
            if abs(products[i, j]) > abs(products[p, q]):
                p, q = i, j
        if products[p, q] == 0.0:
            break
        _turn_to_zero(products, axes, p, q)
    largest = 0
    for number in range(1, 3):
        if products[number, number] > products[largest, largest]:
            largest = number
    return axes[:, largest].copy()


@kernel
def _turn_to_zero(products: Matrix, axes: Matrix, p: int, q: int) -> None:
    """Turn one element of the products, which is not 0, to zero, and the axes with them."""
    ratio = float(products[q, q] - products[p, p]) / float(2.0 * products[p, q])
    tangent = math.copysign(1.0, ratio) / (abs(ratio) + math.sqrt(1.0 + ratio * ratio))
    cosine = 1.0 / math.sqrt(1.0 + tangent**2)
    turn = cosine, tangent * cosine
    _turn_columns(products, p, q, turn)
    _turn_columns(products.T, p, q, turn)
    _turn_columns(axes, p, q, turn)
    products[p, q] = products[q, p] = 0.0


@kernel
def _turn_columns(matrix: Matrix, p: int, q: int, turn: tuple[float, float]) -> None:
    """Turn two columns of a matrix of shape (3, 3) by an angle with this cosine and sine."""
    cosine, sine = turn
    for i in range(3):
        first, second = matrix[i, p], matrix[i, q]
        matrix[i, p] = cosine * first - sine * second
        matrix[i, q] = sine * first + cosine * second


@kernel
def spread(places: Matrix, middle: Vector, products: Matrix) -> float:
    """Diagonal in m of the box about places; enters how they lie in it.

    Args:
        places: Places, of shape (n, 3), in m; one at least.
        middle: Takes their mean, of shape (3,), in m.
        products: Takes the sums of products of their offsets from it, of shape (3, 3), in m².
    """
    count, square = len(places), 0.0
    products[:] = 0.0
    for axis in range(3):
        along = places[:, axis]
        square += (along.max() - along.min()) ** 2
        middle[axis] = along.sum() / count
    for place in places:
        for i in range(3):
            for j in range(3):
                products[i, j] += (place[i] - middle[i]) * (place[j] - middle[j])
    return math.sqrt(square)


@kernel
def swing_begin(places: Matrix, middle: Vector, axis: Vector, leg: float, legs: int) -> int:
    """Index of the place at which the last legs to and fro began; -1 if there are fewer.

    The first place and the last end a leg, too.

    Args:
        places: Places, of shape (n, 3), in m.
        middle: Place from which ways along the axis are counted, of shape (3,), in m.
        axis: Unit vector along which legs are, of shape (3,).
        leg: Least length of a leg in m.
        legs: Number of them.
    """
    turns = np.zeros(len(places) + 1, np.int64)
    count, farthest, sign, most, first = 1, 0, 0.0, 0.0, 0.0
    for index in range(len(places)):
        along = 0.0
        for i in range(3):
            along += (places[index, i] - middle[i]) * axis[i]
        if index == 0:
            first = along
        elif sign == 0.0:
            if abs(along - first) >= leg:
                sign, farthest, most = math.copysign(1.0, along - first), index, along
        elif sign * (along - most) >= 0.0:
            farthest, most = index, along
        elif sign * (most - along) >= leg:
            turns[count] = farthest
            count, sign, farthest, most = count + 1, -sign, index, along
    if sign != 0.0:
        turns[count] = farthest
        count += 1
    return turns[count - legs - 1] if count > legs else -1


@kernel
def slope_against(eyes: Matrix, lines: Matrix, depth: float) -> tuple[float, float]:
    """How far what is seen moves for each metre of a camera, by least squares.

    Args:
        eyes: Places of the camera, of shape (n, 3), in m, not all the same.
        lines: Ways to what is seen for each metre of depth, of shape (n, 3).
        depth: Depth in m at which it is believed to be.

    Returns:
        The slope, and the share of what the target seems to move that it explains.
    """
    count, eye, seen = len(eyes), np.zeros(3), np.zeros(3)
    for index in range(count):
        for i in range(3):
            eye[i] += eyes[index, i] / count
            seen[i] += (eyes[index, i] + depth * lines[index, i]) / count
    both, swung, moved = 0.0, 0.0, 0.0
    for index in range(count):
        for i in range(3):
            off = eyes[index, i] - eye[i]
            place = eyes[index, i] + depth * lines[index, i] - seen[i]
            both += place * off
            swung += off * off
            moved += place * place
    slope = both / swung
    return slope, slope * both / moved if moved > 0.0 else 0.0
