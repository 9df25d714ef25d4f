"""What the arms of a world have reserved: where each will be until it rests, whatever happens."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from bt_dualarm.motion.collision.bounding_spheres import BoundingSpheres
from bt_dualarm.pose import Matrix
from bt_dualarm.world.world import World


@dataclass(frozen=True, eq=False)
class Reservation:
    """Published by an arm's controller for those of the other arms; never by or for its tree.

    Attributes:
        time: Simulated time in s of the first row.
        period: Seconds from row to row.
        q: Set-points to come, of shape (n, dof), rad; the last one is where the arm rests.
        deviation: Farthest that any point of the arm may be away from there, in metres.
        spread: Farthest that any point of the arm may get from ``spheres``, in metres.
        spheres: Spheres around the arm as it was at ``time``: centres and radii, (m, 4), m.
        generation: Generation of the world that the spheres belong to.
    """

    time: float
    period: float
    q: Matrix
    deviation: float
    spread: float
    spheres: Matrix
    generation: int

    def rows(self, time: float, count: int) -> Matrix:
        """Where the arm will be at ``count`` times from ``time`` on, of shape (count, dof)."""
        index = np.minimum(np.arange(count) + self._first(time), len(self.q) - 1)
        rows: Matrix = self.q[index]
        return rows

    def left(self, time: float) -> int:
        """Rows from ``time`` to the last one, at least one."""
        return max(len(self.q) - self._first(time), 1)

    def _first(self, time: float) -> int:
        return max(round((time - self.time) / self.period), 0)


class Reservations:
    """The latest reservation of each arm of one world.

    All controllers of a world share one, as the robots of a cell share its safety controller.
    """

    def __init__(self) -> None:
        self._of: dict[str, Reservation] = {}
        self._hulls: dict[str, BoundingSpheres] = {}
        self._looked_at: tuple[World, int] | None = None

    def hulls(self, world: World) -> Mapping[str, BoundingSpheres]:
        """Spheres around all arms of a world as it is composed now, for all controllers."""
        if self._looked_at != (world, world.generation):
            self._looked_at = world, world.generation
            self._hulls = {name: BoundingSpheres(world, name) for name in world.arms}
        return self._hulls

    def of(self, arm: str) -> Reservation | None:
        """The reservation of an arm; None until its controller has published one."""
        return self._of.get(arm)

    def publish(self, arm: str, reservation: Reservation) -> None:
        """Replace the reservation of an arm."""
        self._of[arm] = reservation

    def withdraw(self, arm: str) -> None:
        """Drop the reservation of an arm, if it has one: its controller begins anew, or is gone."""
        self._of.pop(arm, None)
