"""Compiled kernels of tracking: filters, motion model, oscillation and rest detection."""

from __future__ import annotations

import math
from typing import Final, TypeAlias

import numpy as np
import numpy.typing as npt

from bt_dualarm.core.kernel import kernel
from bt_dualarm.core.pose import Matrix, Vector

# Kalman filter


@kernel
def correct(
    state: Matrix, covariance: npt.NDArray[np.float64], position: Vector, variance: Vector
) -> None:
    """Correct states and covariances by a measurement of the positions.

    Args:
        state: States of shape (n, 4); changed.
        covariance: Their covariances, of shape (n, 4, 4); changed, stay symmetric.
        position: Measured positions, of shape (n,).
        variance: Variances of the measurement, of shape (n,).
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
        # Symmetrize. Joseph's form would cost twice as much, and is not needed with four states.
        for number in range(4):
            for other in range(number):
                own[number, other] = 0.5 * (own[number, other] + own[other, number])
                own[other, number] = own[number, other]


# Oscillator: a sine of unknown frequency

Stack: TypeAlias = npt.NDArray[np.float64]

MIN_FREQUENCY = 1e-3
"""Least frequency in rad/s: avoids a division by zero, indistinguishable from 0."""


@kernel
def swing(state: Matrix, dt: float, moved: Matrix) -> None:
    """Evaluate the sine through position, velocity and acceleration ``dt`` seconds on.

    Args:
        state: States of shape (n, 4).
        dt: Seconds.
        moved: Takes the states then, likewise.
    """
    for axis in range(len(state)):
        p = state[axis, 0]
        v = state[axis, 1]
        a = state[axis, 2]
        w = max(abs(state[axis, 3]), MIN_FREQUENCY)
        sine = math.sin(w * dt)
        cosine = math.cos(w * dt)
        half = math.sin(0.5 * w * dt)
        moved[axis, 0] = p + v * sine / w + a * 2.0 * (half / w) ** 2
        moved[axis, 1] = v * cosine + a * sine / w
        moved[axis, 2] = a * cosine - v * w * sine
        moved[axis, 3] = state[axis, 3]


@kernel
def differentiate(state: Matrix, dt: float, jacobian: Stack) -> None:
    """Enter the Jacobian of `swing` with respect to the state, of shape (n, 4, 4)."""
    for axis in range(len(state)):
        v = state[axis, 1]
        a = state[axis, 2]
        w = max(abs(state[axis, 3]), MIN_FREQUENCY)
        sine = math.sin(w * dt)
        cosine = math.cos(w * dt)
        integral = sine / w
        double = 2.0 * (math.sin(0.5 * w * dt) / w) ** 2
        by_frequency = (dt * cosine - integral) / w
        own = jacobian[axis]
        own[:] = 0.0
        own[0, 0] = own[3, 3] = 1.0
        own[0, 1] = own[1, 2] = integral
        own[0, 2] = double
        own[1, 1] = own[2, 2] = cosine
        own[2, 1] = -w * sine
        own[0, 3] = v * by_frequency + a * (dt * integral - 2.0 * double) / w
        own[1, 3] = a * by_frequency - v * dt * sine
        own[2, 3] = -a * dt * sine - v * (sine + w * dt * cosine)


@kernel
def propagate(
    state: Matrix, covariance: Stack, dt: float, densities: tuple[float, float],
    moved: Matrix, spread: Stack,
) -> None:  # fmt: skip
    """Propagate states and covariances by ``dt`` seconds (prediction step of the EKF).

    Args:
        state: States of shape (n, 4).
        covariance: Their covariances, of shape (n, 4, 4).
        dt: Seconds.
        densities: Noise densities of the jerk in m²/s⁵ and of the frequency in rad²/s³.
        moved: Takes the states then, of shape (n, 4).
        spread: Takes the covariances then, of shape (n, 4, 4).
    """
    jacobian = np.empty((len(state), 4, 4))
    half = np.empty((4, 4))
    swing(state, dt, moved)
    differentiate(state, dt, jacobian)
    noise = _noise(abs(dt), densities)
    for axis in range(len(state)):
        for row in range(4):
            for column in range(4):
                half[row, column] = 0.0
                for between in range(4):
                    half[row, column] += (
                        jacobian[axis, row, between] * covariance[axis, between, column]
                    )
        for row in range(4):
            for column in range(4):
                total = 0.0
                for between in range(4):
                    total += half[row, between] * jacobian[axis, column, between]
                spread[axis, row, column] = total + noise[row, column]


@kernel
def _noise(t: float, densities: tuple[float, float]) -> Matrix:
    """Covariance of white jerk noise through three integrators, and of the frequency's noise."""
    noise = np.zeros((4, 4))
    for row in range(3):
        for column in range(3):
            order = 5 - row - column
            share = densities[0] / order / (2.0 if row == 0 else 1.0)
            noise[row, column] = share / (2.0 if column == 0 else 1.0) * t**order
    noise[3, 3] = densities[1] * t
    return noise


