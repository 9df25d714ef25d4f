"""Filters, motion models and rest detection of a tracked target: compiled."""

from __future__ import annotations

import math
from typing import Final, TypeAlias

import numpy as np
import numpy.typing as npt

from bt_dualarm.core.kernel import kernel
from bt_dualarm.core.pose import Matrix, Vector

# What one measurement tells a Kalman filter of axes that are independent of each other.


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


# How a sine of unknown frequency goes on, and what is known of it by then; see `Oscillator`.


Stack: TypeAlias = npt.NDArray[np.float64]

MIN_FREQUENCY = 1e-3
"""Frequency in rad/s that a slower one is taken for."""


@kernel
def swing(state: Matrix, dt: float, moved: Matrix) -> None:
    """Enter states of shape (n, 4) ``dt`` seconds on: a sine through the first three numbers."""
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
    """Enter the derivative of `swing` by the state, of shape (n, 4, 4)."""
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
def carry(
    state: Matrix, covariance: Stack, dt: float, densities: tuple[float, float],
    moved: Matrix, spread: Stack,
) -> None:  # fmt: skip
    """Enter states and their covariances ``dt`` seconds on.

    Args:
        state: States of shape (n, 4).
        covariance: Their covariances, of shape (n, 4, 4).
        dt: Seconds.
        densities: Densities of the jerk's noise in m²/s⁵ and of the frequency's in rad²/s³.
        moved: States then, of shape (n, 4), to be filled.
        spread: Covariances then, of shape (n, 4, 4), to be filled.
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
    """Covariance of white noise through three integrators, and apart from it the frequency's."""
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
    lively: Matrix, dt: float, calm: Matrix, calm_dt: float, share: float, motion: Matrix
) -> None:
    """Enter position, velocity and acceleration between those of two states.

    Args:
        lively: One state, of shape (n, 4).
        dt: Seconds on at which it is asked for.
        calm: The other, of shape (n, 4).
        calm_dt: Seconds on at which that is asked for.
        share: Weight of the other, from 0 to 1.
        motion: Rows to be filled with them, of shape (3, n).
    """
    one = np.empty_like(lively)
    other = np.empty_like(calm)
    swing(lively, dt, one)
    swing(calm, calm_dt, other)
    for axis in range(len(one)):
        for order in range(3):
            apart = other[axis, order] - one[axis, order]
            motion[order, axis] = one[axis, order] + share * apart


@kernel
def blend_in_plane(
    lively: Matrix,
    dt: float,
    calm: Matrix,
    calm_dt: float,
    share: float,
    axes: Matrix,
    origin: Vector,
    motion: Matrix,
) -> None:
    """Enter the same along two axes.

    Args:
        lively: One state, of shape (n, 4).
        dt: Seconds on at which it is asked for.
        calm: The other, of shape (n, 4).
        calm_dt: Seconds on at which that is asked for.
        share: Weight of the other, from 0 to 1.
        axes: Unit vectors, of shape (2, n).
        origin: Where positions count from, of shape (n,).
        motion: Rows to be filled with position, velocity and acceleration, of shape (3, 2).
    """
    whole = np.empty((3, len(lively)))
    blend(lively, dt, calm, calm_dt, share, whole)
    whole[0] -= origin
    for order in range(3):
        for axis in range(2):
            total = 0.0
            for k in range(len(lively)):
                total += axes[axis, k] * whole[order, k]
            motion[order, axis] = total


# Whether a camera swings to and fro, told by its places.


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
    middle = np.empty(3)
    products = np.empty((3, 3))
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
        first = matrix[i, p]
        second = matrix[i, q]
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
    """How far what is seen moves for each meter of a camera, by least squares.

    Args:
        eyes: Places of the camera, of shape (n, 3), in m, not all the same.
        lines: Ways to what is seen for each meter of depth, of shape (n, 3).
        depth: Depth in m at which it is believed to be.

    Returns:
        The slope, and the share of what the target seems to move that it explains.
    """
    count = len(eyes)
    eye = np.zeros(3)
    seen = np.zeros(3)
    for index in range(count):
        for i in range(3):
            eye[i] += eyes[index, i] / count
            seen[i] += (eyes[index, i] + depth * lines[index, i]) / count
    both = 0.0
    swung = 0.0
    moved = 0.0
    for index in range(count):
        for i in range(3):
            off = eyes[index, i] - eye[i]
            place = eyes[index, i] + depth * lines[index, i] - seen[i]
            both += place * off
            swung += off * off
            moved += place * place
    slope = both / swung
    return slope, slope * both / moved if moved > 0.0 else 0.0


# Whether newest sightings of a target are elsewhere than its first ones; see `RestDetector`.


COLUMNS: Final = 5
"""Numbers of a sighting: place of the camera along the plane (2), slope (2), variance."""

VARIANCE: Final = 4

FIRST: Final = 24
"""First sightings that make a mean."""

FEWEST: Final = 3
"""Newest sightings all of which have to be elsewhere."""

_SIGMAS: Final = 6.0  # of a mean: exceeded at rest once in 10⁷ frames, and by 2.5 mm hardly ever
_DOUBLINGS: Final = 5  # of the count of newest sightings whose mean is compared


@kernel
def scatter(newest: Matrix, depth: float) -> float:
    """Standard deviation of a sighting along an axis: as expected, or as seen if that is more.

    Seen in third differences, which smooth movement does not enter (with first ones: Rice,
    Annals of Statistics 12, 1984).
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
    """Whether the newest sightings, of however many, are farther from the first ones than `far`.

    Args:
        rows: Sightings of late, oldest first, of shape (n, `COLUMNS`).
        leaving: Number of those that are no more among the newest.
        firsts: Means of the first ones, by slope, of shape (m, `COLUMNS`).
        depth: Distance at which the target is believed to be, in m.
        doubt: Factor by which it may be larger or smaller.
        far: Distance in m.
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
    """Whether all of the last are: one or two sightings far off move a mean, too."""
    apart = True
    for number in range(len(newest) - FEWEST, len(newest)):
        apart = apart and _excess(newest[number], then, 0.0, depth, doubt) > far
    return apart


@kernel
def _excess(now: Vector, then: Vector, allowed: float, depth: float, doubt: float) -> float:
    """How far it moved at least, in m, less what the scatter explains, whatever the depth.

    The least of |e + z s| - z a over z, the depth as a share of the believed one: of a convex
    function, in closed form.
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
