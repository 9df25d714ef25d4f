"""Kernels of visual servoing in a plane or in space, within the joint limits.

`servo_step` is the entry point.

Three nested loops, each of which asks no more of the next than that one can still undo (cascade
control, Siciliano et al., Robotics, 8.3; the profiles are those of rest-to-rest motion, Biagiotti
and Melchiorri, Trajectory Planning for Automatic Machines and Robots, 3.4):

- Desired velocity: that of the target plus ``c·e`` along the error ``e``, but no faster than the
  tool can brake from before it arrives, and gently over the last distance.
- Desired acceleration: that of the target plus ``b·s`` along the velocity error ``s``, but no more
  than can fade before the velocity is reached.
- The commanded acceleration approaches the desired one by the share ``f`` per period, or by the
  jerk limit.

Near the target no limit is active, and the error is that of a linear system with three poles, which
are placed for the sampled system (`pole_gains`).
"""

from __future__ import annotations

import math

import numpy as np

from bt_dualarm.control.kernel_rows import (
    ACCELERATION,
    ANGLE_ERROR,
    BRAKING_BANDWIDTH,
    DAMPING,
    DISPLACEMENT,
    FADE_JERK,
    HELD,
    HOLD_A,
    HOLD_BANDWIDTH,
    INVERSE,
    JACOBIAN,
    JACOBIAN_BEFORE,
    LOST,
    LOST_M,
    LOST_RAD,
    NEEDED,
    NOW_A,
    NOW_Q,
    NOW_V,
    PLANE_ERROR,
    PLANE_LIMITS,
    PLANE_RATES,
    POSTURE,
    POSTURE_BANDWIDTH,
    TOO_LATE,
    VELOCITY,
    Gains,
    PlaneLimits,
)
from bt_dualarm.core.kernel import kernel
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.kinematics.chain_kernel_arrays import (
    LOWER,
    MAX_ACCELERATION,
    MAX_JERK,
    MAX_VELOCITY,
    UPPER,
)
from bt_dualarm.kinematics.chain_kernels import solve_rows, tool_pose_and_jacobian
from bt_dualarm.trajectory.trajectory_kernels import can_stop

# Shares of the limits that are used for planning; the rest is reserved for feedback.

_STOP_ACCELERATION = 0.5
"""Fraction of the acceleration limit for stopping before a position limit."""

_TOP_SHARE = 0.95
"""Fraction of the velocity limit."""

_BRAKE_ACCELERATION = 0.5
"""Fraction of the plane acceleration for braking before the target, from afar."""

_BRAKE_JERK = 0.35
"""Fraction of the plane jerk for braking before the target, from afar."""

_HURRY_JUMPS = 6.5
"""Distance within which the tool hurries all the same, in jumps ``slack`` of the estimate: 1.3 mm
with images of 60 Hz that are 20 ms old. It is what remains where nothing surprises, and grows with
the error of the prediction."""

_NEAR_M = 0.02
"""Distance down to which the tool closes in as from afar, m; between both with the shares below."""

_NEAR_ACCELERATION = 0.06
"""Fraction of the plane acceleration for closing the last distance."""

_NEAR_JERK = 0.02
"""Fraction of the plane jerk for closing the last distance.

A target that is followed leaves the arm only what it does not need itself, and a prediction errs in
velocity and acceleration before it errs in position. An arm that hurries to close a distance has to
undo that speed when the next image contradicts: it overshoots and needs longer. On 90 motions of
`benchmarks.servo_law`, which need 80 % of an arm's speed, shares of 0.015 and 0.04 have a smaller
mean error; but the arm then closes in so slowly that the shipped job misses its 1 mm RMS.
A trust of 0.8 is about the best there among 220 random variations; `_HURRY_JUMPS` was chosen by
hand: less would be better there, but worse on the shipped circle at 30 Hz.
"""

_NEED_FADES_S = 1.0
"""Time constant with which a need of the target is forgotten, s. An acceleration turns or ends, and
comes back: an arm that hurries in between has too much speed then."""

_LEAST_SPARE = 0.1
"""Least fraction of the limits with which the tool closes a distance, however much the target
needs."""

