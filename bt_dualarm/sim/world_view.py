"""Measurements of a world's true state, for setup, scoring and tests."""

from __future__ import annotations

import copy
from collections.abc import Mapping

import mujoco
import numpy as np

from bt_dualarm.core.errors import WorldError
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.grasping.grasp import Solid
from bt_dualarm.sim.arm_devices import ArmDevices
from bt_dualarm.sim.composition import ArmBody, Present
from bt_dualarm.sim.object_body import body_of, body_of_part
from bt_dualarm.spec.document import ObjectSpec
from bt_dualarm.spec.joints import Articulation

_MAX_DISTANCE_M = 1e3
"""Cutoff in m of distance queries, larger than any world."""


class WorldView:
    """Measurements of a world's true state, for setup, scoring and tests.

    Perception does not read them: it has only camera images.

    Attributes:
        model: Compiled model; a new object after every recompilation.
        data: State of the model; also replaced.
        devices: Hardware and nominal model of the arms.
        arms: Arms that are present, by name.
        objects: Objects that are present, by name.
        declared_objects: Every object of the file, present or not.
    """

    model: mujoco.MjModel
    data: mujoco.MjData
    devices: ArmDevices
    arms: Present[ArmBody]
    objects: Present[ObjectSpec]
    declared_objects: Mapping[str, ObjectSpec]

    @property
    def sensed(self) -> mujoco.MjData:
        """Estimated state of the world by the last sensor readings; see `ArmDevices.sensed`."""
        return self.devices.sensed

    @property
    def time(self) -> float:
        """Simulated time in seconds."""
        return float(self.data.time)

    @property
    def timestep(self) -> float:
        """Seconds of one physics step."""
        return float(self.model.opt.timestep)

    def state(self) -> Vector:
        """The complete state of the simulation (``mjSTATE_INTEGRATION``), of shape (n,)."""
        kind = mujoco.mjtState.mjSTATE_INTEGRATION
        state = np.empty(mujoco.mj_stateSize(self.model, kind))
        mujoco.mj_getState(self.model, self.data, state, kind)
        return state

    def with_contact_forces(self) -> mujoco.MjData:
        """Copy of the state in which the forces are those of its contacts.

        A step ends with new constraints, but with the solver's forces of those before. Where one
        comes or goes, such as the stop of an open finger, ``mj_contactForce`` then reads forces of
        other ones.
        """
        data = copy.copy(self.data)
        mujoco.mj_forward(self.model, data)
        return data

    def object_body(self, name: str) -> int:
        """Id of an object's body."""
        self.objects.require(name)
        return int(self.model.body(name).id)

    def object_geom(self, name: str) -> int:
        """Id of an object's geom; of the first one if it has several parts."""
        self.objects.require(name)
        return int(self.model.geom(name).id)

    def object_geoms(self, name: str) -> tuple[int, ...]:
        """Ids of the geoms of an object's convex parts, in the order of `ObjectBody.parts`."""
        first = self.object_geom(name)
        return tuple(range(first, first + len(body_of(self.objects[name]).parts)))

    def object_solid(self, name: str) -> Solid:
        """Shape of a present object in its own frame."""
        self.objects.require(name)
        return body_of(self.objects[name]).solid

    def object_middle(self, name: str) -> Vector:
        """True position of the center of an object's shape in the world, of shape (3,), m."""
        return self.object_pose(name).apply(body_of(self.objects[name]).middle)

    def joint_of(self, name: str) -> Articulation | None:
        """Joint on which a present object moves; None for one that is free or fixed."""
        self.objects.require(name)
        return self.objects[name].joint

    def part_owner(self, name: str, part: str | None) -> str:
        """Name of the object that has a part of a declared one: its own, or that of a joint."""
        declared = self.declared_objects.get(name)
        if part is None or declared is None or part in declared.parts:
            return name
        for other, obj in self.declared_objects.items():
            if obj.joint is not None and obj.joint.owner == name and part in obj.parts:
                return other
        return name

    def fixed_reason(self, name: str) -> str:
        """Why no arm can carry a fixed object, and which of its parts move on joints."""
        moved = [
            part
            for obj in self.declared_objects.values()
            if obj.joint is not None and obj.joint.owner == name
            for part in obj.parts
        ]
        may = f"; `part` may name one that moves: {', '.join(moved)}" if moved else ""
        return f"object {name!r} is fixed: no arm can carry it{may}"

    def joint_position(self, name: str) -> float:
        """True position in rad or m of the joint on which an object moves.

        Raises:
            WorldError: The object is not present, or moves on no joint.
        """
        return float(self.data.qpos[self._joint_address(name)])

    def joint_reading(self, name: str) -> float | None:
        """Position in rad or m by the sensor of the joint on which an object moves.

        None without a sensor. The sensor is part of the fixture, and has no errors.

        Raises:
            WorldError: The object is not present, or moves on no joint.
        """
        address = self._joint_address(name)
        hung = self.objects[name].joint
        if hung is None or not hung.spec.sensor:
            return None
        return float(self.data.qpos[address])

    def _joint_address(self, name: str) -> int:
        if self.joint_of(name) is None:
            raise WorldError(f"object {name!r} moves on no joint")
        return int(self.model.jnt_qposadr[self.model.body_jntadr[self.object_body(name)]])

    def pose_address(self, name: str) -> int:
        """Address in ``qpos`` of a free object's pose, of seven numbers."""
        joint = self.model.body_jntadr[self.object_body(name)]
        return int(self.model.jnt_qposadr[joint])

    def object_pose(self, name: str) -> Pose:
        """An object's true pose in the world.

        Raises:
            WorldError: The object is not present.
        """
        body = self.object_body(name)
        return Pose(self.data.xpos[body].copy(), self.data.xquat[body].copy())

    def surface_point(
        self, name: str, direction: Vector, pose: Pose | None = None, part: str | None = None
    ) -> Vector:
        """Point at which a ray from an object's center of mass leaves it, (3,), in the world, m.

        Args:
            name: Name of the object.
            direction: Direction of the ray in the world, of unit length.
            pose: Estimated pose of the object; its true one by default.
            part: Part of a compound that stands for the whole object.
        """
        pose = self.object_pose(name) if pose is None else pose
        obj = self.objects[name]
        if part is not None and part in obj.parts:
            pose = pose @ obj.parts[part].pose.pose
            alone = body_of_part(obj.parts[part])
            away = alone.way_out(direction @ pose.rotation_matrix)
            on_part: Vector = pose.apply(alone.center) + away * direction
            return on_part
        body = body_of(obj)
        if not body.is_simple:
            along = direction @ pose.rotation_matrix
            out: Vector = pose.apply(body.center) + body.way_out(along) * direction
            return out
        ray = np.abs(direction @ pose.rotation_matrix) + 1e-12
        if obj.shape == "box":
            reach = float((0.5 * np.asarray(obj.size) / ray).min())
        elif obj.shape == "cylinder":
            radius, length = obj.size
            reach = min(radius / float(np.hypot(ray[0], ray[1])), 0.5 * length / float(ray[2]))
        elif obj.shape == "capsule":
            reach = _ray_out_of_capsule(obj.size[0], obj.size[1], ray)
        else:
            reach = obj.size[0]
        point: Vector = pose.position + reach * direction
        return point

    def edge_point(
        self, name: str, direction: Vector, pose: Pose | None = None, part: str | None = None
    ) -> Vector | None:
        """Point on the nearest edge of something open in a direction, (3,), in the world, m.

        None if the surface is above its center of mass. Arguments as those of `surface_point`.
        """
        obj = self.objects[name]
        pose = self.object_pose(name) if pose is None else pose
        body = body_of(obj)
        if part is not None and part in obj.parts:
            pose = pose @ obj.parts[part].pose.pose
            body = body_of_part(obj.parts[part])
        if body.is_simple:
            return None
        edge = body.edge(direction @ pose.rotation_matrix)
        return None if edge is None else pose.apply(edge)

    def object_velocity(self, name: str) -> Vector:
        """Angular (rad/s) then linear (m/s) velocity at an object's center, of shape (6,)."""
        velocity = np.empty(6)
        kind = mujoco.mjtObj.mjOBJ_BODY
        mujoco.mj_objectVelocity(self.model, self.data, kind, self.object_body(name), velocity, 0)
        return velocity

    def tool_gap(self, arm: str, obj: str) -> float:
        """Smallest distance in meters between an arm's tool and an object; negative inside it."""
        self.arms.require(arm)
        return min(
            float(mujoco.mj_geomDistance(self.model, self.data, tool, geom, _MAX_DISTANCE_M, None))
            for geom in self.object_geoms(obj)
            for tool in self.arms[arm].tool_geom_ids
        )

    def touches(self, arm: str, obj: str) -> bool:
        """Whether an arm's tool and an object are in contact."""
        geoms = self.object_geoms(obj)
        tool = self.arms[arm].tool_geom_ids
        contact = self.data.contact
        return any(
            (geom1 in geoms and geom2 in tool) or (geom2 in geoms and geom1 in tool)
            for geom1, geom2 in contact.geom[contact.dist <= 0.0]
        )


def _ray_out_of_capsule(radius: float, length: float, ray: Vector) -> float:
    """Distance in m at which a ray, of shape (3,), all positive, leaves a capsule's center."""
    across = float(np.hypot(ray[0], ray[1]))
    along = float(ray[2])
    half = 0.5 * length
    to_wall = radius / across
    if to_wall * along <= half:
        return to_wall
    # Beyond the wall the ray leaves through the cap, a sphere about (0, 0, half).
    return half * along + float(np.sqrt(radius**2 - (half * across) ** 2))
