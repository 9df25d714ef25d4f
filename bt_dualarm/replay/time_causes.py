"""Causes that lie in time: a timeout, the end of the run, an arm that waits for another."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from bt_dualarm.replay.evidence import Cause, Evidence
from bt_dualarm.replay.reach_causes import other_arm, target_of
from bt_dualarm.replay.timeline import Node

_STILL_M: Final = 2e-3
"""Way of the tool up to which a leaf has not moved its arm."""

_AT_TARGET_M: Final = 0.15
"""Distance from a target up to which what is there keeps tool or wrist out."""


def time_causes(e: Evidence) -> Iterator[Cause]:
    """What the leaf waited for, or who cut it short."""
    if e.code not in ("", "HALTED", "TIMED_OUT"):
        return
    held_up = _held_up(e)
    if held_up is not None:
        yield held_up
        return
    if e.code == "TIMED_OUT":
        yield e.cause("TOO_LITTLE_TIME", e.reason)
        return
    limit = next((node for node in reversed(e.verdict.chain) if node.kind == "timeout"), None)
    ran = f"{e.leaf.path!r} had run for {e.ended - e.began:.2f} s"
    if e.verdict.at is None and limit is not None and limit.last("FAILURE") is not None:
        seconds = limit.ports.get("seconds")
        sentence = f"the timeout {limit.path!r} of {seconds} s ended it: {ran}"
        faster = ", or a faster motion" if "speed" in e.ports else ""
        remedy = f"more seconds than {seconds}{faster}"
        yield e.cause("TOO_LITTLE_TIME", sentence + _usual(e), remedy, leaf=limit.path)
    elif e.verdict.at is not None:
        yield _at_work(e)
    elif e.verdict.end is None or _ended_with_run(e):
        sentence = f"the run ended at {e.record.until:.2f} s: {ran}{_usual(e)}"
        yield e.cause("TOO_LITTLE_TIME", sentence, "a later time_limit or --duration")


def _at_work(e: Evidence) -> Cause:
    """What a leaf was about at a time, and what came of it."""
    later = [each for each in e.leaf.changes if each.time > e.ended and each.old == "RUNNING"]
    came = "it was still running at the end of the record"
    if later:
        end = later[0]
        what = {"SUCCESS": "it succeeded", "FAILURE": f"it failed with {end.code}"}
        came = f"{what.get(end.new, 'it was halted')} at {end.time:.2f} s"
    waits = ": it waits for its time to pass" if e.leaf.kind == "wait" else ""
    sentence = f"{e.leaf.path!r} had run for {e.ended - e.began:.2f} s{waits}; {came}"
    return e.cause("RUNNING", sentence)


def _held_up(e: Evidence) -> Cause | None:
    """The arm that this one waited for, as its guard said."""
    said = e.notes("guard", since=e.began, until=e.ended + 0.05)
    reasons = [e.reason, *(str(note["reason"]) for note in reversed(said[-3:]))]
    if e.code != "TIMED_OUT" and not (said and said[-1]["does"] == "stopped"):
        return _waited_for(e)
    for reason in reasons:
        for other in e.record.arms:
            if other != e.arm and f"{other}/" in reason:
                cause = other_arm(e, other)
                return e.cause(cause.kind, f"{cause.sentence}; {reason}", cause.remedy)
    return None


def _waited_for(e: Evidence) -> Cause | None:
    """An arm at the target of a leaf that has not moved: it waited for that one to leave."""
    wanted = target_of(e)
    tools = [e.scene(time).tool(e.arm) for time in (e.began, e.ended)]
    if wanted is None or tools[0] is None or tools[1] is None:
        return None
    if float(np.linalg.norm(tools[1] - tools[0])) > _STILL_M:
        return None
    for body in e.scene(e.ended).near(wanted[1], _AT_TARGET_M):
        owner = body.partition("/")[0]
        holders = [arm for arm in e.record.arms if owner in e.scene(e.ended).held(arm)]
        other = (holders or [owner])[0]
        if other in e.record.arms and other != e.arm:
            cause = other_arm(e, other)
            sentence = f"{cause.sentence}; {body} is where the tool is to be"
            return e.cause(cause.kind, sentence, cause.remedy, leaf=cause.leaf)
    return None


def _usual(e: Evidence) -> str:
    """How long the same leaf took when it was left to end."""
    took = [end.time - e.leaf.begun(end).time for end in e.leaf.changes if end.new == "SUCCESS"]
    return f"; it took {max(took):.2f} s another time" if took else ""


def _ended_with_run(e: Evidence) -> bool:
    """Whether the root was halted at the same moment."""
    root: Node = e.verdict.chain[0]
    last = root.changes[-1] if root.changes else None
    return last is not None and last.new == "INVALID" and abs(last.time - e.verdict.time) < 1e-6
