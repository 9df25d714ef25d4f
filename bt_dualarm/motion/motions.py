"""What a controller follows: a trajectory, at a pace, or a stream of set-points."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeAlias, runtime_checkable

import numpy as np

from bt_dualarm.errors import Failure
from bt_dualarm.motion.limiter import SetPoint
from bt_dualarm.motion.pace import (
    Place,
    Stretch,
    advance,
    at_places,
    brake_after,
    change_pace,
    keep_pace,
    stop_after,
)
from bt_dualarm.motion.trajectory import Trajectory
from bt_dualarm.pose import Vector
from bt_dualarm.world.catalogue import JointLimits

Stream: TypeAlias = Callable[[float], SetPoint | None]
"""Gives the set-point for a simulated time in seconds; asked once a control period.

None, or the one before again though the arm is moving, means that there is no new one.
"""

STALE_S = 0.1
"""Seconds for which an arm goes on without a new set-point of its stream."""

_PIECE = 25  # set-points at an even pace that are worked out at a time


@runtime_checkable
class PacedStream(Protocol):
    """A stream that can be asked to go slower."""

    pace: float
    """Share of its usual speed, from 0 to 1."""


class Motion(Protocol):
    """What a controller is following: a trajectory or a stream."""

    def next(self, time: float) -> SetPoint:
        """The set-point for now."""

    @property
    def done(self) -> bool:
        """Whether its last set-point has been sent."""

    @property
    def way_left(self) -> Trajectory | None:
        """From the last set-point to rest, as it is committed to; None if it is free to choose."""


class TrajectoryMotion:
    """Follows a trajectory set-point by set-point and records where the tool really was.

    Attributes:
        executed: Measured tool positions at each set-point's time, each of shape (3,), m.
        places: Seconds on the trajectory at the same times.
        along_path: The tool's path matters, not only its end.
        goal_pace: The pace that it has, or is changing to.
        held_since: Simulated time in s since which it is stopped, None while it goes on.
        held_up: Why it is stopped.
        leaves_path: The way to rest that it is committed to does.
    """

    def __init__(self, trajectory: Trajectory, along_path: bool = False) -> None:
        self.trajectory = trajectory
        self.along_path = along_path
        self.goal_pace = 1.0
        self.held_since: float | None = None
        self.executed: list[Vector] = []
        self.places: list[float] = []
        self.held_up = ""
        self._next = 0
        self._ahead: Stretch | None = None
        self._row = 0
        self._committed = False
        self.leaves_path = False

    @property
    def done(self) -> bool:
        """Whether the last set-point has been sent."""
        if self._ahead is not None:
            return self.place.s >= self.trajectory.duration
        return self._next >= len(self.trajectory)

    @property
    def progress(self) -> float:
        """Share of the motion that was sent, from 0 to 1."""
        if self._ahead is not None:
            return min(self.place.s / max(self.trajectory.duration, 1e-9), 1.0)
        return self._next / len(self.trajectory)

    @property
    def place(self) -> Place:
        """Of the last set-point."""
        if self._ahead is None:
            return Place(max(self._next - 1, 0) * self.trajectory.dt)
        return Place(*self._ahead.places[self._row].tolist())

    @property
    def changing(self) -> bool:
        """Whether its pace is being changed."""
        return self._ahead is not None and self._row < len(self._ahead.places) - 1

    @property
    def way_left(self) -> Trajectory | None:
        """From the last set-point to rest, as it is committed to; None if it is free to choose."""
        if self._ahead is None or not self._committed:
            return None
        rows, i = self._ahead.motion, self._row
        return Trajectory(rows.dt, rows.q[i:], rows.v[i:], rows.a[i:])

    def next(self, time: float) -> SetPoint:  # noqa: ARG002 - a trajectory counts its own time
        """The next set-point."""
        if self._ahead is not None:
            return self._next_ahead(self._ahead)
        i = min(self._next, len(self.trajectory) - 1)
        self._next += 1
        self.places.append(i * self.trajectory.dt)
        return SetPoint(self.trajectory.q[i], self.trajectory.v[i], self.trajectory.a[i])

    def go_at(self, pace: float, limits: JointLimits) -> bool:
        """Begin to change the pace, 0 to stand still on the path; whether the limits allow it."""
        change = change_pace(self.trajectory, self.place, pace, limits)
        if change is None:
            return False
        self._ahead, self._row, self._committed = change, 0, False
        self.goal_pace, self.leaves_path = pace, False
        return True

    def to_rest_after(self, count: int, pace: float, limits: JointLimits) -> Stretch | None:
        """The next ``count`` set-points, changing to a pace, then to rest on the path.

        None where that is not possible within the limits.
        """
        places = advance(self.trajectory, self.place, pace, count, limits)
        return None if places is None else stop_after(self.trajectory, places, limits)

    def to_brake_after(self, count: int, limits: JointLimits) -> Stretch | None:
        """The next ``count`` set-points, then to rest joint by joint, wherever that leads.

        None where its pace is changing.
        """
        place = self.place
        if place.change:
            return None
        return brake_after(self.trajectory, keep_pace(self.trajectory, place, count), limits)

    def commit(self, ahead: Stretch, pace: float, *, leaves_path: bool = False) -> None:
        """Go on in a way that ends at rest, unless the motion is told to go on before.

        Args:
            ahead: From the last set-point on.
            pace: Of its first part.
            leaves_path: The rest of it does.
        """
        self._ahead, self._row, self._committed = ahead, 0, True
        self.goal_pace, self.leaves_path = pace, leaves_path

    def halt(self, limits: JointLimits) -> Trajectory | None:
        """The way to a stop on the path, from the last set-point on; None if there is none."""
        change = change_pace(self.trajectory, self.place, 0.0, limits)
        return None if change is None else change.motion

    def configuration(self, s: float) -> Vector:
        """Joint angles, of shape (dof,), at a place in s, on the grid."""
        place: Vector = self.trajectory.q[
            min(round(s / self.trajectory.dt), len(self.trajectory) - 1)
        ]
        return place

    def _next_ahead(self, ahead: Stretch) -> SetPoint:
        self._row += 1
        if self._row >= len(ahead.places):
            last = Place(*ahead.places[-1].tolist())
            places = keep_pace(self.trajectory, last, _PIECE)
            ahead = Stretch(places, at_places(self.trajectory, places))
            self._ahead, self._row = ahead, 1
        self.places.append(float(ahead.places[self._row, 0]))
        rows, i = ahead.motion, self._row
        return SetPoint(rows.q[i], rows.v[i], rows.a[i])


class StreamMotion:
    """Follows whatever a function says, until it is stopped.

    Args:
        stream: The function.
        sent: The last set-point that was sent.
        period: Seconds between set-points.
        jerk: Limit of shape (dof,), rad/s³.

    Attributes:
        way_left: From the last set-point to rest, as it is committed to; None if it is free.
    """

    done = False

    def __init__(self, stream: Stream, sent: SetPoint, period: float, jerk: Vector) -> None:
        self.way_left: Trajectory | None = None
        self._stream = stream
        self._paced = stream if isinstance(stream, PacedStream) else None
        self._given: SetPoint | None = None
        self._next = sent
        self._period, self._change = period, jerk * period
        self._old = 0

    def next(self, time: float) -> SetPoint:
        """The set-point for now; without a new one the arm coasts for a while.

        Raises:
            Failure: ``STALE`` when there has been no new one for ``STALE_S``.
        """
        given = self._stream(time)
        if given is not None and (given is not self._given or not given.v.any()):
            self._given = self._next = given
            self._old = 0
            return given
        self._old += 1
        if self._old * self._period > STALE_S:
            waited = self._old * self._period
            raise Failure("STALE", f"no new set-point for {waited:.2f} s", waited_s=waited)
        self._next = self._coasting()
        return self._next

    def go_at(self, pace: float) -> bool:
        """Ask the stream to go at another pace, if it can; whether that is a change."""
        if self._paced is None or self._paced.pace == pace:
            return False
        self._paced.pace = pace
        return True

    def _coasting(self) -> SetPoint:
        """One set-point later, while the acceleration fades."""
        last, dt = self._next, self._period
        a = last.a - np.clip(last.a, -self._change, self._change)
        v = last.v + 0.5 * (last.a + a) * dt
        return SetPoint(last.q + 0.5 * (last.v + v) * dt, v, a)
