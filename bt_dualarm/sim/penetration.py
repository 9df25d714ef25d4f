"""Penetration of a spawned object or arm into others."""

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
    model: mujoco.MjModel, data: mujoco.MjData, name: str, tolerated: float = MAX_DEPTH
) -> tuple[str, float] | None:
    """Find the deepest penetration of an arm or object into another.

    Args:
        model: Compiled model.
        data: Its state, with current contacts.
        name: Name of the arm or object.
        tolerated: Depth that is not reported, m.

    Returns:
        Name of the other and the depth in m; None if no depth exceeds the tolerated one.
    """
    worst = None
    for geoms, distance in zip(data.contact.geom.tolist(), data.contact.dist, strict=True):
        names = [name_of_geom(model, geom) for geom in geoms]
        own = [part == name or part.startswith(f"{name}/") for part in names]
        if own[0] != own[1] and -distance > max(tolerated, worst[1] if worst else 0.0):
            worst = names[own.index(False)], float(-distance)
    return worst


def overlap_error(kind: str, name: str, other: str, depth: float) -> OverlapError:
    """Error for an arm or object (``kind``) that would penetrate another by ``depth`` in m."""
    reason = f"{kind} {name!r} would be {1000 * depth:.0f} mm deep in {other}"
    return OverlapError(name, reason, depth)
