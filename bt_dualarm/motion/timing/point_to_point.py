"""Timing of motions: along a path, from point to point, and to a stop."""

from __future__ import annotations

import numpy as np
import ruckig

from bt_dualarm.motion.timing.law import Rows, SetPoints
from bt_dualarm.motion.timing.path_timing import TimedPath, time_path, timed_path
from bt_dualarm.motion.timing.ruckig_solver import answer
from bt_dualarm.motion.timing.trajectory import Trajectory, joined
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.robots.robot import JointLimits

__all__ = ["TimedPath", "point_to_point", "stop", "time_path", "timed_path"]

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
    line = _Straight(q0, q1, _limits_along(way, limits), min_duration, dt)
    return joined(dt, (line,))


class _Straight:
    """The law of a straight motion in joint space, from rest to rest.

    One motion along the line: Ruckig's phase synchronisation leaves the line, without a word,
    where one joint bounds the velocity and another one the acceleration.

    Args:
        q0: Start, of shape (dof,), rad.
        q1: Goal, of shape (dof,), rad.
        limits: Velocity, acceleration and jerk of the share of the line, each of shape (1,).
        min_duration: Least duration in seconds.
        dt: Time between set-points, in seconds.

    Raises:
        Failure: ``NO_PLAN`` where Ruckig finds no motion.
    """

    def __init__(
        self,
        q0: Vector,
        q1: Vector,
        limits: tuple[Vector, Vector, Vector],
        min_duration: float,
        dt: float,
    ) -> None:
        velocity, acceleration, jerk = limits
        request = _request(np.zeros(1), np.zeros(1), np.zeros(1), velocity, acceleration)
        request.target_position = [1.0]
        if min_duration > 0.0:
            request.minimum_duration = min_duration
        self._given = (q0, q1, limits, min_duration, dt)
        self._ends, self._share, self._dt = (q0, q1), answer(request, jerk), dt

    def __reduce__(self) -> tuple[type[_Straight], tuple[object, ...]]:
        """Pickled as what it was made from: Ruckig's trajectories do not pickle."""
        return _Straight, self._given

    def __len__(self) -> int:
        return _count(self._share, self._dt) + 1

    def rows(self, index: Rows) -> SetPoints:
        """Positions, velocities and accelerations of some set-points, each of shape (n, dof)."""
        (q0, q1), last = self._ends, index == len(self) - 1
        place, rate, bend = _at(self._share, index, self._dt)
        place[last], rate[last], bend[last] = 1.0, 0.0, 0.0
        q = q0 + place * (q1 - q0)
        q[last] = q1
        return q, rate * (q1 - q0), bend * (q1 - q0)


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
    return _at(motion, np.arange(_count(motion, dt) + 1), dt)


def _count(motion: ruckig.Trajectory, dt: float) -> int:
    """Steps of ``dt`` that a motion takes, the last one begun."""
    return int(np.ceil(motion.duration / dt - 1e-9))


def _at(motion: ruckig.Trajectory, index: Rows, dt: float) -> SetPoints:
    times = np.minimum(index * dt, motion.duration).tolist()
    rows = np.array([motion.at_time(time) for time in times])
    return rows[:, 0], rows[:, 1], rows[:, 2]
