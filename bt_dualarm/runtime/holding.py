"""Which arm held which object, from when to when."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from bt_dualarm.errors import Number
from bt_dualarm.pose import Vector
from bt_dualarm.runtime.tracks import Tracks


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


@dataclass
class Holding:
    """One attachment from its beginning to its end.

    Attributes:
        arm: Who held.
        object: What was held.
        attached_s: Simulated time in seconds.
        released_s: None while it is still held.
    """

    arm: str
    object: str
    attached_s: float
    released_s: float | None = None

    def during(self, time: Vector) -> npt.NDArray[np.bool_]:
        """Which of some simulated times, of shape (n,), fall into it."""
        until = np.inf if self.released_s is None else self.released_s
        return (time >= self.attached_s) & (time <= until)


class Holdings:
    """Remembers every attachment; looked at after each tick, as only skills attach.

    Args:
        world: World that knows what is attached now.
    """

    def __init__(self, world: HoldingWorld) -> None:
        self._world = world
        self._all: dict[tuple[str, str, float], Holding] = {}

    def after_ticks(self, time: float) -> None:
        """Take up what has been attached or released."""
        now = {(held.arm, held.object, held.since) for held in self._world.attachments}
        for key in sorted(now - self._all.keys()):
            self._all[key] = Holding(*key)
        for key, holding in self._all.items():
            if key not in now and holding.released_s is None:
                holding.released_s = time

    def of(self, arm: str) -> list[Holding]:
        """All of an arm, in the order in which they began."""
        return [held for held in self._all.values() if held.arm == arm]

    def as_dicts(self, tracks: Tracks) -> list[dict[str, Number | None]]:
        """JSON-ready, with ``lifted_m``: how far the object rose while it was held."""
        return [{**vars(held), "lifted_m": _rise(held, tracks)} for held in self._all.values()]


def _rise(held: Holding, tracks: Tracks) -> float:
    during = held.during(tracks.time)
    path = tracks.positions().get(f"object_{held.object}")
    if path is None or not during.any():
        return 0.0
    heights = path[during, 2]
    return float(np.nanmax(heights) - heights[0])
