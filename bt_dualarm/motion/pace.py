"""Going along a motion at another pace: slower, to a stop, and on again, without leaving its path.

At pace r the place s on the motion advances by r seconds a second. Set-points are then
``q(s)``, ``r q'(s)`` and ``r² q''(s) + r' q'(s)``: the joints keep their path, and all brake
together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import ruckig

from bt_dualarm.errors import Failure
from bt_dualarm.motion.ruckig_answer import answer
from bt_dualarm.motion.timing import stop
from bt_dualarm.motion.trajectory import Trajectory
from bt_dualarm.pose import Matrix
from bt_dualarm.world.catalogue import JointLimits

_LONGER = (1.0, 1.3, 1.7, 2.4, 4.0, 7.0)
"""A change that takes so many times as long as the joints' speeds alone would have it is tried."""

_QUICKEST = 25.0  # change of the pace in 1/s: at rest, joints have no say in it
_SUDDEN = 600.0  # likewise in 1/s²
_AHEAD_S = 0.4  # planned seconds whose speeds bound the change
_RUN_OUT_S = 0.8  # a motion that ends sooner need not be stopped before
_JERK_SHARE = 0.9  # of the limit: rounding to the grid takes some

_ROUNDING = 1.0 + 1e-6


@dataclass(frozen=True)
class Place:
    """Where a motion is on its path.

    Attributes:
        s: Seconds from its beginning, as it was planned.
        pace: Planned seconds that go by in one.
        change: Of the pace, 1/s.
    """

    s: float
    pace: float = 1.0
    change: float = 0.0


@dataclass(frozen=True, eq=False)
class Stretch:
    """A piece of a motion at a changing pace; the first row is where it begins.

    Attributes:
        places: Of shape (n, 3): place in s, pace, its change.
        motion: Set-points at them.
    """

    places: Matrix
    motion: Trajectory


def change_pace(
    motion: Trajectory, begin: Place, pace: float, limits: JointLimits
) -> Stretch | None:
    """The quickest change to another pace that keeps the limits, None if there is none.

    Args:
        motion: As planned.
        begin: Where it is now.
        pace: That it shall have, from 0 to 1.
        limits: Acceleration, velocity and jerk that no set-point may pass.
    """
    rate, jerk = _bounds(motion, begin, limits)
    for longer in _LONGER:
        try:
            places = _profile(begin, pace, (rate / longer, jerk / longer**2), motion.dt)
        except Failure:  # where Ruckig finds no root it may find one for a slower change
            continue
        stretch = Stretch(places, at_places(motion, places))
        if _within(stretch.motion, limits):
            return stretch
    return None


def _bounds(motion: Trajectory, begin: Place, limits: JointLimits) -> tuple[float, float]:
    """How quickly the joints' speeds let the pace change, in 1/s and 1/s²."""
    first = min(int(begin.s / motion.dt), len(motion) - 1)
    speed = np.abs(motion.v[first : first + round(_AHEAD_S / motion.dt)]).max(axis=0) + 1e-9
    rate = min(float((limits.acceleration / speed).min()), _QUICKEST)
    jerk = min(float((_JERK_SHARE * limits.jerk / speed).min()), _SUDDEN)
    return rate, jerk


def keep_pace(motion: Trajectory, begin: Place, count: int) -> Matrix:
    """Places at an even pace, of shape (count + 1, 3), the first where it begins."""
    places = np.tile((begin.s, begin.pace, 0.0), (count + 1, 1))
    places[:, 0] += np.arange(count + 1) * (begin.pace * motion.dt)
    return places


def advance(
    motion: Trajectory, begin: Place, pace: float, count: int, limits: JointLimits
) -> Matrix | None:
    """Places of the next ``count`` set-points, of shape (count + 1, 3), changing to a pace.

    Where it cannot change, an even pace is kept; None where it is changing and cannot change back.
    """
    change = None
    if begin.pace != pace or begin.change:
        change = change_pace(motion, begin, pace, limits)
        if change is None and begin.change:
            return None
    if change is None:
        return keep_pace(motion, begin, count)
    places = change.places[: count + 1]
    more = count + 1 - len(places)
    if more <= 0:
        return places
    return np.vstack((places, keep_pace(motion, Place(*places[-1].tolist()), more)[1:]))


