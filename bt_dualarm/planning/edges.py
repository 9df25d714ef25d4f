"""Collision checks of edges: straight motions in joint space from one configuration to another."""

from __future__ import annotations

import itertools
from typing import Protocol

import numpy as np

from bt_dualarm.collision.checker import FINE, CollisionChecker, interpolated
from bt_dualarm.collision.kernel_arrays import SweptArm
from bt_dualarm.core.pose import Matrix, Vector


class Edges(Protocol):
    """Collision check of edges, which counts its work."""

    @property
    def checked(self) -> int:
        """Number of configurations that have been checked so far."""
        ...

    def is_free(self, start: Vector, end: Vector) -> bool:
        """Whether the straight motion between two configurations, each of shape (dof,), is free."""
        ...


def is_path_free(edges: Edges, corners: Matrix) -> bool:
    """Whether straight motions from corner to corner, of shape (n, dof), rad, are free."""
    return all(edges.is_free(start, end) for start, end in itertools.pairwise(corners))


def path_length(corners: Matrix, radii: Vector) -> float:
    """Length of a path, its joints scaled to meters that the arm moves, m.

    Args:
        corners: Corners of the path, of shape (n, dof), rad.
        radii: Largest motion of the arm per radian of each joint, of shape (dof,), m/rad.
    """
    return float(np.linalg.norm(np.diff(corners, axis=0) * radii, axis=1).sum())


class CompiledEdges:
    """Edges checked as a whole by compiled distances between convex shapes.

    Nothing between two configurations is stepped over.

    Args:
        arm: Arm in its world.

    Attributes:
        arm: The same; a search may change its clearance, see `keep_clear`.
        hints: Directions in which each pair was apart when it was checked last, of shape (p, 3).
        spent: Number of configurations that have been checked, of shape (1,); kernels add to it.
    """

    def __init__(self, arm: SweptArm) -> None:
        self.arm = arm
        self.hints = arm.pairs.directions.copy()
        self.spent = np.zeros(1, np.int64)

    @property
    def checked(self) -> int:
        """Number of configurations that have been checked so far."""
        return int(self.spent[0])

    def keep_clear(self, clearance: float) -> None:
        """Set the clearance that shapes keep besides what they must, in m."""
        self.arm = self.arm._replace(clearance=clearance)

    def is_free(self, start: Vector, end: Vector) -> bool:
        """Whether the straight motion between two configurations, each of shape (dof,), is free."""
        from bt_dualarm.collision.swept_kernels import WHOLE, free_share

        return free_share(self.arm, start, end, WHOLE, self.hints, self.spent) == 1.0

    def is_dense_path_free(self, rows: Matrix, radii: Vector) -> bool:
        """Whether a dense path is free.

        Args:
            rows: Configurations, of shape (n, dof), rad.
            radii: Largest motion of the arm per radian of each joint, of shape (dof,), m/rad.
        """
        from bt_dualarm.collision.swept_kernels import first_too_near

        return first_too_near(self.arm, rows, radii, self.hints, self.spent) == len(rows)


class SampledEdges:
    """Edges checked by MuJoCo every `FINE` meters, for shapes that the kernels do not support.

    Args:
        checker: Collision checker of the arm.
    """

    def __init__(self, checker: CollisionChecker) -> None:
        self._checker = checker
        self._checked = 0

    @property
    def checked(self) -> int:
        """Number of configurations that have been checked so far."""
        return self._checked

    def is_free(self, start: Vector, end: Vector) -> bool:
        """Whether the straight motion between two configurations, each of shape (dof,), is free."""
        rows = interpolated(start, end, self._checker.radii, FINE)
        self._checked += len(rows)
        return self._checker.first_contact(rows) is None
