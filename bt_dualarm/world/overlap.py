"""Whether what has just come into the world stands inside something else."""

from __future__ import annotations

import mujoco

from bt_dualarm.errors import OverlapError
from bt_dualarm.world.names import name_of_geom

MOST_DEPTH = 0.005
"""Depth in metres up to which a thing that comes may be inside another: contacts push it out."""


def overlap(model: mujoco.MjModel, data: mujoco.MjData, name: str) -> tuple[str, float] | None:
    """What an arm or object is deepest inside of, and how deep in m; None below ``MOST_DEPTH``.

    Args:
        model: Compiled model.
        data: State of it, with the contacts of now.
        name: Name of the arm or object.
    """
    worst = None
    for geoms, distance in zip(data.contact.geom.tolist(), data.contact.dist, strict=True):
        names = [name_of_geom(model, geom) for geom in geoms]
        own = [part == name or part.startswith(f"{name}/") for part in names]
        if own[0] != own[1] and -distance > max(MOST_DEPTH, worst[1] if worst else 0.0):
            worst = names[own.index(False)], float(-distance)
    return worst


def no_room(kind: str, name: str, other: str, depth: float) -> OverlapError:
    """What is said of an arm or object that would be so many metres deep in another thing."""
    return OverlapError(name, f"{kind} {name!r} would be {1000 * depth:.0f} mm deep in {other}")
