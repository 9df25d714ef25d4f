"""A marker on an object as a tree file describes it."""

from __future__ import annotations

from typing import Final, Literal, TypeAlias

from bt_dualarm.spec.ports import port
from bt_dualarm.spec.values import Value

MarkerDictionary: TypeAlias = Literal[
    "aruco_4x4_50", "aruco_5x5_50", "aruco_6x6_50", "apriltag_16h5", "apriltag_36h11"
]

BITS: Final[dict[str, int]] = {
    "aruco_4x4_50": 4,
    "aruco_5x5_50": 5,
    "aruco_6x6_50": 6,
    "apriltag_16h5": 4,
    "apriltag_36h11": 6,
}
"""Cells along an edge within the black border."""


class MarkerSpec(Value):
    """A square marker, white around it, on the top face of an object."""

    dictionary: MarkerDictionary = port("aruco_4x4_50", "Set of markers that it is one of")
    id: int = port(..., "Its number in the set", ge=0, le=29)
    size: float = port(..., "Edge of its black square", unit="m", ge=0.005, le=1.0)

    @property
    def cells(self) -> int:
        """Cells along an edge, the black border included."""
        return BITS[self.dictionary] + 2

    @property
    def board(self) -> float:
        """Edge in m of the white square around it: one cell wider to each side."""
        return self.size * (self.cells + 2) / self.cells
