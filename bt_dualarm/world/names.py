"""Names of things in a world: looked up, with the nearest one in the refusal."""

from __future__ import annotations

import difflib
from collections.abc import Collection

import mujoco

from bt_dualarm.errors import WorldError


def must_be_among(name: str, known: Collection[str], kind: str, where: str) -> None:
    """Refuse an unknown name: "no arm 'amr1' in the world; did you mean 'arm1'?".

    Raises:
        WorldError: The name is not among the known ones.
    """
    if name not in known:
        raise WorldError(f"no {kind} {name!r} {where}{nearest(name, known)}")


def nearest(name: str, known: Collection[str]) -> str:
    """What may have been meant, and everything that there is, as the end of a sentence."""
    near = difflib.get_close_matches(name, known, n=1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    return f"{hint} (there are: {', '.join(sorted(known)) or 'none'})"


def name_of_geom(model: mujoco.MjModel, geom: int) -> str:
    """What people call the thing that a shape belongs to: its body, or a part of the scene."""
    body = model.body(model.geom_bodyid[geom])
    return str((body.name if body.id else model.geom(geom).name) or "the scene")
