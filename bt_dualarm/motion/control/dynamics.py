"""The equations of motion of one arm and of what it holds, as one chain of rigid bodies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from bt_dualarm.pose import Pose, Vector
from bt_dualarm.spec.document import ObjectSpec
from bt_dualarm.world.robots.primitives import GEOM_TYPES, half_sizes
from bt_dualarm.world.robots.robot import Robot


@dataclass(frozen=True, eq=False)
class Load:
    """A thing that an arm holds.

    Attributes:
        thing: What the file declares of it: shape, size and mass.
        pose: Pose of its centre in the tool's link.
    """

    thing: ObjectSpec
    pose: Pose


class ArmDynamics:
    """Torques that an arm's joints need, by the masses that its URDF and the file declare.

    Args:
        robot: Arm of the catalogue.
        base: Pose of its base in the world.
        gravity: Acceleration of gravity in the world, of shape (3,), m/s².
        loads: Things that it holds, rigidly.
    """

    def __init__(
        self, robot: Robot, base: Pose, gravity: Vector, loads: Sequence[Load] = ()
    ) -> None:
        spec = mujoco.MjSpec.from_string(robot.urdf_text)
        spec.option.gravity = gravity @ base.rotation_matrix
        for load in loads:
            body = spec.body(robot.tool_link).add_body(
                pos=load.pose.position, quat=load.pose.quaternion
            )
            thing = load.thing
            size = half_sizes(thing.shape, thing.size)
            body.add_geom(type=GEOM_TYPES[thing.shape], size=size, mass=thing.mass)
        self._model = spec.compile()
        self._model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        self._model.dof_damping[:] = 0.0
        self._data = mujoco.MjData(self._model)
        joints = [self._model.joint(name) for name in robot.joints]
        self._q = np.array([int(joint.qposadr[0]) for joint in joints])
        self._v = np.array([int(joint.dofadr[0]) for joint in joints])

    def at_rest(self, q: Vector) -> Vector:
        """Torques, of shape (dof,), N m, that hold a configuration ``q``, of shape (dof,), rad."""
        nothing = np.zeros_like(q)
        return self.moving(q, nothing, nothing)

    def moving(self, q: Vector, v: Vector, a: Vector) -> Vector:
        """Torques, of shape (dof,), N m, of a motion: inverse dynamics (Newton and Euler).

        Args:
            q: Configuration, of shape (dof,), rad.
            v: Velocity, of shape (dof,), rad/s.
            a: Acceleration, of shape (dof,), rad/s².
        """
        model, data = self._model, self._data
        data.qpos[self._q], data.qvel[self._v], data.qacc[self._v] = q, v, a
        mujoco.mj_inverse(model, data)
        torques: Vector = data.qfrc_inverse[self._v]
        return torques
