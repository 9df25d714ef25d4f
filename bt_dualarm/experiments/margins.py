"""How close an arm came to its limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bt_dualarm.run.parts import RunView
from bt_dualarm.tree.report import StatusChange
from bt_dualarm.world.world import World


@dataclass(frozen=True)
class Margins:
    """The least over all joints and all time, of the measured state.

    Set-points keep every limit; a measured acceleration may pass its own for moments.

    Attributes:
        position_rad: To a position limit.
        velocity: Share of the velocity limit that was left.
        acceleration: The same of the acceleration limit.
    """

    position_rad: float
    velocity: float
    acceleration: float


class MarginWatch:
    """Looks on at one arm, at every step.

    Args:
        world: In which the arm is.
        arm: Its name.
    """

    def __init__(self, world: World, arm: str) -> None:
        self._world = world
        self._arm = arm
        self._least = np.array([np.inf, 1.0, 1.0])

    @property
    def margins(self) -> Margins:
        """As far as seen."""
        return Margins(*map(float, self._least))

    def on_event(self, change: StatusChange) -> None:
        """Changes of a status do not matter here."""

    def after_ticks(self, run: RunView) -> None:
        """Neither do ticks."""

    def after_step(self, time: float) -> None:  # noqa: ARG002 - the world has the state
        """Compare the measured state with the limits."""
        body = self._world.arms.get(self._arm)
        if body is None:
            return
        limits, q = body.robot.limits, body.q
        room = np.minimum(q - limits.lower, limits.upper - q).min()
        velocity = (np.abs(body.v) / limits.velocity).max()
        acceleration = np.abs(self._world.data.qacc[body.dof_ids]) / limits.acceleration
        self._least = np.minimum(self._least, (room, 1.0 - velocity, 1.0 - acceleration.max()))
