"""What can be measured in a world: where its objects are, how they move, what touches what."""

from __future__ import annotations

import mujoco
import numpy as np

from bt_dualarm.pose import Pose, Vector
from bt_dualarm.spec.document import ObjectSpec
from bt_dualarm.world.arm_body import ArmBody
from bt_dualarm.world.equipment import Equipment
from bt_dualarm.world.names import must_be_among

_FARTHEST = 1e3
"""Metres to which a distance is measured: larger than any world that can be reached across."""


class WorldView:
    """The measurable side of a world; what a camera is meant to see is not taken from here.

    Attributes:
        model: Compiled model; a new object after every change of the world's parts.
        data: State of the model; likewise.
        equipment: All that arms are controlled through: sensors and drives, and what is believed of
            them.
        arms: Arms that are present, by name.
        objects: Objects that are present, by name.
    """

    model: mujoco.MjModel
    data: mujoco.MjData
    equipment: Equipment
    arms: dict[str, ArmBody]
    objects: dict[str, ObjectSpec]

    @property
    def sensed(self) -> mujoco.MjData:
        """Positions by the sensors, and where all bodies are by them; see `Equipment.sensed`."""
        return self.equipment.sensed

    @property
    def time(self) -> float:
        """Simulated time in seconds."""
        return float(self.data.time)

    @property
    def timestep(self) -> float:
        """Seconds of one physics step."""
        return float(self.model.opt.timestep)

    def state(self) -> Vector:
        """Everything the simulation goes on from (``mjSTATE_INTEGRATION``), of shape (n,)."""
        kind = mujoco.mjtState.mjSTATE_INTEGRATION
        state = np.empty(mujoco.mj_stateSize(self.model, kind))
        mujoco.mj_getState(self.model, self.data, state, kind)
        return state

    def object_body(self, name: str) -> int:
        """Id of an object's body."""
        must_be_among(name, self.objects, "object", "in the world")
        return int(self.model.body(name).id)

    def object_geom(self, name: str) -> int:
        """Id of an object's shape."""
        must_be_among(name, self.objects, "object", "in the world")
        return int(self.model.geom(name).id)

    def pose_address(self, name: str) -> int:
        """Where the seven numbers of a free object's pose begin in ``qpos``."""
        joint = self.model.body_jntadr[self.object_body(name)]
        return int(self.model.jnt_qposadr[joint])

    def object_pose(self, name: str) -> Pose:
        """An object's true pose in the world.

        Raises:
            WorldError: The object is not present.
        """
        body = self.object_body(name)
        return Pose(self.data.xpos[body].copy(), self.data.xquat[body].copy())

    def surface_point(self, name: str, direction: Vector, pose: Pose | None = None) -> Vector:
        """Where a ray from an object's centre leaves it, of shape (3,), in the world.

        Args:
            name: Name of the object.
            direction: Direction of the ray in the world, of unit length.
            pose: Pose that it is believed to have; its true one by default.
        """
        pose = self.object_pose(name) if pose is None else pose
        ray = np.abs(direction @ pose.rotation_matrix) + 1e-12
        thing = self.objects[name]
        if thing.shape == "box":
            reach = float((0.5 * np.asarray(thing.size) / ray).min())
        elif thing.shape == "cylinder":
            radius, length = thing.size
            reach = min(radius / float(np.hypot(ray[0], ray[1])), 0.5 * length / float(ray[2]))
        elif thing.shape == "capsule":
            reach = _out_of_capsule(thing.size[0], thing.size[1], ray)
        else:
            reach = thing.size[0]
        point: Vector = pose.position + reach * direction
        return point

    def object_velocity(self, name: str) -> Vector:
        """Angular (rad/s) then linear (m/s) velocity at an object's centre, of shape (6,)."""
        velocity = np.empty(6)
        kind = mujoco.mjtObj.mjOBJ_BODY
        mujoco.mj_objectVelocity(self.model, self.data, kind, self.object_body(name), velocity, 0)
        return velocity

    def tool_gap(self, arm: str, thing: str) -> float:
        """Smallest distance in metres between an arm's tool and an object; negative inside it."""
        must_be_among(arm, self.arms, "arm", "in the world")
        geom = self.object_geom(thing)
        return min(
            float(mujoco.mj_geomDistance(self.model, self.data, tool, geom, _FARTHEST, None))
            for tool in self.arms[arm].tool_geom_ids
        )

    def touches(self, arm: str, thing: str) -> bool:
        """Whether an arm's tool and an object touch now."""
        geom = self.object_geom(thing)
        tool = self.arms[arm].tool_geom_ids
        contact = self.data.contact
        return any(
            (geom1 == geom and geom2 in tool) or (geom2 == geom and geom1 in tool)
            for geom1, geom2 in contact.geom[contact.dist <= 0.0]
        )


def _out_of_capsule(radius: float, length: float, ray: Vector) -> float:
    """Metres from a capsule's centre along a ray, of shape (3,), all of it positive."""
    across, along, half = float(np.hypot(ray[0], ray[1])), float(ray[2]), 0.5 * length
    aside = radius / across
    if aside * along <= half:
        return aside
    return half * along + float(np.sqrt(radius**2 - (half * across) ** 2))
