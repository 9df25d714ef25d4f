"""Boxes, cylinders, capsules and spheres as people give them, and as MuJoCo takes them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import mujoco

GEOM_TYPES: Final[Mapping[str, mujoco.mjtGeom]] = {
    "box": mujoco.mjtGeom.mjGEOM_BOX,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "capsule": mujoco.mjtGeom.mjGEOM_CAPSULE,
    "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
}


def half_sizes(kind: str, size: Sequence[float]) -> tuple[float, float, float]:
    """Sizes in metres as MuJoCo has them: half lengths, and zeros for what a shape has not.

    Args:
        kind: A key of `GEOM_TYPES`.
        size: Full lengths of a box, radius and length of a cylinder, or of a capsule between its
            half balls, radius of a sphere.
    """
    if kind == "box":
        x, y, z = size
        return x / 2, y / 2, z / 2
    if kind in ("cylinder", "capsule"):
        radius, length = size
        return radius, length / 2, 0.0
    return size[0], 0.0, 0.0
