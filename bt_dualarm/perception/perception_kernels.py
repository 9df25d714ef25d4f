"""Compiled kernels of perception: coverage and outlines in images, and filters of targets."""

from __future__ import annotations

import math
from typing import Final, TypeAlias

import numpy as np
import numpy.typing as npt

from bt_dualarm.core.kernel import kernel
from bt_dualarm.core.pose import Matrix, Vector

Indices: TypeAlias = npt.NDArray[np.int64]

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
"""Minimum frequency in rad/s: avoids a division by zero, indistinguishable from 0."""


@kernel
def swing(state: Matrix, dt: float, moved: Matrix) -> None:
    """Evaluate the sine through position, velocity and acceleration ``dt`` seconds on.

    Args:
        state: States of shape (n, 4).
        dt: Seconds.
        moved: Output: the states at that time, of the same shape.
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
    """Like `blend`, along some axes.

    Args:
        fast: State of the fast filter, of shape (n, 4).
        dt: Seconds of its prediction.
        slow: State of the slow filter, of shape (n, 4).
        slow_dt: Seconds of its prediction.
        share: Weight of the slow filter, from 0 to 1.
        axes: Unit vectors, of shape (k, n).
        origin: Origin of the positions, of shape (n,).
        motion: Takes position, velocity and acceleration, of shape (3, k).
    """
    whole = np.empty((3, len(fast)))
    blend(fast, dt, slow, slow_dt, share, whole)
    whole[0] -= origin
    for order in range(3):
        for axis in range(len(axes)):
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
def last_swing(places: Matrix, leg: float, legs: int) -> Indices:
    """Indices of the positions at which the last legs to and fro began and ended.

    None, an empty array, if there are fewer legs; otherwise of shape (legs + 1,).

    A leg is a monotonic motion along the principal axis of the positions.

    Args:
        places: Positions, of shape (n, 3), m; at least one.
        leg: Minimum length of a leg, m.
        legs: Number of legs.
    """
    middle = np.empty(3)
    products = np.empty((3, 3))
    # The diagonal of the bounding box is an upper bound of the extent along any direction.
    if spread(places, middle, products) < _ROUNDING_FACTOR * leg:
        return np.empty(0, np.int64)
    return swing_turns(places, middle, longest_axis(products), leg, legs)


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
def swing_turns(places: Matrix, middle: Vector, axis: Vector, leg: float, legs: int) -> Indices:
    """Indices of the positions at which the last legs to and fro began and ended.

    The first and the last position end a leg, too. As `last_swing`.

    Args:
        places: Positions, of shape (n, 3), m.
        middle: Origin of the coordinate along the axis, of shape (3,), m.
        axis: Unit vector of the legs' direction, of shape (3,).
        leg: Minimum length of a leg, m.
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
    last: Indices = turns[count - legs - 1 : count].copy() if count > legs else turns[:0]
    return last


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

