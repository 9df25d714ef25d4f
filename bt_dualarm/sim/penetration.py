"""Penetration of a spawned object or arm into others, or of an arm into itself."""

from __future__ import annotations

import mujoco

from bt_dualarm.core.errors import OverlapError
from bt_dualarm.sim.composition import name_of_geom

MAX_DEPTH = 0.005
"""Penetration in m up to which something may be spawned inside another: contacts push it out."""

SHALLOW_DEPTH = 0.001
"""Penetration in m beyond which the push may throw a light object away: 4 mm threw one of 0.09 kg
off its table. Objects that rest on the ground penetrate it by less."""


def deepest_overlap(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    kind: str,
    name: str,
    tolerated: float = MAX_DEPTH,
) -> OverlapError | None:
    """Find the deepest penetration of an arm or object into another, or of an arm into itself.

    Args:
        model: Compiled model.
        data: Its state, with current contacts.
        kind: ``"arm"`` or ``"object"``.
        name: Name of the arm or object.
        tolerated: Depth that is not reported, m.

    Returns:
        An error that describes it; None if no depth exceeds the tolerated one.
    """
    worst: tuple[float, list[int], list[str], list[bool]] | None = None
    for geoms, distance in zip(data.contact.geom.tolist(), data.contact.dist, strict=True):
        names = [name_of_geom(model, geom) for geom in geoms]
        own = [part == name or part.startswith(f"{name}/") for part in names]
        counts = any(own) and (kind == "arm" or not all(own))
        if counts and -distance > max(tolerated, worst[0] if worst else 0.0):
            worst = float(-distance), geoms, names, own
    if worst is None:
        return None
    depth, geoms, names, own = worst
    deep = f"{1000 * depth:.0f} mm deep in"
    # A link may have the name of the body that the world adds below a base, but not of its geom.
    pedestal = f"{name}/pedestal"
    below = [model.geom(geom).name == pedestal for geom in geoms]
    if all(own) and any(below):
        reason = (
            f"{kind} {name!r} would collide with its pedestal, which fills the gap below its base: "
            f"{names[below.index(False)]} would be {deep} it"
        )
        return OverlapError(name, reason, depth, pedestal)
    if all(own):
        reason = f"{kind} {name!r} would collide with itself: {names[0]} {deep} {names[1]}"
        return OverlapError(name, reason, depth, name)
    other = names[own.index(False)]
    part = names[own.index(True)]
    of_it = "" if part == name else f", with {part}"
    reason = f"{kind} {name!r} would be {deep} {other}{of_it}"
    return OverlapError(name, reason, depth, other.partition("/")[0])
