"""Going along a motion at another pace: slower, to a stop, and on again, without leaving its path.

At pace r the place s on the motion advances by r seconds a second. Set-points are then
``q(s)``, ``r q'(s)`` and ``r² q''(s) + r' q'(s)``: the joints keep their path, and all brake
together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import ruckig

from bt_dualarm.motion.trajectory import Trajectory
from bt_dualarm.pose import Matrix
from bt_dualarm.world.catalogue import JointLimits

TIMES = (0.08, 0.12, 0.18, 0.25, 0.35, 0.5)
"""Seconds from full pace to rest that are tried, shortest first."""

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
    motion: Trajectory, begin: Place, pace: float, limits: JointLimits, *, promptly: bool = False
) -> Stretch | None:
    """The quickest change to another pace that keeps the limits, None if there is none.

    Args:
        motion: As planned.
        begin: Where it is now.
        pace: That it shall have, from 0 to 1.
        limits: Acceleration, velocity and jerk that no set-point may pass.
        promptly: Slow down in little more time than braking each joint by itself takes, or not
            at all: what other arms foresee of this one.
    """
    longest = _longest(motion, begin, limits) if promptly and pace < begin.pace else TIMES[-1]
    for time in TIMES:
        if time > longest:
            return None
        places = _profile(begin, pace, time, motion.dt)
        stretch = Stretch(places, at_places(motion, places))
        if _within(stretch.motion, limits):
            return stretch
    return None


def _longest(motion: Trajectory, begin: Place, limits: JointLimits) -> float:
    """Seconds that slowing down may take."""
    speed = np.abs(motion.v[min(round(begin.s / motion.dt), len(motion) - 1)]) * begin.pace
    each = speed / limits.acceleration + limits.acceleration / limits.jerk
    return max(1.2 * float(each.max()) + 0.03, 0.2)


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


def _profile(begin: Place, pace: float, time: float, dt: float) -> Matrix:
    """Places on the grid ``dt`` until the pace is reached, of shape (n, 3)."""
    request = ruckig.InputParameter(1)
    request.control_interface = ruckig.ControlInterface.Velocity
    request.current_position = [begin.s]
    request.current_velocity = [begin.pace]
    request.current_acceleration = [begin.change]
    request.target_velocity, request.target_acceleration = [pace], [0.0]
    request.max_velocity = [2.0]
    request.max_acceleration, request.max_jerk = [2.0 / time], [4.0 / time**2]
    answer = ruckig.Trajectory(1)
    ruckig.Ruckig(1).calculate(request, answer)
    grid = np.arange(int(np.ceil(answer.duration / dt - 1e-9)) + 1) * dt
    rows = np.array([answer.at_time(min(t, answer.duration)) for t in grid.tolist()])[:, :, 0]
    # Ruckig holds the state at its end; the pace goes on from there.
    rows[-1] = (rows[-1, 0] + max(grid[-1] - answer.duration, 0.0) * pace, pace, 0.0)
    return rows


def _within(motion: Trajectory, limits: JointLimits) -> bool:
    dt = motion.dt
    return bool(
        (np.abs(motion.v) <= limits.velocity * _ROUNDING).all()
        and (np.abs(motion.a) <= limits.acceleration * _ROUNDING).all()
        and (np.abs(np.diff(motion.v, axis=0)) <= limits.acceleration * dt * _ROUNDING).all()
        and (np.abs(np.diff(motion.a, axis=0)) <= limits.jerk * dt * _ROUNDING).all()
    )
