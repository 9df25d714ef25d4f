"""Collision-free paths of an object that several arms hold.

The path is one of the object: straight from pose to pose where that is free, otherwise around
obstacles by an RRT over its poses (LaValle, Kuffner, IJRR 2001). Every edge is followed by inverse
kinematics of all arms at once from the configurations at its beginning, so that no arm changes its
branch.
"""

from __future__ import annotations

import itertools
from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bt_dualarm.collision.group import GroupChecker
from bt_dualarm.core.errors import CollisionFailure, Failure
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.kinematics.multi_arm import MultiArmKinematics, holding
from bt_dualarm.planning.pose_tree import REACH_M, TO_GOAL, PoseTree
from bt_dualarm.trajectory.paths import CartesianPath, blended, line

BLEND_M = 0.05
"""Distance from a corner at which the object may begin to round it, m."""

_DRAWS = 200
"""Number of edges that are tried."""

_COARSE = (0.008, 0.015)
"""Largest distance in m and rotation in rad between two samples of an edge of the search. The path
that is executed is checked at every sample of `line`."""

_SHORTCUTS = 20
"""Number of shortcuts that are tried on a path."""


@dataclass(frozen=True, eq=False)
class CarriedPath:
    """Path of an object and of all arms that hold it.

    Attributes:
        poses: Poses of the object in the world, n of them.
        rows: Joint positions of all arms, side by side, of shape (n, dof), rad.
    """

    poses: list[Pose]
    rows: Matrix


