"""Causes of failures in cameras and in the visibility of targets."""

from __future__ import annotations

import colorsys
import itertools
from collections.abc import Iterator
from typing import Final

import numpy as np

from bt_dualarm.diagnosis.evidence import Cause, Evidence
from bt_dualarm.diagnosis.object_causes import absence
from bt_dualarm.replay.record import Facts
from bt_dualarm.replay.scene import CameraSight
from bt_dualarm.spec.document import ObjectSpec
from bt_dualarm.spec.values import Color
from bt_dualarm.spec.yaml_reader import with_tuples

VISION_CODES: Final = frozenset({"NOT_SEEN", "LOST", "NOT_FOLLOWING", "NOT_STILL"})
"""Failure codes of leaves that did not see their target, or not often enough."""

_LATE_S: Final = 0.5
"""Latency in s from which no arm can follow a moving target."""

_HIGH_DROP: Final = 0.5
"""Fraction of lost frames that impairs tracking."""


def camera_causes(e: Evidence) -> Iterator[Cause]:
    """Yields causes in the delivery of frames, independent of their content."""
    camera = e.record.arms[e.arm].get("camera") if e.arm in e.record.arms else None
    if not camera or e.code not in VISION_CODES | {"", "HALTED"}:
        return
    taken = e.notes("frame", since=e.began, until=e.ended)
    if not taken:
        return
    latency = float(camera["latency"])
    drop = float(camera["drop"])
    if latency >= _LATE_S:
        sentence = (
            f"images of {e.arm} arrive {latency:g} s after exposure (latency): "
            "the target had moved on by then"
        )
        yield e.cause("LATE_PICTURES", sentence, "a smaller latency, or a target at rest")
    if drop >= _HIGH_DROP:
        seen = len(e.notes("look", since=e.began, until=e.ended))
        sentence = (
            f"images of {e.arm} are lost: of {len(taken)} taken, {seen} arrived (drop: {drop:g})"
        )
        yield e.cause("LOST_PICTURES", sentence, "a smaller drop, or a higher fps")


_SIZE_TOLERANCE: Final = 0.2
"""Deviation from which a size counts as different, relative to the longest side."""

_BACKGROUND_SHARE: Final = 0.15
"""Fraction of an image from which a region beyond its edge may be the background."""

_SEEN_SHARE: Final = 0.7
"""Fraction of frames with the target from which visibility was not the cause."""

_FOLLOWED_S: Final = 2.0
"""Seconds before the end whose frames count for that share."""

_FOLLOWED_LOOKS: Final = 40
"""Number of times between which speeds are measured."""

_HIGH_SHARE: Final = 0.5
"""Fraction of a limit from which a larger one would hardly make the arm faster."""

_LOOKING_AROUND: Final = frozenset({"scan", "locate"})
"""Leaves that turn the camera themselves, so that occlusion matters more than the field of view."""


def sight_causes(e: Evidence) -> Iterator[Cause]:
    """Yields causes that kept the camera from seeing its target."""
    color, name_of_object, marker = (e.ports.get(name) for name in ("color", "object", "marker"))
    if (color, name_of_object, marker) == (None, None, None) or e.arm not in e.record.arms:
        return
    if color is None and e.code not in VISION_CODES | {"INACCURATE"}:
        return  # many leaves have an object that they do not search with the camera
    if e.code == "UNREACHABLE" and e.leaf.kind == "track":
        yield e.cause("LEFT_REACH", e.reason, "a larger `reach`, or a target that stays nearer")
    meant = _candidates(e)
    if e.code == "INACCURATE":
        yield from filter(None, (_wrong_kind(e, meant),))
    if e.code not in VISION_CODES and not _saw_nothing(e):
        return
    if e.code == "NOT_FOLLOWING" and meant and _seen_share(e) > _SEEN_SHARE:
        yield _too_slow(e, meant[0])
        return
    wrong = _wrong_kind(e, meant) or (_wrong_color(e, color, meant) if color else None)
    if wrong is not None:
        yield wrong
        return
    for name in meant:
        yield from _of_target(e, name)


