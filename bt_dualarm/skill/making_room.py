"""Making room: an arm that waits for others moves aside if it is in the way of what it waits for.

It does so only where the run would otherwise end the wait with ``DEADLOCK``, at most `ASIDES` times
a wait, straight and without turning its tool, and it returns before its tree goes on. An arm that
holds a part of a fixture, or whose hand or held object touches something, stays where it is.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from bt_dualarm.arm.arm import Arm
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Vector
from bt_dualarm.skill.cell import CellState, CellWait

ASIDES: Final = 3
"""How often an arm moves aside in one wait: one place may be as much in the way as another."""

_SPEED: Final = 0.4  # fraction of the arm's limits
_LOST: Final = ("IN_COLLISION", "NO_PLAN", "TIMED_OUT", "DEADLOCK")


class WaitingPlace:
    """Where an arm waits for others, and to which it returns.

    Args:
        arm: Arm of the leaf that waits.
        cell: What the trees share.
    """

    def __init__(self, arm: Arm, cell: CellState) -> None:
        self._arm = arm
        self._cell = cell
        self._places: list[Vector] = []
        self._for = ""

    @property
    def is_left(self) -> bool:
        """Whether the arm has moved aside, and has not returned."""
        return bool(self._places)

    def make_room(self, wait: CellWait) -> Iterator[None]:
        """Move aside for the arm that asks for it; yields once per tick.

        Args:
            wait: The wait, which is asked.
        """
        arm = self._arm
        self._places.append(arm.setpoint.q.copy())
        moving = arm.past_others(_SPEED).make_room(wait.asked_by, self._places)
        moved = False
        try:
            while True:
                try:
                    next(moving)
                except StopIteration as end:
                    moved = bool(end.value)
                    return
                yield
        finally:
            if moved:
                self._for = wait.asked_by
            else:
                self._places.pop()
            self._cell.made_room(wait, moved=moved)

    def come_back(self) -> Iterator[None]:
        """Return to where the arm was when it began to wait; yields once per tick.

        Raises:
            Failure: ``DEADLOCK`` if others stay there; as motions.
        """
        if not self._places:
            return
        try:
            for _ in self._arm.travel([self._places[0]], _SPEED):
                yield
            self._places.clear()
        except Failure as failure:
            if failure.code not in _LOST:
                raise
            raise Failure(
                "DEADLOCK",
                f"{self._arm.name} moved aside for {self._for} while it waited, and cannot return: "
                f"{failure.reason}",
            ) from failure
