"""Timing of motions: along a path, from point to point, and to a stop."""

from __future__ import annotations

import numpy as np
import ruckig

from bt_dualarm.motion.timing.path_timing import shortest_time, time_path
from bt_dualarm.motion.timing.ruckig_solver import answer
from bt_dualarm.motion.timing.trajectory import Trajectory
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.robots.robot import JointLimits

__all__ = ["point_to_point", "shortest_time", "stop", "time_path"]

_NOWHERE = 1e-12
"""Joint distance in rad below which there is no motion."""


def point_to_point(
    q0: Vector, q1: Vector, limits: JointLimits, dt: float, min_duration: float = 0.0
) -> Trajectory:
    """From rest to rest on the straight line in joint space, as fast as the limits allow.

    Args:
        q0: Start, of shape (dof,), within the position limits.
        q1: Goal, of shape (dof,), within the position limits.
        limits: Velocity, acceleration and jerk to keep.
        dt: Time between set-points in seconds.
        min_duration: Take at least this long, in seconds.

    Raises:
        Failure: ``NO_PLAN`` where Ruckig finds no motion.
        ValueError: A configuration is not finite or outside the position limits.
    """
    for name, q in (("start", q0), ("goal", q1)):
        if not np.all((q >= limits.lower - 1e-9) & (q <= limits.upper + 1e-9)):
            raise ValueError(f"the {name} {np.round(q, 4).tolist()} is outside the position limits")
    way = q1 - q0
    length = float(np.abs(way).max())
    if length < _NOWHERE:
        return Trajectory.rest(q1, dt)
    # One motion along the line: Ruckig's phase synchronisation leaves the line, without a word,
    # where one joint bounds the velocity and another one the acceleration.
    velocity, acceleration, jerk = _limits_along(way, limits)
    request = _request(np.zeros(1), np.zeros(1), np.zeros(1), velocity, acceleration)
    request.target_position = [1.0]
    if min_duration > 0.0:
        request.minimum_duration = min_duration
    place, rate, bend = _sampled(request, jerk, dt)
    place[-1], rate[-1], bend[-1] = 1.0, 0.0, 0.0
    q = q0 + place * way
    q[-1] = q1
    return Trajectory(dt, q, rate * way, bend * way)


def stop(q: Vector, v: Vector, a: Vector, limits: JointLimits, dt: float) -> Trajectory:
    """From motion to rest, each joint as fast as its limits allow.

    It keeps velocity, acceleration and jerk limits if ``v`` and ``a`` do. Where the arm comes to
    rest follows from them: a joint that is too fast near a position limit passes it.

    Args:
        q: Position of shape (dof,), rad.
        v: Velocity of shape (dof,), rad/s.
        a: Acceleration of shape (dof,), rad/s².
        limits: Acceleration and jerk to brake with.
        dt: Time between set-points in seconds.

    Raises:
        Failure: ``NO_PLAN`` where Ruckig finds no motion.
    """
    request = _request(q, v, a, limits.velocity, limits.acceleration)
    request.control_interface = ruckig.ControlInterface.Velocity
    request.synchronization = ruckig.Synchronization.No
    position, velocity, acceleration = _sampled(request, limits.jerk, dt)
    velocity[-1], acceleration[-1] = 0.0, 0.0
    return Trajectory(dt, position, velocity, acceleration)


def _limits_along(way: Vector, limits: JointLimits) -> tuple[Vector, Vector, Vector]:
    """Velocity, acceleration and jerk of the share of a straight line, each of shape (1,)."""
    moving = np.abs(way) > 0.0
    velocity, acceleration, jerk = (
        np.array([(limit[moving] / np.abs(way[moving])).min()])
        for limit in (limits.velocity, limits.acceleration, limits.jerk)
    )
    return velocity, acceleration, jerk


def _request(
    q: Vector, v: Vector, a: Vector, velocity: Vector, acceleration: Vector
) -> ruckig.InputParameter:
    """A state and limits, each of shape (dof,), for Ruckig; it ends at rest.

    Ruckig takes lists of the wrong length and loses an item that is set in place: every list is
    assigned whole, from an array whose shape has been checked.

    Raises:
        ValueError: A shape differs, or a number is not finite.
    """
    for values in (q, v, a):
        if values.shape != velocity.shape or not np.isfinite(values).all():
            raise ValueError(f"not {len(velocity)} finite numbers: {values.tolist()}")
    request = ruckig.InputParameter(len(velocity))
    request.current_position = q.tolist()
    request.current_velocity = v.tolist()
    request.current_acceleration = a.tolist()
    request.target_velocity = request.target_acceleration = [0.0] * len(velocity)
    request.max_velocity = velocity.tolist()
    request.max_acceleration = acceleration.tolist()
    return request


def _sampled(
    request: ruckig.InputParameter, jerk: Vector, dt: float
) -> tuple[Matrix, Matrix, Matrix]:
    """Ruckig's answer on the grid ``dt``, to its end or less than ``dt`` later: (n, dof) each."""
    motion = answer(request, jerk)
    count = int(np.ceil(motion.duration / dt - 1e-9))
    times = np.minimum(np.arange(count + 1) * dt, motion.duration).tolist()
    rows = np.array([motion.at_time(time) for time in times])
    return rows[:, 0], rows[:, 1], rows[:, 2]
