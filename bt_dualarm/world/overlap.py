"""Whether what has just come into the world stands inside something else."""

from __future__ import annotations

from typing import Any

MOST_DEPTH = 0.005
"""Depth in metres up to which a thing that comes may be inside another: contacts push it out."""


def overlap(model: Any, data: Any, name: str) -> tuple[str, float] | None:
    """What an arm or object is deepest inside of, and how deep in m; None below ``MOST_DEPTH``.

    Args:
        model: Compiled.
        data: With the contacts of now.
        name: Of the arm or object.
    """
    worst = None
    for geoms, distance in zip(data.contact.geom.tolist(), data.contact.dist, strict=True):
        names = [_body_name(model, geom) for geom in geoms]
        own = [part == name or part.startswith(f"{name}/") for part in names]
        if own[0] != own[1] and -distance > max(MOST_DEPTH, worst[1] if worst else 0.0):
            worst = names[own.index(False)], float(-distance)
    return worst


def _body_name(model: Any, geom: int) -> str:
    """Name of the body of a shape; of the shape itself where it is part of the scene."""
    name = model.body(model.geom_bodyid[geom]).name
    return str(model.geom(geom).name if name == "world" else name)
