"""Time scaling: a motion made slower, to a stop, and on again, without leaving its path.

At a time scale r the path parameter s, which is the time on the motion as planned, advances by r
seconds a second. Set-points are then ``q(s)``, ``r q'(s)`` and ``r² q''(s) + r' q'(s)``: the joints
keep their path, and all brake together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import ruckig

from bt_dualarm.errors import Failure
from bt_dualarm.motion.chains.kernel_rows import Stack
from bt_dualarm.motion.timing.law import Rows, SetPoints
from bt_dualarm.motion.timing.point_to_point import stop
from bt_dualarm.motion.timing.ruckig_solver import answer
from bt_dualarm.motion.timing.trajectory import LongTrajectory, Trajectory, joined
from bt_dualarm.pose import Matrix
from bt_dualarm.world.robots.robot import JointLimits

_LONGER = (1.0, 1.3, 1.7, 2.4, 4.0, 7.0)
"""A change that takes so many times as long as the joints' speeds alone would have it is tried."""

_QUICKEST = 25.0  # change of the time scale in 1/s: at rest, joints have no say in it
_SUDDEN = 600.0  # likewise in 1/s²
_AHEAD_S = 0.4  # planned seconds whose speeds bound the change
_RUN_OUT_S = 0.8  # a motion that ends sooner need not be stopped before
_JERK_SHARE = 0.9  # of the limit: rounding to the grid takes some

_SPARSE = 8.0  # set-points from one that is asked for to the next: far apart, they come one by one
_ROUNDING = 1.0 + 1e-6


@dataclass(frozen=True)
class PathParameter:
    """Where a motion is on its path, and how fast it goes along it.

    Attributes:
        s: Seconds from the beginning of the motion as planned.
        scale: Time scale: planned seconds that go by in one.
        change: Change of the time scale, 1/s.
    """

    s: float
    scale: float = 1.0
    change: float = 0.0


@dataclass(frozen=True, eq=False)
class ScaledPiece:
    """A piece of a motion at a changing time scale; the first row is where it begins.

    Attributes:
        parameters: Path parameters, of shape (n, 3): s, time scale, its change.
        motion: Set-points at them.
        goal: Time scale that it changes to, before it comes to rest if it does.
    """

    parameters: Matrix
    motion: Trajectory
    goal: float


def change_scale(
    motion: Trajectory, begin: PathParameter, scale: float, limits: JointLimits
) -> ScaledPiece | None:
    """The quickest change to another time scale that keeps the limits, None if there is none.

    Args:
        motion: Motion as planned.
        begin: Path parameter now.
        scale: Time scale that it shall have, from 0 to 1.
        limits: Limits of velocity, acceleration and jerk that no set-point may pass.
    """
    rate, jerk = _bounds(motion, begin, limits)
    for longer in _LONGER:
        try:
            parameters = _profile(begin, scale, (rate / longer, jerk / longer**2), motion.dt)
        except Failure:  # where Ruckig finds no root it may find one for a slower change
            continue
        rows = _sampled(motion, parameters)
        if _within(rows, motion.dt, limits):
            return ScaledPiece(parameters, Trajectory(motion.dt, *rows), scale)
    return None


def _bounds(motion: Trajectory, begin: PathParameter, limits: JointLimits) -> tuple[float, float]:
    """How quickly the joints' speeds let the time scale change, in 1/s and 1/s²."""
    first = min(int(begin.s / motion.dt), len(motion) - 1)
    end = min(first + round(_AHEAD_S / motion.dt), len(motion))
    speed = np.abs(motion.piece(first, end).v).max(axis=0) + 1e-9
    rate = min(float((limits.acceleration / speed).min()), _QUICKEST)
    jerk = min(float((_JERK_SHARE * limits.jerk / speed).min()), _SUDDEN)
    return rate, jerk


def keep_scale(motion: Trajectory, begin: PathParameter, count: int) -> Matrix:
    """Path parameters at an even time scale, of shape (count + 1, 3), the first where it begins."""
    parameters = np.tile((begin.s, begin.scale, 0.0), (count + 1, 1))
    parameters[:, 0] += np.arange(count + 1) * (begin.scale * motion.dt)
    return parameters


def to_rest_after(
    motion: Trajectory, begin: PathParameter, scale: float, count: int, limits: JointLimits
) -> ScaledPiece | None:
    """The next ``count`` set-points, changing to a time scale, then to rest on the path.

    Where the time scale cannot change, it is kept. Near its end a motion rests soonest at its end.
    None where it is changing and cannot change back, and where it takes too long to rest.
    """
    ahead = _advance(motion, begin, scale, count, limits)
    if ahead is None:
        return None
    parameters, goal = ahead
    last = PathParameter(*parameters[-1].tolist())
    change = change_scale(motion, last, 0.0, limits)
    if change is not None:
        tail = change.parameters
    else:
        steps = (motion.duration - last.s) / max(last.scale * motion.dt, 1e-9)
        if last.change or steps > round(_RUN_OUT_S / motion.dt):
            return None
        tail = keep_scale(motion, last, int(np.ceil(steps)))
    whole = np.vstack((parameters, tail[1:]))
    return ScaledPiece(whole, sampled_at(motion, whole), goal)


