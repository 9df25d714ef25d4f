"""Causes of failures of grippers: a thing that is slippery, too heavy, too wide, or not held."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

from bt_dualarm.errors import DualArmError
from bt_dualarm.replay.evidence import Cause, Evidence
from bt_dualarm.replay.world_causes import not_attached
from bt_dualarm.world.grippers.named import load_gripper

_LOST: Final = frozenset({"SLIPPED", "DROPPED", "NOT_GRASPED", "TOO_HEAVY", "NOT_HELD"})

_NEAR_M: Final = 0.06
"""Distance at which another thing can be where a finger has to be."""

_SLIPPERY: Final = 0.3
"""Coefficient of friction below which fingers hold by little: wet steel has about that."""


def grip_causes(e: Evidence) -> Iterator[Cause]:
    """What kept fingers or a cup from holding the object of a leaf."""
    name = e.ports.get("object")
    facts = e.record.start["objects"].get(name) if isinstance(name, str) else None
    if facts is None:
        return
    if e.code in _LOST and float(facts["friction"]) < _SLIPPERY:
        sentence = f"{name} is slippery: its friction is {facts['friction']:g}; {e.reason}"
        yield e.cause("LOW_FRICTION", sentence, "rougher, more force, or another grasp")
    elif e.code == "TOO_HEAVY":
        sentence = f"{name} ({facts['mass']:g} kg) is too heavy for the grip: {e.reason}"
        yield e.cause("OVERLOADED", sentence, "a lighter object, or a stronger gripper")
    opening = _opening(e)
    size = " by ".join(f"{1e3 * side:g}" for side in facts["size"])
    opens = "" if opening is None else f", and the fingers open {1e3 * opening:.0f} mm"
    wide = opening is not None and facts["shape"] == "box" and sorted(facts["size"])[1] > opening
    if e.code == "TOO_WIDE":
        sentence = f"{name} is {size} mm{opens}: {e.reason}"
        yield e.cause("TOO_WIDE", sentence, "a smaller object, or fingers that open wider")
    elif "grasps" in e.numbers and e.code == "OUT_OF_REACH":
        beside = e.scene(e.began).beside(str(name), _NEAR_M)
        if beside and not wide:
            yield _crowded(e, str(name), beside)
        elif wide:
            sentence = f"{name} is {size} mm{opens}; around its short side there is no room"
            remedy = "a smaller object, fingers that open wider, or a suction cup"
            yield e.cause("TOO_WIDE", sentence, remedy)
        else:
            remedy = "another side of it up, something below it, or a suction cup"
            yield e.cause("NO_ROOM", f"{name} is {size} mm{opens}: {e.reason}", remedy)
    if e.code == "NOT_HELD":
        yield not_attached(e, str(name))


def _crowded(e: Evidence, name: str, beside: list[tuple[str, float]]) -> Cause:
    """Things stand where the fingers would come down."""
    near = ", ".join(f"{other} ({1e3 * gap:.0f} mm away)" for other, gap in beside)
    sentence = f"the fingers have no room around {name}; beside it there is {near}"
    return e.cause("NO_ROOM", sentence, f"move {beside[0][0]} away, or take it first")


def _opening(e: Evidence) -> float | None:
    """How far the fingers of the arm open in m; None for a cup, and where none are known here."""
    mounted = e.record.arms[e.arm].get("gripper")
    name = mounted.get("kind") if isinstance(mounted, dict) else mounted
    try:
        gripper = load_gripper(str(name), Path(e.record.start["path"]).parent)
    except (DualArmError, OSError, ValueError):
        return None
    return gripper.stroke or None