class CarryPlanner:
    """Plans paths of one object in the hands of several arms.

    Args:
        kinematics: Kinematics of these arms.
        grasps: Poses of the tools in the object's frame, by arm, in the same order.
        checker: Collision checker of the arms with the object.
        seed: Seed of the search around obstacles.
    """

    def __init__(
        self,
        kinematics: MultiArmKinematics,
        grasps: Mapping[str, Pose],
        checker: GroupChecker,
        seed: int,
    ) -> None:
        self._kinematics = kinematics
        self._grasps = dict(grasps)
        self._checker = checker
        self._seed = seed

    def joined(self, q: Mapping[str, Vector]) -> Vector:
        """Joint positions of all arms, side by side, rad."""
        return np.concatenate([q[arm] for arm in self._kinematics.parts])

    def along(self, path: CartesianPath, q: Vector) -> CarriedPath:
        """Path of all arms along a path of the object, from joint positions at its beginning.

        Args:
            path: Path of the object in the world.
            q: Joint positions of all arms, side by side, rad, at its first pose.

        Raises:
            Failure: ``PATH_BROKEN`` or ``IN_COLLISION``.
        """
        poses = path.poses
        rows = self._follow(poses, q)
        found = self._checker.first_contact(rows)
        if found is not None:
            raise found[1].failure()
        return CarriedPath(poses, rows)

    def down(self, start: Pose, goal: Pose, low: Pose, q: Vector) -> CarriedPath:
        """Straight path past a goal to an intended contact, without a check of collisions.

        It ends where the arms reach no farther, but not before the goal.

        Args:
            start: Pose of the object in the world at the beginning.
            goal: Pose at which the contact is expected, on the way to the last one.
            low: Last pose at which it is searched.
            q: Joint positions of all arms, side by side, rad, at the beginning.

        Raises:
            Failure: ``PATH_BROKEN``.
        """
        poses = line(start, low).poses
        least = sum(pose.distance(start) < goal.distance(start) for pose in poses) + 1
        rows = self._follow(poses, q, min(least, len(poses)))
        return CarriedPath(poses[: len(rows)], rows)

    def through(self, poses: Sequence[Pose], q: Vector) -> Generator[None, None, CarriedPath]:
        """Path through poses of the object, around obstacles; yields during the search.

        Args:
            poses: Poses of the object in the world; at the first one the arms are at ``q``.
            q: Joint positions of all arms, side by side, rad.

        Raises:
            Failure: ``PATH_BROKEN``, ``IN_COLLISION`` or ``NO_PLAN``.
        """
        stops = [poses[0]]
        for pose in poses[1:]:
            if pose.distance(stops[-1]) > 1e-4 or pose.angle(stops[-1]) > 1e-3:
                stops.append(pose)
        try:
            return self.along(path_through(stops), q)
        except CollisionFailure:
            yield
        corners = [stops[0]]
        at = q
        for here, there in itertools.pairwise(stops):
            rows = self._follow(line(here, there).poses, at)
            blocked = self._checker.first_contact(rows)
            if blocked is None:
                corners.append(there)
                at = rows[-1]
                continue
            at_goal = self._checker.contact(rows[-1])
            if at_goal is not None:
                raise at_goal.failure()
            found = yield from self._around(here, there, at)
            if found is None:
                refusal = blocked[1].failure()
                raise Failure(
                    "NO_PLAN",
                    f"no path of the object around the obstacle was found: {refusal.reason}",
                    **refusal.numbers,
                )
            corners += found[0][1:]
            at = found[1]
        try:
            return self.along(path_through(corners), q)
        except Failure:  # a blend leads through an obstacle: stop at the corners
            return self._stopping(corners, q)

    def _stopping(self, corners: Sequence[Pose], q: Vector) -> CarriedPath:
        parts = []
        for here, there in itertools.pairwise(corners):
            parts.append(self.along(line(here, there), q))
            q = parts[-1].rows[-1]
        poses = [parts[0].poses[0], *(pose for part in parts for pose in part.poses[1:])]
        return CarriedPath(
            poses, np.vstack([part.rows[min(i, 1) :] for i, part in enumerate(parts)])
        )

    def _follow(self, poses: Sequence[Pose], q: Vector, least: int | None = None) -> Matrix:
        """Joint positions along poses of the object; of ``least`` or more, if that is given."""
        parts = self._kinematics.parts
        steps = [holding(self._grasps, pose) for pose in poses]
        start = {arm: q[part] for arm, part in parts.items()}
        rows = self._kinematics.follow_on(steps, start, least=least)
        return np.hstack([rows[arm] for arm in parts])

    def _around(
        self, start: Pose, goal: Pose, q: Vector
    ) -> Generator[None, None, tuple[list[Pose], Vector] | None]:
        """Corners of a path around obstacles and the joint positions at its end; None if none."""
        rng = np.random.default_rng(self._seed)
        tree = PoseTree(start, goal, q, _step, self._edge)
        low = np.minimum(start.position, goal.position) - REACH_M
        high = np.maximum(start.position, goal.position) + REACH_M
        for _ in range(_DRAWS):
            yield
            target = goal
            if rng.random() > TO_GOAL:
                turn = line(start, goal).poses[int(rng.integers(9))]
                target = Pose(rng.uniform(low, high), turn.quaternion)
            corners = tree.grow(target)
            if corners is not None:
                return (yield from self._shortened(corners, q, rng))
        return None

    def _edge(self, start: Pose, end: Pose, q: Vector) -> Vector | None:
        """Joint positions at the end of a straight edge; None if it is not free."""
        try:
            rows = self._follow(line(start, end, *_COARSE).poses, q)
        except Failure:
            return None
        last: Vector = rows[-1]
        return None if self._checker.first_contact(rows) is not None else last

    def _shortened(
        self, corners: list[Pose], q: Vector, rng: np.random.Generator
    ) -> Generator[None, None, tuple[list[Pose], Vector]]:
        """Fewer corners, as far as straight edges between them are free, and the last positions."""
        at = [q]
        for here, there in itertools.pairwise(corners):
            found = self._edge(here, there, at[-1])
            at.append(at[-1] if found is None else found)
        for _ in range(_SHORTCUTS):
            if len(corners) < 3:
                break
            yield
            i, j = sorted(rng.choice(len(corners), 2, replace=False).tolist())
            found = self._edge(corners[i], corners[j], at[i]) if j > i + 1 else None
            if found is None:
                continue
            rest = [found]
            for here, there in itertools.pairwise(corners[j:]):
                further = self._edge(here, there, rest[-1])
                if further is None:
                    break
                rest.append(further)
            if len(rest) == len(corners) - j:
                corners = [*corners[: i + 1], *corners[j:]]
                at = [*at[: i + 1], *rest]
        return corners, at[-1]


def path_through(poses: Sequence[Pose]) -> CartesianPath:
    """Path of an object through poses: a line, or lines with blended corners."""
    if len(poses) == 1:
        return line(poses[0], poses[0])
    return line(poses[0], poses[1]) if len(poses) == 2 else blended(poses, BLEND_M)


def _step(start: Pose, end: Pose, share: float) -> Pose:
    """Pose at about a fraction of the way between two others."""
    if share == 1.0:
        return end
    poses = line(start, end, 1e-3, 1e-2).poses
    return poses[max(round(share * (len(poses) - 1)), 1)]
