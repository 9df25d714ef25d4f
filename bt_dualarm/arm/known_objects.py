"""Where an arm believes objects to be: as declared, seen by its camera, or felt by its gripper."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Pose
from bt_dualarm.sim.world import World

KnownBy: TypeAlias = Literal["declared", "seen", "felt", "held", "sensor"]
"""How an arm knows a pose: from the file, from its camera, from where its gripper let the object
go, from where its gripper holds the object now, or from the sensor of the joint that moves it."""


@dataclass(frozen=True, eq=False)
class KnownPose:
    """Estimated pose of an object.

    Attributes:
        pose: Pose in the world.
        by: How the arm knows it.
        since: Simulated time of the estimate, s.
    """

    pose: Pose
    by: KnownBy
    since: float


class KnownObjects:
    """Poses of objects as one arm knows them; all of its leaves share them.

    An object that nobody has touched is where the file declares it. The true pose, which `noise` or
    another arm may have changed, is never read.

    Args:
        world: World that the arm is in, for the declarations and for what the arm holds.
        arm: Name of the arm.
    """

    def __init__(self, world: World, arm: str) -> None:
        self._world = world
        self._arm = arm
        self._known: dict[str, KnownPose] = {}
        self._unknown: dict[str, str] = {}

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
            link = world.nominal[self._arm].tool_link_pose_at(world.hardware[self._arm].q)
            return KnownPose(link @ held.relative, "held", world.time)
        if name in self._unknown:
            raise self._unknown_pose(name, self._unknown[name])
        if name in self._known:
            return self._known[name]
        if hung is not None:
            owner = self.pose(hung.owner)
            return replace(owner, pose=owner.pose @ hung.spec.displacement(hung.spec.start))
        declared = world.declared_objects[name]
        if not declared.spawned:
            raise self._unknown_pose(name, "it was spawned during the run, and was never seen")
        return KnownPose(declared.pose.pose, "declared", 0.0)

    def joint_position(self, name: str) -> float:
        """Estimated position in rad or m of the joint on which an object moves.

        By its sensor, or from the pose of the object.

        Raises:
            Failure: ``UNKNOWN_POSE``; ``INVALID_TARGET`` if it moves on no joint.
        """
        known = self.pose(name)
        hung = self._world.objects[name].joint
        if hung is None:
            raise Failure("INVALID_TARGET", f"{name!r} moves on no joint")
        reading = self._world.joint_reading(name)
        if reading is not None:
            return reading
        return hung.spec.position_of(self.pose(hung.owner).pose.inverse @ known.pose)

    def saw(self, name: str, pose: Pose) -> None:
        """Store a pose in the world that a camera has measured."""
        self._set(name, KnownPose(pose, "seen", self._world.time))

    def put(self, name: str, pose: Pose) -> None:
        """Take over a pose in the world at which the arm's own leaf has spawned the object."""
        self._set(name, KnownPose(pose, "declared", self._world.time))

    def took(self, name: str) -> None:
        """Record that the arm holds an object from now on; it is lost later unless released."""
        self._known.pop(name, None)
        self._unknown[name] = f"{self._arm} had taken it, and lost it"

    def left(self, name: str) -> None:
        """Record that the arm releases an object where it is; call while it is still held."""
        self._set(name, KnownPose(self.pose(name).pose, "felt", self._world.time))

    def forget(self, name: str, why: str) -> None:
        """Record that an object is elsewhere from now on.

        Args:
            name: Name of the object.
            why: Why its pose is unknown, as a clause: ``"it was handed over"``.
        """
        self._known.pop(name, None)
        self._unknown[name] = why

    def _set(self, name: str, known: KnownPose) -> None:
        self._known[name] = known
        self._unknown.pop(name, None)

    def _unknown_pose(self, name: str, why: str) -> Failure:
        return Failure("UNKNOWN_POSE", f"{self._arm} does not know where {name!r} is: {why}")