_TRUSTED_ACCELERATION = 0.8
"""Fraction of the target's predicted acceleration that is fed forward.

The best linear prediction of an acceleration from noisy positions is smaller than its estimate, and
the loops below make up for the rest.
"""

_BRAKING_SHARE = 0.3
"""Share per period by which the acceleration approaches the braking one, without a target."""

# Prediction of a stop

_STOP_STEP_S = 0.005  # of the integration
_STOP_SHARE = 0.6  # by which the acceleration approaches the wanted one in one of its steps
_STOPPED = 0.01  # fraction of the velocity that counts as rest
_LONGEST_STOP_S = 2.0


@kernel
def servo_step(
    period: float,
    bandwidth: float,
    slack: float,
    time_scale: float,
    has_target: bool,
    target: Matrix,
    links: Matrix,
    frames: Matrix,
    plane: Matrix,
    followed: int,
    work: Matrix,
    seen: Vector,
    result: Matrix,
) -> int:
    """Compute the acceleration of this set-point; integrate to the next and observe the tool there.

    Args:
        period: Seconds between set-points.
        bandwidth: Upper bound of the following bandwidth, rad/s.
        slack: Jump of the target that may use all of the jerk, m.
        time_scale: Fraction of the desired velocity that the guard allows.
        has_target: Whether there is a target; if not, the tool comes to rest.
        target: Position, velocity and acceleration along the axes, of shape (3, 3); zeros along an
            axis that is not followed.
        links: As in `observe_tool`.
        frames: As in `observe_tool`.
        plane: As in `observe_tool`.
        followed: As in `observe_tool`.
        work: Servo state after `observe_tool`.
        seen: Tool motion after `observe_tool`.
        result: Output: acceleration, next position, next velocity, of shape (3, dof).

    Returns:
        `HELD`, `LOST`, or `TOO_LATE`; after the last the tool has not been observed.
    """
    desired = np.empty(3)
    share = _BRAKING_SHARE
    if has_target:
        share = _follow_target(period, bandwidth, slack, time_scale, target, work, seen, desired)
    else:
        slowing = -seen[VELOCITY : VELOCITY + 3]
        desired[:] = fading_acceleration(slowing, 2.0 * BRAKING_BANDWIDTH, seen[PLANE_LIMITS + 1])
    limit_acceleration(
        work, seen[ACCELERATION : ACCELERATION + 3], desired, share, period, result[0]
    )
    if not _integrate(work, period, result):
        return TOO_LATE
    work[NOW_A] = result[0]
    work[NOW_Q] = result[1]
    work[NOW_V] = result[2]
    return HELD if observe_tool(links, frames, plane, followed, period, work, seen) else LOST


@kernel
def _follow_target(
    period: float,
    bandwidth: float,
    slack: float,
    time_scale: float,
    target: Matrix,
    work: Matrix,
    seen: Vector,
    desired: Vector,
) -> float:
    """Write the acceleration, of shape (3,), that follows the target; return its share ``f``."""
    reach = PlaneLimits(seen[PLANE_LIMITS], seen[PLANE_LIMITS + 1])
    gains = following_gains(bandwidth, slack, reach.jerk, period)
    away = target[0] - seen[DISPLACEMENT : DISPLACEMENT + 3]
    spare = spare_limits(reach, target[2], period, seen)
    goal = target[1] + closing_velocity(away, gains, spare, _HURRY_JUMPS * slack)
    passed = min(time_scale, stoppable_share(work, goal))
    # The guard's time scale and the position limits slow down the desired velocity alike.
    lack = passed * goal - seen[VELOCITY : VELOCITY + 3]
    desired[:] = fading_acceleration(lack, gains.b, reach.jerk)
    if passed == 1.0:  # slowed down, the tool does not follow the target's acceleration
        desired += _TRUSTED_ACCELERATION * target[2]
    return gains.f


@kernel
def _integrate(work: Matrix, dt: float, result: Matrix) -> bool:
    """Write positions and velocities one period later; return whether all joints can stop."""
    feasible = True
    for i in range(work.shape[1]):
        q = work[NOW_Q, i]
        v = work[NOW_V, i]
        a = result[0, i]
        feasible = feasible and can_stop(work, i, q, v, a)
        # Constant acceleration over the period, so that all three stay consistent.
        result[1, i] = q + v * dt + 0.5 * a * dt * dt
        result[2, i] = v + a * dt
    return feasible