def stop_after(motion: Trajectory, places: Matrix, limits: JointLimits) -> Stretch | None:
    """The same places, then to rest on the path; None where that takes too long.

    Near its end a motion rests soonest at its end.
    """
    last = Place(*places[-1].tolist())
    change = change_pace(motion, last, 0.0, limits)
    if change is not None:
        tail = change.places
    else:
        steps = (motion.duration - last.s) / max(last.pace * motion.dt, 1e-9)
        if last.change or steps > round(_RUN_OUT_S / motion.dt):
            return None
        tail = keep_pace(motion, last, int(np.ceil(steps)))
    whole = np.vstack((places, tail[1:]))
    return Stretch(whole, at_places(motion, whole))


def brake_after(motion: Trajectory, places: Matrix, limits: JointLimits) -> Stretch:
    """The same places, then to rest joint by joint, off the path; its rows stay at the last one."""
    rows = at_places(motion, places)
    rows = rows.then(stop(rows.q[-1], rows.v[-1], rows.a[-1], limits, motion.dt))
    off = np.broadcast_to((places[-1, 0], 0.0, 0.0), (len(rows) - len(places), 3))
    return Stretch(np.vstack((places, off)), rows)


def at_places(motion: Trajectory, places: Matrix) -> Trajectory:
    """Set-points of a motion at places, of shape (n, 3): in s, pace, its change."""
    s, pace, change = places.T[:, :, None]
    count = len(motion)
    index = np.clip(s[:, 0] / motion.dt, 0.0, count - 1.0)
    low = np.minimum(index.astype(int), max(count - 2, 0))
    high = np.minimum(low + 1, count - 1)
    u = (index - low)[:, None]
    q0, q1 = motion.q[low], motion.q[high]
    v0, v1 = motion.v[low] * motion.dt, motion.v[high] * motion.dt
    bend = (1.0 - u) * (v0 - (q1 - q0)) - u * (v1 - (q1 - q0))
    q = q0 + u * (q1 - q0) + u * (1.0 - u) * bend
    rate = motion.v[low] + u * (motion.v[high] - motion.v[low])
    curve = motion.a[low] + u * (motion.a[high] - motion.a[low])
    over = s >= (count - 1) * motion.dt  # beyond the end it rests
    v = np.where(over, 0.0, pace * rate)
    a = np.where(over, 0.0, pace**2 * curve + change * rate)
    return Trajectory(motion.dt, q, v, a)


def _profile(begin: Place, pace: float, bounds: tuple[float, float], dt: float) -> Matrix:
    """Places on the grid ``dt`` until the pace is reached, of shape (n, 3).

    Args:
        begin: Where it begins.
        pace: That is reached.
        bounds: Of the change of the pace in 1/s, and of that one's change in 1/s².
        dt: Seconds.
    """
    request = ruckig.InputParameter(1)
    request.control_interface = ruckig.ControlInterface.Velocity
    request.current_position = [begin.s]
    request.current_velocity = [begin.pace]
    request.current_acceleration = [begin.change]
    request.target_velocity, request.target_acceleration = [pace], [0.0]
    request.max_velocity = [2.0]
    request.max_acceleration = [max(bounds[0], abs(begin.change))]
    motion = answer(request, np.array(bounds[1:]))
    grid = np.arange(int(np.ceil(motion.duration / dt - 1e-9)) + 1) * dt
    rows = np.array([motion.at_time(min(t, motion.duration)) for t in grid.tolist()])[:, :, 0]
    # Ruckig holds the state at its end; the pace goes on from there.
    rows[-1] = (rows[-1, 0] + max(grid[-1] - motion.duration, 0.0) * pace, pace, 0.0)
    return rows


def _within(motion: Trajectory, limits: JointLimits) -> bool:
    dt = motion.dt
    return bool(
        (np.abs(motion.v) <= limits.velocity * _ROUNDING).all()
        and (np.abs(motion.a) <= limits.acceleration * _ROUNDING).all()
        and (np.abs(np.diff(motion.v, axis=0)) <= limits.acceleration * dt * _ROUNDING).all()
        and (np.abs(np.diff(motion.a, axis=0)) <= limits.jerk * dt * _ROUNDING).all()
    )
