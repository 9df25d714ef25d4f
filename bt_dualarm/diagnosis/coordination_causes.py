"""Causes that lie with another arm: a wait for a signal, at a rendezvous, or for a claim."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from bt_dualarm.diagnosis.evidence import Cause, Evidence, descend
from bt_dualarm.skill.cell import waiting_sentence
from bt_dualarm.spec.cell import AWAIT, CLAIM, MEET

_CODES: Final = frozenset({"", "HALTED", "TIMEOUT", "PARTNER_GONE", "DEADLOCK"})


def coordination_causes(e: Evidence) -> Iterator[Cause]:
    """Yields causes of a node that waited for other arms: what they did meanwhile."""
    if e.leaf.kind not in (AWAIT, MEET, CLAIM) or e.code not in _CODES:
        return
    if e.code == "DEADLOCK":
        remedy = "meet and claim in the same order in all trees, or give one wait a timeout"
        yield e.cause("DEADLOCK", e.reason, remedy, leaf=e.leaf.path)
        return
    waits = [
        note
        for note in e.notes("waits", since=e.began, until=e.ended)
        if note["leaf"] == e.leaf.path
    ]
    if not waits and e.code != "PARTNER_GONE":
        return
    others = [str(other) for other in waits[-1]["others"]] if waits else []
    what = e.reason
    if waits:
        since = float(waits[-1]["since"])
        what = f"{e.arm} {waiting_sentence(str(waits[-1]['target']), others, since)}"
        what += f" ({e.reason})" if e.reason else ""
    for other in others or [name for name in e.timeline.roots if f"{name} " in e.reason]:
        if other == e.arm or other not in e.timeline.roots:
            continue
        sentence, leaf, time = _meanwhile(e, other)
        yield e.cause("OTHER_ARM", f"{what}: {sentence}", leaf=leaf, time_s=time)


def _meanwhile(e: Evidence, other: str) -> tuple[str, str, float | None]:
    """What another arm did when the wait ended: a sentence, the leaf, the time of its end."""
    root = e.timeline.roots[other]
    failed = root.last("FAILURE")
    if failed is not None and failed.time <= e.ended:
        deciding = descend(root, failed)
        end = deciding.end or failed
        sentence = f"{other} had failed at {end.time:.2f} s, at {deciding.leaf.path!r}"
        return f"{sentence} with {end.code}: {end.reason}", deciding.leaf.path, end.time
    removal = e.timeline.removal(other)
    if removal is not None and removal[1].time <= e.ended:
        return f"{other} was removed at {removal[1].time:.2f} s", "", removal[1].time
    doing = [leaf.path for leaf in root.leaves_at(e.ended, "RUNNING")]
    if doing:
        return f"{other} was at {doing[0]!r} then", doing[0], None
    return f"the tree of {other} was {root.status_at(e.ended)} then", "", None