@kernel
def following_gains(bandwidth: float, error: float, jerk: float, period: float) -> Gains:
    """Gains for following a target, as fast as the jerk allows.

    Args:
        bandwidth: Upper bound of the bandwidth, rad/s; two poles are at it or below.
        error: Jump of the target that may use all of the jerk, m.
        jerk: Jerk limit in the plane, m/s³.
        period: Seconds between set-points.
    """
    w = min(bandwidth, jerk_bandwidth(jerk, error))
    # The third pole p is as fast as the jerk allows: w² p e = jerk.
    return pole_gains((w, w, max(w, jerk / (error * w * w))), period)


@kernel
def pole_gains(poles: tuple[float, float, float], period: float) -> Gains:
    """Gains that place the poles of the sampled, unlimited system at ``exp(-pole · period)``.

    With position, velocity and acceleration errors (e, e', e'') as the state, the last one as
    commanded, one period has the characteristic polynomial
    ``z³ - (3 - f - m - k/2) z² + (3 - 2f - m + k/2) z - (1 - f)`` with ``k = f b c T²`` and
    ``m = f b T``; comparing coefficients gives the gains.

    Args:
        poles: Three real poles, positive, rad/s.
        period: Control period ``T``, s.
    """
    x = math.exp(-poles[0] * period)
    y = math.exp(-poles[1] * period)
    z = math.exp(-poles[2] * period)
    f = 1.0 - x * y * z
    k = (1.0 - x) * (1.0 - y) * (1.0 - z)
    m = 3.0 - f - (x + y + z) - 0.5 * k
    return Gains(k / (m * period), m / (f * period), f)


@kernel
def jerk_bandwidth(jerk: float, error: float) -> float:
    """Bandwidth in rad/s at which a position error in m uses all of the jerk in m/s³.

    A system with three poles at ``w`` responds to a step ``e`` with a jerk of ``w³·e``.
    """
    bandwidth: float = np.cbrt(jerk / error)
    return bandwidth


@kernel
def spare_limits(
    reach: PlaneLimits, acceleration: Vector, period: float, seen: Vector
) -> PlaneLimits:
    """Limits that the target's own motion leaves, by what it has needed lately.

    Args:
        reach: Limits along the followed axes.
        acceleration: Predicted acceleration of the target, of shape (3,), m/s².
        period: Seconds between set-points.
        seen: Tool motion, in which the need is kept.
    """
    faded = seen[NEEDED] * math.exp(-period / _NEED_FADES_S)
    seen[NEEDED] = min(max(length(acceleration), faded), reach.acceleration)
    share = max(1.0 - seen[NEEDED] / reach.acceleration, _LEAST_SPARE)
    return PlaneLimits(share * reach.acceleration, share * reach.jerk)


@kernel
def closing_velocity(away: Vector, gains: Gains, reach: PlaneLimits, hurry: float) -> Vector:
    """Velocity toward a target, of shape (3,), m/s.

    Args:
        away: Offset of the target, of shape (3,), m.
        gains: Gains near the target.
        reach: Limits along the followed axes that the target's own motion leaves.
        hurry: Distance within which the tool closes in at full gain, m.
    """
    distance = length(away)
    if distance == 0.0:
        return np.zeros(3)
    far = PlaneLimits(_BRAKE_ACCELERATION * reach.acceleration, _BRAKE_JERK * reach.jerk)
    small = min(distance, hurry)
    speed = min(gains.c * small, braking_speed(small, far))
    # Squares add: by v² = 2 a d the tool then brakes no harder than each part requires.
    if distance > hurry:
        near = PlaneLimits(_NEAR_ACCELERATION * reach.acceleration, _NEAR_JERK * reach.jerk)
        speed = math.hypot(speed, braking_speed(distance - hurry, near))
    if distance > _NEAR_M:
        speed = math.hypot(speed, braking_speed(distance - _NEAR_M, far))
    speed = min(gains.c * distance, speed)
    closing: Vector = away * (speed / distance)
    return closing


