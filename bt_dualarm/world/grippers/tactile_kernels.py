"""What two pads feel, turned into the tool frame: compiled, for each reading."""

from __future__ import annotations

import numpy as np

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.pose import Matrix, Vector


@kernel
def felt_in_tool(
    felt: Vector, palm: Vector, turn: Matrix, gains: Vector, noise: Matrix, row: int
) -> Matrix:
    """Force of what is held on each pad, in the axes of the tool frame, of shape (2, 3), N.

    Args:
        felt: Force of each pad on what it touches, in the axes of the world, of shape (6,), N.
        palm: Rotation of the palm, row by row, of shape (9,).
        turn: Rotation of the tool frame in the palm, of shape (3, 3).
        gains: Share of a force that each pad's sensor reads, of shape (2,).
        noise: What readings have of noise, of shape (n, 6), N.
        row: The one of them to take.
    """
    forces = np.empty((2, 3))
    for axis in range(3):
        x = palm[0] * turn[0, axis] + palm[1] * turn[1, axis] + palm[2] * turn[2, axis]
        y = palm[3] * turn[0, axis] + palm[4] * turn[1, axis] + palm[5] * turn[2, axis]
        z = palm[6] * turn[0, axis] + palm[7] * turn[1, axis] + palm[8] * turn[2, axis]
        for pad in range(2):
            first = 3 * pad
            along = felt[first] * x + felt[first + 1] * y + felt[first + 2] * z
            forces[pad, axis] = noise[row, first + axis] - gains[pad] * along
    return forces
