"""Checks a motion against the world while it runs: has something come into its way?"""

from __future__ import annotations

import numpy as np

from bt_dualarm.errors import Failure
from bt_dualarm.motion.collision import CollisionChecker, Contact
from bt_dualarm.motion.motions import TrajectoryMotion
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.world import World

LOOK_S = 0.2
"""Simulated seconds between two looks."""

AHEAD_S = 2.0
"""How far ahead a look goes, in planned seconds."""

_MOVED = 2e-3  # rad or m: less has not moved
_RESTING = 0.05  # rad/s: an arm that moves faster will be elsewhere; the guard minds it
_STEP = 0.015  # metres: with 5 mm of the arm's own thickness, too little to miss a wall of 10 mm


class PlanWatch:
    """Looks ahead along a motion, once something else in the world has moved.

    Args:
        world: As it was when the motion was planned.
        arm: Name of the arm.
        motion: That has just begun; all of it was checked against this world.
        ignore: Objects that may be touched.
    """

    def __init__(
        self, world: World, arm: str, motion: TrajectoryMotion, ignore: frozenset[str]
    ) -> None:
        self._world, self._arm = world, arm
        self._motion, self._ignore = motion, ignore
        self._next = world.time + LOOK_S
        self._generation = world.generation
        self._seen = self._others()
        self._checked = len(motion.trajectory)

    def look(self, time: float) -> None:
        """Look, if it is time for that.

        Raises:
            Failure: ``IN_COLLISION`` with what is in the way.
        """
        if time < self._next or self._motion.done:
            return
        self._next = time + LOOK_S
        if self._has_changed():
            self._checked = self._row()
        if self._checked < len(self._motion.trajectory):
            self._look_ahead()

    def _has_changed(self) -> bool:
        """Whether anything else has moved since it was last seen to."""
        others = self._others()
        same = self._generation == self._world.generation
        if same and np.abs(others - self._seen).max(initial=0.0) < _MOVED:
            return False
        self._generation, self._seen = self._world.generation, others
        return True

    def _look_ahead(self) -> None:
        """Check what comes next of the motion, as far as it has not been checked yet."""
        checker = CollisionChecker(self._world, self._arm, ignore=self._ignore)
        ahead = self._row() + round(AHEAD_S / self._motion.trajectory.dt)
        waiting = False
        for q in self._rows(max(self._row(), self._checked), ahead, checker.radii):
            contact = checker.contact(q)
            if contact is not None and not self._is_moving(contact.second):
                raise self._failure(contact)
            waiting = waiting or contact is not None
        if not waiting:  # an arm that moves now may stop there
            self._checked = ahead

    def _row(self) -> int:
        """Of the set-point that the motion has come to."""
        return round(self._motion.place.s / self._motion.trajectory.dt)

    def _rows(self, first: int, end: int, radii: Vector) -> Matrix:
        """Configurations of a part of the motion, of shape (n, dof), not too close together."""
        rows = self._motion.trajectory.q[first:end]
        way = np.concatenate(((0.0,), np.cumsum(np.abs(np.diff(rows, axis=0)) @ radii)))
        _, kept = np.unique((way / _STEP).astype(int), return_index=True)
        picked: Matrix = rows[kept[1:]]
        return picked

    def _is_moving(self, body: str) -> bool:
        arm = self._world.arms.get(body.partition("/")[0])
        return arm is not None and float(np.abs(arm.v).max()) > _RESTING

    def _others(self) -> Vector:
        """Positions in the world, without those of this arm and what it holds."""
        world = self._world
        mine = np.zeros(world.model.nq, dtype=bool)
        mine[world.arms[self._arm].qpos_ids] = True
        for thing in world.attachments.attached_to(self._arm):
            start = int(world.model.jnt_qposadr[world.model.body_jntadr[world.object_body(thing)]])
            mine[start : start + 7] = True
        others: Vector = world.data.qpos[~mine]
        return others

    def _failure(self, contact: Contact) -> Failure:
        return Failure(
            "IN_COLLISION",
            f"{contact.second} has come into the way of {contact.first}",
            first=contact.first,
            second=contact.second,
            progress=self._motion.progress,
        )
