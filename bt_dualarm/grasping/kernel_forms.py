"""Solids as arrays for the kernels."""

from __future__ import annotations

from typing import Final, NamedTuple

from bt_dualarm.core.pose import Matrix

BOX: Final = 0
CYLINDER: Final = 1
CAPSULE: Final = 2
CONVEX: Final = 3
TRIANGLES: Final = 4


class Form(NamedTuple):
    """Solid in its own frame.

    Attributes:
        kind: `BOX`, `CYLINDER`, `CAPSULE`, `CONVEX` or `TRIANGLES`.
        numbers: Half edges of a box, or radius and half length of a cylinder or capsule, in one
            row, m. Of the last two kinds, one row per triangle, of shape (n, 13): its three
            corners, its outward unit normal, and the distance of its plane from the origin.
    """

    kind: int
    numbers: Matrix
