"""Solids as numbers, as kernels take them."""

from __future__ import annotations

from typing import Final, NamedTuple

from bt_dualarm.core.pose import Matrix

BOX: Final = 0
CYLINDER: Final = 1
CAPSULE: Final = 2
CONVEX: Final = 3
TRIANGLES: Final = 4


class Form(NamedTuple):
    """A solid in its own frame.

    Attributes:
        kind: `BOX`, `CYLINDER`, `CAPSULE`, `CONVEX` or `TRIANGLES`.
        numbers: One row of half edges, or of radius and half length, m; of the last two one row
            a triangle: its three corners, its unit normal outward, the distance of its plane
            from the origin; of shape (n, 13).
    """

    kind: int
    numbers: Matrix
