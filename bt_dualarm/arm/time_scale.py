"""To which time scale a load slows a motion: its accelerations, which grow with the square."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.sim.arm_models import NominalArm
from bt_dualarm.trajectory.trajectory import Trajectory

SLOWEST: Final = 0.1
"""Smallest time scale to which a load slows a motion."""

_SAMPLE_S: Final = 0.012  # sampling period for differencing accelerations
_BISECTIONS: Final = 8


def largest_scale(holds: Callable[[float], bool]) -> float:
    """Largest time scale, from `SLOWEST` to 1, at which a condition holds, by bisection."""
    if holds(1.0):
        return 1.0
    least = SLOWEST
    most = 1.0
    for _ in range(_BISECTIONS):
        middle = 0.5 * (least + most)
        if holds(middle):
            least = middle
        else:
            most = middle
    return least


@dataclass(frozen=True, eq=False)
class LinkMotion:
    """Accelerations of what moves with an arm's tool link; they grow with the square of the scale.

    Attributes:
        accelerations: Accelerations of a point in the world, of shape (n, 3), m/s².
        turns: Axes of the link in the world, of shape (n, 3, 3).
        angular_velocities: Angular velocities in the link's axes, of shape (n, 3), rad/s.
        angular_accelerations: Angular accelerations in the link's axes, of shape (n, 3), rad/s².
    """

    accelerations: Matrix
    turns: np.ndarray
    angular_velocities: Matrix
    angular_accelerations: Matrix

    def moments(self, inertia: Matrix) -> Matrix:
        """Moments that a body about its center of mass needs, link axes, of shape (n, 3), N m.

        Args:
            inertia: Its moments of inertia in the link's axes, of shape (3, 3), kg m².
        """
        spinning = self.angular_velocities
        needed: Matrix = self.angular_accelerations @ inertia  # Euler's equations
        return needed + np.cross(spinning, spinning @ inertia)


def link_motion(motion: Trajectory, nominal: NominalArm, point: Vector) -> LinkMotion:
    """Accelerations of an arm's tool link, and of a point that moves with it.

    Args:
        motion: Motion from rest to rest.
        nominal: Model of the arm.
        point: The point in the frame of the tool link, of shape (3,), m.
    """
    stride = max(1, round(_SAMPLE_S / motion.dt))
    count = max(2, (len(motion) - 1) // stride + 1)
    rows = np.minimum(np.arange(-1, count + 1) * stride, len(motion) - 1).clip(0)
    positions, turns = nominal.tool_link_frames_at(motion.rows(rows)[0])
    period = stride * motion.dt
    centers = positions + turns @ point
    steps = np.einsum("nji,njk->nik", turns[:-1], turns[1:])
    # The antisymmetric part of a rotation is its vector, up to the third power of a small angle.
    turned = 0.5 * (steps[:, (2, 0, 1), (1, 2, 0)] - steps[:, (1, 2, 0), (2, 0, 1)])
    return LinkMotion(
        np.diff(centers, 2, axis=0) / period**2,
        turns[1:-1],
        (turned[:-1] + turned[1:]) / (2.0 * period),
        np.diff(turned, axis=0) / period**2,
    )
