"""Causes of failures to see: the wrong colour, something before the camera, nothing in view."""

from __future__ import annotations

import colorsys
import itertools
from collections.abc import Iterator
from typing import Final

import numpy as np

from bt_dualarm.replay.camera_causes import OF_SIGHT
from bt_dualarm.replay.evidence import Cause, Evidence
from bt_dualarm.replay.record import Facts
from bt_dualarm.replay.scene import Sight
from bt_dualarm.replay.world_causes import absence
from bt_dualarm.spec.color import Color
from bt_dualarm.spec.document import ObjectSpec
from bt_dualarm.spec.source import with_tuples

_ANOTHER_SIZE: Final = 0.2
"""Share of its longest side by which a thing is of another size."""

_BEHIND: Final = 0.15
"""Share of a picture from which on what goes beyond its edge may be the ground of things."""

_MOSTLY: Final = 0.7
"""Share of pictures with the target from which on seeing it was not what failed."""

_FOLLOWED_S: Final = 2.0
"""Seconds before the end whose pictures count for that."""

_FOLLOWED_LOOKS: Final = 40
"""Moments at which speeds are measured."""

_FULL: Final = 0.5
"""Share of a limit from which on an arm is about as quick as it can be."""

_LOOKING_AROUND: Final = frozenset({"scan", "locate"})
"""Leaves that turn the camera themselves: what is hidden wherever they look is what matters."""


def sight_causes(e: Evidence) -> Iterator[Cause]:
    """What kept the camera from its target."""
    color, thing, marker = (e.ports.get(name) for name in ("color", "object", "marker"))
    if (color, thing, marker) == (None, None, None) or e.arm not in e.record.arms:
        return
    if color is None and e.code not in OF_SIGHT | {"INACCURATE"}:
        return  # many leaves have an object that they do not look for
    if e.code == "UNREACHABLE" and e.leaf.kind == "track":
        yield e.cause("LEFT_REACH", e.reason, "a larger `reach`, or a target that stays nearer")
    meant = _meant(e)
    if e.code == "INACCURATE":
        yield from filter(None, (_wrong_kind(e, meant),))
    if e.code not in OF_SIGHT and not _saw_nothing(e):
        return
    if e.code == "NOT_FOLLOWING" and meant and _seen_share(e) > _MOSTLY:
        yield _too_slow(e, meant[0])
        return
    wrong = _wrong_kind(e, meant) or (_wrong_color(e, color, meant) if color else None)
    if wrong is not None:
        yield wrong
        return
    for name in meant:
        yield from _of_target(e, name)


def _seen_share(e: Evidence) -> float:
    """Share of the pictures before the end in which the target was found."""
    looks = e.notes("look", since=max(e.began, e.ended - _FOLLOWED_S), until=e.ended)
    return sum(bool(look["pixel"]) for look in looks) / max(len(looks), 1)


def _too_slow(e: Evidence, name: str) -> Cause:
    """A target that was seen all the time, and left the middle of the picture all the same."""
    scenes = [scene for scene in e.moments(_FOLLOWED_LOOKS) if scene.has(name)]
    ways = {"target": [scene.position(name) for scene in scenes]}
    ways["tool"] = [tool for scene in scenes if (tool := scene.tool(e.arm)) is not None]
    step = (e.ended - e.began) / _FOLLOWED_LOOKS
    top = {
        what: max((float(np.linalg.norm(b - a)) for a, b in itertools.pairwise(way)), default=0.0)
        / max(step, 1e-6)
        for what, way in ways.items()
    }
    sentence = (
        f"{name} was in view, and {e.arm} too slow for it: it moved at up to "
        f"{top['target']:.2f} m/s, the tool at up to {top['tool']:.2f} m/s"
    )
    shares = {what: float(share) for what, share in e.record.arms[e.arm]["limits"].items()}
    shares["speed"] = float(e.ports.get("speed") or 1.0)
    least = min(shares, key=lambda what: shares[what])
    remedy = "a slower target, or a larger max_error"
    if shares[least] < _FULL:
        where = "its leaf" if least == "speed" else "its limits"
        sentence += f"; {where} may use {shares[least]:g} of the {least} of {e.robot}"
        remedy = f"a larger share of {least}, or a slower target"
    elif e.ports.get("controller") == "proportional":
        gains = ", ".join(f"{key} {e.ports[key]:g} m" for key in ("gain_u", "gain_v"))
        sentence += f"; a proportional controller goes on by its gains ({gains}) at full error"
        remedy = "larger gains, or controller: predictive"
    return e.cause("TOO_SLOW", sentence, remedy)


def _saw_nothing(e: Evidence) -> bool:
    """Whether it still ran, or was halted, and had not found its target of late."""
    if e.code not in ("", "HALTED"):
        return False
    looks = e.notes("look", since=max(e.began, e.ended - 1.0), until=e.ended)
    return not any(look["pixel"] for look in looks)


def _meant(e: Evidence) -> list[str]:
    """Objects that the leaf can have meant: the one it is scored by, else those of the colour."""
    color = e.ports.get("color")
    objects = e.record.start["objects"]
    for named in (e.ports.get("score"), e.ports.get("object")):
        if isinstance(named, str) and named in objects:
            return [named]
    if e.ports.get("marker"):
        return [name for name, thing in objects.items() if thing.get("marker")]
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


def _wrong_kind(e: Evidence, meant: list[str]) -> Cause | None:
    """Another marker, or another size, than what there is has."""
    objects = e.record.start["objects"]
    asked, size = e.ports.get("marker"), e.ports.get("size")
    if asked and meant:
        name, has = meant[0], objects[meant[0]]["marker"]
        same = all(asked[key] == has[key] for key in ("id", "dictionary") if key in asked)
        if not same:
            wanted = f"{asked['id']} of {asked.get('dictionary', 'its set')}"
            sentence = (
                f"it looked for marker {wanted}; {name} bears {has['id']} of {has['dictionary']}"
            )
            return e.cause("NOT_RECOGNISED", sentence, f"id: {has['id']}")
    if size and meant and not e.ports.get("object"):
        name, has = meant[0], [float(side) for side in objects[meant[0]]["size"]]
        away = [abs(one - other) for one, other in zip(sorted(size), sorted(has), strict=False)]
        if len(size) != len(has) or max(away) > _ANOTHER_SIZE * max(has):
            wanted, real = (" by ".join(f"{1e3 * x:g}" for x in each) for each in (size, has))
            sentence = f"it looked for a thing of {wanted} mm; {name} is {real} mm"
            return e.cause("NOT_RECOGNISED", sentence, f"size: {has}")
    return None


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
    if worst == "outside" and e.leaf.kind in _LOOKING_AROUND and "hidden" in states:
        worst = "hidden"
    sight = next(sight for _, sight in sights if sight.state == worst)
    if worst == "hidden":
        yield _hidden(e, name, sight)
    elif worst == "outside":
        yield _outside(e, name, sight, last_seen)
    elif float(e.numbers.get("beyond_share", 0.0)) > _BEHIND:
        share = 100.0 * float(e.numbers["beyond_share"])
        sentence = f"what is behind {name} has its colour: {share:.0f} % of the picture have it"
        remedy = "`color` with ranges of saturation and value that only it has, or a marker on it"
        yield e.cause("SAME_COLOR_BEHIND", sentence, remedy)
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