@kernel
def blend(
    fast: Matrix, dt: float, slow: Matrix, slow_dt: float, share: float, motion: Matrix
) -> None:
    """Predict two states and interpolate position, velocity and acceleration between them.

    Args:
        fast: State of the fast filter, of shape (n, 4).
        dt: Seconds of its prediction.
        slow: State of the slow filter, of shape (n, 4).
        slow_dt: Seconds of its prediction.
        share: Weight of the slow filter, from 0 to 1.
        motion: Takes position, velocity and acceleration, of shape (3, n).
    """
    one = np.empty_like(fast)
    other = np.empty_like(slow)
    swing(fast, dt, one)
    swing(slow, slow_dt, other)
    for axis in range(len(one)):
        for order in range(3):
            apart = other[axis, order] - one[axis, order]
            motion[order, axis] = one[axis, order] + share * apart


@kernel
def blend_in_plane(
    fast: Matrix,
    dt: float,
    slow: Matrix,
    slow_dt: float,
    share: float,
    axes: Matrix,
    origin: Vector,
    motion: Matrix,
) -> None:
    """As `blend`, along two axes.

    Args:
        fast: State of the fast filter, of shape (n, 4).
        dt: Seconds of its prediction.
        slow: State of the slow filter, of shape (n, 4).
        slow_dt: Seconds of its prediction.
        share: Weight of the slow filter, from 0 to 1.
        axes: Unit vectors, of shape (2, n).
        origin: Origin of the positions, of shape (n,).
        motion: Takes position, velocity and acceleration, of shape (3, 2).
    """
    whole = np.empty((3, len(fast)))
    blend(fast, dt, slow, slow_dt, share, whole)
    whole[0] -= origin
    for order in range(3):
        for axis in range(2):
            total = 0.0
            for k in range(len(fast)):
                total += axes[axis, k] * whole[order, k]
            motion[order, axis] = total


# Oscillation of a camera, from its positions

_ROUNDING_FACTOR = 1.0 - 1e-9
"""Factor of a leg's length below which, despite rounding, there certainly is no leg."""

_MAX_ROTATIONS = 30
"""Jacobi rotations after which a 3 by 3 matrix is diagonal to the last bit."""


@kernel
def last_swing(places: Matrix, leg: float, legs: int) -> int:
    """Index of the position at which the last legs to and fro began; -1 if there are fewer.

    A leg is a monotonic motion along the principal axis of the positions.

    Args:
        places: Positions, of shape (n, 3), m; at least one.
        leg: Least length of a leg, m.
        legs: Number of legs.
    """
    middle = np.empty(3)
    products = np.empty((3, 3))
    # The diagonal of the bounding box is an upper bound of the extent along any direction.
    if spread(places, middle, products) < _ROUNDING_FACTOR * leg:
        return -1
    return swing_begin(places, middle, longest_axis(products), leg, legs)


