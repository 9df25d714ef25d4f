"""Which cells of a row lie on the inner side of planes through the eye, and which of them can.

A ray through column c and row r of the grid points along ((c - c0) s, -(r - r0) s, -1), with the
camera's axis at (c0, r0) and the spacing s. It lies on the inner side of a plane with the normal e
if A c + B r + C <= 0, with A = e_x, B = -e_y, C = -e_x c0 + e_y r0 - e_z / s. Each ray passes
through some point of its cell: a cell can be inside if one of its corners is, and is if all are.
"""

from __future__ import annotations

from typing import TypeAlias

from bt_dualarm.kernels.kernel import kernel

Crossing: TypeAlias = tuple[float, float, float]
"""Column where a plane crosses the near end of row 0, columns that it goes on by for each row, and
a number above 0 where cells to the left are inside, below 0 where those to the right are, 0 where
columns do not tell."""

_STEEP = 1e-9
"""Share of the other terms that A must have: planes along the rows say nothing of columns."""

_SPARE = 0.01
"""Share of a cell that covers errors of rounding."""


@kernel
def crossing(spacing: float, centre: tuple[float, float], x: float, y: float, z: float) -> Crossing:
    """Where a plane crosses the rows of a grid.

    Args:
        spacing: Spacing of a fan.
        centre: Centre of a fan.
        x: First component of the plane's outward normal in the camera's axes, of any length.
        y: Second component.
        z: Third component.
    """
    rest = -x * centre[0] + y * centre[1] - z / spacing
    if abs(x) <= _STEEP * (abs(y) + abs(rest)):
        return 0.0, 0.0, 0.0
    by_column = 1.0 / x
    return -rest * by_column, y * by_column, x


@kernel
def stretch(
    left: int, right: int, row: int, first: Crossing, second: Crossing, third: Crossing
) -> tuple[int, int, int, int]:
    """Which cells of a row can be inside of three planes.

    Args:
        left: First column that is asked for.
        right: First column after them.
        row: The row.
        first: Where a plane crosses the rows.
        second: Another one.
        third: And another.

    Returns:
        Column of the first cell that can be inside, of the first that is, of the first after it
        that may not be, and of the first that cannot be; without one that is inside, any.
    """
    begin, end = float(left), float(right)
    begin, sure, unsure, end = _narrowed(begin, begin, end, end, row, first)
    begin, sure, unsure, end = _narrowed(begin, sure, unsure, end, row, second)
    begin, sure, unsure, end = _narrowed(begin, sure, unsure, end, row, third)
    # What is cut off after the point is not below 0: it is rounded down.
    return int(begin), int(sure), int(max(unsure, 0.0)), int(max(end, 0.0))


@kernel
def _narrowed(
    begin: float, sure: float, unsure: float, end: float, row: int, plane: Crossing
) -> tuple[float, float, float, float]:
    """The columns of `stretch` on the inner side of one more plane."""
    from_column, slope, side = plane
    at = from_column + slope * row
    least, most = at + min(slope, 0.0) - _SPARE, at + max(slope, 0.0) + _SPARE
    if side > 0.0:
        return begin, sure, min(unsure, least), min(end, most + 1.0)
    if side < 0.0:
        return max(begin, least), max(sure, most + 1.0), unsure, end
    return begin, sure, begin, end
