"""Where the arms of a file lie in a compiled model: joints, motors, tool, camera."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.pose import Vector
from bt_dualarm.world.composition import CAMERA
from bt_dualarm.world.robots.mjspec import TOOL_SITE, joint_motors

Ids = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Places:
    """One arm that is in a model.

    Attributes:
        name: Name of the arm.
        qpos: Addresses of its joints' positions, base to tip, of shape (dof,).
        motors: Ids of its joints' motors, in the same order; a gripper's drive is none of them.
        tool: Id of the site at its tool.
        camera: Id of its camera, -1 without one.
    """

    name: str
    qpos: Ids
    motors: Ids
    tool: int
    camera: int

    def torque_share(self, model: mujoco.MjModel, torque: Vector) -> float:
        """Largest of some torques, of shape (dof,), N m, as a share of what that motor can give."""
        return float((np.abs(torque) / model.actuator_ctrlrange[self.motors, 1]).max())


def places_of(model: mujoco.MjModel, arms: Iterable[str]) -> dict[str, Places]:
    """Those of some arms that are in a model, by name."""
    return {places.name: places for arm in arms for places in _places(model, arm)}


def _places(model: mujoco.MjModel, arm: str) -> Iterator[Places]:
    tool = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, f"{arm}/{TOOL_SITE}")
    if tool < 0:
        return
    motors = joint_motors(model, arm)
    joints = model.actuator_trnid[motors, 0]
    camera = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, f"{arm}/{CAMERA}")
    yield Places(arm, model.jnt_qposadr[joints].astype(np.int64), motors, tool, camera)
