"""One MuJoCo world with arms and objects that come and go while it runs."""

from __future__ import annotations

import difflib
import logging
from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np

from bt_dualarm.errors import DivergenceError, WorldError
from bt_dualarm.pose import Pose, Vector
from bt_dualarm.spec.document import ArmSpec, ObjectSpec, TreeFile
from bt_dualarm.world import composition
from bt_dualarm.world.arm_body import ArmBody
from bt_dualarm.world.attachments import Attachment, Attachments
from bt_dualarm.world.catalogue import Robot, load_robot

_log = logging.getLogger(__name__)

_ABSURD_SPEED = 1e4  # rad/s or m/s: nothing on a table moves like this
_SUPPORT_GAP = 0.02  # m: a base this close above a surface stands on it


class World:
    """The composed world: ``model`` and ``data`` change identity when ``generation`` grows.

    Args:
        file: Declares scene, objects and arms.
        seed: Moves objects by their noise.
        visuals: Load the full visual meshes, for pictures.

    Raises:
        CatalogueError: A robot or scene is unknown or broken.
        WorldError: The parts do not compile to one world.
    """

    def __init__(self, file: TreeFile, seed: int = 0, *, visuals: bool = False) -> None:
        mujoco.set_mju_user_warning(_log.warning)  # else it writes a file where the user stands
        self._file = file
        self._visuals = visuals
        self._poses = {
            name: composition.noisy_pose(name, thing, seed) for name, thing in file.objects.items()
        }
        self.robots: dict[str, Robot] = {
            name: load_robot(arm.robot, file.root) for name, arm in file.arms.items()
        }
        self.arms: dict[str, ArmBody] = {}
        self.objects: dict[str, ObjectSpec] = {}
        self.generation = 0
        self._spec = composition.scene_spec(file.world, file.root)
        self.attachments = Attachments(self._spec, self._recompile)
        self._compile_first()

    @property
    def time(self) -> float:
        """Simulated time in seconds."""
        return float(self.data.time)

    @property
    def timestep(self) -> float:
        """Seconds of one physics step."""
        return float(self.model.opt.timestep)

    @property
    def declared_arms(self) -> Mapping[str, ArmSpec]:
        """Every arm of the file, present or not."""
        return self._file.arms

    def step(self) -> None:
        """Advance by one physics step; positions, contacts and inertias are then those of now.

        ``mj_step`` would leave them as they were before the step, 2 ms old: its two halves are
        called in the other order.

        Raises:
            DivergenceError: The state is no longer finite, or time did not advance.
        """
        before = self.data.time
        mujoco.mj_step2(self.model, self.data)
        mujoco.mj_step1(self.model, self.data)
        if not (np.abs(self.data.qvel).max(initial=0.0) < _ABSURD_SPEED):
            raise DivergenceError(self._diagnosis("moves absurdly fast or is not a number"))
        if self.data.time <= before:
            raise DivergenceError(f"simulated time went from {before} s back to {self.data.time} s")

    def spawn_arm(self, name: str) -> None:
        """Add a declared arm in its initial posture.

        Raises:
            WorldError: Not declared, or present already.
        """
        self._must_be_declared(name, self._file.arms, "arm")
        if name in self.arms:
            raise WorldError(f"arm {name!r} is present already")
        self._add_arm(name)
        self._recompile()
        self._take_posture(name)
        mujoco.mj_step1(self.model, self.data)

    def remove_arm(self, name: str) -> None:
        """Take an arm away; what it held falls.

        Raises:
            WorldError: The arm is not present.
        """
        self._must_be_present(name, self.arms, "arm")
        self.attachments.forget(name)
        composition.remove_arm(self._spec, name, self.robots[name])
        del self.arms[name]
        self._recompile()

    def spawn_object(self, name: str, pose: Pose | None = None) -> None:
        """Add a declared object at rest, at its declared pose or at ``pose``.

        Raises:
            WorldError: Not declared, or present already.
        """
        self._must_be_declared(name, self._file.objects, "object")
        if name in self.objects:
            raise WorldError(f"object {name!r} is present already")
        thing = self._file.objects[name]
        composition.add_object(self._spec, name, thing, pose or self._poses[name])
        self.objects[name] = thing
        self._recompile()

    def remove_object(self, name: str) -> None:
        """Take an object away, out of any arm's hold.

        Raises:
            WorldError: The object is not present.
        """
        self._must_be_present(name, self.objects, "object")
        self.attachments.forget(name)
        self._spec.delete(self._spec.body(name))
        del self.objects[name]
        self._recompile()

    def attach(self, arm: str, thing: str) -> Attachment:
        """Weld an object to an arm's tool link with the relative pose of this moment.

        Raises:
            WorldError: Arm or object is not present.
        """
        self._must_be_present(arm, self.arms, "arm")
        self._must_be_present(thing, self.objects, "object")
        relative = self.arms[arm].tool_link_pose.inverse @ self.object_pose(thing)
        link = f"{arm}/{self.robots[arm].tool_link}"
        return self.attachments.attach(arm, link, thing, relative, self.time)

    def object_body(self, name: str) -> int:
        """Id of an object's body."""
        self._must_be_present(name, self.objects, "object")
        return int(self.model.body(name).id)

    def object_geom(self, name: str) -> int:
        """Id of an object's shape."""
        self._must_be_present(name, self.objects, "object")
        return int(self.model.geom(name).id)

    def object_pose(self, name: str) -> Pose:
        """An object's true pose in the world.

        Raises:
            WorldError: The object is not present.
        """
        body = self.object_body(name)
        return Pose(self.data.xpos[body].copy(), self.data.xquat[body].copy())

    def surface_point(self, name: str, direction: Vector) -> Vector:
        """Where a ray from an object's centre leaves it, of shape (3,), in the world.

        Args:
            name: Of the object.
            direction: Of the ray in the world, of unit length.
        """
        pose = self.object_pose(name)
        ray = np.abs(pose.rotation.inv().apply(direction)) + 1e-12
        thing = self.objects[name]
        if thing.shape == "box":
            reach = float((0.5 * np.asarray(thing.size) / ray).min())
        elif thing.shape == "cylinder":
            radius, length = thing.size
            reach = min(radius / float(np.hypot(ray[0], ray[1])), 0.5 * length / float(ray[2]))
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
        self._must_be_present(arm, self.arms, "arm")
        geom = self.object_geom(thing)
        return min(
            float(mujoco.mj_geomDistance(self.model, self.data, tool, geom, 1.0, None))
            for tool in self.arms[arm].tool_geom_ids
        )

    def touches(self, arm: str, thing: str) -> bool:
        """Whether an arm's tool and an object touch now."""
        geom = self.object_geom(thing)
        tool = self.arms[arm].tool_geom_ids
        return any(
            (geom1 == geom and geom2 in tool) or (geom2 == geom and geom1 in tool)
            for geom1, geom2 in self.data.contact.geom
        )

    def state(self) -> Vector:
        """Everything the simulation goes on from (``mjSTATE_INTEGRATION``), of shape (n,)."""
        kind = mujoco.mjtState.mjSTATE_INTEGRATION
        state = np.empty(mujoco.mj_stateSize(self.model, kind))
        mujoco.mj_getState(self.model, self.data, state, kind)
        return state

    def restore(self, state: Vector) -> None:
        """Go back to a state of the same generation, bit for bit."""
        mujoco.mj_setState(self.model, self.data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
        mujoco.mj_step1(self.model, self.data)

    def _compile_first(self) -> None:
        for name, thing in self._file.objects.items():
            if thing.spawned:
                composition.add_object(self._spec, name, thing, self._poses[name])
                self.objects[name] = thing
        self._compile()
        for name, arm in self._file.arms.items():
            if arm.spawned:
                self._add_arm(name)
        self._compile()
        self._bind()
        for name in self.arms:
            self._take_posture(name)
        mujoco.mj_step1(self.model, self.data)

    def _compile(self) -> None:
        try:
            self.model = self._spec.compile()
        except ValueError as error:
            raise WorldError(f"MuJoCo cannot compile the world: {error}") from error
        self.data = mujoco.MjData(self.model)
        mujoco.mj_step1(self.model, self.data)

    def _recompile(self) -> None:
        """Take up changes of the spec; the state of everything that stays is kept."""
        try:
            self.model, self.data = self._spec.recompile(self.model, self.data)
        except ValueError as error:
            raise WorldError(f"MuJoCo cannot recompile the world: {error}") from error
        self.generation += 1
        self._bind()
        mujoco.mj_step1(self.model, self.data)

    def _bind(self) -> None:
        self.arms = {
            name: ArmBody.find(
                name, self.robots[name], self._file.arms[name].base.pose, self.model, self.data
            )
            for name in self.arms
        }

    def _add_arm(self, name: str) -> None:
        arm = self._file.arms[name]
        robot = self.robots[name]
        floor = self._floor_below(arm.base.pose.position)
        composition.add_arm(self._spec, name, arm, robot, floor=floor, visuals=self._visuals)
        self.arms[name] = None  # type: ignore[assignment]  # bound when the model is compiled

    def _take_posture(self, name: str) -> None:
        """Put an arm that has just come into its initial posture: before its first step only."""
        posture = self.robots[name].postures.get(self._file.arms[name].posture)
        if posture is None:
            raise WorldError(
                f"arm {name!r}: robot {self.robots[name].name!r} has no posture "
                f"{self._file.arms[name].posture!r} (there are: "
                f"{', '.join(self.robots[name].postures)})"
            )
        self.data.qpos[self.arms[name].qpos_ids] = posture

    def _floor_below(self, base: Vector) -> float | None:
        """Height of what lies below a base, or None where the base stands on it."""
        groups = np.zeros(6, dtype=np.uint8)
        groups[composition.SCENE_GROUP] = 1
        geom = np.array([-1], dtype=np.int32)
        above = base + np.array([0.0, 0.0, 1e-3])
        distance = mujoco.mj_ray(
            self.model, self.data, above, np.array([0.0, 0, -1]), groups, 1, -1, geom
        )
        if distance < 0 or distance < _SUPPORT_GAP:
            return None
        return float(above[2] - distance)

    def _diagnosis(self, what: str) -> str:
        speeds = np.nan_to_num(np.abs(self.data.qvel), nan=np.inf)
        worst = int(np.argmax(speeds))
        joint = self.model.joint(self.model.dof_jntid[worst]).name
        return f"the simulation diverged at {self.data.time:.3f} s: joint {joint!r} {what}"

    @staticmethod
    def _must_be_declared(name: str, declared: Mapping[str, Any], kind: str) -> None:
        if name not in declared:
            raise WorldError(f"no {kind} {name!r} is declared{_nearest(name, declared)}")

    @staticmethod
    def _must_be_present(name: str, present: Mapping[str, Any], kind: str) -> None:
        if name not in present:
            raise WorldError(f"no {kind} {name!r} is in the world{_nearest(name, present)}")


def _nearest(name: str, among: Mapping[str, Any]) -> str:
    near = difflib.get_close_matches(name, among, n=1)
    return f"; the nearest is {near[0]!r}" if near else ""
