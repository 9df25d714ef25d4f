"""What happens between two frames of a history: ports, keys, pictures, the guard's doings."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterable, Mapping
from typing import Protocol

from bt_dualarm.errors import Number
from bt_dualarm.runtime.summary import json_ready
from bt_dualarm.tree.notes import KeyWritten, TreeNote
from bt_dualarm.world.cameras.frame import Frame, Plain
from bt_dualarm.world.cameras.look import Look


class GuardedArm(Protocol):
    """An arm whose guard keeps count of what it does."""

    @property
    def guard(self) -> Mapping[str, Number]:
        """Counts and reasons, as in `GuardReport`."""


class Held(Protocol):
    """An object that an arm holds, or is believed to hold."""

    @property
    def arm(self) -> str:
        """Who holds."""

    @property
    def object(self) -> str:
        """What is held."""

    @property
    def by_gripper(self) -> bool:
        """Whether a gripper is believed to hold it; else it is welded to the tool."""


class Notes:
    """Collects notes until somebody takes them; each is ready for JSON, its ``kind`` first.

    Args:
        clock: Function that gives simulated time in seconds; set once there is a world.

    Attributes:
        readers: Functions that are told each note as soon as it is made.
        lookers: Functions that are handed each picture, with the arm's name.
    """

    def __init__(self, clock: Callable[[], float] = lambda: 0.0) -> None:
        self.clock = clock
        self._notes: list[dict[str, object]] = []
        self._guards: dict[str, tuple[object, object]] = {}
        self._attached: tuple[Held, ...] = ()
        self._held: dict[str, tuple[tuple[str, bool], ...]] = {}
        self.readers: list[Callable[[dict[str, object]], object]] = []
        self.lookers: list[Callable[[str, Frame], object]] = []

    def take(self) -> list[dict[str, object]]:
        """What has been noted since the last time."""
        taken, self._notes = self._notes, []
        return taken

    def of_tree(self, note: TreeNote) -> None:
        """A leaf has begun, or has written a key."""
        if isinstance(note, KeyWritten):
            self._add("wrote", note.arm, note.time, leaf=note.path, key=note.key, value=note.value)
        else:
            self._add("ports", note.arm, note.time, leaf=note.path, ports=note.ports)

    def of_frame(self, arm: str, frame: Frame, crc: int | None = None) -> None:
        """A camera has taken a picture: which part, how finely, and a checksum of its pixels.

        Args:
            arm: Name of the arm.
            frame: The frame.
            crc: Checksum, where it is known.
        """
        left, top, right, bottom = frame.region
        said = {"kind": "frame", "arm": arm, "time_s": self.clock(), "stamp": float(frame.stamp)}
        if crc is None:
            crc = zlib.crc32(frame.image[top:bottom, left:right].tobytes())
        part = {"region": (left, top, right, bottom), "stride": frame.stride}
        self._keep({**said, **part, "crc": crc})
        for look in self.lookers:
            look(arm, frame)

    def of_answer(self, arm: str, stamp: float, question: str, answer: Plain) -> None:
        """Somebody has looked for something in a picture; what was found, to the last bit."""
        said = {"kind": "found", "arm": arm, "time_s": self.clock(), "stamp": float(stamp)}
        self._keep({**said, "asked": question, "answer": answer})

    def of_look(self, arm: str, look: Look) -> None:
        """Somebody has looked for a target in a frame."""
        said = {"kind": "look", "arm": arm, "time_s": self.clock(), "stamp": float(look.stamp)}
        pixel = look.pixel and (round(float(look.pixel[0]), 2), round(float(look.pixel[1]), 2))
        point = look.point and tuple(round(float(x), 6) for x in look.point)
        area = round(float(look.area_px), 1)
        found = {"pixel": pixel, "area_px": area, "point": point, "locked": bool(look.locked)}
        self._keep({**said, **found})

    def of_edit(self, arm: str, tree: Mapping[str, object]) -> None:
        """The tree of an arm is another from now on."""
        self._add("edited", arm, self.clock(), tree=tree)

    def of_guard(self, arm: str, controller: GuardedArm) -> None:
        """See whether the guard has slowed or stopped the arm since it was last asked."""
        guard = controller.guard
        now = guard.get("slowed", 0), guard.get("stopped", 0)
        before = self._guards.get(arm, (0, 0))
        self._guards[arm] = now
        if now == before:
            return
        does = "stopped" if now[1] != before[1] else "slowed"
        self._add("guard", arm, self.clock(), does=does, reason=guard.get("last_reason", ""))

    def of_holding(self, held: Iterable[Held]) -> None:
        """See whether an arm holds something else than when this was last asked."""
        attached = tuple(held)
        if attached == self._attached:
            return
        self._attached = attached
        now: dict[str, tuple[tuple[str, bool], ...]] = {}
        for one in attached:
            now[one.arm] = (*now.get(one.arm, ()), (one.object, one.by_gripper))
        for arm in sorted(now.keys() | self._held.keys()):
            holds = now.get(arm, ())
            if holds != self._held.get(arm, ()):
                gripped = [thing for thing, by_gripper in holds if by_gripper]
                welded = [thing for thing, by_gripper in holds if not by_gripper]
                self._add("holds", arm, self.clock(), gripped=gripped, welded=welded)
        self._held = now

    def _add(self, kind: str, arm: str, time: float, **fields: object) -> None:
        note = {"kind": kind, "arm": arm, "time_s": time, **fields}
        self._keep({name: json_ready(value) for name, value in note.items()})

    def _keep(self, note: dict[str, object]) -> None:
        self._notes.append(note)
        for read in self.readers:
            read(note)