@kernel
def braking_speed(distance: float, reach: PlaneLimits) -> float:
    """Speed in m/s from which a point comes to rest within a distance in m.

    Acceleration begins and ends at zero. Up to a speed of ``a²/j`` it does not reach its limit:
    ``d = v·√(v/j)``; above, ``d = v/2·(v/a + a/j)``.
    """
    a, j = reach
    ramp = a / j
    if distance <= a * ramp * ramp:
        speed: float = np.cbrt(distance * distance * j)
        return speed
    return 0.5 * a * (math.sqrt(ramp * ramp + 8.0 * distance / a) - ramp)


@kernel
def length(vector: Vector) -> float:
    """Length of a vector of shape (3,), accurate to the last bit in a plane, where z is 0."""
    return math.hypot(math.hypot(vector[0], vector[1]), vector[2])


@kernel
def fading_acceleration(lack: Vector, gain: float, jerk: float) -> Vector:
    """Acceleration in m/s² for a velocity error in m/s, both of shape (3,).

    ``gain`` times the error, but no more than can fade to zero with a share of the jerk ``j`` by
    the time the error ``s`` is gone: ``s = a²/2j``.
    """
    size = length(lack)
    if size == 0.0:
        return np.zeros(3)
    acceleration: Vector = lack * min(gain, math.sqrt(2.0 * FADE_JERK * jerk / size))
    return acceleration


@kernel
def stoppable_share(work: Matrix, velocity: Vector) -> float:
    """Largest share of a tool velocity, of shape (3,), from which each joint can stop in time."""
    share = math.inf
    for i in range(work.shape[1]):
        turning = _joint_rate(work, i, velocity)
        q = work[NOW_Q, i]
        room = work[UPPER, i] - q if turning > 0.0 else q - work[LOWER, i]
        # v² = 2 a d
        braking = math.sqrt(2.0 * _STOP_ACCELERATION * work[MAX_ACCELERATION, i] * max(room, 0.0))
        most = min(braking, _TOP_SHARE * work[MAX_VELOCITY, i])
        share = min(share, most / max(abs(turning), 1e-9))
    return share


@kernel
def _joint_rate(work: Matrix, joint: int, along: Vector) -> float:
    """Rate of a joint for a rate of the tool along the axes, of shape (3,)."""
    rate: float = work[PLANE_RATES, joint] * along[0]
    rate += work[PLANE_RATES + 1, joint] * along[1]
    rate += work[PLANE_RATES + 2, joint] * along[2]
    return rate


@kernel
def limit_acceleration(
    work: Matrix, now: Vector, desired: Vector, share: float, period: float, a: Vector
) -> None:
    """Write joint accelerations that hold plane and orientation, then move within the limits.

    Holding comes first: only the part of the followed motion that the remaining acceleration and
    jerk of every joint allow is added to it.

    Args:
        work: Servo state.
        now: Current acceleration along the followed axes, of shape (3,), m/s².
        desired: Desired acceleration along them, likewise.
        share: Fraction of the step from one to the other that this period takes.
        period: Seconds between set-points.
        a: Output: joint accelerations, of shape (dof,), rad/s².
    """
    dof = len(a)
    step_a = np.empty(dof)
    low = np.empty(dof)
    high = np.empty(dof)
    # First by the acceleration limits, from holding alone; then by the jerk limits, from what
    # holding and the current plane motion need now.
    for i in range(dof):
        high[i] = work[MAX_ACCELERATION, i]
        low[i] = -high[i]
        step_a[i] = _joint_rate(work, i, desired)
    step = share * (desired * _feasible_share(work[HOLD_A], step_a, low, high) - now)
    for i in range(dof):
        change = work[MAX_JERK, i] * period
        low[i] = work[NOW_A, i] - change
        high[i] = work[NOW_A, i] + change
        step_a[i] = _joint_rate(work, i, step)
        a[i] = work[HOLD_A, i]
        for axis in range(3):
            a[i] += work[PLANE_RATES + axis, i] * now[axis]
    a += _feasible_share(a, step_a, low, high) * step_a
    # Where holding alone breaks a limit, all joints are scaled alike: first to the acceleration
    # limits, then to the jerk limits.
    most = 1.0
    for i in range(dof):
        most = max(most, abs(a[i]) / work[MAX_ACCELERATION, i])
    a /= most
    most = 1.0
    for i in range(dof):
        most = max(most, abs(a[i] - work[NOW_A, i]) / (work[MAX_JERK, i] * period))
    for i in range(dof):
        a[i] = work[NOW_A, i] + (a[i] - work[NOW_A, i]) / most