@kernel
def longest_axis(products: Matrix) -> Vector:
    """Unit eigenvector of the largest eigenvalue of a symmetric matrix, of shape (3, 3).

    Jacobi's method (Golub and Van Loan, Matrix Computations, 8.5): rotate the largest off-diagonal
    element to zero, until none is left.

    Args:
        products: The matrix; it becomes diagonal.
    """
    axes = np.eye(3)
    for _ in range(_MAX_ROTATIONS):
        p = 0
        q = 1
        for i, j in ((0, 2), (1, 2)):
            if abs(products[i, j]) > abs(products[p, q]):
                p = i
                q = j
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
    """Rotate one element, which is not 0, to zero, and the axes with it."""
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
    """Rotate two columns of a matrix of shape (3, 3) by an angle given by cosine and sine."""
    cosine, sine = turn
    for i in range(3):
        first = matrix[i, p]
        second = matrix[i, q]
        matrix[i, p] = cosine * first - sine * second
        matrix[i, q] = sine * first + cosine * second


@kernel
def spread(places: Matrix, middle: Vector, products: Matrix) -> float:
    """Mean and scatter matrix of positions; returns the diagonal of their bounding box, m.

    Args:
        places: Positions, of shape (n, 3), m; at least one.
        middle: Takes their mean, of shape (3,), m.
        products: Takes their scatter matrix, of shape (3, 3), m².
    """
    count = len(places)
    square = 0.0
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
    """Index of the position at which the last legs to and fro began; -1 if there are fewer.

    The first and the last position end a leg, too.

    Args:
        places: Positions, of shape (n, 3), m.
        middle: Origin of the coordinate along the axis, of shape (3,), m.
        axis: Unit vector of the legs' direction, of shape (3,).
        leg: Least length of a leg, m.
        legs: Number of legs.
    """
    turns = np.zeros(len(places) + 1, np.int64)
    count = 1
    farthest = 0
    sign = 0.0
    most = 0.0
    first = 0.0
    for index in range(len(places)):
        along = 0.0
        for i in range(3):
            along += (places[index, i] - middle[i]) * axis[i]
        if index == 0:
            first = along
        elif sign == 0.0:
            if abs(along - first) >= leg:
                sign = math.copysign(1.0, along - first)
                farthest = index
                most = along
        elif sign * (along - most) >= 0.0:
            farthest = index
            most = along
        elif sign * (most - along) >= leg:
            turns[count] = farthest
            count = count + 1
            sign = -sign
            farthest = index
            most = along
    if sign != 0.0:
        turns[count] = farthest
        count += 1
    return turns[count - legs - 1] if count > legs else -1


@kernel
def slope_against(eyes: Matrix, lines: Matrix, depth: float) -> tuple[float, float]:
    """Apparent motion of a target per meter of camera motion, by least squares.

    Args:
        eyes: Positions of the camera, of shape (n, 3), m, not all the same.
        lines: Lines of sight per meter of depth, of shape (n, 3).
        depth: Assumed depth of the target, m.

    Returns:
        The slope, and the share of the apparent motion's variance that it explains.
    """
    count = len(eyes)
    eye = np.zeros(3)
    seen = np.zeros(3)
    for index in range(count):
        for i in range(3):
            eye[i] += eyes[index, i] / count
            seen[i] += (eyes[index, i] + depth * lines[index, i]) / count
    product = 0.0
    eye_square = 0.0
    seen_square = 0.0
    for index in range(count):
        for i in range(3):
            off = eyes[index, i] - eye[i]
            place = eyes[index, i] + depth * lines[index, i] - seen[i]
            product += place * off
            eye_square += off * off
            seen_square += place * place
    slope = product / eye_square
    return slope, slope * product / seen_square if seen_square > 0.0 else 0.0


# Rest detection; see `RestDetector`

COLUMNS: Final = 5
"""Columns of a sighting: position of the camera along the plane (2), slope (2), variance."""

VARIANCE: Final = 4

FIRST: Final = 24
"""Number of first sightings that are averaged."""

FEWEST: Final = 3
"""Number of newest sightings all of which must have moved."""

