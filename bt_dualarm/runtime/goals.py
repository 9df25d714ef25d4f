"""The referee: conditions of a file on the true world, checked during a run and at its end.

Trees, skills and controllers never read them. They cannot turn a failure into a success.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.perception.known_shape import KnownShape
from bt_dualarm.runtime.arm_runtime import IdleObserver
from bt_dualarm.runtime.outcome import GoalResult
from bt_dualarm.sim.contact_monitor import ContactMonitor, Contacts
from bt_dualarm.sim.world import World
from bt_dualarm.spec.document import TreeFile
from bt_dualarm.spec.goals import ConditionSpec
from bt_dualarm.spec.joints import moved_name

CHECK_S: Final = 0.004
"""Simulated seconds between two checks: the period of the controllers."""

_TOUCHES_M: Final = 1e-4
"""Gap below which an object stands on another one: in some steps, what rests on something light is
some micrometers above it."""


class _BodyIds(NamedTuple):
    """Ids of the bodies of a model.

    Attributes:
        model: The model; None before the first one.
        of_objects: Ids by the name of the object.
        of_geoms: Ids by the id of the geom, of shape (ngeom,).
    """

    model: mujoco.MjModel | None
    of_objects: Mapping[str, int]
    of_geoms: npt.NDArray[np.int_]


class Referee(IdleObserver):
    """Observes the true world on behalf of a file's goals and invariants.

    Args:
        world: World of the run.
        file: Tree file.
        taken_away: Name of the fault that has taken an object away; empty if none has.

    Attributes:
        violation: Sentence on the first violated invariant, empty while none is.
    """

    def __init__(self, world: World, file: TreeFile, taken_away: Callable[[str], str]) -> None:
        self._world = world
        self._taken_away = taken_away
        self._zones = file.cell.zones
        self._goals = file.goal
        self._always = file.always
        self._never = file.never
        self._forces: dict[str, ContactMonitor] = {}
        self._ids = _BodyIds(None, {}, np.empty(0, int))
        self._held_since: dict[str, float | None] = {}
        self._next = 0.0
        self._lasting = {name: one for name, one in file.goal.items() if one.lasting}
        self._forced = {
            one.tool
            for conditions in (file.goal, file.always, file.never)
            for one in conditions.values()
            if one.force is not None and one.tool is not None
        }
        # Observing every step costs time, so it is added only if the file needs forces.
        self._contacts = Contacts(world) if self._forced else None
        self.violation = ""

    @property
    def watches(self) -> bool:
        """Whether anything has to be checked during the run."""
        return bool(self._lasting or self._always or self._never or self._forced)

    def after_step(self, time: float) -> None:
        """Check invariants, and goals that must last."""
        if not self.watches or time < self._next - 1e-9:
            return
        self._next = time + CHECK_S
        self._watch_forces()
        for name, goal in self._lasting.items():
            if self._failing(goal):
                self._held_since[name] = None
            elif self._held_since.get(name) is None:
                self._held_since[name] = time
        if self.violation:
            return
        for name, one in self._always.items():
            reason = self._failing(one)
            if reason:
                self.violation = f"always {name} is violated at {time:.3f} s: {reason}"
                return
        for name, one in self._never.items():
            if not self._failing(one):
                self.violation = f"never {name} is violated at {time:.3f} s: {_said(one)}"
                return

    def results(self) -> Mapping[str, GoalResult]:
        """Result of each goal, in the world as it is now."""
        found = {}
        for name, goal in self._goals.items():
            reason = self._failing(goal)
            since = self._held_since.get(name)
            lasted = 0.0 if since is None else self._world.time - since
            if not reason and lasted < goal.lasting - 1e-6:
                reason = f"it has been so for {lasted:.2f} s, not for {goal.lasting:g} s"
            found[name] = GoalResult(not reason, reason)
        return found

    def _watch_forces(self) -> None:
        """Monitor the contacts of the arms whose force matters, once they are in the world."""
        if self._contacts is None:
            return
        for arm in self._forced:
            if arm in self._world.arms and arm not in self._forces:
                self._forces[arm] = self._contacts.watch(arm)
            elif arm not in self._world.arms:
                self._forces.pop(arm, None)

    def _failing(self, one: ConditionSpec) -> str:
        """Sentence on the first part of a condition that does not hold; empty if all hold."""
        world = self._world
        if one.object is not None:
            if one.object not in world.objects:
                return f"{one.object} is not in the world"
            fault = self._taken_away(one.object)
            if fault:
                return f"{one.object} is taken away by the fault {fault!r}"
            subject = one.object
            pose = world.object_pose(subject)
        else:
            if one.tool is None or one.tool not in world.arms:
                return f"{one.tool} is not in the world"
            subject = f"the tool of {one.tool}"
            pose = world.arms[one.tool].tool_pose
        return (
            self._away(one, subject, pose)
            or self._outside(one, subject, pose)
            or self._not_on(one)
            or self._tilted(one, subject, pose)
            or self._at_another_height(one, subject, pose)
            or self._held_otherwise(one)
            or self._too_fast(one, subject)
            or self._too_firm(one)
            or self._too_near(one, subject, pose)
            or self._joint_elsewhere(one)
        )

    def _center(self, one: ConditionSpec, pose: Pose) -> Vector:
        """Center of an object, or the tool's position, of shape (3,), m."""
        return pose.position if one.object is None else self._world.object_middle(one.object)

    def _tilted(self, one: ConditionSpec, subject: str, pose: Pose) -> str:
        if one.tilt is None:
            return ""
        if one.object is None:
            cosine = float(pose.rotation_matrix[2, 2])
            tilt = math.degrees(math.acos(max(-1.0, min(1.0, cosine))))
        else:
            tilt = math.degrees(KnownShape.of(self._world.objects[one.object]).tilt(pose))
        return f"{subject} is tilted by {tilt:.1f}°" if tilt > one.tilt else ""

    def _away(self, one: ConditionSpec, subject: str, pose: Pose) -> str:
        if one.at is None:
            return ""
        goal = one.at.pose_from(pose)
        distance, angle = pose.distance(goal), 0.0
        shape = None if one.object is None else KnownShape.of(self._world.objects[one.object])
        if shape is None:
            angle = pose.angle(goal)
        elif distance <= one.within or any(shape.center):
            # Up to the symmetry of the object, which takes a tenth of a millisecond: its frame may
            # be elsewhere then, unless it is in the center.
            distance, angle = shape.away(pose, goal)
        if distance > one.within:
            off, most = _unlike(distance, one.within)
            return f"{subject} is {off} from its place, not within {most}"
        if math.degrees(angle) > one.angle:
            return f"{subject} is turned by {math.degrees(angle):.1f}°, not within {one.angle:g}°"
        return ""

    def _outside(self, one: ConditionSpec, subject: str, pose: Pose) -> str:
        if one.in_zone is None:
            return ""
        zone = self._zones[one.in_zone]
        frame = zone.pose.pose
        if zone.around is not None:
            if zone.around not in self._world.objects:
                return f"the zone {one.in_zone} is around {zone.around}, which is not in the world"
            frame = self._world.object_pose(zone.around) @ frame
        distance = zone.outside_by(frame.inverse.apply(self._center(one, pose)))
        return f"{subject} is {_mm(distance)} outside {one.in_zone}" if distance > 0.0 else ""

    def _not_on(self, one: ConditionSpec) -> str:
        if one.on is None or one.object is None:
            return ""
        if one.on not in self._world.objects:
            return f"{one.on} is not in the world"
        ids = self._body_ids()
        bodies = ids.of_objects
        upper = bodies[one.object]
        found = self._world.data.contact
        first, second = ids.of_geoms[found.geom].T
        # The normal points from the first geom to the second one.
        up = found.frame[:, 2]
        supports = {*first[(second == upper) & (up > 0.5)].tolist()}
        supports |= {*second[(first == upper) & (up < -0.5)].tolist()}
        if bodies[one.on] in supports or self._is_just_above(upper, bodies[one.on]):
            return ""
        others = [name for name in self._world.objects if bodies[name] in supports]
        but = f", but on {' and '.join(others)}" if others else ""
        return f"{one.object} does not stand on {one.on}{but}"

    def _is_just_above(self, upper: int, lower: int) -> bool:
        """Whether a body is less than `_TOUCHES_M` above another one, by their ids."""
        model, data = self._world.model, self._world.data
        is_solid = (model.geom_contype | model.geom_conaffinity) != 0
        of_upper, of_lower = (
            np.flatnonzero((model.geom_bodyid == body) & is_solid) for body in (upper, lower)
        )
        apart = data.geom_xpos[of_upper][:, None] - data.geom_xpos[of_lower]
        reach = model.geom_rbound[of_upper][:, None] + model.geom_rbound[of_lower] + _TOUCHES_M
        between = np.empty(6)
        for i, j in np.argwhere(np.linalg.norm(apart, axis=2) < reach).tolist():
            gap = mujoco.mj_geomDistance(model, data, of_lower[j], of_upper[i], _TOUCHES_M, between)
            if 0.0 < gap < _TOUCHES_M and between[5] - between[2] > 0.5 * gap:
                return True
        return False

    def _body_ids(self) -> _BodyIds:
        """Ids of bodies, until the world is compiled again."""
        world = self._world
        if self._ids.model is not world.model:
            of_objects = {name: world.object_body(name) for name in world.objects}
            self._ids = _BodyIds(world.model, of_objects, np.array(world.model.geom_bodyid))
        return self._ids

    def _held_otherwise(self, one: ConditionSpec) -> str:
        if one.object is None or (one.held is None and one.held_by is None):
            return ""
        holders = {
            held.arm: held.object
            for held in self._world.attachments
            if held.object == one.object or self._world.moves_on(held.object, one.object)
        }
        if one.held_by is not None and one.held_by not in holders:
            return f"{one.held_by} does not hold {one.object}"
        if one.held is True and not holders:
            return f"no arm holds {one.object}"
        if one.held is False and holders:
            arm, held = next(iter(holders.items()))
            return f"{arm} holds {held}"
        return ""

    def _too_fast(self, one: ConditionSpec, subject: str) -> str:
        if one.speed is None:
            return ""
        if one.object is not None:
            velocity = self._world.object_velocity(one.object)[3:]
        else:
            velocity = self._tool_velocity(str(one.tool))
        speed = float(np.linalg.norm(velocity))
        return f"{subject} moves at {speed:.3f} m/s" if speed > one.speed else ""

    def _tool_velocity(self, arm: str) -> Vector:
        model, data = self._world.model, self._world.data
        body = self._world.arms[arm]
        jacobian = np.zeros((3, model.nv))
        point = body.tool_pose.position
        mujoco.mj_jac(model, data, jacobian, None, point, body.tool_body)
        velocity: Vector = jacobian @ data.qvel
        return velocity

    def _too_firm(self, one: ConditionSpec) -> str:
        if one.force is None or one.tool is None or one.tool not in self._forces:
            return ""
        forces = self._forces[one.tool].forces_n
        obj = max(forces, key=lambda name: forces[name], default="")
        if obj and forces[obj] > one.force:
            return f"{one.tool} has pressed on {obj} with {forces[obj]:.1f} N"
        return ""

    def _joint_elsewhere(self, one: ConditionSpec) -> str:
        if one.joint is None or one.between is None:
            return ""
        name = moved_name(one.object or "", one.joint)
        hung = self._world.joint_of(name) if name in self._world.objects else None
        if hung is None:
            return f"{name} is not in the world"
        low, high = (hung.spec.si(end) for end in one.between)
        position = self._world.joint_position(name)
        if low <= position <= high:
            return ""
        where = hung.spec.in_words(position)
        return f"{name} is at {where}, not between {one.between[0]:g} and {one.between[1]:g}"

    def _at_another_height(self, one: ConditionSpec, subject: str, pose: Pose) -> str:
        if one.height is None:
            return ""
        height = float(self._center(one, pose)[2])
        low, high = one.height
        return "" if low <= height <= high else f"{subject} is at a height of {height:.3f} m"

    def _too_near(self, one: ConditionSpec, subject: str, pose: Pose) -> str:
        if one.distance_to is None:
            return ""
        world = self._world
        if one.distance_to in world.objects:
            other = world.object_middle(one.distance_to)
        elif one.distance_to in world.arms:
            other = world.arms[one.distance_to].tool_pose.position
        else:
            return ""
        distance = float(np.linalg.norm(self._center(one, pose) - other))
        if distance >= one.apart:
            return ""
        near, least = _unlike(distance, one.apart)
        return f"{subject} is {near} from {one.distance_to}, not {least}"


def _said(one: ConditionSpec) -> str:
    """A condition that holds, as text."""
    given = one.model_dump(exclude_defaults=True)
    return ", ".join(f"{name} {value}" for name, value in given.items())


def _mm(meters: float, digits: int = 1) -> str:
    return f"{1000 * meters:.{digits}f} mm"


def _unlike(meters: float, bound: float) -> tuple[str, str]:
    """A length and the bound that it violates, with as many digits as tell them apart."""
    for digits in range(1, 6):  # nm: less is noise of the simulation
        length, limit = _mm(meters, digits), _mm(bound, digits)
        if length != limit:
            break
    return length, limit
