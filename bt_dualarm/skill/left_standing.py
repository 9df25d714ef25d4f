"""Does an object stay where an arm has left it? Judged by the simulator's truth, as a referee."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import Final

import mujoco
import numpy as np

from bt_dualarm.arm.arm import Arm
from bt_dualarm.errors import Failure
from bt_dualarm.pose import Pose
from bt_dualarm.vision.known_shape import KnownShape

REST_S: Final = 0.25
"""Simulated seconds for which an object stays where it is, to be at rest."""

_BODY: Final = int(mujoco.mjtObj.mjOBJ_BODY)
_STILL_M, _STILL_RAD = 1e-4, 1e-3
"""Farthest that what rests was from where it is now, in the last `REST_S`: a tool that trembles on
it, or an edge that it rocks on, moves it to and fro at any speed, but nowhere."""


class LeftStanding:
    """An object that an arm has let go of, from then on.

    No sensor of the arm tells what becomes of it. So this looks at the simulator's truth: it scores
    the outcome, and turns a SUCCESS that is none into a failure. Nothing that the arm does depends
    on it.

    Args:
        arm: Arm that lets go.
        thing: Name of the object, which is in the world.

    Attributes:
        rests: Whether it has been where it is for long enough.
    """

    def __init__(self, arm: Arm, thing: str) -> None:
        self._arm, self._thing = arm, thing
        self._been = deque[tuple[float, Pose]]()
        self.rests = False

    @property
    def pose(self) -> Pose:
        """Its true pose in the world."""
        return self._arm.world.object_pose(self._thing)

    @property
    def is_there(self) -> bool:
        """Whether it is in the world at all."""
        return self._thing in self._arm.world.objects

    def look(self) -> None:
        """Look whether it rests; to be called once a tick."""
        if not self.is_there:
            self.rests = False
            return
        now, pose = self._arm.time, self.pose
        self._been.append((now, pose))
        while len(self._been) > 1 and now - self._been[1][0] >= REST_S:
            self._been.popleft()
        self.rests = now - self._been[0][0] >= REST_S and all(
            pose.distance(was) <= _STILL_M and pose.angle(was) <= _STILL_RAD
            for _, was in self._been
        )

    def until_rest(self, longest: float) -> Iterator[float]:
        """Wait until it rests, or is gone, or for so many seconds; yields once a tick."""
        until = self._arm.time + max(longest, REST_S)
        while self.is_there and not self.rests and self._arm.time <= until:
            yield 1.0
            self.look()

    def away_from(self, goal: Pose) -> tuple[float, float]:
        """Distance in m and angle in rad from a pose; turns that nobody can see do not count."""
        pose, spec = self.pose, self._arm.world.objects[self._thing]
        return pose.distance(goal), KnownShape(spec.shape, spec.size).angle(pose, goal)

    def refuse_unless_at(
        self, goal: Pose, tolerance: float, angle_tolerance: float, *, touched: bool = False
    ) -> None:
        """Look whether it rests at a pose, free of the arm.

        Args:
            goal: Pose in the world.
            tolerance: Largest distance from there, m.
            angle_tolerance: Largest angle from there, rad.
            touched: Whether the arm's tool may still touch it.

        Raises:
            Failure: ``NOT_PLACED`` with both.
        """
        thing = repr(self._thing)
        if not self.is_there:
            raise Failure("NOT_PLACED", f"object {thing} was taken out of the world")
        away, turned = self.away_from(goal)
        numbers = {"placed_error_m": away, "placed_turned_rad": turned}
        how = f"{thing} is {1e3 * away:.1f} mm and {np.degrees(turned):.1f}° from its goal"
        if not self.rests:
            raise Failure("NOT_PLACED", f"{how}, and still moves", **numbers)
        if away > tolerance or turned > angle_tolerance:
            raise Failure("NOT_PLACED", f"{how}, at rest", **numbers)
        if not touched and is_borne_by(self._arm, self._thing):
            raise Failure("NOT_PLACED", f"{how}, but the tool still holds or touches it", **numbers)


def is_borne_by(arm: Arm, thing: str) -> bool:
    """Whether an object truly touches an arm's tool, or is tied to the arm."""
    world = arm.world
    if world.touches(arm.name, thing):
        return True
    model, data, body = world.model, world.data, world.arms[arm.name]
    own = {int(model.geom_bodyid[geom]) for geom in body.geom_ids} | {body.tool_body}
    its = world.object_body(thing)
    for tie in np.flatnonzero(data.eq_active).tolist():
        pair = {int(model.eq_obj1id[tie]), int(model.eq_obj2id[tie])}
        if model.eq_objtype[tie] == _BODY and its in pair and pair & own:
            return True
    return False


def stands_without(arm: Arm, thing: str) -> bool:
    """Whether something else than an arm truly bears an object: at least half of its weight."""
    world = arm.world
    if world.objects[thing].fixed:
        return True
    if any(one.object == thing and one.arm != arm.name for one in world.attachments):
        return True
    model, data, geom = world.model, world.data, world.object_geom(thing)
    own, force, borne = world.arms[arm.name].geom_ids, np.empty(6), 0.0
    for number, pair in enumerate(data.contact.geom.tolist()):
        if geom in pair and not own & set(pair):
            mujoco.mj_contactForce(model, data, number, force)
            upward = float(force[:3] @ data.contact.frame[number].reshape(3, 3)[:, 2])
            borne += upward if pair[1] == geom else -upward  # it points into the second
    weight = float(model.body_mass[world.object_body(thing)] * -model.opt.gravity[2])
    return borne >= 0.5 * weight
