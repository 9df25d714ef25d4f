"""Kernels of trajectories: path timing by TOPP-RA, averaged profiles, time scaling, joint limits.

TOPP-RA: x is the squared path speed at a grid point, u the path acceleration from there to the
next. Joint accelerations bound both by rows ``|a u + b x| <= 1`` with ``a >= 0``, two per joint:
the limits hold at both ends of a grid interval. Each step of a pass is a linear program in u and x,
whose solution is the minimum of a few closed-form values.

Joint limits are checked between set-points, and for the ability to stop afterwards; they bound
how long an arm may move freely within the room around it.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from bt_dualarm.collision.distance_kernels import reach
from bt_dualarm.core.kernel import kernel
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.kinematics.chain_kernel_arrays import (
    LOWER,
    MAX_ACCELERATION,
    MAX_JERK,
    MAX_VELOCITY,
    ROUNDING,
    UPPER,
    Stack,
)
from bt_dualarm.trajectory.kernel_arrays import Parabolas, PathOnGrid, Pieces, Spline

SLOWING: Final = 0.1
"""Minimum ratio of squared speeds from one grid point to the next, except for the last one. Without
it, on a sharp bend, the largest speed of a grid point could be one from which the next one is
reached at rest, and the arm would stop there."""

_BELOW: Final = 1.0 - 1e-6
"""Fraction of the largest squared speed of a grid point that is used: at that speed itself a single
acceleration is feasible, and where a joint almost reverses it may be a low one."""


@kernel
def squares_of_rates(path: PathOnGrid, acceleration: Vector, share: Vector) -> Vector:
    """Squared path speeds of the fastest rest-to-rest motion, of shape (n,).

    Args:
        path: Path on its grid of n points.
        acceleration: Joint acceleration limits, of shape (dof,), rad/s².
        share: Fraction of them that may be used at each grid point, of shape (n,).
    """
    count, dof = path.slope.shape
    a = np.empty((count - 1, 2 * dof))
    b = np.empty((count - 1, 2 * dof))
    # Backward: the largest speed from which the end can still be reached at rest.
    reachable = np.zeros(count)
    for i in range(count - 2, -1, -1):
        # From dx/ds = 2 u: x changes by 2 u (s' - s) over a grid interval with constant u.
        step = 2.0 * (path.grid[i + 1] - path.grid[i])
        last = i == count - 2
        _write_rows(path, acceleration, share, i, a[i], b[i])
        most = _largest(a[i], b[i], step, 1.0 if last else 1.0 - SLOWING, path.most[i]) * _BELOW
        steepest = math.inf if last else reachable[i + 1] / SLOWING
        reachable[i] = min(_before(a[i], b[i], step, reachable[i + 1]), most, steepest)
    # Forward: the largest acceleration that stays below it.
    squares = np.zeros(count)
    for i in range(count - 1):
        step = 2.0 * (path.grid[i + 1] - path.grid[i])
        squares[i + 1] = min(_after(a[i], b[i], step, squares[i]), reachable[i + 1])
    return squares


@kernel
def _write_rows(
    path: PathOnGrid, acceleration: Vector, share: Vector, i: int, a: Vector, b: Vector
) -> None:
    """Write the row coefficients of a grid interval, of shape (2 dof,) each."""
    dof = len(acceleration)
    step = 2.0 * (path.grid[i + 1] - path.grid[i])
    for j in range(dof):
        here = acceleration[j] * share[i]
        there = acceleration[j] * share[i + 1]
        # Joint acceleration q' u + q'' x; at the next grid point, x is larger by step * u.
        curvature = path.curvature[i + 1, j] / there
        _write_row(a, b, j, path.slope[i, j] / here, path.curvature[i, j] / here)
        _write_row(a, b, dof + j, path.slope[i + 1, j] / there + step * curvature, curvature)


@kernel
def _write_row(a: Vector, b: Vector, row: int, along: float, across: float) -> None:
    """Write the coefficients of a row, with the sign that makes that of u positive."""
    a[row] = abs(along)
    b[row] = -across if along < 0.0 else across


@kernel
def _largest(a: Vector, b: Vector, step: float, slowing: float, most: float) -> float:
    """Largest x up to ``most`` for which some u is feasible.

    u is feasible while its least upper bound ``(1 - b x) / a`` is not below its greatest lower
    bound, which is ``(-1 - b x) / a`` or the one that keeps the ratio `SLOWING`. The difference of
    the bounds is concave in x: Newton's method from the right, intersecting the two active lines,
    converges in a few iterations.
    """
    x = most
    # Where a joint's slope is zero, its row bounds x alone: the zero-inertia points of the path.
    for k in range(len(a)):
        if a[k] == 0.0 and b[k] != 0.0:
            x = min(x, 1.0 / abs(b[k]))
    while True:
        up = -1
        low = -1
        least = math.inf
        greatest = -slowing * x / step
        for k in range(len(a)):
            if a[k] > 0.0:
                tilt = b[k] * x
                width = 1.0 / a[k]
                if (1.0 - tilt) * width < least:
                    up = k
                    least = (1.0 - tilt) * width
                if (-1.0 - tilt) * width > greatest:
                    low = k
                    greatest = (-1.0 - tilt) * width
        if up < 0:
            return x
        if low < 0:
            slack = step
            rise = b[up] * step - slowing * a[up]
        else:
            slack = a[up] + a[low]
            rise = b[up] * a[low] - b[low] * a[up]
        if rise <= 0.0 or slack / rise >= x:
            return x
        x = slack / rise


@kernel
def _before(a: Vector, b: Vector, step: float, ahead: float) -> float:
    """Largest x from which some u leads to at most ``ahead`` at the next grid point.

    That is the largest x for which every lower bound of u is below ``(ahead - x) / step``.
    """
    x = math.inf
    for k in range(len(a)):
        rise = a[k] - step * b[k]
        if rise > 0.0:
            x = min(x, (a[k] * ahead + step) / rise)
    return x


@kernel
def _after(a: Vector, b: Vector, step: float, here: float) -> float:
    """Largest x at the next grid point: x here plus ``step`` times the least upper bound of u."""
    x = math.inf
    for k in range(len(a)):
        if a[k] > 0.0:
            x = min(x, here + step * (1.0 - b[k] * here) / a[k])
    return x


@kernel
def write_average(profile: Parabolas, width: float, step: float, course: Matrix) -> None:
    """Write the moving average of the path parameter and its first two derivatives.

    Args:
        profile: Path parameter over time.
        width: Width of the average, s.
        step: Seconds between columns; the last one is at the end of the average.
        course: Output: s, ds/dt and d²s/dt², of shape (3, n).
    """
    time, places, rates, bends, areas = profile
    end = time[-1]
    now = 0
    before = 0
    for i in range(course.shape[1]):
        # The average over [early, late] is the difference of the integrals, divided by the width.
        # Both ends move forward only, so that the search for their pieces is amortized.
        late = min(i * step, end + width)
        early = max(late - width, 0.0)
        beyond = max(late - end, 0.0)
        late = min(late, end)
        now = _piece(time, late, now)
        before = _piece(time, early, before)
        t = late - time[now]
        r = rates[now]
        p = places[now]
        b = bends[now]
        area = areas[now] + (p + (r / 2.0 + b * t / 6.0) * t) * t + beyond * places[-1]
        place = p + (r + b * t / 2.0) * t
        rate = r + b * t
        t = early - time[before]
        r = rates[before]
        p = places[before]
        b = bends[before]
        area -= areas[before] + (p + (r / 2.0 + b * t / 6.0) * t) * t
        course[0, i] = area / width
        course[1, i] = (place - p - (r + b * t / 2.0) * t) / width
        course[2, i] = (rate - r - b * t) / width


@kernel
def write_joints(path: Spline, course: Matrix, v: Matrix, a: Matrix) -> None:
    """Write joint velocities and accelerations along a path; at rest at both ends.

    Chain rule: ``v = q'(s) s'`` and ``a = q'(s) s'' + q''(s) s'²``.

    Args:
        path: Path.
        course: s, ds/dt and d²s/dt² at each step, of shape (3, n).
        v: Output: velocities, of shape (n, dof), rad/s.
        a: Output: accelerations, of shape (n, dof), rad/s².
    """
    k = 0
    # Exactly at rest: the average leaves a rounding error.
    v[0] = 0.0
    a[0] = 0.0
    v[-1] = 0.0
    a[-1] = 0.0
    for i in range(1, len(v) - 1):
        place = course[0, i]
        rate = course[1, i]
        bend = course[2, i]
        # The last point of a closed path is the first one of the next period.
        if 0.0 < path.period <= place:
            place -= path.period
        k = _piece(path.knots, place, k)
        along = place - path.knots[k]
        squared = rate * rate
        for j in range(v.shape[1]):
            cube = path.pieces[k, 0, j]
            square = path.pieces[k, 1, j]
            line = path.pieces[k, 2, j]
            slope = line + (2.0 * square + 3.0 * cube * along) * along
            v[i, j] = slope * rate
            a[i, j] = slope * bend + (2.0 * square + 6.0 * cube * along) * squared


@kernel
def write_shares(
    v: Matrix, a: Matrix, step: float, limits: Matrix, most: float, shares: Matrix
) -> int:
    """Write the fraction of its limits that a motion uses at each step, until one is too large.

    Velocities and accelerations count, and their changes until the next step.

    Args:
        v: Velocities, of shape (n, dof), rad/s.
        a: Accelerations, of shape (n, dof), rad/s².
        step: Seconds from one step to the next.
        limits: Velocity, acceleration and jerk limits, of shape (3, dof).
        most: Largest time stretch; a step that needs more ends the search. Stretching by r divides
            velocity by r, acceleration by r² and jerk by r³.
        shares: Output: shares of the velocity, acceleration and jerk limits of the worst joint, of
            shape (3, n).

    Returns:
        Number of steps written.
    """
    # Multiplications instead of divisions in the loop over all samples.
    per = 1.0 / limits
    per_step = 1.0 / step
    last = len(v) - 1
    by_velocity = most
    by_acceleration = most**2
    by_jerk = most**3
    for i in range(len(v)):
        velocity = 0.0
        acceleration = 0.0
        jerk = 0.0
        after = min(i + 1, last)
        for j in range(v.shape[1]):
            change = abs(v[after, j] - v[i, j]) * per_step
            velocity = max(velocity, abs(v[i, j]) * per[0, j])
            acceleration = max(acceleration, max(abs(a[i, j]), change) * per[1, j])
            jerk = max(jerk, abs(a[after, j] - a[i, j]) * per_step * per[2, j])
        shares[0, i] = velocity
        shares[1, i] = acceleration
        shares[2, i] = jerk
        if velocity > by_velocity or acceleration > by_acceleration or jerk > by_jerk:
            return i + 1
    return len(v)


@kernel
def _piece(knots: Vector, at: float, near: int) -> int:
    """Index of the piece that contains a parameter, searched from a nearby piece."""
    piece = near
    while piece < len(knots) - 2 and knots[piece + 1] <= at:
        piece += 1
    while piece > 0 and knots[piece] > at:
        piece -= 1
    return piece


@kernel
def solve_tridiagonal(lower: Vector, diagonal: Vector, upper: Vector, right: Matrix) -> None:
    """Solve a tridiagonal system by Gaussian elimination with partial pivoting.

    The operations are those of LAPACK's ``dgtsv``, in the same order.

    Args:
        lower: Coefficients below the diagonal, of shape (n - 1,); overwritten.
        diagonal: Coefficients on the diagonal, of shape (n,); overwritten.
        upper: Coefficients above the diagonal, of shape (n - 1,); overwritten.
        right: Right-hand sides, of shape (n, k); overwritten with the solutions.
    """
    count, sides = right.shape
    for i in range(count - 1):
        if abs(diagonal[i]) >= abs(lower[i]):
            factor = lower[i] / diagonal[i]
            diagonal[i + 1] -= factor * upper[i]
            for k in range(sides):
                right[i + 1, k] -= factor * right[i, k]
            lower[i] = 0.0
            continue
        # Rows i and i + 1 change places. From now on, `lower` holds the second diagonal above the
        # main one, which only arises by such changes.
        factor = diagonal[i] / lower[i]
        diagonal[i] = lower[i]
        below = diagonal[i + 1]
        diagonal[i + 1] = upper[i] - factor * below
        lower[i] = 0.0
        if i < count - 2:
            lower[i] = upper[i + 1]
            upper[i + 1] *= -factor
        upper[i] = below
        for k in range(sides):
            here = right[i, k]
            right[i, k] = right[i + 1, k]
            right[i + 1, k] = here - factor * right[i + 1, k]
    for i in range(count - 1, -1, -1):
        for k in range(sides):
            value = right[i, k]
            if i < count - 1:
                value -= upper[i] * right[i + 1, k]
            if i < count - 2:
                value -= lower[i] * right[i + 2, k]
            right[i, k] = value / diagonal[i]


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
    """Write set-points at path parameters with a time scale; beyond the end they are at rest.

    Between set-points, positions are interpolated by the cubic that matches positions and
    velocities (Hermite), velocities and accelerations linearly.

    Args:
        q: Positions of the motion, or of the part that is needed, of shape (m, dof), rad.
        v: Velocities, of the same shape, rad/s.
        a: Accelerations, of the same shape, rad/s².
        first: Index of the first of these rows in the motion.
        count: Number of set-points of the motion.
        dt: Seconds between set-points.
        parameters: Path parameter in s, time scale, and its change in 1/s, of shape (n, 3).
        scaled: Output: positions, velocities, accelerations, of shape (3, n, dof).
    """
    for i in range(len(parameters)):
        s = parameters[i, 0]
        rate = parameters[i, 1]
        change = parameters[i, 2]
        place = min(max(s / dt, 0.0), count - 1.0)
        low = min(int(place), max(count - 2, 0))
        u = place - low
        over = s >= (count - 1) * dt
        before = low - first
        after = min(low + 1, count - 1) - first
        for j in range(q.shape[1]):
            start = q[before, j]
            step = q[after, j] - q[before, j]
            # Cubic Hermite interpolation, as the deviation from the straight line.
            bend = (1.0 - u) * (v[before, j] * dt - step) - u * (v[after, j] * dt - step)
            slope = v[before, j] + u * (v[after, j] - v[before, j])
            curve = a[before, j] + u * (a[after, j] - a[before, j])
            scaled[0, i, j] = start + u * step + u * (1.0 - u) * bend
            scaled[1, i, j] = 0.0 if over else rate * slope
            scaled[2, i, j] = 0.0 if over else rate * rate * curve + change * slope


@kernel
def keeps_limits(limits: Matrix, period: float, last: Matrix, desired: Matrix) -> bool:
    """Whether all joints keep their limits from one set-point to the next.

    Checks velocity, acceleration (as given and as the change of velocity), jerk, consistency of
    position with velocity, and whether each joint could still stop before its position limits.

    Args:
        limits: Joint limits, of shape (LIMITS, dof).
        period: Seconds between set-points.
        last: Position, velocity and acceleration of the previous set-point, of shape (3, dof).
        desired: The same of the next set-point.
    """
    factor = 1.0 + ROUNDING
    for i in range(limits.shape[1]):
        q = desired[0, i]
        v = desired[1, i]
        a = desired[2, i]
        max_v = limits[MAX_VELOCITY, i]
        max_a = limits[MAX_ACCELERATION, i]
        # Position minus the trapezoidal integral of velocity: a jump of the position alone.
        drift = q - last[0, i] - 0.5 * period * (v + last[1, i])
        kept = (
            abs(v) <= max_v * factor
            and abs(a) <= max_a * factor
            and abs(v - last[1, i]) <= max_a * period * factor
            and abs(a - last[2, i]) <= limits[MAX_JERK, i] * period * factor
            and abs(drift) <= max_a * period**2
        )
        if not (kept and can_stop(limits, i, q, v, a)):
            return False
    return True


@kernel
def can_stop(limits: Matrix, i: int, q: float, v: float, a: float) -> bool:
    """Whether a joint can keep its limits from a state on; false for a state that is not finite."""
    max_a = limits[MAX_ACCELERATION, i]
    jerk = limits[MAX_JERK, i]
    ahead = q + max_displacement_before_rest(v, a, max_a, jerk)
    # Mirrored for the lower limit.
    behind = q - max_displacement_before_rest(-v, -a, max_a, jerk)
    # Velocity once the acceleration has faded at the jerk limit.
    max_v = abs(v + a * abs(a) / (2.0 * jerk))
    kept: bool = (
        behind >= limits[LOWER, i] - ROUNDING
        and ahead <= limits[UPPER, i] + ROUNDING
        and max_v <= limits[MAX_VELOCITY, i] * (1.0 + ROUNDING)
    )
    return kept


@kernel
def max_displacement_before_rest(v: float, a: float, acceleration: float, jerk: float) -> float:
    """Largest displacement in the positive direction before a joint can come to rest, rad.

    Braking profile: negative jerk limit until the negative acceleration limit, and positive jerk
    limit at the end. From zero acceleration, the velocity of such a profile is point-symmetric, so
    that the distance is half the initial velocity times the duration.

    Args:
        v: Velocity, rad/s.
        a: Acceleration within its limit, rad/s².
        acceleration: Limit of the acceleration, rad/s².
        jerk: Limit of the jerk, rad/s³.
    """
    # The profile begins where the acceleration is zero: ``lead`` seconds from now, or ago.
    lead = a / jerk
    top = max(v + 0.5 * a * lead, 0.0)  # velocity at that time
    if not (v > 0.0 or top > 0.0):
        return 0.0
    if a < 0.0 and 2.0 * jerk * v < a * a:
        # Slower than the end of such a profile: it comes to rest while the acceleration fades.
        root = math.sqrt(max(a * a - 2.0 * jerk * max(v, 0.0), 0.0))
        rest = (-a - root) / jerk
        return max((v + (0.5 * a + jerk * rest / 6.0) * rest) * rest, 0.0)
    ramp = acceleration / jerk
    # With a phase of constant acceleration, or a triangle of two jerk phases.
    long = top >= acceleration * ramp
    duration = top / acceleration + ramp if long else 2.0 * math.sqrt(top / jerk)
    return max((v + a * lead / 3.0) * lead + 0.5 * top * duration, 0.0)


@kernel
def max_displacement(limits: Matrix, i: int, v: float, a: float, seconds: float) -> float:
    """Upper bound in rad of a joint's displacement: any motion for a time, then braking.

    Braking begins with the acceleration fading within ``a/j``. From a speed v it then takes at
    most ``v/a + a/j`` at an average speed of v/2.

    Args:
        limits: Joint limits, of shape (LIMITS, dof).
        i: Index of the joint.
        v: Velocity, rad/s.
        a: Acceleration within its limit, rad/s².
        seconds: Time after which it brakes, s.
    """
    max_v = limits[MAX_VELOCITY, i]
    max_a = limits[MAX_ACCELERATION, i]
    jerk = limits[MAX_JERK, i]
    # Fastest growth of the acceleration, then of the velocity; both within their limits.
    most = min(abs(a) + jerk * seconds, max_a)
    fade = most / jerk
    speed = min(abs(v) + most * seconds, max_v) + 0.5 * most * fade
    turn: float = speed * (seconds + fade + 0.5 * speed / max_a + 0.5 * max_a / jerk)
    return turn


@kernel
def within(scaled: Stack, dt: float, factor: float, limits: Matrix) -> bool:
    """Whether set-points keep the rate limits, each one by itself and from one to the next.

    Args:
        scaled: Positions, velocities, accelerations of a motion, of shape (3, n, dof).
        dt: Seconds between set-points.
        factor: Multiplies the limits, as a tolerance for rounding.
        limits: Velocity, acceleration and jerk limits, of shape (3, dof), rad/s, rad/s², rad/s³.
    """
    v = scaled[1]
    a = scaled[2]
    for i in range(len(v)):
        for j in range(v.shape[1]):
            max_a = limits[1, j]
            if not (abs(v[i, j]) <= limits[0, j] * factor and abs(a[i, j]) <= max_a * factor):
                return False
            # What a controller can observe: differences of consecutive set-points.
            if i and not (
                abs(v[i, j] - v[i - 1, j]) <= max_a * dt * factor
                and abs(a[i, j] - a[i - 1, j]) <= limits[2, j] * dt * factor
            ):
                return False
    return True


@kernel
def longest_free_time(
    room: float,
    waits: Vector,
    levers: Matrix,
    span: float,
    limits: Matrix,
    now: Matrix,
    turns: Vector,
) -> tuple[int, float]:
    """First of several times for which an arm can move freely, and then brake, within the room.

    Args:
        room: Distance that no point of the arm may exceed, m.
        waits: Times in descending order, of shape (n,), s.
        levers: Distances of points from each joint, see `BoundingSpheres.levers`, (m, dof), m.
        span: Largest distance of any point from the first joint, m.
        limits: Joint limits, of shape (5, dof).
        now: Velocities and accelerations, of shape (2, dof), rad/s, rad/s².
        turns: Scratch: displacement of the joints, of shape (dof,), rad.

    Returns:
        Index of the time, -1 for none; and the largest displacement of any point within it, m.
    """
    for k in range(len(waits)):
        for i in range(len(turns)):
            turns[i] = max_displacement(limits, i, now[0, i], now[1, i], waits[k])
        away = reach(levers, turns, span)
        if away <= room:
            return k, away
    return -1, 0.0
