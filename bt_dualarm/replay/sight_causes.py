"""Causes of failures to see: the wrong colour, something before the camera, nothing in view."""

from __future__ import annotations

import colorsys
from collections.abc import Iterator
from typing import Final

from bt_dualarm.replay.evidence import Cause, Evidence
from bt_dualarm.replay.record import Facts
from bt_dualarm.replay.scene import Sight
from bt_dualarm.replay.world_causes import absence
from bt_dualarm.spec.color import Color
from bt_dualarm.spec.document import ObjectSpec
from bt_dualarm.spec.source import with_tuples

_OF_SIGHT: Final = frozenset({"NOT_SEEN", "LOST", "NOT_FOLLOWING", "NOT_STILL"})


def sight_causes(e: Evidence) -> Iterator[Cause]:
    """What kept the camera from its target."""
    color = e.ports.get("color")
    if color is None or e.arm not in e.record.arms:
        return
    if e.code == "UNREACHABLE" and e.leaf.kind == "track":
        yield e.cause("LEFT_REACH", e.reason, "a larger `reach`, or a target that stays nearer")
    if e.code not in _OF_SIGHT and not _saw_nothing(e):
        return
    meant = _meant(e)
    wrong = _wrong_color(e, color, meant)
    if wrong is not None:
        yield wrong
        return
    for name in meant:
        yield from _of_target(e, name)


def _saw_nothing(e: Evidence) -> bool:
    """Whether it still ran, or was halted, and had not found its target of late."""
    if e.code not in ("", "HALTED"):
        return False
    looks = e.notes("look", since=max(e.began, e.ended - 1.0), until=e.ended)
    return not any(look["pixel"] for look in looks)


def _meant(e: Evidence) -> list[str]:
    """Objects that the leaf can have meant: the one it is scored by, else those of the colour."""
    scored, color = e.ports.get("score"), e.ports.get("color")
    objects = e.record.start["objects"]
    if isinstance(scored, str) and scored in objects:
        return [scored]
    same = [name for name, thing in objects.items() if _has(thing, color)]
    loose = [name for name, thing in objects.items() if not thing["fixed"]]
    return same or loose


def _has(thing: Facts, color: object) -> bool:
    """Whether an object has the hue of a colour; light makes it brighter and darker."""
    try:
        wanted = Color.model_validate(with_tuples(color))
    except ValueError:
        return False
    red, green, blue, _ = ObjectSpec.model_validate(with_tuples(thing)).rgba
    hue, saturation, _ = colorsys.rgb_to_hsv(red, green, blue)
    return any(
        _between(360.0 * hue, each.hue) and saturation >= 0.5 * each.saturation[0]
        for each in wanted.ranges
    )


def _between(hue: float, ends: tuple[float, float]) -> bool:
    low, high = ends
    return low <= hue <= high if low <= high else hue >= low or hue <= high


def _wrong_color(e: Evidence, color: object, meant: list[str]) -> Cause | None:
    objects = e.record.start["objects"]
    if not meant or any(_has(objects[name], color) for name in meant):
        return None
    name, said = meant[0], e.leaf.ports.get("color")
    has = objects[name]["color"]
    wanted = said if isinstance(said, str) else "other hues"
    sentence = f"the camera looked for {wanted}, and {name} is {has}"
    return e.cause("WRONG_COLOR", sentence, f"color: {has}")


def _of_target(e: Evidence, name: str) -> Iterator[Cause]:
    """Why a target of the right colour was not found, by what the camera could see of it."""
    last_seen = _last_seen(e)
    gone = absence(e, name)
    if gone is not None:
        yield gone
        return
    since = e.began if last_seen is None else last_seen
    sights = [
        (scene.time, sight)
        for scene in e.moments(since=since)
        if (sight := scene.sight(e.arm, name)) is not None
    ]
    if not sights:
        return
    states = [sight.state for _, sight in sights]
    worst = max(("seen", "hidden", "outside"), key=states.count)
    if worst == "seen" and states[0] != "seen":
        worst = states[0]
    sight = next(sight for _, sight in sights if sight.state == worst)
    if worst == "hidden":
        yield _hidden(e, name, sight)
    elif worst == "outside":
        yield _outside(e, name, sight, last_seen)
    else:
        away = f"{sight.distance_m:.2f} m away"
        sentence = f"{name} was in view, {away}, and was not taken for the target"
        yield e.cause("NOT_RECOGNISED", sentence, "other ranges of the colour (bt-tune-color)")


def _hidden(e: Evidence, name: str, sight: Sight) -> Cause:
    sentence = (
        f"{sight.hidden_by} stands between the camera and {name}, {sight.distance_m:.2f} m away"
    )
    return e.cause("OCCLUDED", sentence, f"move {sight.hidden_by}, or look from elsewhere")


def _outside(e: Evidence, name: str, sight: Sight, last_seen: float | None) -> Cause:
    sentence = (
        f"{name} was outside of the picture: {sight.off_axis_deg:.0f}° off the camera's axis, "
        f"which sees {sight.half_view_deg:.0f}° up and down"
    )
    mover = _mover(e, name) if last_seen is not None else ""
    if last_seen is not None:
        sentence += f"; it was seen last at {last_seen:.2f} s" + (f", {mover}" if mover else "")
    remedy = f"a posture or base of {e.arm} from which its camera looks at {name}"
    return e.cause("OUT_OF_VIEW", sentence, remedy, time_s=last_seen)


def _last_seen(e: Evidence) -> float | None:
    """When the camera had its target last in s; None if it never had."""
    looks = e.notes("look", since=e.began, until=e.ended)
    return max((look["stamp"] for look in looks if look["pixel"]), default=None)


def _mover(e: Evidence, name: str) -> str:
    """Which arm held the object when it left, and at which leaf."""
    for arm, root in e.timeline.roots.items():
        if name in e.scene(e.ended).held(arm):
            leaves = [leaf.path for leaf in root.leaves_at(e.ended, "RUNNING")]
            at = f" at {leaves[0]!r}" if leaves else ""
            return f"{arm} carried it away{at}"
    return ""
