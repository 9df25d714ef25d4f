"""Resolves the poses in a leaf's ports that are relative to what its arm knows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np

from bt_dualarm.arm.arm import Arm
from bt_dualarm.arm.known_objects import KnownPose
from bt_dualarm.core.errors import Failure, Number
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.sim.object_body import ObjectBody, body_of, body_of_part
from bt_dualarm.spec.node_types import PortModel, metadata_of
from bt_dualarm.spec.relative_pose import FRAME_WORDS, PoseOf, RelativePose
from bt_dualarm.spec.values import PoseSpec

_FARTHEST_M: Final = 100.0  # largest coordinate of a pose in a tree file


@dataclass(frozen=True)
class ResolvedPorts:
    """Ports of a leaf, each relative pose replaced by one in the world.

    Attributes:
        ports: Ports as the skill receives them.
        names: Names of the objects to which poses were relative.
        metrics: How the arm knew the poses of these objects, and for how long.
    """

    ports: PortModel
    names: frozenset[str] = frozenset()
    metrics: Mapping[str, Number] = field(default_factory=dict)


def resolve_poses(ports: PortModel, arm: Arm) -> ResolvedPorts:
    """Resolve the relative poses among the ports of a leaf, by what its arm knows now.

    Args:
        ports: Validated ports.
        arm: Arm of the leaf.

    Raises:
        Failure: ``UNKNOWN_POSE``, as `KnownObjects.pose`, or if an arm is not in the world;
            ``INVALID_TARGET`` if the result is too far away, or on what the arm holds itself.
    """
    resolver = _Resolver(arm, ports)
    now = resolver.all_of(ports)
    if now is ports:
        return ResolvedPorts(ports)
    metrics: dict[str, Number] = {}
    if resolver.known:
        metrics["known_by"] = ", ".join(sorted({known.by for known in resolver.known}))
        metrics["known_for_s"] = arm.time - min(known.since for known in resolver.known)
    return ResolvedPorts(now, frozenset(resolver.names), metrics)


class _Resolver:
    """Resolves relative poses for one leaf; arguments as `resolve_poses`."""

    def __init__(self, arm: Arm, ports: PortModel) -> None:
        self._arm = arm
        self._ports = ports
        self.names: set[str] = set()
        self.known: list[KnownPose] = []

    def all_of(self, model: PortModel) -> PortModel:
        """The model with all of its relative poses resolved; the same object if it has none."""
        found: dict[str, object] = {}
        for name, value in model.__dict__.items():
            of = metadata_of(type(model).model_fields[name], PoseOf)
            if isinstance(value, RelativePose):
                found[name] = self._resolved(name, of, value)
            elif isinstance(value, tuple) and any(isinstance(one, RelativePose) for one in value):
                found[name] = tuple(
                    self._resolved(name, of, one) if isinstance(one, RelativePose) else one
                    for one in value
                )
            elif isinstance(value, PortModel):
                part = self.all_of(value)
                if part is not value:
                    found[name] = part
        return model.model_copy(update=found) if found else model

    def _resolved(self, port: str, of: PoseOf | None, wanted: RelativePose) -> PoseSpec:
        """Pose in the world; it has an orientation only if the relative pose has one."""
        if wanted.in_frame is not None:
            pose = self._frame(wanted.in_frame) @ wanted.local
        else:
            pose = self._next_to(of, wanted)
        x, y, z = pose.position.tolist()
        if max(abs(x), abs(y), abs(z)) > _FARTHEST_M:
            raise Failure("INVALID_TARGET", f"{port}: more than {_FARTHEST_M:g} m away")
        if not wanted.is_oriented:
            return PoseSpec(xyz=(x, y, z))
        a, b, c, d = pose.quaternion.tolist()
        return PoseSpec(xyz=(x, y, z), quat=(a, b, c, d))

    def _frame(self, name: str) -> Pose:
        """Frame of ``in_frame`` in the world."""
        arm = self._arm
        if name in FRAME_WORDS:
            return arm.commanded_tool_pose if name == "tool" else arm.kinematics.base
        if name not in arm.world.declared_arms:
            return self._object(name)
        if name not in arm.world.arms:
            raise Failure("UNKNOWN_POSE", f"arm {name!r} is not in the world now")
        return arm.world.arms[name].base

    def _next_to(self, of: PoseOf | None, wanted: RelativePose) -> Pose:
        """Pose above, on or beside an object."""
        name = wanted.reference
        object_pose = self._object(name)
        turn = Pose(np.zeros(3), wanted.local.quaternion)
        what, moved, current = self._moved(of)
        if what == "held" and wanted.on is not None and self._named(name)[0] in self._arm.held:
            reason = f"the arm holds {wanted.on!r} itself: it cannot put anything on it"
            raise Failure("INVALID_TARGET", reason)
        orientation = turn if wanted.is_oriented else current
        reference = self._body(name)
        along = wanted.direction
        middle = object_pose.position + _beside(along, object_pose.turn(_middle(reference)))
        distance = self._surface(object_pose, middle, wanted) + wanted.by
        if moved is not None:
            distance += moved.solid.reach(orientation.inverse.turn(-along))
        position = middle + distance * along + np.array(wanted.xyz)
        if moved is not None:
            position -= _beside(along, orientation.turn(_middle(moved)))
        if wanted.beside is not None and what != "tool" and moved is not None:
            # The two bottoms are at the same height.
            down = np.array((0.0, 0.0, -1.0))
            position[2] = object_pose.position[2] + wanted.xyz[2]
            position[2] += moved.solid.reach(orientation.inverse.turn(down))
            position[2] -= reference.solid.reach(object_pose.inverse.turn(down))
        return Pose(position, turn.quaternion)

    def _surface(self, object_pose: Pose, middle: Vector, wanted: RelativePose) -> float:
        """Distance of the object's surface from its origin, along the direction, m.

        In something hollow, an object stands on the inner floor, not at the height of the rim. On
        what is convex, it stands on the highest point, as it would be in it elsewhere.

        Args:
            object_pose: Pose of the object.
            middle: Point of the line along the direction on which it counts, of shape (3,), m.
            wanted: The relative pose.
        """
        body = self._body(wanted.reference)
        along = object_pose.inverse.turn(wanted.direction)
        if wanted.on is not None and len(body.parts) > 1:
            place = middle + np.array((*wanted.xyz[:2], 0.0))
            start = object_pose.inverse.apply(place + _FARTHEST_M * wanted.direction)
            length = body.ray(start, -along)
            if np.isfinite(length):
                return _FARTHEST_M - length
        return body.solid.reach(along)

    def _moved(self, of: PoseOf | None) -> tuple[str, ObjectBody | None, Pose]:
        """What has the pose, its shape if it counts, and its current orientation."""
        what: Literal["tool", "held", "object", "point"] = "point" if of is None else of.what
        name: str | None = getattr(self._ports, "object", None)
        held = self._arm.held
        released = self._arm.known.released
        if what == "held" and name is None and len(held) == 1:
            name = held[0]
        if what == "held" and not held and released is not None:  # to be placed all the same
            name = name or released.held.object
            if name == released.held.object:
                return what, self._body(name), released.pose
        declared = self._arm.world.declared_objects.get(name or "")
        if what in ("tool", "point") or name is None or declared is None:
            return what, None, Pose.identity()
        if what == "held" and name not in held:  # the skill refuses it
            return what, None, Pose.identity()
        if name in held:
            relative = self._arm.world.attachments.find(self._arm.name, name)
            assert relative is not None  # noqa: S101 - it is held
            tool_link = self._arm.commanded_tool_pose @ self._arm.robot.tool.inverse
            return what, self._body(name), tool_link @ relative.relative
        return what, self._body(name), declared.pose.pose

    def _object(self, name: str) -> Pose:
        """Pose of an object, or of a part of one, as the arm knows it."""
        owner, part = self._named(name)
        known = self._arm.known.pose(owner)
        self.names.add(owner)
        self.known.append(known)
        if part is None:
            return known.pose
        return known.pose @ self._arm.world.declared_objects[owner].parts[part].pose.pose

    def _body(self, name: str) -> ObjectBody:
        """Shape of an object, or of a part of one, in its own frame."""
        owner, part = self._named(name)
        obj = self._arm.world.declared_objects[owner]
        return body_of(obj) if part is None else body_of_part(obj.parts[part])

    def _named(self, name: str) -> tuple[str, str | None]:
        """Name of an object, and of its part that a name stands for."""
        world = self._arm.world
        owner, dot, part = name.partition(".")
        if not dot or name in world.declared_objects:
            return name, None
        return world.part_owner(owner, part), part


def _middle(body: ObjectBody) -> Vector:
    """Point of a body that is to be above or beside another one, in its frame, of shape (3,), m.

    Its origin, but the frame of a mesh, other than that of a compound, has not been chosen for it.
    """
    return body.middle if body.shape == "mesh" else np.zeros(3)


def _beside(along: Vector, vector: Vector) -> Vector:
    """The part of a vector across a unit vector, both of shape (3,)."""
    across: Vector = vector - (vector @ along) * along
    return across
