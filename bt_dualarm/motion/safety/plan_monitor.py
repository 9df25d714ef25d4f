"""Checks a motion against the world while it runs: has something come into its way?"""

from __future__ import annotations

import numpy as np

from bt_dualarm.errors import BlockedFailure
from bt_dualarm.motion.collision.bounding_spheres import BoundingSpheres, apart
from bt_dualarm.motion.collision.checker import CollisionChecker, Contact
from bt_dualarm.motion.setpoints.trajectory_source import TrajectorySource
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.world import World

LOOK_S = 0.2
"""Simulated seconds between two looks."""

AHEAD_S = 2.0
"""How far ahead a look goes, in planned seconds."""

_MOVED = 2e-3  # rad or m: less has not moved
_RESTING = 0.05  # rad/s: an arm that moves faster will be elsewhere; the guard minds it
_STEP = 0.015  # metres: with 5 mm of the arm's own thickness, too little to miss a wall of 10 mm


class PlanMonitor:
    """Looks ahead along a motion, once something else in the world has moved.

    Only what has moved is in question: all else is where it was when the motion was planned.

    Args:
        world: World, still as it was when the motion was planned.
        arm: Name of the arm.
        motion: Motion that has just begun; all of it was checked against this world.
        ignore: Names of the objects that may be touched.
    """

    def __init__(
        self, world: World, arm: str, motion: TrajectorySource, ignore: frozenset[str]
    ) -> None:
        self._world, self._arm = world, arm
        self._motion, self._ignore = motion, ignore
        self._bounds, self._bounded = BoundingSpheres(world, arm), world.model
        self._next = world.time + LOOK_S
        self._seen = self._others()
        self._moved: set[str] = set()
        self._checked = len(motion.trajectory)

    def look(self, time: float) -> None:
        """Look, if it is time for that.

        Raises:
            Failure: ``IN_COLLISION`` with what is in the way.
        """
        if time < self._next or self._motion.done:
            return
        self._next = time + LOOK_S
        if self._sees_a_move():
            self._checked = self._row()
        if self._checked < len(self._motion.trajectory):
            self._look_ahead()

    def _sees_a_move(self) -> bool:
        """Whether another thing has come or moved since it was last seen to."""
        now = self._others()
        moved = {name for name, place in now.items() if not self._is_at(place, name)}
        self._seen = {name: now[name] if name in moved else self._seen[name] for name in now}
        self._moved |= moved
        return bool(moved)

    def _is_at(self, place: Vector, name: str) -> bool:
        """Whether a thing is where it was seen."""
        seen = self._seen.get(name)
        return seen is not None and bool((np.abs(place - seen) < _MOVED).all())

    def _look_ahead(self) -> None:
        """Check what comes next of the motion, as far as it has not been checked yet."""
        motion = self._motion.trajectory
        first = max(self._row(), self._checked)
        ahead = min(self._row() + round(AHEAD_S / motion.dt), len(motion))
        if first >= ahead:  # another arm holds this one up: nothing has come into view
            return
        near = self._within_reach(first, ahead)
        if not near:
            self._checked = ahead
            return
        if all(
            self._is_moving(name) for name in near
        ):  # whatever would touch: it will be elsewhere
            return
        checker = CollisionChecker(self._world, self._arm, ignore=self._ignore)
        waiting = False
        for q in self._rows(first, ahead, checker.radii):
            contact = checker.contact(q)
            if contact is None or contact.failure().obstacle not in self._moved:
                continue
            if not self._is_moving(contact.second):
                raise self._failure(contact)
            waiting = True
        if not waiting:  # an arm that moves now may stop there
            self._checked = ahead

    def _within_reach(self, first: int, end: int) -> list[str]:
        """Names of what has moved and is within reach of a part of the motion."""
        world, motion = self._world, self._motion.trajectory
        rows = motion.piece(first, end).q
        way = np.abs(rows - world.hardware[self._arm].q).max(axis=0)
        if self._bounded is not world.model:  # it was compiled anew
            self._bounds, self._bounded = BoundingSpheres(world, self._arm), world.model
        mine = self._bounds.spheres()
        reach = self._bounds.reach(self._bounds.levers(mine), way) + _STEP
        there = self._moved & (world.arms.keys() | world.objects.keys())
        return [name for name in there if apart(mine, self._spheres(name)) < reach]

    def _spheres(self, name: str) -> Matrix:
        """Around the shapes of an object, or of an arm and what it holds, of shape (n, 4), m."""
        world, arm = self._world, self._world.arms.get(name)
        if arm is None:
            geoms = [world.object_geom(name)]
        else:
            held = world.attachments.attached_to(name)
            geoms = [*arm.geom_ids, *(world.object_geom(one) for one in held)]
        spheres: Matrix = np.empty((len(geoms), 4))
        spheres[:, :3], spheres[:, 3] = (
            world.sensed.geom_xpos[geoms],
            world.model.geom_rbound[geoms],
        )
        return spheres

    def _row(self) -> int:
        """Row of the trajectory that the motion has come to."""
        return round(self._motion.parameter.s / self._motion.trajectory.dt)

    def _rows(self, first: int, end: int, radii: Vector) -> Matrix:
        """Configurations of a part of the motion, of shape (n, dof), not too close together.

        Its last one is among them: the next part may be as short as a slow arm goes in one look.
        """
        rows = self._motion.trajectory.piece(first, end).q
        moved = np.concatenate(((0.0,), np.cumsum(np.abs(np.diff(rows, axis=0)) @ radii)))
        _, kept = np.unique((moved / _STEP).astype(int), return_index=True)
        picked: Matrix = rows[[*kept[1:], -1]]
        return picked

    def _is_moving(self, body: str) -> bool:
        """Whether a link of an arm, or what an arm holds, will be elsewhere soon."""
        world = self._world
        holders = {one.arm for one in world.attachments if one.object == body}
        arms = (world.hardware.get(name) for name in holders or {body.partition("/")[0]})
        return any(arm is not None and np.abs(arm.v).max() > _RESTING for arm in arms)

    def _others(self) -> dict[str, Vector]:
        """Where everything else is, but what this arm holds: joint angles, and poses of objects.

        What is fixed is where it came.
        """
        world = self._world
        held = world.attachments.attached_to(self._arm)
        places = {name: arm.q for name, arm in world.hardware.items() if name != self._arm}
        for name in world.objects.keys() - held:
            if world.objects[name].fixed:
                places[name] = np.zeros(7)
            else:
                start = world.pose_address(name)
                places[name] = world.sensed.qpos[start : start + 7].copy()
        return places

    def _failure(self, contact: Contact) -> BlockedFailure:
        return BlockedFailure(
            "IN_COLLISION",
            f"{contact.second} has come into the way of {contact.first}",
            first=contact.first,
            second=contact.second,
            progress=self._motion.progress,
        )
