"""Jerk-limited motions from point to point and to rest, by Ruckig."""

from __future__ import annotations

import numpy as np
import ruckig

from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.robots.robot import JointLimits
from bt_dualarm.trajectory.path_timing import TimedPath, time_path, timed_path
from bt_dualarm.trajectory.trajectory import Rows, SetPoints, Trajectory, joined

__all__ = ["TimedPath", "point_to_point", "stop", "time_path", "timed_path"]

_LESS_JERK = (1.0, 0.999, 0.99, 0.9)
"""Shares of the jerk limits that are tried in turn."""

_ZERO_RAD = 1e-12
"""Joint distance below which there is no motion, rad."""


def solve_ruckig(
    request: ruckig.InputParameter, jerk: Vector, solver: ruckig.Ruckig | None = None
) -> ruckig.Trajectory:
    """Ruckig's trajectory for a request.

    If a phase of the solution has exactly zero duration, Ruckig may find no root; slightly less
    jerk avoids that case.

    Args:
        request: State, target and all limits except jerk.
        jerk: Jerk limits, of shape (dof,), rad/s³.
        solver: Ruckig instance for as many joints, to reuse.

    Raises:
        Failure: ``NO_PLAN`` with Ruckig's message.
    """
    solver = solver or ruckig.Ruckig(request.degrees_of_freedom)
    trajectory = ruckig.Trajectory(request.degrees_of_freedom)
    refusal = ""
    for share in _LESS_JERK:
        request.max_jerk = (share * jerk).tolist()
        try:
            result = solver.calculate(request, trajectory)
        except ruckig.RuckigError as error:
            refusal = str(error)
            continue
        if result in (ruckig.Result.Working, ruckig.Result.Finished):
            return trajectory
        refusal = result.name
    raise Failure(
        "NO_PLAN", f"Ruckig finds no motion within the limits: {' '.join(refusal.split())}"
    )


def point_to_point(
    q0: Vector, q1: Vector, limits: JointLimits, dt: float, min_duration: float = 0.0
) -> Trajectory:
    """Fastest rest-to-rest motion on a straight line in joint space within the limits.

    Args:
        q0: Start, of shape (dof,), rad, within the position limits.
        q1: Goal, of shape (dof,), rad, within the position limits.
        limits: Position, velocity, acceleration and jerk limits.
        dt: Time between set-points, s.
        min_duration: Lower bound of the duration, s.

    Raises:
        Failure: ``NO_PLAN`` if Ruckig finds no motion.
        ValueError: A configuration is not finite or outside the position limits.
    """
    for name, q in (("start", q0), ("goal", q1)):
        if not np.all((q >= limits.lower - 1e-9) & (q <= limits.upper + 1e-9)):
            raise ValueError(f"the {name} {np.round(q, 4).tolist()} is outside the position limits")
    displacement = q1 - q0
    if float(np.abs(displacement).max()) < _ZERO_RAD:
        return Trajectory.rest(q1, dt)
    # Not sampled here: a long motion computes its set-points on demand.
    line = _Straight(q0, q1, _limits_along(displacement, limits), min_duration, dt)
    return joined(dt, (line,))


class _Straight:
    """Rest-to-rest motion on a straight line in joint space, see `TrajectoryProtocol`.

    A one-dimensional motion along the line: Ruckig's phase synchronization silently leaves the line
    if one joint limits the velocity and another one the acceleration.

    Args:
        q0: Start, of shape (dof,), rad.
        q1: Goal, of shape (dof,), rad.
        limits: Velocity, acceleration and jerk of the line parameter in [0, 1], each (1,).
        min_duration: Lower bound of the duration, s.
        dt: Time between set-points, s.

    Raises:
        Failure: ``NO_PLAN`` if Ruckig finds no motion.
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
        self._ends = (q0, q1)
        self._share = solve_ruckig(request, jerk)
        self._dt = dt

    def __reduce__(self) -> tuple[type[_Straight], tuple[object, ...]]:
        """Pickled as its arguments: Ruckig's trajectories cannot be pickled."""
        return _Straight, self._given

    def __len__(self) -> int:
        return _count(self._share, self._dt) + 1

    def rows(self, index: Rows) -> SetPoints:
        """Positions, velocities and accelerations of some set-points, each of shape (n, dof)."""
        q0, q1 = self._ends
        last = index == len(self) - 1
        place, rate, bend = _at(self._share, index, self._dt)
        # The last set-point may be up to a period after the end: exactly at the goal, at rest.
        place[last] = 1.0
        rate[last] = 0.0
        bend[last] = 0.0
        q = q0 + place * (q1 - q0)
        q[last] = q1
        return q, rate * (q1 - q0), bend * (q1 - q0)


def stop(q: Vector, v: Vector, a: Vector, limits: JointLimits, dt: float) -> Trajectory:
    """Braking trajectory: each joint comes to rest as fast as its limits allow.

    Keeps velocity, acceleration and jerk limits if ``v`` and ``a`` do. Position limits are not
    considered: a joint that is too fast near one passes it.

    Args:
        q: Position of shape (dof,), rad.
        v: Velocity of shape (dof,), rad/s.
        a: Acceleration of shape (dof,), rad/s².
        limits: Velocity, acceleration and jerk limits.
        dt: Time between set-points, s.

    Raises:
        Failure: ``NO_PLAN`` if Ruckig finds no motion.
    """
    request = _request(q, v, a, limits.velocity, limits.acceleration)
    request.control_interface = ruckig.ControlInterface.Velocity
    # Each joint brakes at its own limits: the arm leaves its path, but stops soonest.
    request.synchronization = ruckig.Synchronization.No
    position, velocity, acceleration = _sampled(request, limits.jerk, dt)
    velocity[-1] = 0.0
    acceleration[-1] = 0.0
    return Trajectory(dt, position, velocity, acceleration)


def _limits_along(displacement: Vector, limits: JointLimits) -> tuple[Vector, Vector, Vector]:
    """Velocity, acceleration and jerk limits of the parameter of a line, each of shape (1,)."""
    # Along q0 + s (q1 - q0), each joint bounds the rates of s by its limit over its displacement.
    moving = np.abs(displacement) > 0.0
    velocity, acceleration, jerk = (
        np.array([(limit[moving] / np.abs(displacement[moving])).min()])
        for limit in (limits.velocity, limits.acceleration, limits.jerk)
    )
    return velocity, acceleration, jerk


def _request(
    q: Vector, v: Vector, a: Vector, velocity: Vector, acceleration: Vector
) -> ruckig.InputParameter:
    """Ruckig request with a state and limits, each of shape (dof,), that ends at rest.

    Ruckig accepts lists of the wrong length and ignores elements that are set in place: each list
    is assigned as a whole, from an array whose shape was checked.

    Raises:
        ValueError: Shapes differ, or a value is not finite.
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
    """Ruckig's trajectory sampled every ``dt``, to its end or less than ``dt`` later: (n, dof)."""
    motion = solve_ruckig(request, jerk)
    return _at(motion, np.arange(_count(motion, dt) + 1), dt)


def _count(motion: ruckig.Trajectory, dt: float) -> int:
    """Number of steps of ``dt`` of a motion, rounded up."""
    return int(np.ceil(motion.duration / dt - 1e-9))


def _at(motion: ruckig.Trajectory, index: Rows, dt: float) -> SetPoints:
    times = np.minimum(index * dt, motion.duration).tolist()
    rows = np.array([motion.at_time(time) for time in times])
    return rows[:, 0], rows[:, 1], rows[:, 2]
