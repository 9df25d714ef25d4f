"""A servo's set-point in one call: how its joints are accelerated, and where its tool is next."""

from __future__ import annotations

import math

import numpy as np

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.motion.chains.inertia_kernels import solve_rows
from bt_dualarm.motion.chains.kernel_rows import MOST_ACCELERATION, MOST_JERK
from bt_dualarm.motion.chains.limit_kernels import can_stop
from bt_dualarm.motion.chains.place_kernels import place_tool
from bt_dualarm.motion.setpoints.allowance_kernels import keep_within, passable_share
from bt_dualarm.motion.setpoints.following_kernels import (
    closing_velocity,
    fading_acceleration,
    following_gains,
)
from bt_dualarm.motion.setpoints.kernel_rows import (
    ACCELERATION,
    BRAKING_BANDWIDTH,
    DAMPING,
    DISPLACEMENT,
    HELD,
    HOLD,
    HOLD_BANDWIDTH,
    INVERSE,
    JACOBIAN,
    JACOBIAN_BEFORE,
    LOST,
    LOST_M,
    LOST_RAD,
    NOW_A,
    NOW_Q,
    NOW_V,
    OFF,
    POSTURE,
    POSTURE_BANDWIDTH,
    RATES,
    REACH,
    TOO_LATE,
    TURN,
    VELOCITY,
    Reach,
)
from bt_dualarm.pose import Matrix, Vector

_BRAKING_SHARE = 0.3  # of the way to the acceleration that brakes, a period


@kernel
def look(
    links: Matrix, frames: Matrix, plane: Matrix, period: float, work: Matrix, seen: Vector
) -> bool:
    """Enter where the tool is, and what holds it there.

    Args:
        links: Links of the arm, see the rows of `chains`.
        frames: Rotation, row by row, and place of the tool: at the start, now, and, from the last
            joint while all are at zero, of shape (3, 12).
        plane: Unit vectors of the plane and its normal in the world, of shape (3, 3).
        period: Seconds between set-points.
        work: What the servo works with.
        seen: What it sees.

    Returns:
        Whether the tool is in its plane and oriented as it was, by `LOST_M` and `LOST_RAD`.
    """
    place_tool(links, work[NOW_Q], frames, work[JACOBIAN : JACOBIAN + 6])
    _invert(work)
    twist, change = np.empty(6), np.empty(6)
    for row in range(6):
        twist[row] = change[row] = 0.0
        for i in range(work.shape[1]):
            now, before = work[JACOBIAN + row, i], work[JACOBIAN_BEFORE + row, i]
            twist[row] += now * work[NOW_V, i]
            change[row] += (now - before) * work[NOW_V, i] / period
            work[JACOBIAN_BEFORE + row, i] = now
    for axis in range(2):
        seen[DISPLACEMENT + axis] = seen[VELOCITY + axis] = seen[ACCELERATION + axis] = 0.0
        for along in range(3):
            part = plane[axis, along]
            seen[DISPLACEMENT + axis] += part * (frames[1, 9 + along] - frames[0, 9 + along])
            seen[VELOCITY + axis] += part * twist[along]
            total = change[along]
            for i in range(work.shape[1]):
                total += work[JACOBIAN + along, i] * work[NOW_A, i]
            seen[ACCELERATION + axis] += part * total
    _hold(frames, plane, twist, change, work, seen)
    _reach(plane, work, seen)
    return _is_held(seen)


@kernel
def _is_held(seen: Vector) -> bool:
    """Whether the tool is in its plane and oriented as it was."""
    turn = max(abs(seen[TURN]), abs(seen[TURN + 1]), abs(seen[TURN + 2]))
    held: bool = abs(seen[OFF]) <= LOST_M and turn <= LOST_RAD
    return held


@kernel
def _invert(work: Matrix) -> None:
    """Enter the damped right inverse of the Jacobian: ``Jᵀ (J Jᵀ + d)⁻¹``, transposed."""
    square = np.empty((6, 6))
    for row in range(6):
        for column in range(row + 1):
            total = DAMPING if row == column else 0.0
            for i in range(work.shape[1]):
                total += work[JACOBIAN + row, i] * work[JACOBIAN + column, i]
            square[row, column] = square[column, row] = total
    solve_rows(square, work[JACOBIAN : JACOBIAN + 6], work[INVERSE : INVERSE + 6])