def _seen_share(e: Evidence) -> float:
    """Fraction of the frames before the end in which the target was found."""
    looks = e.notes("look", since=max(e.began, e.ended - _FOLLOWED_S), until=e.ended)
    return sum(bool(look["pixel"]) for look in looks) / max(len(looks), 1)


def _too_slow(e: Evidence, name: str) -> Cause:
    """Cause for a target that was visible and yet left the center of the image."""
    scenes = [scene for scene in e.moments(_FOLLOWED_LOOKS) if scene.has(name)]
    paths = {"target": [scene.position(name) for scene in scenes]}
    paths["tool"] = [tool for scene in scenes if (tool := scene.tool(e.arm)) is not None]
    step = (e.ended - e.began) / _FOLLOWED_LOOKS
    top = {
        what: max((float(np.linalg.norm(b - a)) for a, b in itertools.pairwise(path)), default=0.0)
        / max(step, 1e-6)
        for what, path in paths.items()
    }
    sentence = (
        f"{name} was in view; {e.arm} was too slow: the target moved at up to "
        f"{top['target']:.2f} m/s, the tool at up to {top['tool']:.2f} m/s"
    )
    shares = {what: float(share) for what, share in e.record.arms[e.arm]["limits"].items()}
    shares["speed"] = float(e.ports.get("speed") or 1.0)
    least = min(shares, key=lambda what: shares[what])
    remedy = "a slower target, or a larger max_error"
    if shares[least] < _HIGH_SHARE:
        where = "its leaf" if least == "speed" else "its limits"
        sentence += f"; {where} may use {shares[least]:g} of the {least} limit of {e.robot}"
        remedy = f"a larger fraction of the {least} limit, or a slower target"
    elif e.ports.get("controller") == "proportional":
        gains = ", ".join(f"{key} {e.ports[key]:g} m" for key in ("gain_u", "gain_v"))
        sentence += f"; a proportional controller moves by its gains ({gains}) at full error"
        remedy = "larger gains, or controller: predictive"
    return e.cause("TOO_SLOW", sentence, remedy)


def _saw_nothing(e: Evidence) -> bool:
    """Whether it was running or halted, and had not found its target in the last second."""
    if e.code not in ("", "HALTED"):
        return False
    looks = e.notes("look", since=max(e.began, e.ended - 1.0), until=e.ended)
    return not any(look["pixel"] for look in looks)


def _candidates(e: Evidence) -> list[str]:
    """Objects that may be the target: the one it is scored by, else those of the color."""
    color = e.ports.get("color")
    objects = e.record.start["objects"]
    for named in (e.ports.get("score"), e.ports.get("object")):
        if isinstance(named, str) and named in objects:
            return [named]
    if e.ports.get("marker"):
        return [name for name, facts in objects.items() if facts.get("marker")]
    same = [name for name, facts in objects.items() if _has(facts, color)]
    movable = [name for name, facts in objects.items() if not facts["fixed"]]
    return same or movable


def _has(facts: Facts, color: object) -> bool:
    """Whether an object has the hue of a color; its brightness depends on the light."""
    try:
        wanted = Color.model_validate(with_tuples(color))
    except ValueError:
        return False
    red, green, blue, _ = ObjectSpec.model_validate(with_tuples(facts)).rgba
    hue, saturation, _ = colorsys.rgb_to_hsv(red, green, blue)
    return any(
        _between(360.0 * hue, each.hue) and saturation >= 0.5 * each.saturation[0]
        for each in wanted.ranges
    )


def _between(hue: float, ends: tuple[float, float]) -> bool:
    low, high = ends
    return low <= hue <= high if low <= high else hue >= low or hue <= high


