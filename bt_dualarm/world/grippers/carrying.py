"""What a gripper holds goes with it: integrated in the palm's frame, and not along straight lines.

MuJoCo lets no friction slip at the level of velocities, and moves a free body along its velocity
for a step. A palm that swings on an arm moves along an arc. Without this, what it holds would creep
outwards by half the step times the centripetal acceleration: 2 mm/s at 2 m/s² and 2 ms.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from types import ModuleType

import mujoco
import numpy as np

from bt_dualarm.world.grippers.gripper import FINGERS, PALM, Gripper
from bt_dualarm.world.grippers.mjspec import CUP, PAD


class Carrying:
    """One gripper of the plant; to be made anew after a recompilation.

    Args:
        model: The plant.
        data: Its state.
        arm: Name of the arm.
        gripper: Page of its gripper.
    """

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, arm: str, gripper: Gripper
    ) -> None:
        self._model, self._data = model, data
        bodies = FINGERS if gripper.fingers else (CUP, CUP)
        self._first, self._second = (model.geom(f"{arm}/{body}/{PAD}").id for body in bodies)
        self._palm = int(model.body(f"{arm}/{PALM}").id)
        self._bodies = model.geom_bodyid.copy()
        joints = model.body_jntadr
        free = (joints >= 0) & (model.jnt_type[joints] == mujoco.mjtJoint.mjJNT_FREE)
        self._addresses = np.where(free, model.jnt_qposadr[joints], -1).tolist()
        self._jacobian = np.zeros((6, model.nv))
        self._before = np.zeros((3, 7))
        self._step = float(model.opt.timestep)
        # Views: looking a field up costs more than what is done with it.
        self._places, self._turns = data.xpos, data.xquat
        self._positions, self._velocities = data.qpos, data.qvel
        self._parts = self._jacobian[:3], self._jacobian[3:]

    def look(self) -> int:
        """The body that it holds, -1 where there is none; where that and the palm are is kept.

        To be called of all grippers before any of them goes on: positions are then still those
        before the step.
        """
        data, palm, compiled = self._data, self._palm, kernels()
        if not data.ncon:
            return -1
        contact = data.contact
        body = int(
            compiled.gripped(contact.geom, contact.dist, self._first, self._second, self._bodies)
        )
        if body < 0 or self._addresses[body] < 0:
            return -1
        compiled.remember(self._places, self._turns, palm, body, self._before)
        mujoco.mj_jacBody(self._model, data, *self._parts, palm)
        return body

    def carry(self, body: int) -> None:
        """Correct where the body that it holds is, once positions are those after the step."""
        palm, before, compiled = self._palm, self._before, kernels()
        compiled.remember(self._places, self._turns, palm, palm, before[1:])
        start = self._addresses[body]
        pose = self._positions[start : start + 7]
        compiled.go_with(pose, before, self._jacobian, self._velocities, self._step)


def carry_all(model: mujoco.MjModel, data: mujoco.MjData, grippers: Sequence[Carrying]) -> None:
    """Correct what all grippers hold after the integration of a step.

    What two of them hold goes with the first.
    """
    held: dict[int, Carrying] = {}
    for gripper in grippers:
        body = gripper.look()
        if body >= 0:
            held.setdefault(body, gripper)
    if held:
        mujoco.mj_kinematics(model, data)
        for body, gripper in held.items():
            gripper.carry(body)


@cache
def kernels() -> ModuleType:
    """The kernels: an import statement costs as much as they do."""
    from bt_dualarm.world.grippers import grip_kernels

    return grip_kernels


def carry_something() -> None:
    """Have all kernels of what is held compiled."""
    one = np.zeros(1, np.int32)
    kernels().gripped(np.zeros((1, 2), np.int32), np.zeros(1), 0, 0, one)
    pose = np.array((0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0))
    before = np.zeros((3, 7))
    kernels().remember(np.zeros((1, 3)), np.zeros((1, 4)), 0, 0, before)
    kernels().remember(np.zeros((1, 3)), np.zeros((1, 4)), 0, 0, before[1:])
    kernels().go_with(pose, before, np.zeros((6, 1)), np.zeros(1), 0.002)
