"""How close an arm came to its limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bt_dualarm.runtime.parts import IdleObserver
from bt_dualarm.world.world import World


@dataclass(frozen=True)
class Margins:
    """The worst over all joints and all time, of the measured state.

    What is sent keeps every limit; a measured acceleration may pass its own for moments.

    Attributes:
        position_rad: Distance from a position limit in rad.
        velocity: Largest velocity as share of its limit.
        acceleration: Largest acceleration as share of its limit.
    """

    position_rad: float
    velocity: float
    acceleration: float


class MarginWatch(IdleObserver):
    """Looks on at one arm, at every step.

    Args:
        world: World of the run.
        arm: Name of the arm.
    """

    def __init__(self, world: World, arm: str) -> None:
        self._world = world
        self._arm = arm
        self._room, self._velocity, self._acceleration = np.inf, 0.0, 0.0

    @property
    def margins(self) -> Margins:
        """The worst so far."""
        return Margins(float(self._room), float(self._velocity), float(self._acceleration))

    def after_step(self, time: float) -> None:  # noqa: ARG002 - the world has the state
        """Compare the measured state with the limits."""
        body = self._world.arms.get(self._arm)
        if body is None:
            return
        limits, q = body.robot.limits, body.q
        self._room = min(self._room, np.minimum(q - limits.lower, limits.upper - q).min())
        self._velocity = max(self._velocity, (np.abs(body.v) / limits.velocity).max())
        acceleration = np.abs(self._world.data.qacc[body.dof_ids]) / limits.acceleration
        self._acceleration = max(self._acceleration, acceleration.max())
