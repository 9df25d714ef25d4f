"""What a controller follows: a trajectory, at a pace, or a stream of set-points."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeAlias

import numpy as np

from bt_dualarm.motion.limiter import SetPoint
from bt_dualarm.motion.pace import Place, Stretch, at_places, change_pace
from bt_dualarm.motion.trajectory import Trajectory
from bt_dualarm.pose import Vector
from bt_dualarm.world.catalogue import JointLimits

Stream: TypeAlias = Callable[[float], SetPoint]
"""Gives the set-point for a simulated time in seconds; asked once a control period."""


class Motion(Protocol):
    """What a controller is following: a trajectory or a stream."""

    def next(self, time: float) -> SetPoint:
        """The set-point for now."""

    @property
    def done(self) -> bool:
        """Whether its last set-point has been sent."""


class TrajectoryMotion:
    """Follows a trajectory set-point by set-point and records where the tool really was.

    Attributes:
        executed: Measured tool positions at each set-point's time, each of shape (3,), m.
        places: Seconds on the trajectory at the same times.
        along_path: The tool's path matters, not only its end.
        goal_pace: The pace that it has, or is changing to.
        held_since: Simulated time in s since which it stands, None while it moves.
        held_up: Why it stands.
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
        self._place: Place | None = None
        self._change: Stretch | None = None
        self._row = 0

    @property
    def done(self) -> bool:
        """Whether the last set-point has been sent."""
        if self._place is not None:
            return self._place.s >= self.trajectory.duration
        return self._next >= len(self.trajectory)

    @property
    def progress(self) -> float:
        """Share of the motion that was sent, from 0 to 1."""
        if self._place is not None:
            return min(self._place.s / max(self.trajectory.duration, 1e-9), 1.0)
        return self._next / len(self.trajectory)

    @property
    def place(self) -> Place:
        """Of the last set-point."""
        return self._place or Place(max(self._next - 1, 0) * self.trajectory.dt)

    @property
    def changing(self) -> bool:
        """Whether its pace is being changed."""
        return self._change is not None

    def next(self, time: float) -> SetPoint:  # noqa: ARG002 - a trajectory counts its own time
        """The next set-point."""
        if self._place is not None:
            return self._next_at_pace(self._place)
        i = min(self._next, len(self.trajectory) - 1)
        self._next += 1
        self.places.append(i * self.trajectory.dt)
        return SetPoint(self.trajectory.q[i], self.trajectory.v[i], self.trajectory.a[i])

    def go_at(self, pace: float, limits: JointLimits, *, promptly: bool = False) -> bool:
        """Begin to change the pace, 0 to stand still on the path; whether the limits allow it."""
        change = change_pace(self.trajectory, self.place, pace, limits, promptly=promptly)
        if change is None:
            return False
        self._place, self._change, self._row = self.place, change, 0
        self.goal_pace = pace
        return True

    def halt(self, limits: JointLimits) -> Trajectory | None:
        """The way to a stop on the path, from the last set-point on; None if there is none."""
        change = change_pace(self.trajectory, self.place, 0.0, limits)
        return None if change is None else change.motion

    def stopping_place(self, limits: JointLimits) -> float | None:
        """Place in s where it would stand if it went at pace 0 from now on; None if it cannot."""
        change = change_pace(self.trajectory, self.place, 0.0, limits, promptly=True)
        return None if change is None else float(change.places[-1, 0])

    def configuration(self, s: float) -> Vector:
        """Joint angles, of shape (dof,), at a place in s, on the grid."""
        place: Vector = self.trajectory.q[
            min(round(s / self.trajectory.dt), len(self.trajectory) - 1)
        ]
        return place

    def _next_at_pace(self, now: Place) -> SetPoint:
        change = self._change
        if change is None:
            place = Place(now.s + now.pace * self.trajectory.dt, now.pace)
            rows = at_places(self.trajectory, np.array(((place.s, place.pace, 0.0),)))
            row = 0
        else:
            self._row = row = min(self._row + 1, len(change.places) - 1)
            place, rows = Place(*change.places[row].tolist()), change.motion
            if row == len(change.places) - 1:
                self._change = None
        self._place = place
        self.places.append(place.s)
        return SetPoint(rows.q[row], rows.v[row], rows.a[row])


class StreamMotion:
    """Follows whatever a function says, until it is stopped."""

    done = False

    def __init__(self, stream: Stream) -> None:
        self.next = stream
