"""What an arm touches while one leaf moves it, for the leaf's metrics."""

from __future__ import annotations

from collections.abc import Collection

from bt_dualarm.errors import Number
from bt_dualarm.world.touches import Touches, TouchWatch


class Touching:
    """The touches of one leaf's motions: a score, which nothing that moves the arm can read.

    Args:
        touches: Touches of all arms.
        arm: Name of the arm.
    """

    def __init__(self, touches: Touches, arm: str) -> None:
        self._touches, self._arm = touches, arm
        self._watch: TouchWatch | None = None

    def begin(self) -> None:
        """The leaf begins to move the arm; again changes nothing."""
        if self._watch is None:
            self._watch = self._touches.watch(self._arm)

    def end(self, asked: Collection[str]) -> dict[str, Number]:
        """What was touched since, for the metrics; nothing where nothing was.

        Args:
            asked: Names of the things that the leaf was asked to deal with.
        """
        if self._watch is None:
            return {}
        watch, self._watch = self._watch, None
        self._touches.end(watch)
        forces = {thing: force for thing, force in watch.forces_n.items() if thing not in asked}
        if not forces:
            return {}
        hardest_first = sorted(forces, key=lambda thing: (-forces[thing], thing))
        return {"touched": ", ".join(hardest_first), "touch_force_n": max(forces.values())}
