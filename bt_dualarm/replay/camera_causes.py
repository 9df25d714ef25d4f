"""Causes that lie in a camera itself: pictures that come late, or do not come."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from bt_dualarm.replay.evidence import Cause, Evidence

OF_SIGHT: Final = frozenset({"NOT_SEEN", "LOST", "NOT_FOLLOWING", "NOT_STILL"})
"""Codes of leaves that did not see what they look for, or not often enough."""

_LATE_S: Final = 0.5
"""Latency by which no arm can follow anything that moves."""

_MANY: Final = 0.5
"""Share of pictures that are lost of which a tracker takes notice."""


def camera_causes(e: Evidence) -> Iterator[Cause]:
    """What was the matter with the pictures, whatever was in them."""
    camera = e.record.arms[e.arm].get("camera") if e.arm in e.record.arms else None
    if not camera or e.code not in OF_SIGHT | {"", "HALTED"}:
        return
    taken = e.notes("frame", since=e.began, until=e.ended)
    if not taken:
        return
    latency, drop = float(camera["latency"]), float(camera["drop"])
    if latency >= _LATE_S:
        sentence = (
            f"pictures of {e.arm} come {latency:g} s after they were taken (latency): "
            "what it saw had moved on by then"
        )
        yield e.cause("LATE_PICTURES", sentence, "a smaller latency, or a target that rests")
    if drop >= _MANY:
        seen = len(e.notes("look", since=e.began, until=e.ended))
        sentence = (
            f"pictures of {e.arm} get lost: of {len(taken)} that were taken {seen} came "
            f"(drop: {drop:g})"
        )
        yield e.cause("LOST_PICTURES", sentence, "a camera that loses fewer, or more a second")
