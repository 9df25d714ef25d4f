"""Referee of a released object: whether it stands at its goal, free of the arm."""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Iterator
from typing import Final

import mujoco
import numpy as np

from bt_dualarm.arm.arm import Arm
from bt_dualarm.core.errors import Failure, Number
from bt_dualarm.core.pose import Matrix, Pose
from bt_dualarm.skill.symmetry import true_error

REST_S: Final = 0.25
"""Simulated seconds for which an object has to keep its pose, to be at rest."""

_BODY: Final = int(mujoco.mjtObj.mjOBJ_BODY)
_STILL_M = 1e-4
_STILL_SHARE = 1e-3
"""Largest displacement of any point of an object at rest within `REST_S`, in m and as a fraction of
the distance of its farthest corner: the ends of a beam move more. Poses are compared, not
velocities, since a vibrating tool or an edge makes an object oscillate without displacing it: every
12 ms, MuJoCo 4.0.0 finds one contact instead of four of a box that reaches over an edge, and turns
a bar of 30 mm by 1 mrad about its long axis, forever. Its edges move by less than 0.04 mm."""


class LeftStanding:
    """Referee for an object that an arm has released.

    No sensor of the arm measures what happens to the object. The referee uses the true state: it
    scores the outcome, and turns a false SUCCESS into a failure. No motion of the arm depends on
    it.

    Args:
        arm: Arm that releases the object.
        name: Name of the object, which is in the world.
        still_share: Largest displacement of a point of it at rest, as a fraction of the distance of
            its farthest corner.

    Attributes:
        rests: Whether the object is at rest.
    """

    def __init__(self, arm: Arm, name: str, still_share: float = _STILL_SHARE) -> None:
        self._arm = arm
        self._name = name
        self._still_share = still_share
        self._corners = deque[tuple[float, Matrix]]()
        self.rests = False

    @property
    def pose(self) -> Pose:
        """True pose of the object in the world."""
        return self._arm.world.object_pose(self._name)

    @property
    def is_there(self) -> bool:
        """Whether the object is in the world."""
        return self._name in self._arm.world.objects

    def look(self) -> None:
        """Take a sample; to be called once per tick."""
        if not self.is_there:
            self.rests = False
            return
        now = self._arm.time
        corners = self._box_corners()
        self._corners.append((now, corners))
        while len(self._corners) > 1 and now - self._corners[1][0] >= REST_S:
            self._corners.popleft()
        reach = 0.5 * float(np.linalg.norm(corners[-1] - corners[0]))
        still = max(_STILL_M, self._still_share * reach)
        self.rests = self._spans and all(
            np.linalg.norm(corners - were, axis=1).max() <= still for _, were in self._corners
        )

    @property
    def _spans(self) -> bool:
        """Whether the samples cover `REST_S`: without that, rest cannot be told."""
        return bool(self._corners) and self._corners[-1][0] - self._corners[0][0] >= REST_S

    def _box_corners(self) -> Matrix:
        """Corners of its bounding box in the world, of shape (8, 3), m: they move farthest."""
        solid = self._arm.world.object_solid(self._name)
        sides = [(-solid.reach(-axis), solid.reach(axis)) for axis in np.eye(3)]
        pose = self.pose
        corners: Matrix = np.array([*itertools.product(*sides)]) @ pose.rotation_matrix.T
        return corners + pose.position

    def until_rest(self, longest: float) -> Iterator[float]:
        """Wait until it rests or is gone, or ``longest`` seconds have passed; once per tick."""
        until = self._arm.time + max(longest, REST_S)
        while self.is_there and not self.rests and (self._arm.time <= until or not self._spans):
            yield 1.0
            self.look()

    def away_from(self, goal: Pose) -> tuple[float, float]:
        """Distance, m, and angle, rad, from a pose, up to the symmetry of the object."""
        return true_error(self._arm.world, self._name, goal)

    def until_placed(
        self,
        goal: Pose,
        tolerance: float,
        angle_tolerance: float,
        longest: float,
        metrics: dict[str, Number],
    ) -> Iterator[float]:
        """Wait until it rests, and check that it does so at a pose, free of the arm.

        Args:
            goal: Pose in the world.
            tolerance: Largest distance from there, m.
            angle_tolerance: Largest angle from there, rad.
            longest: As for `until_rest`.
            metrics: Metrics of the leaf; get its distance and angle from there.

        Raises:
            Failure: ``NOT_PLACED`` with both.
        """
        yield from self.until_rest(longest)
        label = repr(self._name)
        if not self.is_there:
            raise Failure("NOT_PLACED", f"object {label} was removed from the world")
        away, turned = self.away_from(goal)
        numbers = {"placed_error_m": away, "placed_turned_rad": turned}
        metrics.update(numbers)
        how = f"{label} is {1e3 * away:.1f} mm and {np.degrees(turned):.1f}° from its goal"
        if not self.rests:
            raise Failure("NOT_PLACED", f"{how}, and still moves", **numbers)
        if away > tolerance or turned > angle_tolerance:
            raise Failure("NOT_PLACED", f"{how}, at rest", **numbers)
        # A leaf that succeeds leaves nothing at the tool, whether it sticks there or is held.
        if self._arm.world.touches(self._arm.name, self._name) or is_tied_to(self._arm, self._name):
            raise Failure("NOT_PLACED", f"{how}, but the tool still holds or touches it", **numbers)


def is_tied_to(arm: Arm, name: str) -> bool:
    """Whether an equality constraint ties an object to an arm, as glue would."""
    world = arm.world
    model = world.model
    data = world.data
    body = world.arms[arm.name]
    own = {int(model.geom_bodyid[geom]) for geom in body.geom_ids} | {body.tool_body}
    its = world.object_body(name)
    for tie in np.flatnonzero(data.eq_active).tolist():
        pair = {int(model.eq_obj1id[tie]), int(model.eq_obj2id[tie])}
        if model.eq_objtype[tie] == _BODY and its in pair and pair & own:
            return True
    return False


def stands_without(arm: Arm, name: str) -> bool:
    """Whether something other than an arm bears at least half of an object's weight."""
    world = arm.world
    if not world.objects[name].is_free:
        return True
    if any(one.object == name and one.arm != arm.name for one in world.attachments):
        return True
    model = world.model
    data = world.with_contact_forces()
    geoms = world.payload_geoms(name)
    own = world.arms[arm.name].geom_ids
    force = np.empty(6)
    borne = 0.0
    for number, pair in enumerate(data.contact.geom.tolist()):
        if not own & set(pair) and (pair[0] in geoms) != (pair[1] in geoms):
            mujoco.mj_contactForce(model, data, number, force)
            upward = float(force[:3] @ data.contact.frame[number].reshape(3, 3)[:, 2])
            borne += upward if pair[1] in geoms else -upward  # forces act on the second geom
    riders = (one.object for one in world.passengers_of(name))
    mass = sum(model.body_subtreemass[world.object_body(one)] for one in (name, *riders))
    weight = float(mass * -model.opt.gravity[2])
    return borne >= 0.5 * weight
