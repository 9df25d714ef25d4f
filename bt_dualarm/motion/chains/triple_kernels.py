"""Vectors of the world as three numbers: machine code keeps them in registers."""

from __future__ import annotations

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.motion.chains.kernel_rows import Triple
from bt_dualarm.pose import Matrix


@kernel
def triple(rows: Matrix, row: int, first: int) -> Triple:
    """Three numbers of a row."""
    return rows[row, first], rows[row, first + 1], rows[row, first + 2]


@kernel
def add(a: Triple, b: Triple) -> Triple:
    """Sum of two vectors."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@kernel
def sub(a: Triple, b: Triple) -> Triple:
    """Difference of two vectors."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@kernel
def scale(a: Triple, factor: float) -> Triple:
    """A vector, so many times."""
    return a[0] * factor, a[1] * factor, a[2] * factor


@kernel
def dot(a: Triple, b: Triple) -> float:
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def cross(a: Triple, b: Triple) -> Triple:
    """Vector product."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


@kernel
def turned(rows: Matrix, row: int, first: int, a: Triple) -> Triple:
    """A vector turned by a matrix whose 9 numbers stand in a row."""
    return (
        rows[row, first] * a[0] + rows[row, first + 1] * a[1] + rows[row, first + 2] * a[2],
        rows[row, first + 3] * a[0] + rows[row, first + 4] * a[1] + rows[row, first + 5] * a[2],
        rows[row, first + 6] * a[0] + rows[row, first + 7] * a[1] + rows[row, first + 8] * a[2],
    )