_SIGMAS: Final = 6.0  # standard deviations of a mean: at rest exceeded once in 10⁷ frames
_DOUBLINGS: Final = 5  # doublings of the number of newest sightings that are averaged


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
    """Minimum displacement in m beyond what the scatter explains, over all possible depths.

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


# Pixel coverage
#
# Each step replaces a function of OpenCV, with the same rounding: for the few pixels of one target
# the call overhead would dominate.


_Mask: TypeAlias = npt.NDArray[np.uint8]
_Share: TypeAlias = npt.NDArray[np.float32]

_TILE: Final = 32
"""Edge of a tile in pixels: OpenCV sums up moments in tiles, which determines the rounding."""

_REACH: Final = 2
"""Pixels to either side over which the extremes of a neighborhood are taken."""


@kernel
def cover(rgb: _Mask, filled: _Mask, share: _Share) -> None:
    """Compute the fraction of each pixel that the target covers; see `detection.coverage`.

    Args:
        rgb: Colors, of shape (h, w, 3).
        filled: Mask of the pixels within the outline, of shape (h, w).
        share: Takes the shares, of shape (h, w).
    """
    height, width = filled.shape
    near = np.empty((height, width), np.uint8)
    inside = np.empty((height, width), np.uint8)
    _dilate_and_erode(filled, near, inside)
    along = _along(rgb, filled, near)
    lowest, highest = _extremes(along)
    for row in range(height):
        for column in range(width):
            if inside[row, column] != 0:
                share[row, column] = 1.0
            elif near[row, column] != 0:
                low = lowest[row, column]
                high = highest[row, column]
                for x in range(max(column - _REACH, 0), min(column + _REACH + 1, width)):
                    low = min(low, lowest[row, x])
                    high = max(high, highest[row, x])
                span = max(high - low, np.float32(1.0))
                share[row, column] = (along[row, column] - low) / span
            else:
                share[row, column] = 0.0


@kernel
def _dilate_and_erode(filled: _Mask, near: _Mask, inside: _Mask) -> None:
    """Dilate a mask into ``near`` and erode it into ``inside``, by 3 by 3 pixels."""
    height, width = filled.shape
    wide = height + 2, width + 2
    some = np.zeros(wide, np.uint8)
    every = np.empty(wide, np.uint8)
    every[:] = 255  # erosion treats pixels beyond the border as filled
    some[1:-1, 1:-1] = filled
    every[1:-1, 1:-1] = filled
    for row in range(height):
        above = some[row]
        here = some[row + 1]
        below = some[row + 2]
        for column in range(width + 2):
            above[column] |= here[column] | below[column]
        for column in range(width):
            near[row, column] = above[column] | above[column + 1] | above[column + 2]
        above = every[row]
        here = every[row + 1]
        below = every[row + 2]
        for column in range(width + 2):
            above[column] &= here[column] & below[column]
        for column in range(width):
            inside[row, column] = above[column] & above[column + 1] & above[column + 2]


@kernel
def _along(rgb: _Mask, filled: _Mask, near: _Mask) -> _Share:
    """Project colors to the line from the background's mean color to the target's, (h, w)."""
    line = _line(rgb, filled, near)
    red = np.float64(line[0])
    green = line[1]
    blue = np.float64(line[2])
    along = np.empty(filled.shape, np.float32)
    for row in range(rgb.shape[0]):
        for column in range(rgb.shape[1]):
            # Rounded after each sum, not before: OpenCV uses fused multiply-add where it can.
            part = green * np.float32(rgb[row, column, 1])
            part = np.float32(red * rgb[row, column, 0] + np.float64(part))
            along[row, column] = np.float32(blue * rgb[row, column, 2] + np.float64(part))
    return along


@kernel
def _line(rgb: _Mask, filled: _Mask, near: _Mask) -> _Share:
    """Difference of the mean colors of target and background, of shape (3,)."""
    target = np.zeros(3)
    background = np.zeros(3)
    count = 0
    others = 0
    for row in range(rgb.shape[0]):
        for column in range(rgb.shape[1]):
            if filled[row, column] != 0:
                count += 1
                for channel in range(3):
                    target[channel] += rgb[row, column, channel]
            if near[row, column] == 0:
                others += 1
                for channel in range(3):
                    background[channel] += rgb[row, column, channel]
    line = np.empty(3, np.float32)
    for channel in range(3):
        mean = target[channel] * (1.0 / count) if count else 0.0
        line[channel] = mean - (background[channel] * (1.0 / others) if others else 0.0)
    return line


@kernel
def _extremes(along: _Share) -> tuple[_Share, _Share]:
    """Minimum and maximum over the vertical neighborhood of each pixel, of shape (h, w)."""
    height, width = along.shape
    lowest = along.copy()
    highest = along.copy()
    for row in range(height):
        for other in range(max(row - _REACH, 0), min(row + _REACH + 1, height)):
            low = lowest[row]
            high = highest[row]
            values = along[other]
            for column in range(width):
                value = values[column]
                low[column] = value if value < low[column] else low[column]
                high[column] = value if value > high[column] else high[column]
    return lowest, highest


@kernel
def weigh(share: _Share) -> tuple[float, float, float]:
    """Moments m00, m10 and m01 of an image of shape (h, w)."""
    height, width = share.shape
    total = 0.0
    by_column = 0.0
    by_row = 0.0
    for top in range(0, height, _TILE):
        for left in range(0, width, _TILE):
            own = 0.0
            own_by_column = 0.0
            own_by_row = 0.0
            for y in range(min(_TILE, height - top)):
                line = 0.0
                line_by_column = 0.0
                for x in range(min(_TILE, width - left)):
                    value = float(share[top + y, left + x])
                    line += value
                    line_by_column += x * value
                own += line
                own_by_column += line_by_column
                own_by_row += y * line
            total += own
            by_column += own_by_column + left * own
            by_row += own_by_row + top * own
    return total, by_column, by_row


@kernel
def measure_coverage(rgb: _Mask, raw: _Mask, filled: _Mask) -> tuple[float, float, float, int, int]:
    """Measure one target.

    Args:
        rgb: Colors, of shape (h, w, 3).
        raw: Mask of the pixels with the target's color, of shape (h, w).
        filled: Mask of the pixels within the outline, of the same shape.

    Returns:
        Moments of the coverage (see `weigh`), number of pixels within the outline, and number of
        those with the color.
    """
    share = np.empty(filled.shape, np.float32)
    cover(rgb, filled, share)
    total, by_column, by_row = weigh(share)
    count = 0
    colored = 0
    for row in range(filled.shape[0]):
        for column in range(filled.shape[1]):
            if filled[row, column] != 0:
                count += 1
                colored += 1 if raw[row, column] != 0 else 0
    return total, by_column, by_row, count, colored


# Outline residuals

# Unknowns: position, rotation, rotation and shift of the mount (three each), focal length, rim.
_TURN: Final = 3
_MOUNT_TURN: Final = 6
_MOUNT_SHIFT: Final = 9
_FOCAL: Final = 12
_RIM: Final = 13


@kernel
def see(
    about: Matrix, offset: Vector, inward: Matrix, mount: Matrix, focals: tuple[float, float],
    pixels: Matrix, change: npt.NDArray[np.float64],
) -> float:  # fmt: skip
    """Project points into an image, with derivatives; returns their smallest depth, m.

    If the smallest depth is not positive, nothing is entered.

    Args:
        about: Points relative to the object's center, in the world's axes, of shape (n, 3), m.
        offset: Center relative to the camera, of shape (3,), m.
        inward: Camera's axes as columns in the world, of shape (3, 3).
        mount: Camera's axes as columns in the nominal camera frame, of shape (3, 3).
        focals: Estimated and nominal focal length, px.
        pixels: Takes positions relative to the image center, of shape (n, 2), px.
        change: Takes their derivatives with respect to the unknowns, of shape (n, 2, 14).
    """
    places = _from_camera(about, offset, inward)
    least: float = places[:, 2].min()
    if least <= 0.0:
        return least
    by_point = np.zeros(3)
    by_place = np.empty(3)
    for number in range(len(about)):
        local = places[number]
        for side in range(2):
            flat = local[side] / local[2]
            pixels[number, side] = focals[0] * flat
            by_point[0] = by_point[1] = 0.0
            by_point[side] = focals[0] / local[2]
            by_point[2] = -pixels[number, side] / local[2]
            entry = change[number, side]
            for axis in range(3):
                by_place[axis] = 0.0
                shift = 0.0
                for own in range(3):
                    by_place[axis] += by_point[own] * inward[axis, own]
                    shift += by_point[own] * mount[axis, own]
                entry[axis] = by_place[axis]
                entry[_MOUNT_SHIFT + axis] = -shift
            for axis in range(3):
                after = (axis + 1) % 3
                last = (axis + 2) % 3
                entry[_TURN + axis] = about[number, after] * by_place[last]
                entry[_TURN + axis] -= about[number, last] * by_place[after]
                entry[_MOUNT_TURN + axis] = local[last] * by_point[after]
                entry[_MOUNT_TURN + axis] -= local[after] * by_point[last]
            entry[_FOCAL] = focals[1] * flat
            entry[_RIM] = 0.0
    return least


@kernel
def _from_camera(about: Matrix, offset: Vector, inward: Matrix) -> Matrix:
    """Transform points to the camera, of shape (n, 3), m; arguments as for `see`."""
    places = np.zeros((len(about), 3))
    for number in range(len(about)):
        for own in range(3):
            for axis in range(3):
                places[number, own] += (offset[axis] + about[number, axis]) * inward[axis, own]
    return places


@kernel
def measure_outline(
    corners: Matrix, ends: npt.NDArray[np.float64], edge: Matrix, beyond: float,
    error: Vector, jacobian: Matrix,
) -> None:  # fmt: skip
    """Signed distances of points from a convex outline, positive outside, with derivatives.

    Args:
        corners: Corners of the outline, in order, of shape (m, 2), px.
        ends: Their derivatives with respect to the unknowns, of shape (m, 2, 14).
        edge: Points, of shape (n, 2), px.
        beyond: Offset that is added to each distance, px.
        error: Takes the distances, of shape (n,), px.
        jacobian: Takes their derivatives, of shape (n, 14).
    """
    sides = _sides(corners)
    for number in range(len(edge)):
        error[number] = -math.inf
        best = 0
        for side in range(len(sides)):
            apart = edge[number, 0] * sides[side, 0] + edge[number, 1] * sides[side, 1]
            if apart - sides[side, 2] > error[number]:
                error[number] = apart - sides[side, 2]
                best = side
        error[number] += beyond
        u = sides[best, 0]
        v = sides[best, 1]
        after = (best + 1) % len(sides)
        share = (edge[number, 0] - corners[best, 0]) * sides[best, 3]
        share = (share + (edge[number, 1] - corners[best, 1]) * sides[best, 4]) / sides[best, 5]
        share = min(max(share, 0.0), 1.0)
        for unknown in range(ends.shape[2]):
            across = (1.0 - share) * ends[best, 0, unknown] + share * ends[after, 0, unknown]
            down = (1.0 - share) * ends[best, 1, unknown] + share * ends[after, 1, unknown]
            jacobian[number, unknown] = -(u * across + v * down)
        jacobian[number, _RIM] = -1.0


@kernel
def _sides(corners: Matrix) -> Matrix:
    """Sides of a polygon: outward normal (2), offset, direction (2), squared length; (m, 6)."""
    count = len(corners)
    middle = np.zeros(2)
    sides = np.empty((count, 6))
    for number in range(count):
        after = (number + 1) % count
        x = corners[after, 0] - corners[number, 0]
        y = corners[after, 1] - corners[number, 1]
        length = max(math.sqrt(x * x + y * y), 1e-9)
        sides[number, 0] = y / length
        sides[number, 1] = -x / length
        sides[number, 3] = x
        sides[number, 4] = y
        sides[number, 5] = length**2
        middle += corners[number] / count
    inside = sides[0, 0] * (middle[0] - corners[0, 0]) + sides[0, 1] * (middle[1] - corners[0, 1])
    for number in range(count):
        if inside > 0.0:
            sides[number, 0], sides[number, 1] = -sides[number, 0], -sides[number, 1]
        sides[number, 2] = (
            corners[number, 0] * sides[number, 0] + corners[number, 1] * sides[number, 1]
        )
    return sides