def _wrong_kind(e: Evidence, meant: list[str]) -> Cause | None:
    """Cause if the leaf searches for a marker or size that differs from the object's."""
    objects = e.record.start["objects"]
    asked = e.ports.get("marker")
    size = e.ports.get("size")
    if asked and meant:
        name = meant[0]
        has = objects[meant[0]]["marker"]
        same = all(asked[key] == has[key] for key in ("id", "dictionary") if key in asked)
        if not same:
            wanted = f"{asked['id']} of {asked.get('dictionary', 'its set')}"
            sentence = (
                f"it looked for marker {wanted}; {name} has {has['id']} of {has['dictionary']}"
            )
            return e.cause("NOT_RECOGNISED", sentence, f"id: {has['id']}")
    if size and meant and not e.ports.get("object"):
        name = meant[0]
        has = [float(side) for side in objects[meant[0]]["size"]]
        deviation = [
            abs(one - other) for one, other in zip(sorted(size), sorted(has), strict=False)
        ]
        if len(size) != len(has) or max(deviation) > _SIZE_TOLERANCE * max(has):
            wanted, real = (" by ".join(f"{1e3 * x:g}" for x in each) for each in (size, has))
            sentence = f"it looked for an object of {wanted} mm; {name} is {real} mm"
            return e.cause("NOT_RECOGNISED", sentence, f"size: {has}")
    return None


def _wrong_color(e: Evidence, color: object, meant: list[str]) -> Cause | None:
    objects = e.record.start["objects"]
    if not meant or any(_has(objects[name], color) for name in meant):
        return None
    name = meant[0]
    color_port = e.leaf.ports.get("color")
    has = objects[name]["color"]
    wanted = color_port if isinstance(color_port, str) else "other hues"
    sentence = f"the camera looked for {wanted}, but {name} is {has}"
    return e.cause("WRONG_COLOR", sentence, f"color: {has}")


def _of_target(e: Evidence, name: str) -> Iterator[Cause]:
    """Yields causes of not finding a target of the right color, from its visibility."""
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
    elif float(e.numbers.get("beyond_share", 0.0)) > _BACKGROUND_SHARE:
        share = 100.0 * float(e.numbers["beyond_share"])
        sentence = f"the background of {name} has its color: {share:.0f} % of the image"
        remedy = "`color` with ranges that match only the object, or a marker on it"
        yield e.cause("SAME_COLOR_BEHIND", sentence, remedy)
    else:
        away = f"{sight.distance_m:.2f} m away"
        sentence = f"{name} was in view, {away}, but was not detected as the target"
        yield e.cause("NOT_RECOGNISED", sentence, "tune the color ranges (bt-tune-color)")


def _hidden(e: Evidence, name: str, sight: CameraSight) -> Cause:
    sentence = f"{sight.hidden_by} is between the camera and {name}, {sight.distance_m:.2f} m away"
    return e.cause("OCCLUDED", sentence, f"move {sight.hidden_by}, or look from elsewhere")


def _outside(e: Evidence, name: str, sight: CameraSight, last_seen: float | None) -> Cause:
    sentence = (
        f"{name} was outside the image: {sight.off_axis_deg:.0f}° off the camera's axis, "
        f"and its view ends at {sight.half_view_deg:.0f}°"
    )
    mover = _mover(e, name) if last_seen is not None else ""
    if last_seen is not None:
        sentence += f"; it was seen last at {last_seen:.2f} s" + (f", {mover}" if mover else "")
    remedy = f"a posture or base of {e.arm} from which its camera looks at {name}"
    return e.cause("OUT_OF_VIEW", sentence, remedy, time_s=last_seen)


def _last_seen(e: Evidence) -> float | None:
    """Time in s of the last frame with the target; None if there is none."""
    looks = e.notes("look", since=e.began, until=e.ended)
    return max((look["stamp"] for look in looks if look["pixel"]), default=None)


def _mover(e: Evidence, name: str) -> str:
    """Clause on the arm that held the object at the end, and its leaf; empty if none did."""
    for arm, root in e.timeline.roots.items():
        if name in e.scene(e.ended).held(arm):
            leaves = [leaf.path for leaf in root.leaves_at(e.ended, "RUNNING")]
            at = f" at {leaves[0]!r}" if leaves else ""
            return f"{arm} carried it away{at}"
    return ""
