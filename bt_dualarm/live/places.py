"""Where the arms of a file lie in a compiled model: joints, motors, tool, camera, gripper."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.pose import Vector
from bt_dualarm.world.composition import CAMERA
from bt_dualarm.world.grippers.gripper import FINGERS
from bt_dualarm.world.grippers.mjspec import CUP, PAD
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
        fingers: Addresses of its fingers' positions, of shape (2,), or (0,) without fingers.
        pads: Ids of the shapes that take hold of things: of two fingers, of a cup, or none.
    """

    name: str
    qpos: Ids
    motors: Ids
    tool: int
    camera: int
    fingers: Ids
    pads: tuple[int, ...]

    def torque_share(self, model: mujoco.MjModel, torque: Vector) -> float:
        """Largest of some torques, of shape (dof,), N m, as a share of what that motor can give."""
        return float((np.abs(torque) / model.actuator_ctrlrange[self.motors, 1]).max())

    def opening(self, qpos: Vector) -> float:
        """How far its fingers are open in m; NaN without fingers."""
        return float(qpos[self.fingers].sum()) if len(self.fingers) else np.nan

    def held(self, model: mujoco.MjModel, data: mujoco.MjData) -> list[str]:
        """Bodies that all of its pads touch, and those that are welded to it, sorted by name."""
        found: set[int] = set()
        if self.pads:
            pairs = data.contact.geom[data.contact.dist <= 0.0]
            both_ways = np.vstack((pairs, pairs[:, ::-1])).reshape(-1, 2)
            touched = [
                set(model.geom_bodyid[both_ways[both_ways[:, 0] == pad, 1]].tolist())
                for pad in self.pads
            ]
            found = set.intersection(*touched) - {0}
        for weld in np.flatnonzero((model.eq_type == mujoco.mjtEq.mjEQ_WELD) & data.eq_active):
            pair = (int(model.eq_obj1id[weld]), int(model.eq_obj2id[weld]))
            own = [model.body(body).name.startswith(f"{self.name}/") for body in pair]
            if own[0] != own[1]:
                found.add(pair[own.index(False)])
        return sorted(model.body(body).name for body in found)


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
    slides = _ids(model, mujoco.mjtObj.mjOBJ_JOINT, [f"{arm}/{finger}" for finger in FINGERS])
    holds = [f"{arm}/{body}/{PAD}" for body in (*FINGERS, CUP)]
    yield Places(
        arm,
        model.jnt_qposadr[joints].astype(np.int64),
        motors,
        tool,
        camera,
        model.jnt_qposadr[slides].astype(np.int64),
        tuple(_ids(model, mujoco.mjtObj.mjOBJ_GEOM, holds)),
    )


def _ids(model: mujoco.MjModel, kind: mujoco.mjtObj, names: Iterable[str]) -> list[int]:
    """Ids of those of some things that are in the model."""
    found = (mujoco.mj_name2id(model, kind, name) for name in names)
    return [number for number in found if number >= 0]
