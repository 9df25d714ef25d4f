"""Where the joints and links of a chain are: a product of exponentials.

All links have the world's axes while the joints are at zero, so that a joint is nothing but an axis
and a place (Lynch, Park, Modern Robotics, 4.1).
"""

from __future__ import annotations

import math

import numpy as np

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.motion.chains.kernel_rows import AXIS, STEP
from bt_dualarm.motion.chains.triple_kernels import add, cross, sub, triple, turned
from bt_dualarm.pose import Matrix, Vector


@kernel
def place(links: Matrix, q: Vector, turns: Matrix, axes: Matrix, anchors: Matrix) -> None:
    """Enter where a chain is.

    Args:
        links: Links of the chain, see `kernel_rows`.
        q: Positions of the joints, of shape (dof,), rad.
        turns: Rotation of each link, row by row, of shape (dof, 9).
        axes: Axis of each joint in the world, of shape (dof, 3).
        anchors: Place of each joint in the world, of shape (dof, 3), m.
    """
    for i in range(len(q)):
        axis, step = triple(links, i, AXIS), triple(links, i, STEP)
        x, y, z = axis
        cos, sin = math.cos(q[i]), math.sin(q[i])
        rest = 1.0 - cos
        # Rodrigues' formula, row by row.
        own = (
            (cos + rest * x * x, rest * x * y - sin * z, rest * x * z + sin * y),
            (rest * y * x + sin * z, cos + rest * y * y, rest * y * z - sin * x),
            (rest * z * x - sin * y, rest * z * y + sin * x, cos + rest * z * z),
        )
        if i == 0:
            for row in range(3):
                for column in range(3):
                    turns[0, 3 * row + column] = own[row][column]
        else:
            for row in range(3):
                a, b, c = triple(turns, i - 1, 3 * row)
                for column in range(3):
                    value = a * own[0][column] + b * own[1][column] + c * own[2][column]
                    turns[i, 3 * row + column] = value
            axis, step = turned(turns, i - 1, 0, axis), turned(turns, i - 1, 0, step)
        for column in range(3):
            axes[i, column] = axis[column]
            anchors[i, column] = step[column] + (anchors[i - 1, column] if i else 0.0)


@kernel
def place_tool(links: Matrix, q: Vector, frames: Matrix, jacobian: Matrix) -> None:
    """Enter where the tool is, and its Jacobian.

    Args:
        links: Links of the chain, see `kernel_rows`.
        q: Positions of the joints, of shape (dof,), rad.
        frames: Rotation, row by row, and place of the tool; the second row takes those of now, the
            third has those from the last joint while all are at zero, of shape (3, 12).
        jacobian: Joint rates to the tool's linear, then angular velocity in the world: (6, dof).
    """
    dof = len(q)
    turns, axes, anchors = np.empty((dof, 9)), np.empty((dof, 3)), np.empty((dof, 3))
    place(links, q, turns, axes, anchors)
    arm = turned(turns, dof - 1, 0, triple(frames, 2, 9))
    tool = add(triple(anchors, dof - 1, 0), arm)
    for row in range(3):
        frames[1, 9 + row] = tool[row]
        for column in range(3):
            total = 0.0
            for between in range(3):
                total += turns[dof - 1, 3 * row + between] * frames[2, 3 * between + column]
            frames[1, 3 * row + column] = total
    for i in range(dof):
        axis = triple(axes, i, 0)
        moving = cross(axis, sub(tool, triple(anchors, i, 0)))
        for row in range(3):
            jacobian[row, i], jacobian[3 + row, i] = moving[row], axis[row]
