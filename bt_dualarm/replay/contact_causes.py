"""Causes that lie in contacts and forces: blocked, pressed too hard, hit, nothing to touch."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import Final

from bt_dualarm.replay.evidence import LOOK_BACK_S, Cause, Evidence
from bt_dualarm.replay.scene import Touch
from bt_dualarm.replay.world_causes import carried

_USUAL_LIMIT_N: Final = 280.0
"""Force limit of an arm whose file says nothing."""

_RESTING_M: Final = 1e-6


def contact_causes(e: Evidence) -> Iterator[Cause]:
    """What the arm touched, or did not."""
    if e.code == "FORCE_LIMIT":
        yield from _pressed(e)
    if e.code == "COLLISION":
        yield from _hit(e)
    if e.code in ("TRACKING_ERROR", "NOT_REACHED", "PROXIMITY_NOT_REACHED"):
        yield from _blocked(e)
    if e.code == "NO_CONTACT":
        yield _nothing_there(e)


def _nothing_there(e: Evidence) -> Cause:
    """A way to the touch, or a place to stand, that is too far from what there is."""
    if "search" in e.ports:
        below = 1e3 * float(e.ports["search"])
        sentence = f"there is no ground within {below:.0f} mm below the place: {e.reason}"
        return e.cause("NOTHING_THERE", sentence, "a lower `at`, or a longer `search`")
    way = 1e3 * float(e.numbers.get("distance_m", 0.0))
    sentence = f"there was nothing to touch within {way:.0f} mm"
    return e.cause("NOTHING_THERE", sentence, "a longer distance, or another direction")


def _pressed(e: Evidence) -> Iterator[Cause]:
    limit = float(e.record.arms[e.arm]["force_limit"])
    second = e.numbers.get("second", "something")
    wanted = e.ports.get("force")
    if limit < _USUAL_LIMIT_N:
        asked = f"; the leaf itself asks for {wanted} N" if wanted is not None else ""
        sentence = (
            f"the force limit of {e.arm} is {limit:g} N, and it pressed on {second} with "
            f"{float(e.numbers.get('force_n', 0.0)):.0f} N{asked}"
        )
        yield e.cause("LOW_FORCE_LIMIT", sentence, "a higher force_limit, or a slower motion")
    else:
        yield e.cause("PRESSED", e.reason, f"move {second} away, or go slower")


def _hit(e: Evidence) -> Iterator[Cause]:
    threshold = float(e.record.arms[e.arm]["collision"]["threshold"])
    met = _met(e)
    if met:
        touch = met[0]
        sentence = f"{touch.own} ran into {touch.other}: {e.reason}"
        yield e.cause("RAN_INTO", sentence, f"move {touch.other} away, or go another way")
    elif threshold < 1.0:
        sentence = f"the threshold of a hit is {threshold:g} times the usual one: {e.reason}"
        yield e.cause("LOW_THRESHOLD", sentence, "collision: {threshold: 1.0}")
    else:
        yield e.cause("HIT", e.reason)


def _blocked(e: Evidence) -> Iterator[Cause]:
    met = _met(e)
    if met:
        touch = met[0]
        other = touch.other.partition("/")[0]
        kind = "OTHER_ARM" if other in e.record.arms else "BLOCKED"
        sentence = f"{touch.own} was blocked by {touch.other}: {e.reason}"
        yield e.cause(kind, sentence, f"move {other} away, or go another way")
        return
    saturated = int(e.numbers.get("saturated", 0) or _guard_saturated(e))
    held = e.scene(e.ended).held(e.arm)
    if held and saturated:
        objects = e.record.start["objects"]
        mass = sum(float(objects[name]["mass"]) for name in held if name in objects)
        sentence = f"{e.arm} was too weak for the {mass:g} kg that it held: {e.reason}"
        yield e.cause("OVERLOADED", sentence, "a lighter object, or a slower motion")


def _met(e: Evidence) -> list[Touch]:
    """What the arm touched shortly before the end and not before that, the commonest first."""
    held = carried(e)  # by fingers, too, of which no weld tells
    before = {(touch.own, touch.other) for touch in e.scene(e.ended - LOOK_BACK_S).touches(e.arm)}
    found: Counter[tuple[str, str]] = Counter()
    deepest: dict[tuple[str, str], Touch] = {}
    for scene in e.moments(25, since=e.ended - LOOK_BACK_S):
        for touch in scene.touches(e.arm):
            if touch.other in held:
                continue
            pair = touch.own, touch.other
            if touch.depth_m > _RESTING_M:
                found[pair] += 1
                deepest.setdefault(pair, touch)
    new = [pair for pair, _ in found.most_common() if pair not in before]
    return [deepest[pair] for pair in new or [pair for pair, _ in found.most_common()]]


def _guard_saturated(e: Evidence) -> int:
    if e.record.summary is None:
        return 0
    return int(e.record.summary["arms"].get(e.arm, {}).get("guard", {}).get("saturated", 0))
