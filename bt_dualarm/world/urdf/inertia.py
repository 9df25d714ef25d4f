"""Inertias of links that are one rigid body."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from bt_dualarm.pose import Matrix, Pose
from bt_dualarm.world.urdf.attributes import Origin
from bt_dualarm.world.urdf.link import Inertial

LEAST_MASS: Final = 1e-6
"""kg; what a joint moves weighs more, or its acceleration has no meaning."""

LEAST_MOMENT: Final = 1e-12
"""kg m²; likewise: a ball of 1 mg that is 3 mm wide."""

_RELATIVE: Final = 1e-9  # of the largest moment: less is rounding


def is_solid(inertial: Inertial) -> bool:
    """Whether it resists a turn about every axis: MuJoCo wants no less of a body."""
    moments = np.linalg.eigvalsh(inertial.tensor)
    return bool(
        inertial.mass >= LEAST_MASS and moments[0] > max(LEAST_MOMENT, _RELATIVE * moments[2])
    )


def combined(parts: Sequence[tuple[Pose, Inertial]]) -> Inertial | None:
    """The inertia of several bodies that hold together.

    Args:
        parts: Pose of each body's link in the frame of the result, and its inertia.

    Returns:
        Inertia about the common centre of mass, along the axes of that frame (parallel-axis
        theorem); None for bodies that weigh nothing.
    """
    mass = sum(inertial.mass for _, inertial in parts)
    if not mass > 0:
        return None
    frames = [pose @ inertial.origin.pose for pose, inertial in parts]
    weights = np.array([inertial.mass for _, inertial in parts]) / mass
    centre = weights @ np.array([frame.position for frame in frames])
    tensor = np.zeros((3, 3))
    for frame, (_, inertial) in zip(frames, parts, strict=True):
        turn = frame.rotation_matrix
        tensor += turn @ inertial.tensor @ turn.T
        tensor += inertial.mass * _point(frame.position - centre)
    diagonal, rest = np.diag(tensor), tensor[[0, 0, 1], [1, 2, 2]]
    xx, yy, zz, xy, xz, yz = (float(moment) for moment in (*diagonal, *rest))
    x, y, z = (float(part) for part in centre)
    return Inertial(mass, Origin((x, y, z)), (xx, yy, zz, xy, xz, yz))


def _point(away: Matrix) -> Matrix:
    """Inertia of a point of 1 kg at a place of shape (3,), of shape (3, 3)."""
    return float(away @ away) * np.eye(3) - np.outer(away, away)