@kernel
def _feasible_share(start: Vector, step_a: Vector, low: Vector, high: Vector) -> float:
    """Largest share in [0, 1] of a step of shape (dof,) with which all joints stay in bounds."""
    share = 1.0
    for i in range(len(step_a)):
        room = high[i] - start[i] if step_a[i] > 0.0 else start[i] - low[i]
        share = min(share, room / max(abs(step_a[i]), 1e-9))
    return max(share, 0.0)


@kernel
def observe_tool(
    links: Matrix,
    frames: Matrix,
    plane: Matrix,
    followed: int,
    period: float,
    work: Matrix,
    seen: Vector,
) -> bool:
    """Write tool motion, Jacobian and holding accelerations for the next set-point.

    Args:
        links: Links of the arm, see `chain_kernel_arrays`.
        frames: Tool frames, rotation row by row, then position, of shape (3, 12): at the start,
            now, and relative to the last joint with all joints at zero.
        plane: Unit vectors of the plane and its normal in the world, of shape (3, 3).
        followed: Number of these along which the tool follows: 2 in the plane, whose distance is
            then held, or 3 in space.
        period: Seconds between set-points.
        work: Servo state, of shape (SERVO_STATE, dof).
        seen: Tool motion along them, of shape (OBSERVED,).

    Returns:
        Whether the tool is within `LOST_M` and `LOST_RAD` of its plane and orientation.
    """
    tool_pose_and_jacobian(links, work[NOW_Q], frames, work[JACOBIAN : JACOBIAN + 6])
    _invert(work)
    twist = np.empty(6)
    change = np.empty(6)
    for row in range(6):
        twist[row] = change[row] = 0.0
        for i in range(work.shape[1]):
            now = work[JACOBIAN + row, i]
            before = work[JACOBIAN_BEFORE + row, i]
            twist[row] += now * work[NOW_V, i]
            change[row] += (now - before) * work[NOW_V, i] / period  # J' q'
            work[JACOBIAN_BEFORE + row, i] = now
    for axis in range(followed):
        seen[DISPLACEMENT + axis] = seen[VELOCITY + axis] = seen[ACCELERATION + axis] = 0.0
        for along in range(3):
            part = plane[axis, along]
            seen[DISPLACEMENT + axis] += part * (frames[1, 9 + along] - frames[0, 9 + along])
            seen[VELOCITY + axis] += part * twist[along]
            total = change[along]
            for i in range(work.shape[1]):
                total += work[JACOBIAN + along, i] * work[NOW_A, i]
            seen[ACCELERATION + axis] += part * total
    _hold_plane(frames, plane, followed, twist, change, work, seen)
    _plane_limits(plane, followed, work, seen)
    return _is_held(seen)


@kernel
def _is_held(seen: Vector) -> bool:
    """Whether plane distance and orientation error are within their bounds."""
    turn = max(abs(seen[ANGLE_ERROR]), abs(seen[ANGLE_ERROR + 1]), abs(seen[ANGLE_ERROR + 2]))
    held: bool = abs(seen[PLANE_ERROR]) <= LOST_M and turn <= LOST_RAD
    return held


@kernel
def _invert(work: Matrix) -> None:
    """Write the damped right inverse of the Jacobian, ``Jᵀ (J Jᵀ + d I)⁻¹``, transposed."""
    square = np.empty((6, 6))
    for row in range(6):
        for column in range(row + 1):
            total = DAMPING if row == column else 0.0
            for i in range(work.shape[1]):
                total += work[JACOBIAN + row, i] * work[JACOBIAN + column, i]
            square[row, column] = square[column, row] = total
    solve_rows(square, work[JACOBIAN : JACOBIAN + 6], work[INVERSE : INVERSE + 6])