_SIGMAS: Final = 6.0  # of a mean: exceeded at rest once in 10⁷ frames
_DOUBLINGS: Final = 5  # of the number of newest sightings that are averaged


@kernel
def scatter(newest: Matrix, depth: float) -> float:
    """Standard deviation of a sighting along an axis: the expected or the observed, if larger.

    The observed one is from third differences, in which smooth motion cancels (after Rice, Annals
    of Statistics 12, 1984, who uses first differences). Their variance is 1 + 9 + 9 + 1 = 20 times
    that of a sighting.
    """
    count = len(newest)
    expected = 0.0
    bends = 0.0
    for number in range(count):
        expected += newest[number, VARIANCE]
    for number in range(count - 3):
        for axis in range(2):
            bend = 0.0
            for after, share in enumerate((-1.0, 3.0, -3.0, 1.0)):
                row = newest[number + after]
                bend += share * (row[axis] + depth * row[2 + axis])
            bends += bend * bend
    measured = bends / (2.0 * (count - 3)) / 20.0 if count > 3 else 0.0
    return math.sqrt(max(expected / count, measured))


@kernel
def has_moved(
    rows: Matrix, leaving: int, firsts: Matrix, depth: float, doubt: float, far: float
) -> bool:
    """Whether the mean of the newest sightings, over any window, is too far from the first ones.

    Args:
        rows: Recent sightings, oldest first, of shape (n, `COLUMNS`).
        leaving: Number of them that no longer count as newest.
        firsts: Means of the first sightings, by slope, of shape (m, `COLUMNS`).
        depth: Estimated depth of the target, m.
        doubt: Factor by which it may be larger or smaller.
        far: Displacement beyond which the target has moved, m.
    """
    newest = rows[leaving:]
    now = np.zeros(COLUMNS)
    then = np.empty(COLUMNS)
    sigma = scatter(newest, depth)
    taken = 0
    count = FEWEST
    for _ in range(_DOUBLINGS):
        if count > len(newest) or (len(firsts) == 0 and count >= len(rows)):
            break
        for number in range(taken, count):
            now += newest[len(newest) - 1 - number]
        taken = count
        of = FIRST if len(firsts) else min(len(rows) - count, FIRST)
        allowed = _SIGMAS * sigma * math.sqrt(1.0 / count + 1.0 / of)
        for number in range(max(len(firsts), 1)):
            if len(firsts):
                then[:] = firsts[number]
            else:
                then[:] = 0.0
                for early in range(of):
                    then += rows[early]
                then /= of
            if _excess(now / count, then, allowed, depth, doubt) > far and _is_apart(
                newest, then, depth, doubt, far
            ):
                return True
        count *= 2
    return False


@kernel
def _is_apart(newest: Matrix, then: Vector, depth: float, doubt: float, far: float) -> bool:
    """Whether all of the last sightings have moved: one or two outliers move a mean, too."""
    apart = True
    for number in range(len(newest) - FEWEST, len(newest)):
        apart = apart and _excess(newest[number], then, 0.0, depth, doubt) > far
    return apart


@kernel
def _excess(now: Vector, then: Vector, allowed: float, depth: float, doubt: float) -> float:
    """Least displacement in m beyond what the scatter explains, over all possible depths.

    With the depth z as a factor of the estimated one, the displacement is |e + z s|, and the
    scatter explains z a. Their difference is convex in z; its minimum has a closed form.
    """
    x = now[0] - then[0]
    y = now[1] - then[1]
    u = depth * (now[2] - then[2])
    v = depth * (now[3] - then[3])
    length = max(math.sqrt(u * u + v * v), 1e-9)
    along = (x * u + y * v) / length
    across = math.sqrt(max(x * x + y * y - along * along, 0.0))
    share = doubt
    if allowed < length:
        steep = math.sqrt(max(length * length - allowed * allowed, 1e-18))
        share = min(max((allowed * across / steep - along) / length, 1.0 / doubt), doubt)
    return math.hypot(along + share * length, across) - share * allowed
