"""All that is known of one leaf that failed, or that a run waited for: what causes are found in."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

from bt_dualarm.replay.decisive import Verdict
from bt_dualarm.replay.record import Facts, Record
from bt_dualarm.replay.scene import Scene
from bt_dualarm.replay.timeline import Node, Timeline
from bt_dualarm.spec.ports import REFERENCE

LOOK_BACK_S: Final = 1.0
"""Seconds before the end of a leaf that are told about."""

_MOST_SCENES: Final = 64
"""Moments that are kept for the causes that look at them again."""

_WITH_UNIT: Final = re.compile(r"_(m|mm|rad|deg|n|nm|kg|s|hz|px|px2|share|rad_s|m_s)$")
"""The end of a name of a number, as `bt_dualarm.errors.Failure` has them."""


@dataclass(frozen=True)
class Cause:
    """Why a leaf failed, as far as the record shows.

    Attributes:
        kind: Upper-case identifier, the same for all causes of a sort.
        sentence: What was the matter, with numbers.
        remedy: What would have to change, where that is known; else empty.
        arm: Arm that it happened to.
        leaf: Path of the leaf that brought it about; empty if none did.
        time_s: When it came about in s; None if it was so from the start.
    """

    kind: str
    sentence: str
    remedy: str = ""
    arm: str = ""
    leaf: str = ""
    time_s: float | None = None


@dataclass(frozen=True, eq=False)
class Evidence:
    """One run of one leaf.

    Attributes:
        record: The record.
        timeline: Trees of it.
        verdict: The leaf, and how it ended.
    """

    record: Record
    timeline: Timeline
    verdict: Verdict

    @property
    def leaf(self) -> Node:
        """The leaf itself."""
        return self.verdict.leaf

    @property
    def arm(self) -> str:
        """Name of the arm."""
        return self.leaf.arm

    @property
    def robot(self) -> str:
        """Name of its robot, or the page that describes it."""
        return str(self.record.arms[self.arm]["robot"])

    @property
    def code(self) -> str:
        """Code of its end; empty while it runs."""
        return "" if self.verdict.end is None else self.verdict.end.code

    @property
    def reason(self) -> str:
        """Sentence of its end."""
        return "" if self.verdict.end is None else self.verdict.end.reason

    @property
    def numbers(self) -> Mapping[str, Any]:  # numbers and names, as JSON has them
        """Metrics, and the numbers of its failure; what has a unit in its name is a number."""
        if self.verdict.end is None:
            return {}
        return {
            name: value
            for name, value in self.verdict.end.metrics.items()
            if not _WITH_UNIT.search(name)
            or (isinstance(value, float | int) and not isinstance(value, bool))
        }

    @property
    def ended(self) -> float:
        """When it ended, or the end of the record, in s."""
        return min(self.verdict.time, self.record.until)

    @cached_property
    def began(self) -> float:
        """When this run of it began in s."""
        end = self.verdict.end
        if end is not None:
            return self.leaf.begun(end).time
        until = self.ended + 1e-9
        running = [each for each in self.leaf.changes if each.new == "RUNNING"]
        return max((each.time for each in running if each.time <= until), default=0.0)

    @cached_property
    def ports(self) -> Facts:
        """Ports with the values that they had; as the file has them where it never began."""
        for note in reversed(self.notes("ports", until=self.ended)):
            if note["leaf"] == self.leaf.path:
                return dict(note["ports"])
        return dict(self.leaf.ports)

    @cached_property
    def keys(self) -> list[Facts]:
        """Keys that its ports refer to: key, port, value, writer, time; None where unwritten."""
        found = []
        for port, value in self.leaf.ports.items():
            for key in REFERENCE.findall(value) if isinstance(value, str) else ():
                written = [
                    note for note in self.notes("wrote", until=self.ended) if note["key"] == key
                ]
                last = written[-1] if written else {"value": None, "leaf": None, "time_s": None}
                found.append({"key": key, "port": port, **_only(last, "value", "leaf", "time_s")})
        return found

    def notes(self, kind: str, *, since: float = 0.0, until: float | None = None) -> list[Facts]:
        """Notes of its arm, in order, of one kind and between two times in s."""
        end = self.record.until + 1.0 if until is None else until
        return [
            note
            for note in self.record.notes
            if note["kind"] == kind and note["arm"] == self.arm and since <= note["time_s"] <= end
        ]

    def scene(self, time: float) -> Scene:
        """The world at a time in s."""
        when, scenes = round(time, 3), self.timeline.scenes
        if when not in scenes:
            while len(scenes) >= _MOST_SCENES:
                del scenes[next(iter(scenes))]
            scenes[when] = Scene(self.record, when)
        return scenes[when]

    def moments(self, count: int = 12, since: float | None = None) -> Iterator[Scene]:
        """The world at a few times of its run, the last one first.

        Args:
            count: Number of moments at most.
            since: First time in s; by default when it began.
        """
        first = self.began if since is None else max(since, 0.0)
        span = max(self.ended - first, 0.0)
        for number in range(count):
            yield self.scene(self.ended - span * number / count)

    def moments_before(self, count: int) -> Iterator[Scene]:
        """The world at even times from its beginning back to the start, the last one first."""
        for number in range(1, count + 1):
            yield self.scene(self.began * (1.0 - number / count))

    def cause(
        self,
        kind: str,
        sentence: str,
        remedy: str = "",
        *,
        leaf: str = "",
        time_s: float | None = None,
    ) -> Cause:
        """A cause that concerns its arm."""
        return Cause(kind, sentence, remedy, self.arm, leaf, time_s)


def _only(facts: Facts, *names: str) -> Facts:
    return {name: facts[name] for name in names}
