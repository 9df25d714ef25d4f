"""What an arm senses of what its gripper holds: is it there, does it slip?"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from typing import Final

from bt_dualarm.arm.arm import Arm
from bt_dualarm.arm.hold_signs import LOST_S, has_slid
from bt_dualarm.errors import Failure

_FIRM: Final = 4.0  # times the force that is pressed with: some comes before the arm has stopped
_JUDGED_S: Final = 1.0  # that fingers may take to shut


class Grip:
    """A gripper that holds something, watched from now on.

    Args:
        arm: Arm whose gripper it is.
        thing: Name of what it holds.

    Attributes:
        width: Opening in m when the watch began.
    """

    def __init__(self, arm: Arm, thing: str) -> None:
        self._arm, self._thing = arm, thing
        self.width = arm.gripper.width
        self._widths: deque[tuple[float, float]] = deque()

    def look(self) -> None:
        """Check what is sensed of the hold; to be called once a tick.

        Raises:
            Failure: ``SLIPPED`` where the fingers have moved on what they hold, ``DROPPED`` where
                nothing is between them any more, or the cup does not seal.
        """
        gripper = self._arm.gripper
        if gripper.is_lost:
            fingers = gripper.page.fingers
            how = "is no longer between the fingers" if fingers else "came off the cup"
            raise self._failure("DROPPED", how)
        if gripper.page.fingers:
            moved = abs(self._settled_width() - self.width)
            if has_slid(gripper.page, moved):
                raise self._failure("SLIPPED", f"slips: the fingers moved {1e3 * moved:.1f} mm")

    def firm_for(self, force_n: float) -> float:
        """Hold so firmly that what is held can be pressed on something and does not slide.

        Args:
            force_n: Force in N along the pads.

        Returns:
            That force, or less: what friction bears with half of it in hand at the most force.
        """
        gripper, thing = self._arm.gripper, self._arm.world.objects[self._thing]
        page = gripper.page
        if not page.fingers:
            return force_n  # the cup is pressed on
        friction = 2.0 * max(page.friction, thing.friction)  # of two pads
        needed = _FIRM * force_n / max(friction, 1e-3)
        held = self._arm.world.attachments.find(self._arm.name, self._thing)
        bears = math.inf if held is None else held.most_force
        firm = min(page.force.clipped(needed), bears)
        if firm > gripper.commanded.force:
            gripper.command(force=firm)
        return min(force_n, gripper.commanded.force * friction / _FIRM)

    def judge(self, slip: Failure) -> Iterator[None]:
        """Stop, and see what is left between the fingers when they stand.

        Args:
            slip: What `look` has raised.

        Raises:
            Failure: ``DROPPED`` where nothing is left, else what was given.
        """
        yield from self._arm.halt()
        gripper, began = self._arm.gripper, self._arm.time
        while self._arm.time - began < _JUDGED_S and not gripper.is_lost:
            yield None
        if gripper.is_lost:
            raise self._failure("DROPPED", "is no longer between the fingers") from None
        raise slip

    def _settled_width(self) -> float:
        """The opening, by the smallest change of the last moments: one reading may be off."""
        now, gripper = self._arm.time, self._arm.gripper
        self._widths.append((now, gripper.width))
        while now - self._widths[0][0] > LOST_S:
            self._widths.popleft()
        return min((width for _, width in self._widths), key=lambda one: abs(one - self.width))

    def _failure(self, code: str, how: str) -> Failure:
        gripper = self._arm.gripper
        if code == "DROPPED":
            gripper.let_go(self._thing)
        return Failure(
            code,
            f"{self._thing!r} {how}",
            width_m=gripper.width,
            width_before_m=self.width,
            force_n=gripper.force,
        )
