"""Targets of the tool: checked, compared, and refused with their residual."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from bt_dualarm.errors import Failure
from bt_dualarm.pose import Matrix, Pose


@dataclass(frozen=True)
class Tolerance:
    """How far the tool may be from its target, in metres and radians."""

    position: float
    angle: float

    def holds(self, residual: tuple[float, float]) -> bool:
        """Whether a residual in metres and radians is within."""
        return residual[0] <= self.position and residual[1] <= self.angle


EXACT = Tolerance(1e-5, 1e-4)
"""Tolerance of an answer that a motion is planned with."""


def target_matrix(target: Pose) -> Matrix:
    """As ``Pose.matrix``, of shape (4, 4), but of valid poses only.

    Raises:
        Failure: ``INVALID_TARGET`` for numbers that are no pose.
    """
    w, x, y, z = target.quaternion.tolist()
    unit = abs(w * w + x * x + y * y + z * z - 1.0) < 1e-3
    if not (unit and all(map(math.isfinite, target.position.tolist()))):
        raise Failure(
            "INVALID_TARGET",
            f"position {target.position.tolist()} with quaternion {target.quaternion.tolist()} "
            "is no pose: numbers must be finite and the quaternion of unit length",
        )
    return target.matrix


def residual_between(reached: Matrix, goal: Matrix) -> tuple[float, float]:
    """Distance in metres and angle in radians between two transforms."""
    (a, b, c, x), (d, e, f, y), (g, h, i, z) = (reached - goal)[:3].tolist()
    chord = math.hypot(a, b, c, d, e, f, g, h, i)  # of two rotations: sqrt(8) sin(angle / 2)
    return math.hypot(x, y, z), 2.0 * math.asin(min(1.0, chord / math.sqrt(8.0)))


def unreachable(distance: float, angle: float) -> Failure:
    """The failure of a target that the tool misses by a distance (m) and an angle (rad)."""
    return Failure(
        "UNREACHABLE",
        f"the tool gets no closer to the target than {1e3 * distance:.1f} mm "
        f"and {np.rad2deg(angle):.1f}°",
        residual_m=distance,
        residual_rad=angle,
    )
