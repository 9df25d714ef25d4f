"""Which arm held which object, from when to when."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from bt_dualarm.errors import Number
from bt_dualarm.pose import Vector
from bt_dualarm.runtime.tracks import Sample
from bt_dualarm.tree.first_and_last import FirstAndLast


class Attached(Protocol):
    """One attachment as the world has it."""

    @property
    def arm(self) -> str:
        """Who holds."""

    @property
    def object(self) -> str:
        """What is held."""

    @property
    def since(self) -> float:
        """Simulated time in seconds at which it was attached."""


class HoldingWorld(Protocol):
    """What is read of the world."""

    @property
    def attachments(self) -> Iterable[Attached]:
        """All that there are now."""


MOST_HOLDINGS = 1000
"""Attachments that are kept from the beginning of a run, and as many of the latest."""


@dataclass
class Holding:
    """One attachment from its beginning to its end.

    Attributes:
        arm: Who held.
        object: What was held.
        attached_s: Simulated time in seconds.
        released_s: None while it is still held.
        lifted_m: Metres by which the object rose while it was held.
    """

    arm: str
    object: str
    attached_s: float
    released_s: float | None = None
    lifted_m: float = 0.0

    def during(self, time: Vector) -> npt.NDArray[np.bool_]:
        """Which of some simulated times, of shape (n,), fall into it."""
        until = np.inf if self.released_s is None else self.released_s
        return (time >= self.attached_s) & (time <= until)


class _Open:
    """An attachment whose object is looked at still.

    Args:
        holding: The attachment.
    """

    def __init__(self, holding: Holding) -> None:
        self.holding = holding
        self._from: float | None = None

    def look(self, sample: Sample) -> None:
        """See how high its object is, if it was held then."""
        point = sample.point(f"object_{self.holding.object}")
        if point is None or sample.time < self.holding.attached_s:
            return
        height = float(point[2])
        if self._from is None:
            self._from = height
        self.holding.lifted_m = max(self.holding.lifted_m, height - self._from)


class Holdings:
    """Remembers attachments; looked at after each tick, as only skills attach.

    What it keeps is bounded: the first and the last ones of a run in which there are many.

    Args:
        world: World that knows what is attached now.
    """

    def __init__(self, world: HoldingWorld) -> None:
        self._world = world
        self._kept: FirstAndLast[Holding] = FirstAndLast(MOST_HOLDINGS)
        self._held: dict[tuple[str, str, float], _Open] = {}
        self._released: list[_Open] = []

    def after_ticks(self, time: float) -> None:
        """Take up what has been attached or released."""
        now = {(held.arm, held.object, held.since) for held in self._world.attachments}
        for key in sorted(now - self._held.keys()):
            self._held[key] = _Open(Holding(*key))
            self._kept.add(self._held[key].holding)
        for key in self._held.keys() - now:
            released = self._held.pop(key)
            released.holding.released_s = time
            self._released.append(released)

    def sampled(self, sample: Sample) -> None:
        """See how high the objects are that are held."""
        for one in self._held.values():
            one.look(sample)
        for one in self._released:
            if sample.time <= (one.holding.released_s or 0.0):
                one.look(sample)
        self._released.clear()

    def of(self, arm: str) -> list[Holding]:
        """All of an arm that are kept, in the order in which they began."""
        return [held for held in self._kept if held.arm == arm]

    @property
    def left_out(self) -> int:
        """Number of attachments that are not kept."""
        return self._kept.left_out

    def as_dicts(self) -> list[dict[str, Number | None]]:
        """All that are kept, JSON-ready."""
        return [dict(vars(held)) for held in self._kept]
