"""A set-point, and where a controller gets one from at every control period."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from bt_dualarm.motion.timing.trajectory import Trajectory
from bt_dualarm.pose import Vector


class SetPoint(NamedTuple):
    """What a joint controller is to follow: rad, rad/s, rad/s², each of shape (dof,)."""

    q: Vector
    v: Vector
    a: Vector


class SetPointSource(Protocol):
    """What a controller is following: a trajectory or a stream."""

    def next(self, time: float) -> SetPoint:
        """The set-point for a simulated time in s, which is now."""

    @property
    def done(self) -> bool:
        """Whether its last set-point has been sent."""

    @property
    def braking(self) -> Trajectory | None:
        """Braking trajectory from the last set-point on that is reserved; None if there is none."""
