"""A stream of set-points as a controller follows it: it coasts through gaps, and gets stale."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeAlias, runtime_checkable

import numpy as np

from bt_dualarm.errors import Failure
from bt_dualarm.motion.setpoints.set_point import SetPoint
from bt_dualarm.motion.timing.trajectory import Trajectory
from bt_dualarm.pose import Vector

Stream: TypeAlias = Callable[[float], SetPoint | None]
"""Gives the set-point for a simulated time in seconds; asked once a control period.

None, or the one before again though the arm is moving, means that there is no new one.
"""

STALE_S = 0.1
"""Seconds for which an arm goes on without a new set-point of its stream."""


@runtime_checkable
class ScalableStream(Protocol):
    """A stream that can be asked to go slower."""

    time_scale: float
    """Share of its usual speed, from 0 to 1."""


class StreamSource:
    """Follows a stream until it is told to stop, or no new set-points come.

    Args:
        stream: Function that gives the set-points.
        sent: The last set-point that was sent.
        period: Seconds between set-points.
        jerk: Limits of the joints, of shape (dof,), rad/s³.

    Attributes:
        braking: Braking trajectory from the last set-point on that is reserved; None if there is
            none.
    """

    done = False

    def __init__(self, stream: Stream, sent: SetPoint, period: float, jerk: Vector) -> None:
        self.braking: Trajectory | None = None
        self._stream = stream
        self._scalable = stream if isinstance(stream, ScalableStream) else None
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

    def change_scale(self, scale: float) -> bool:
        """Ask the stream to go at another time scale, if it can; whether that is a change."""
        if self._scalable is None or self._scalable.time_scale == scale:
            return False
        self._scalable.time_scale = scale
        return True

    def _coasting(self) -> SetPoint:
        """One set-point later, while the acceleration fades."""
        last, dt = self._next, self._period
        a = last.a - np.clip(last.a, -self._change, self._change)
        v = last.v + 0.5 * (last.a + a) * dt
        return SetPoint(last.q + 0.5 * (last.v + v) * dt, v, a)