@kernel
def _hold_plane(
    frames: Matrix,
    plane: Matrix,
    followed: int,
    twist: Vector,
    change: Vector,
    work: Matrix,
    seen: Vector,
) -> None:
    """Write accelerations that hold distance to the plane, orientation, and a posture.

    Each error obeys ``e'' + 2we' + w²e = 0`` (critically damped). The posture acts in the null
    space of the Jacobian: its tool acceleration is subtracted from what the tool needs.
    """
    w = HOLD_BANDWIDTH
    dof = work.shape[1]
    error = 0.0
    speed = 0.0
    if followed == 2:
        for axis in range(3):
            error += plane[2, axis] * (frames[0, 9 + axis] - frames[1, 9 + axis])
            speed += plane[2, axis] * twist[axis]
    seen[PLANE_ERROR] = error
    rest = np.zeros(dof)
    if dof > 6:
        for i in range(dof):
            away = work[POSTURE, i] - work[NOW_Q, i]
            rest[i] = POSTURE_BANDWIDTH**2 * away - 2.0 * POSTURE_BANDWIDTH * work[NOW_V, i]
    work[HOLD_A] = rest
    for row in range(6):
        if row < 3:
            desired = (w * w * error - 2.0 * w * speed) * plane[2, row]
        else:
            # Orientation error: half the skew part of R_start R_nowᵀ, an axis times sin(angle).
            one = (row - 2) % 3
            two = (row - 1) % 3
            skew = 0.0
            for along in range(3):
                skew += frames[0, 3 * two + along] * frames[1, 3 * one + along]
                skew -= frames[0, 3 * one + along] * frames[1, 3 * two + along]
            seen[ANGLE_ERROR + row - 3] = 0.5 * skew
            desired = 0.5 * w * w * skew - 2.0 * w * twist[row]
        desired -= change[row]
        for i in range(dof):
            desired -= work[JACOBIAN + row, i] * rest[i]
        for i in range(dof):
            work[HOLD_A, i] += work[INVERSE + row, i] * desired


@kernel
def _plane_limits(plane: Matrix, followed: int, work: Matrix, seen: Vector) -> None:
    """Write joint rates per unit of followed velocity, and the limits that follow from them."""
    seen[PLANE_LIMITS] = seen[PLANE_LIMITS + 1] = math.inf
    for i in range(work.shape[1]):
        for axis in range(followed):
            work[PLANE_RATES + axis, i] = 0.0
            for along in range(3):
                work[PLANE_RATES + axis, i] += work[INVERSE + along, i] * plane[axis, along]
        in_plane = math.hypot(work[PLANE_RATES, i], work[PLANE_RATES + 1, i])
        per_unit = max(math.hypot(in_plane, work[PLANE_RATES + 2, i]), 1e-6)
        seen[PLANE_LIMITS] = min(seen[PLANE_LIMITS], work[MAX_ACCELERATION, i] / per_unit)
        seen[PLANE_LIMITS + 1] = min(seen[PLANE_LIMITS + 1], work[MAX_JERK, i] / per_unit)


@kernel
def stopping_time(acceleration: float, jerk: float, fade: float, rate: float) -> float:
    """Distance of a stop by the law of `servo_step`, divided by the present velocity, s.

    All quantities are fractions of the present velocity.

    Args:
        acceleration: Limit of the acceleration, 1/s.
        jerk: Limit of the jerk, 1/s².
        fade: Twice the jerk with which an acceleration may fade, 1/s².
        rate: Present acceleration, 1/s.
    """
    left = 1.0
    passed = 0.0
    for _ in range(round(_LONGEST_STOP_S / _STOP_STEP_S)):
        if left <= _STOPPED:
            break
        gain = min(2.0 * BRAKING_BANDWIDTH, math.sqrt(fade / left))
        wanted = max(-gain * left, -acceleration)
        change = jerk * _STOP_STEP_S
        rate += min(max(_STOP_SHARE * (wanted - rate), -change), change)
        passed += left * _STOP_STEP_S
        left += rate * _STOP_STEP_S
    return passed
