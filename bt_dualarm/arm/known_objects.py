"""Where an arm believes objects to be: as declared, seen by its camera, or felt by its gripper."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Final, Literal, TypeAlias

import numpy as np

from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.sim.grippers import Attachment
from bt_dualarm.sim.object_body import body_of
from bt_dualarm.sim.world import World

KnownBy: TypeAlias = Literal["declared", "seen", "felt", "held", "sensor"]
"""How an arm knows a pose: from the file, from its camera, from where its gripper let the object
go, from where its gripper holds the object now, or from the sensor of the joint that moves it."""

_FALLS_M: Final = 0.03
_SINKS_M: Final = 0.01
"""Largest gap between an object and what it stands on, which it falls, and largest penetration, by
which poses known to some millimeters may overlap, m."""

_DOWN: Final[Vector] = np.array((0.0, 0.0, -1.0))


@dataclass(frozen=True, eq=False)
class KnownPose:
    """Estimated pose of an object.

    Attributes:
        pose: Pose in the world.
        by: How the arm knows it.
        since: Simulated time of the estimate, s.
        on: Object that moves on a joint, such as a drawer, or that the arm has taken, such as a
            tray, on or in which the object stood then; it moves along. Empty if there is none.
        relative: Pose in the frame of that object, or in the tool link of the holder.
        holder: Other arm that held the object when it was seen, and with which it moves along.
            Empty if there is none.
        held_since: Simulated time in s at which the holder took it.
    """

    pose: Pose
    by: KnownBy
    since: float
    on: str = ""
    relative: Pose | None = None
    holder: str = ""
    held_since: float = 0.0


@dataclass(frozen=True, eq=False)
class Released:
    """An object that an arm has released where it places it, and from which it still has to leave.

    Attributes:
        held: Its attachment to the gripper before.
        width: Opening of the fingers when they held it, m.
        pose: Estimated pose in the world at the release.
        tool: Pose of the tool in the world then.
    """

    held: Attachment
    width: float
    pose: Pose
    tool: Pose


@dataclass(frozen=True, eq=False)
class SetDown:
    """What several arms have set down and released together, if one was halted before it was away.

    Attributes:
        object: Name of the object.
        goal: Pose at which they set it down.
        tool: Pose of this arm's tool then.
    """

    object: str
    goal: Pose
    tool: Pose


class KnownObjects:
    """Poses of objects as one arm knows them; all of its leaves share them.

    An object that nobody has touched is where the file declares it. The true pose, which `noise` or
    another arm may have changed, is never read. What stands in a drawer moves with it, by what the
    arm knows of both.

    Args:
        world: World that the arm is in, for the declarations and for what the arm holds.
        arm: Name of the arm.

    Attributes:
        released: What the arm has released last, if the leaf that did so was halted or failed
            before the hand had left it.
        dropped: Failure ``DROPPED`` of an object that the hand has lost while no leaf was checking;
            the next one that checks, or needs a held object, fails with it.
        set_down: What this arm and others have set down together likewise.
        goals: Configurations in which the arm can set down what it grasped, as it found when it
            chose the grasp, of shape (dof,), rad; by object. A redundant arm has endless others.
        glimpsed: Roughly where the camera has seen what leaves looked for, m: where a leaf looks
            that begins with the camera turned away, as after the halt of another one. By a
            description of what was looked for.
    """

    def __init__(self, world: World, arm: str) -> None:
        self.released: Released | None = None
        self.dropped: Failure | None = None
        self.set_down: SetDown | None = None
        self.goals: dict[str, Vector] = {}
        self.glimpsed: dict[str, Vector] = {}
        self._world = world
        self._arm = arm
        self._known: dict[str, KnownPose] = {}
        self._unknown: dict[str, str] = {}
        self._weighed: dict[str, tuple[float, frozenset[str]]] = {}
        self._declared: dict[str, KnownPose] = {}
        objects = world.declared_objects
        self._parts = tuple(name for name, obj in objects.items() if obj.joint is not None)

    def pose(self, name: str) -> KnownPose:
        """Estimated pose of a declared object.

        Raises:
            Failure: ``UNKNOWN_POSE`` with the reason.
        """
        world = self._world
        if name not in world.objects:
            declared = world.declared_objects.get(name)
            if declared is None:
                raise self._unknown_pose(name, "the file declares no such object")
            raise self._unknown_pose(name, "it is not in the world now")
        hung = world.objects[name].joint
        if hung is not None:
            reading = world.joint_reading(name)
            if reading is not None:
                owner = self.pose(hung.owner)
                pose = owner.pose @ hung.spec.displacement(reading)
                return KnownPose(pose, "sensor", world.time)
        held = world.attachments.find(self._arm, name)
        if held is not None:
            return KnownPose(self._link_of(self._arm) @ held.relative, "held", world.time)
        if name in self._unknown:
            raise self._unknown_pose(name, self._unknown[name])
        if name in self._known:
            return self._moved(name, self._known[name])
        if hung is not None:
            owner = self.pose(hung.owner)
            return replace(owner, pose=owner.pose @ hung.spec.displacement(hung.spec.start))
        if not world.declared_objects[name].spawned:
            raise self._unknown_pose(name, "it was spawned during the run, and was never seen")
        return self._moved(name, self._as_declared(name))

    def where(self, name: str) -> KnownPose | None:
        """Estimated pose of a declared object; None if it is unknown."""
        try:
            return self.pose(name)
        except Failure:
            return None

    def standing_on(self, part: str) -> frozenset[str]:
        """Names of the free objects that, as the arm knows, stand on or in what a joint moves.

        Also on each other. What this arm holds stands nowhere, and neither does what it has lost.

        Args:
            part: Name of the object that moves on a joint.
        """
        world = self._world
        found = set[str]()
        for name in world.objects:
            if not world.objects[name].is_free or world.attachments.find(self._arm, name):
                continue
            known = self.where(name)
            if known is not None and self._is_upon(known.on, part):
                found.add(name)
        return frozenset(found)

    def _is_upon(self, on: str, base: str) -> bool:
        """Whether what stands on one object stands on another one, directly or in between."""
        while on and on != base:
            below = self.where(on)
            on = "" if below is None else below.on
        return on == base

    def joint_position(self, name: str) -> float:
        """Estimated position in rad or m of the joint on which an object moves.

        By its sensor, or from the pose of the object.

        Raises:
            Failure: ``UNKNOWN_POSE``; ``INVALID_TARGET`` if it moves on no joint.
        """
        hung = self._world.objects[name].joint if name in self._world.objects else None
        if hung is not None:
            reading = self._world.joint_reading(name)
            if reading is not None:
                return reading
        known = self.pose(name)
        if hung is None:
            raise Failure("INVALID_TARGET", f"{name!r} moves on no joint")
        return hung.spec.position_of(self.pose(hung.owner).pose.inverse @ known.pose)

    def saw(self, name: str, pose: Pose) -> None:
        """Store a pose in the world that a camera has measured."""
        self._set(name, KnownPose(pose, "seen", self._world.time))

    def located(
        self, name: str, pose: Pose, canonical: Callable[[Pose], Pose] | None = None
    ) -> None:
        """Store a pose in the world that a camera has measured accurately enough for a grasp.

        An object in the hand of another arm moves with that hand from then on.

        Args:
            name: Name of the object.
            pose: The pose.
            canonical: Returns the pose with the smallest rotation among those that look like a
                given one; None if no other pose looks like it. Of poses that look alike in the hand
                of another arm, the one nearest to that arm's estimate is stored.
        """
        world = self._world
        holders = [arm for arm in world.attachments.holders(name) if arm != self._arm]
        held = world.attachments.find(holders[0], name) if holders else None
        if held is None:
            self.saw(name, pose)
            return
        link = self._link_of(held.arm)
        relative = link.inverse @ pose
        if canonical is not None:
            relative = held.relative @ canonical(held.relative.inverse @ relative)
        self._known[name] = KnownPose(
            link @ relative,
            "seen",
            world.time,
            relative=relative,
            holder=held.arm,
            held_since=held.since,
        )
        self._unknown.pop(name, None)

    def seen_in_hand(self, name: str, holder: str) -> Pose | None:
        """Pose of an object in the tool link of another arm, as seen since that arm took it.

        None if it was not seen in that hand.
        """
        known = self._known.get(name)
        if known is None or known.holder != holder or not self._is_held_still(name, known):
            return None
        return known.relative

    def _is_held_still(self, name: str, known: KnownPose) -> bool:
        """Whether the arm in whose hand an object was seen has not released it since."""
        held = self._world.attachments.find(known.holder, name)
        return held is not None and held.since == known.held_since

    def _link_of(self, arm: str) -> Pose:
        """Measured pose in the world of the link that carries an arm's tool."""
        return self._world.nominal[arm].tool_link_pose_at(self._world.hardware[arm].q)

    def put(self, name: str, pose: Pose) -> None:
        """Take over a pose in the world where a leaf has spawned an object, or the file has it."""
        self._set(name, KnownPose(pose, "declared", self._world.time))

    def refuse_dropped(self) -> None:
        """Raise `dropped`, once.

        Raises:
            Failure: ``DROPPED``.
        """
        failure, self.dropped = self.dropped, None
        if failure is not None:
            raise failure

    def took(self, name: str) -> None:
        """Record that the arm holds an object from now on; it is lost later unless released.

        What rides on it moves along from now on, also after its release.
        """
        self.released = None
        self.dropped = None
        self._known.pop(name, None)
        self._unknown[name] = f"{self._arm} had taken it, and lost it"
        carrier = self.where(name)
        if carrier is None:
            return
        for one in self._world.passengers_of(name):
            known = self.where(one.object)
            if known is not None:
                relative = carrier.pose.inverse @ known.pose
                self._known[one.object] = replace(
                    known, on=name, relative=relative, holder="", held_since=0.0
                )

    def mass(self, name: str) -> float | None:
        """Mass of an object with what rides on it, kg; None if the arm does not know it.

        An arm that has to estimate loads knows it, with twice its standard deviation, once it has
        held the object, unless something else rides on that now.
        """
        world = self._world
        if name not in world.objects:  # removed meanwhile
            return None
        if not world.nominal[self._arm].estimates_payload:
            return world.loaded_mass(name)
        for load in world.nominal[self._arm].loads:
            if load.object == name and load.mass is not None:
                return load.mass + 2.0 * load.mass_doubt
        mass, riders = self._weighed.get(name, (None, frozenset()))
        return mass if riders == self._riders(name) else None

    def weighed(self, name: str, mass: float | None) -> None:
        """Record the mass of an object that the arm holds, kg, if it knows that."""
        if mass is not None:
            self._weighed[name] = mass, self._riders(name)

    def _riders(self, name: str) -> frozenset[str]:
        return frozenset(one.object for one in self._world.passengers_of(name))

    def left(self, name: str) -> None:
        """Record that the arm releases an object where it is; call while it is still held."""
        if self._world.nominal[self._arm].estimates_payload:
            self.weighed(name, self.mass(name))
        known = self.where(name)
        if known is None:  # what it moves against may be lost
            self._known.pop(name, None)
        else:
            self._set(name, KnownPose(known.pose, "felt", self._world.time))

    def forget(self, name: str, why: str) -> None:
        """Record that an object is elsewhere from now on.

        Args:
            name: Name of the object.
            why: Why its pose is unknown, as a clause: ``"it was handed over"``.
        """
        self._known.pop(name, None)
        self._unknown[name] = why

    def _set(self, name: str, known: KnownPose) -> None:
        # What stands on it moves with it, and bears it nowhere.
        poses = {
            other: there.pose
            for other in self._world.objects
            if self._parts
            and (there := self.where(other)) is not None
            and not self._is_upon(there.on, name)
        }
        self._known[name] = self._stood(name, known, poses, self.pose)
        self._unknown.pop(name, None)

    def _moved(self, name: str, known: KnownPose) -> KnownPose:
        """A pose as it is now, if the object stands on something or is in a hand that moves.

        Raises:
            Failure: ``UNKNOWN_POSE``: that hand has released it.
        """
        if known.relative is None:
            return known
        if known.holder:
            if not self._is_held_still(name, known):
                why = f"it was seen in the hand of {known.holder}, which has released it since"
                raise self._unknown_pose(name, why)
            return replace(known, pose=self._link_of(known.holder) @ known.relative)
        return replace(known, pose=self.pose(known.on).pose @ known.relative)

    def _as_declared(self, name: str) -> KnownPose:
        """Pose of an object as the file declares it, with the joints where they start."""
        if name not in self._declared:
            # Entered first: two objects that are within each other end the recursion.
            known = self._declared[name] = KnownPose(self._declared_pose(name), "declared", 0.0)
            start = {
                other: self._declared_pose(other)
                for other in self._world.objects
                if self._parts and self._world.declared_objects[other].spawned
            }
            self._declared[name] = self._stood(name, known, start, self._as_declared)
        return self._declared[name]

    def _declared_pose(self, name: str) -> Pose:
        objects = self._world.declared_objects
        hung = objects[name].joint
        if hung is None:
            return objects[name].pose.pose
        return objects[hung.owner].pose.pose @ hung.spec.displacement(hung.spec.start)

    def _stood(
        self,
        name: str,
        known: KnownPose,
        poses: Mapping[str, Pose],
        of: Callable[[str], KnownPose],
    ) -> KnownPose:
        """A pose with what the object stands on, if that moves on a joint.

        It stands on the highest surface below its center of mass, of what reaches lower than it
        does: the content of a bin does not bear the bin. What stands on an object that stands in a
        drawer, stands in the drawer.

        Args:
            name: Name of the object.
            known: Its pose.
            poses: Poses of all known objects at that time.
            of: How the arm knows one of them.
        """
        world = self._world
        objects = world.declared_objects
        if not self._parts or not objects[name].is_free:
            return known
        body = body_of(objects[name])
        center = known.pose.apply(body.center)
        local = known.pose.inverse.turn(_DOWN)
        height = body.solid.reach(local) - float(local @ body.center)
        lowest = float(center[2]) - height
        nearest = _FALLS_M
        below = ""
        for other, pose in poses.items():
            if other == name or world.attachments.find(self._arm, other):
                continue
            its = objects[other].joint
            if its is not None and its.owner == name:  # its own lid
                continue
            to_local = pose.inverse
            its_body = body_of(objects[other])
            down = to_local.turn(_DOWN)
            if float(pose.position[2]) - its_body.solid.reach(down) >= lowest:
                continue
            gap = its_body.ray(to_local.apply(center), down) - height
            if -_SINKS_M <= gap < nearest:
                nearest = gap
                below = other
        part = below if not below or below in self._parts else of(below).on
        if part not in poses:
            return known
        return replace(known, on=part, relative=poses[part].inverse @ known.pose)

    def _unknown_pose(self, name: str, why: str) -> Failure:
        return Failure("UNKNOWN_POSE", f"{self._arm} does not know where {name!r} is: {why}")
