"""To which time scale a load slows a motion: its accelerations, which grow with the square."""

from __future__ import annotations

from collections.abc import Callable
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


def accelerations_of(
    motion: Trajectory, nominal: NominalArm, point: Vector
) -> tuple[Matrix, np.ndarray]:
    """Accelerations in the world of a point that moves with an arm's tool link.

    Args:
        motion: Motion from rest to rest.
        nominal: Model of the arm.
        point: The point in the frame of the tool link, of shape (3,), m.

    Returns:
        The accelerations, of shape (n, 3), m/s², and the axes of the link, of shape (n, 3, 3).
    """
    stride = max(1, round(_SAMPLE_S / motion.dt))
    count = max(2, (len(motion) - 1) // stride + 1)
    rows = np.minimum(np.arange(-1, count + 1) * stride, len(motion) - 1).clip(0)
    positions, turns = nominal.tool_link_frames_at(motion.rows(rows)[0])
    centers = positions + turns @ point
    return np.diff(centers, 2, axis=0) / (stride * motion.dt) ** 2, turns[1:-1]
