"""Why a leaf failed: causes by topic, the most telling first."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

from bt_dualarm.replay.board_causes import board_causes
from bt_dualarm.replay.camera_causes import camera_causes
from bt_dualarm.replay.contact_causes import contact_causes
from bt_dualarm.replay.evidence import Cause, Evidence
from bt_dualarm.replay.grip_causes import grip_causes
from bt_dualarm.replay.reach_causes import reach_causes
from bt_dualarm.replay.sight_causes import sight_causes
from bt_dualarm.replay.time_causes import time_causes
from bt_dualarm.replay.world_causes import world_causes

_TOPICS: Final[tuple[Callable[[Evidence], Iterator[Cause]], ...]] = (
    board_causes,
    world_causes,
    grip_causes,
    contact_causes,
    camera_causes,
    sight_causes,
    reach_causes,
    time_causes,
)

_OF_OTHER_SHAPE: Final = (LookupError, TypeError, ValueError, AttributeError, ArithmeticError)
"""What Python raises where data is not of the shape that a rule takes it for."""


def causes_of(e: Evidence) -> tuple[Cause, ...]:
    """Causes of the end of a leaf; at least what it says itself."""
    found: list[Cause] = []
    unreadable: list[Cause] = []
    for topic in _TOPICS:
        try:
            causes = [*topic(e)]
        except _OF_OTHER_SHAPE as error:
            # Ports, metrics and values of keys are the skill's, which need not be here: a record
            # of a stranger may have any JSON there.
            what = f"what the record says of {e.leaf.path!r} is not what {e.leaf.kind} would have"
            sentence = f"{what}: {type(error).__name__}: {str(error)[:200]}"
            unreadable.append(e.cause("UNREADABLE", sentence, leaf=e.leaf.path))
            continue
        for cause in causes:
            if all((cause.kind, cause.sentence) != (known.kind, known.sentence) for known in found):
                found.append(cause)
    return (*(found or (_own_words(e),)), *unreadable[:1])


def _own_words(e: Evidence) -> Cause:
    if e.leaf.kind == "fail":
        sentence = f"the tree itself says so ({e.leaf.place}): {e.reason}"
        return e.cause("SAID_SO", sentence, leaf=e.leaf.path)
    if e.code == "BUSY":
        owner = str(e.numbers.get("owner", ""))
        sentence = f"{e.leaf.path!r} wanted to move {e.arm} while {owner!r} was moving it"
        return e.cause("BUSY", sentence, "one after the other, in a sequence", leaf=owner)
    if e.code == "EXCEPTION":
        sentence = f"the code of {e.leaf.kind} has a fault: {e.reason} (see run.log)"
        return e.cause("FAULT", sentence, leaf=e.leaf.path)
    if not e.code:
        return e.cause("RUNNING", f"{e.leaf.path!r} was running and nothing held it up")
    return e.cause(e.code, e.reason or f"{e.leaf.path!r} ended with {e.code}")
