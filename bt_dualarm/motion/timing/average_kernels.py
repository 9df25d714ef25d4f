"""Set-points: what those of an averaged motion ask of limits, and those at other time scales."""

from __future__ import annotations

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.motion.timing.kernel_arrays import Parabolas, Pieces, Spline
from bt_dualarm.pose import Matrix, Vector


@kernel
def enter_average(profile: Parabolas, width: float, step: float, course: Matrix) -> None:
    """Enter the moving average of how far along a path, and its first two derivatives.

    Args:
        profile: How far along the path, over time.
        width: Seconds of the average.
        step: Seconds from one column to the next, but for the last one: the average ends there.
        course: Place, rate and bend, of shape (3, n).
    """
    time, places, rates, bends, areas = profile
    end, now, before = time[-1], 0, 0
    for i in range(course.shape[1]):
        late = min(i * step, end + width)
        early = max(late - width, 0.0)
        beyond, late = max(late - end, 0.0), min(late, end)
        now, before = _piece(time, late, now), _piece(time, early, before)
        t, r, p, b = late - time[now], rates[now], places[now], bends[now]
        area = areas[now] + (p + (r / 2.0 + b * t / 6.0) * t) * t + beyond * places[-1]
        place, rate = p + (r + b * t / 2.0) * t, r + b * t
        t, r, p, b = early - time[before], rates[before], places[before], bends[before]
        area -= areas[before] + (p + (r / 2.0 + b * t / 6.0) * t) * t
        course[0, i] = area / width
        course[1, i] = (place - p - (r + b * t / 2.0) * t) / width
        course[2, i] = (rate - r - b * t) / width


@kernel
def enter_joints(path: Spline, course: Matrix, v: Matrix, a: Matrix) -> None:
    """Enter velocities and accelerations of the joints; at rest at both ends.

    Args:
        path: The path.
        course: Place, rate and bend at each step, of shape (3, n).
        v: Velocities, of shape (n, dof).
        a: Accelerations, of shape (n, dof).
    """
    k = 0
    v[0], a[0], v[-1], a[-1] = 0.0, 0.0, 0.0, 0.0  # but for the rounding of the average
    for i in range(1, len(v) - 1):
        place, rate, bend = course[0, i], course[1, i], course[2, i]
        if 0.0 < path.period <= place:
            place -= path.period
        k = _piece(path.knots, place, k)
        along, squared = place - path.knots[k], rate * rate
        for j in range(v.shape[1]):
            cube, square, line = path.pieces[k, 0, j], path.pieces[k, 1, j], path.pieces[k, 2, j]
            slope = line + (2.0 * square + 3.0 * cube * along) * along
            v[i, j] = slope * rate
            a[i, j] = slope * bend + (2.0 * square + 6.0 * cube * along) * squared


@kernel
def enter_shares(
    v: Matrix, a: Matrix, step: float, limits: Matrix, most: float, shares: Matrix
) -> int:
    """Enter which shares of its limits a motion takes at each step; stops where it takes too much.

    Velocities and accelerations count, and their changes until the next step.

    Args:
        v: Velocities, of shape (n, dof).
        a: Accelerations, of shape (n, dof).
        step: Seconds from one step to the next.
        limits: Largest velocities, accelerations and jerks, of shape (3, dof).
        most: Factor by which time may be stretched; more stops the search.
        shares: Shares of the limits of velocity, acceleration and jerk, of the worst joint, of
            shape (3, n), to be entered.

    Returns:
        How many steps were entered.
    """
    per, per_step, last = 1.0 / limits, 1.0 / step, len(v) - 1
    by_velocity, by_acceleration, by_jerk = most, most**2, most**3
    for i in range(len(v)):
        velocity, acceleration, jerk = 0.0, 0.0, 0.0
        after = min(i + 1, last)
        for j in range(v.shape[1]):
            change = abs(v[after, j] - v[i, j]) * per_step
            velocity = max(velocity, abs(v[i, j]) * per[0, j])
            acceleration = max(acceleration, max(abs(a[i, j]), change) * per[1, j])
            jerk = max(jerk, abs(a[after, j] - a[i, j]) * per_step * per[2, j])
        shares[0, i], shares[1, i], shares[2, i] = velocity, acceleration, jerk
        if velocity > by_velocity or acceleration > by_acceleration or jerk > by_jerk:
            return i + 1
    return len(v)


@kernel
def _piece(knots: Vector, at: float, near: int) -> int:
    """Number of the piece in which something lies, sought from one that is near."""
    piece = near
    while piece < len(knots) - 2 and knots[piece + 1] <= at:
        piece += 1
    while piece > 0 and knots[piece] > at:
        piece -= 1
    return piece


@kernel
def scale(
    q: Matrix,
    v: Matrix,
    a: Matrix,
    first: int,
    count: int,
    dt: float,
    parameters: Matrix,
    scaled: Pieces,
) -> None:
    """Enter set-points at path parameters; what is beyond the end rests.

    Between set-points positions are on the cubic that meets positions and velocities (Hermite),
    velocities and accelerations on straight lines.

    Args:
        q: Positions of the motion, or of all of it that is needed, of shape (m, dof), rad.
        v: Velocities, likewise, rad/s.
        a: Accelerations, likewise, rad/s².
        first: Number of the first of them in the motion.
        count: How many set-points the motion has.
        dt: Seconds from one to the next.
        parameters: s, time scale, its change, of shape (n, 3): s, 1, 1/s.
        scaled: Takes positions, velocities, accelerations, of shape (3, n, dof).
    """
    for i in range(len(parameters)):
        s, rate, change = parameters[i, 0], parameters[i, 1], parameters[i, 2]
        place = min(max(s / dt, 0.0), count - 1.0)
        low = min(int(place), max(count - 2, 0))
        u, over = place - low, s >= (count - 1) * dt
        before, after = low - first, min(low + 1, count - 1) - first
        for j in range(q.shape[1]):
            start, step = q[before, j], q[after, j] - q[before, j]
            bend = (1.0 - u) * (v[before, j] * dt - step) - u * (v[after, j] * dt - step)
            slope = v[before, j] + u * (v[after, j] - v[before, j])
            curve = a[before, j] + u * (a[after, j] - a[before, j])
            scaled[0, i, j] = start + u * step + u * (1.0 - u) * bend
            scaled[1, i, j] = 0.0 if over else rate * slope
            scaled[2, i, j] = 0.0 if over else rate * rate * curve + change * slope