@kernel
def _hold(
    frames: Matrix, plane: Matrix, twist: Vector, change: Vector, work: Matrix, seen: Vector
) -> None:
    """Enter accelerations that keep the third axis and the orientation, and a posture."""
    w, dof = HOLD_BANDWIDTH, work.shape[1]
    off, speed = 0.0, 0.0
    for axis in range(3):
        off += plane[2, axis] * (frames[0, 9 + axis] - frames[1, 9 + axis])
        speed += plane[2, axis] * twist[axis]
    seen[OFF] = off
    rest = np.zeros(dof)
    if dof > 6:
        for i in range(dof):
            away = work[POSTURE, i] - work[NOW_Q, i]
            rest[i] = POSTURE_BANDWIDTH**2 * away - 2.0 * POSTURE_BANDWIDTH * work[NOW_V, i]
    work[HOLD] = rest
    for row in range(6):
        if row < 3:
            wanted = (w * w * off - 2.0 * w * speed) * plane[2, row]
        else:
            one, two = (row - 2) % 3, (row - 1) % 3
            skew = 0.0
            for along in range(3):
                skew += frames[0, 3 * two + along] * frames[1, 3 * one + along]
                skew -= frames[0, 3 * one + along] * frames[1, 3 * two + along]
            seen[TURN + row - 3] = 0.5 * skew
            wanted = 0.5 * w * w * skew - 2.0 * w * twist[row]
        wanted -= change[row]
        for i in range(dof):
            wanted -= work[JACOBIAN + row, i] * rest[i]
        for i in range(dof):
            work[HOLD, i] += work[INVERSE + row, i] * wanted


@kernel
def _reach(plane: Matrix, work: Matrix, seen: Vector) -> None:
    """Enter joint rates by those in the plane, and what the joints allow there."""
    seen[REACH] = seen[REACH + 1] = math.inf
    for i in range(work.shape[1]):
        for axis in range(2):
            work[RATES + axis, i] = 0.0
            for along in range(3):
                work[RATES + axis, i] += work[INVERSE + along, i] * plane[axis, along]
        per_unit = max(math.hypot(work[RATES, i], work[RATES + 1, i]), 1e-6)
        seen[REACH] = min(seen[REACH], work[MOST_ACCELERATION, i] / per_unit)
        seen[REACH + 1] = min(seen[REACH + 1], work[MOST_JERK, i] / per_unit)


@kernel
def answer(
    period: float,
    bandwidth: float,
    slack: float,
    time_scale: float,
    has_target: bool,
    target: Matrix,
    links: Matrix,
    frames: Matrix,
    plane: Matrix,
    work: Matrix,
    seen: Vector,
    answered: Matrix,
) -> int:
    """Enter accelerations for now, positions and velocities that come of them, and look from there.

    Args:
        period: Seconds between set-points.
        bandwidth: Largest bandwidth with which it follows, rad/s.
        slack: Jump of the target in m for which it may take all of the jerk.
        time_scale: Share of the velocity that it would have.
        has_target: Whether there is a target, or it comes to rest.
        target: Position, velocity and acceleration in the plane, of shape (3, 2).
        links: Links of the arm, as of `look`.
        frames: Where the tool is, likewise.
        plane: Plane and its normal, likewise.
        work: What the servo works with, after `look`.
        seen: What it sees, likewise.
        answered: Takes acceleration, next position, next velocity, of shape (3, dof).

    Returns:
        `HELD`; `LOST` where the tool will be out of its plane or turned; `TOO_LATE` where not all
        joints could stop within their limits from there: then nobody has looked.
    """
    wanted, share = np.empty(2), _BRAKING_SHARE
    if has_target:
        share = _approach(period, bandwidth, slack, time_scale, target, work, seen, wanted)
    else:
        slowing = -seen[VELOCITY : VELOCITY + 2]
        wanted[:] = fading_acceleration(slowing, 2.0 * BRAKING_BANDWIDTH, seen[REACH + 1])
    keep_within(work, seen[ACCELERATION : ACCELERATION + 2], wanted, share, period, answered[0])
    if not _go_on(work, period, answered):
        return TOO_LATE
    work[NOW_A], work[NOW_Q], work[NOW_V] = answered[0], answered[1], answered[2]
    return HELD if look(links, frames, plane, period, work, seen) else LOST


@kernel
def _approach(
    period: float,
    bandwidth: float,
    slack: float,
    time_scale: float,
    target: Matrix,
    work: Matrix,
    seen: Vector,
    wanted: Vector,
) -> float:
    """Enter the acceleration, of shape (2,), that follows a target; share of it in a period."""
    reach = Reach(seen[REACH], seen[REACH + 1])
    gains = following_gains(bandwidth, slack, reach.jerk, period)
    away = target[0] - seen[DISPLACEMENT : DISPLACEMENT + 2]
    goal = target[1] + closing_velocity(away, gains, reach)
    passed = min(time_scale, passable_share(work, goal))
    lack = passed * goal - seen[VELOCITY : VELOCITY + 2]
    wanted[:] = fading_acceleration(lack, gains.b, reach.jerk)
    if passed == 1.0:
        wanted += target[2]
    return gains.f


@kernel
def _go_on(work: Matrix, dt: float, answered: Matrix) -> bool:
    """Enter positions and velocities a period later; whether all joints can stop until then."""
    feasible = True
    for i in range(work.shape[1]):
        q, v, a = work[NOW_Q, i], work[NOW_V, i], answered[0, i]
        feasible = feasible and can_stop(work, i, q, v, a)
        answered[1, i] = q + v * dt + 0.5 * a * dt * dt
        answered[2, i] = v + a * dt
    return feasible