def _advance(
    motion: Trajectory, begin: PathParameter, scale: float, count: int, limits: JointLimits
) -> tuple[Matrix, float] | None:
    """Path parameters of the next set-points, changing to a time scale, and the one they have."""
    change = None
    if begin.scale != scale or begin.change:
        change = change_scale(motion, begin, scale, limits)
        if change is None and begin.change:
            return None
    if change is None:
        return keep_scale(motion, begin, count), begin.scale
    parameters = change.parameters[: count + 1]
    last = PathParameter(*parameters[-1].tolist())
    more = count + 1 - len(parameters)
    return np.vstack((parameters, keep_scale(motion, last, more)[1:])), change.goal


def brake_after(
    motion: Trajectory, begin: PathParameter, count: int, limits: JointLimits
) -> ScaledPiece:
    """The next ``count`` set-points at the same time scale, then to rest joint by joint.

    That leads off the path: s stays as it is.
    """
    parameters = keep_scale(motion, begin, count)
    rows = sampled_at(motion, parameters)
    rows = rows.then(stop(rows.q[-1], rows.v[-1], rows.a[-1], limits, motion.dt))
    off = np.broadcast_to((parameters[-1, 0], 0.0, 0.0), (len(rows) - len(parameters), 3))
    return ScaledPiece(np.vstack((parameters, off)), rows, begin.scale)


def sampled_at(motion: Trajectory, parameters: Matrix) -> Trajectory:
    """Set-points of a motion at path parameters, of shape (n, 3): s, time scale, its change."""
    return Trajectory(motion.dt, *_sampled(motion, parameters))


def _sampled(motion: Trajectory, parameters: Matrix) -> Stack:
    """The same, positions, velocities and accelerations, of shape (3, n, dof)."""
    from bt_dualarm.motion.timing.average_kernels import scale

    parameters = np.ascontiguousarray(parameters)
    far = _SPARSE * len(parameters) * motion.dt
    if isinstance(motion, LongTrajectory) and far < np.ptp(parameters[:, 0]):
        return _sampled_apart(motion, parameters)
    (first, rows), count = motion.around(parameters[:, 0]), len(motion)
    scaled = np.empty((3, len(parameters), rows[0].shape[1]))
    scale(*rows, first, count, motion.dt, parameters, scaled)
    return scaled


def _sampled_apart(motion: Trajectory, parameters: Matrix) -> Stack:
    """The same, of a motion whose set-points in between nobody needs."""
    from bt_dualarm.motion.timing.average_kernels import scale

    count = len(motion)
    place = np.clip(parameters[:, 0] / motion.dt, 0.0, count - 1.0)
    first = np.minimum(place.astype(int), count - 2)
    pairs = np.array(motion.rows(np.column_stack((first, first + 1)).ravel()))
    pairs = pairs.reshape(3, len(first), 2, -1).swapaxes(0, 1).copy()
    scaled = np.empty_like(pairs[:, :, :1])
    for i, (q, v, a) in enumerate(pairs):
        scale(q, v, a, int(first[i]), count, motion.dt, parameters[i : i + 1], scaled[i])
    return np.ascontiguousarray(scaled[:, :, 0].swapaxes(0, 1))


def at_scale(motion: Trajectory, scale: float) -> Trajectory:
    """The whole motion at an even time scale, above 0 to 1."""
    return joined(motion.dt, (_AtScale(motion, scale),))


@dataclass(frozen=True, eq=False)
class _AtScale:
    """The law of a motion at an even time scale."""

    motion: Trajectory
    scale: float

    def __len__(self) -> int:
        return int(np.ceil(self.motion.duration / (self.scale * self.motion.dt))) + 1

    def rows(self, index: Rows) -> SetPoints:
        """Positions, velocities and accelerations of some set-points, each of shape (n, dof)."""
        parameters = np.tile((0.0, self.scale, 0.0), (len(index), 1))
        parameters[:, 0] += index * (self.scale * self.motion.dt)
        slower = sampled_at(self.motion, parameters)
        return slower.q, slower.v, slower.a


def _profile(begin: PathParameter, scale: float, bounds: tuple[float, float], dt: float) -> Matrix:
    """Path parameters until a time scale is reached, of shape (n, 3).

    Args:
        begin: The first of them.
        scale: Time scale that is reached.
        bounds: Most change of the time scale in 1/s, and most change of that in 1/s².
        dt: Seconds from row to row.
    """
    request = ruckig.InputParameter(1)
    request.control_interface = ruckig.ControlInterface.Velocity
    request.current_position = [begin.s]
    request.current_velocity = [begin.scale]
    request.current_acceleration = [begin.change]
    request.target_velocity, request.target_acceleration = [scale], [0.0]
    request.max_velocity = [2.0]
    request.max_acceleration = [max(bounds[0], abs(begin.change))]
    motion = answer(request, np.array(bounds[1:]))
    grid = np.arange(int(np.ceil(motion.duration / dt - 1e-9)) + 1) * dt
    states = map(motion.at_time, np.minimum(grid, motion.duration).tolist())
    rows = np.array([(s[0], rate[0], change[0]) for s, rate, change in states])
    # Ruckig holds the state at its end; the motion goes on from there.
    rows[-1] = (rows[-1, 0] + max(grid[-1] - motion.duration, 0.0) * scale, scale, 0.0)
    return rows


def _within(rows: Stack, dt: float, limits: JointLimits) -> bool:
    from bt_dualarm.motion.chains.limit_kernels import within

    most = np.array((limits.velocity, limits.acceleration, limits.jerk))
    return within(rows, dt, _ROUNDING, most)
