"""What a gripper holds goes with it: integrated in the palm's frame, and not along straight lines.

MuJoCo lets no friction slip at the level of velocities, and moves a free body along its velocity
for a step. A palm that swings on an arm moves along an arc. Without this, what it holds would creep
outwards by half the step times the centripetal acceleration: 2 mm/s at 2 m/s² and 2 ms.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from types import ModuleType

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.pose import Matrix
from bt_dualarm.world.grippers.gripper import FINGERS, PALM, Gripper
from bt_dualarm.world.grippers.kernel_columns import (
    AXIS,
    BEGIN,
    END,
    FIRST,
    HOLDERS,
    LINK,
    PLACE,
    ROOT,
    SECOND,
    TURN,
    ZERO,
)
from bt_dualarm.world.grippers.kernel_columns import PALM as PALM_BODY
from bt_dualarm.world.grippers.mjspec import CUP, PAD


class Carrying:
    """All grippers of the plant; to be made anew after a recompilation.

    Args:
        model: The plant.
        data: Its state.
        grippers: Pages of the grippers, by arm.
    """

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, grippers: Mapping[str, Gripper]
    ) -> None:
        self._data, self._step = data, float(model.opt.timestep)
        self._bodies = model.geom_bodyid.copy()
        joints = model.body_jntadr
        free = (joints >= 0) & (model.jnt_type[joints] == mujoco.mjtJoint.mjJNT_FREE)
        self._addresses = np.where(free, model.jnt_qposadr[joints], -1).astype(np.int64)
        self._holders = np.zeros((len(grippers), HOLDERS), np.int64)
        self._held, links = np.zeros(len(grippers), np.int64), list[int]()
        for row, (arm, gripper) in zip(self._holders, grippers.items(), strict=True):
            bodies = FINGERS if gripper.fingers else (CUP, CUP)
            row[FIRST], row[SECOND] = (model.geom(f"{arm}/{one}/{PAD}").id for one in bodies)
            row[PALM_BODY] = palm = int(model.body(f"{arm}/{PALM}").id)
            row[ROOT], row[BEGIN] = model.body_rootid[palm], len(links)
            links += way_to(model, palm)
            row[END] = len(links)
        self._links, self._joints = links_of(model, links)
        # Views: looking a field up costs more than what is done with it.
        self._state = data.qpos, data.qvel, data.xpos, data.xquat, data.cdof, data.subtree_com

    def act(self) -> None:
        """Correct where all that they hold is, after the integration of a step.

        All but positions and velocities are still those before the step.
        """
        if not self._data.ncon:
            return
        contact, compiled, held = self._data.contact, kernels(), self._held
        if compiled.held_by(
            contact.geom, contact.dist, self._holders, self._bodies, self._addresses, held
        ):
            chains = self._holders, self._links, self._joints, self._addresses
            compiled.carry(held, *chains, *self._state, self._step)


def way_to(model: mujoco.MjModel, body: int) -> list[int]:
    """Bodies from the ground to one of them."""
    way = []
    while body:
        way.append(body)
        body = int(model.body_parentid[body])
    return way[::-1]


def links_of(model: mujoco.MjModel, bodies: Sequence[int]) -> tuple[Matrix, npt.NDArray[np.int64]]:
    """How bodies hang on one another, see `kernel_columns`; and addresses of their joints."""
    links, joints = np.zeros((len(bodies), LINK)), np.full((len(bodies), 2), -1)
    for row, addresses, body in zip(links, joints, bodies, strict=True):
        row[PLACE:TURN], row[TURN:AXIS] = model.body_pos[body], model.body_quat[body]
        joint = int(model.body_jntadr[body])
        if joint < 0:
            continue
        if model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_HINGE or model.jnt_pos[joint].any():
            raise AssertionError("an arm's joints turn about their own origins")
        addresses[:] = model.jnt_qposadr[joint], model.jnt_dofadr[joint]
        row[AXIS:ZERO], row[ZERO] = model.jnt_axis[joint], model.qpos0[addresses[0]]
    return links, joints


@cache
def kernels() -> ModuleType:
    """The kernels: an import statement costs as much as they do."""
    from bt_dualarm.world.grippers import grip_kernels

    return grip_kernels


def carry_something() -> None:
    """Have all kernels of what is held compiled."""
    bodies, one, pair = np.zeros(2, np.int32), np.zeros(1, np.int64), np.zeros((4, 2), np.int32)
    holders, links = np.zeros((1, HOLDERS), np.int64), np.zeros((1, LINK))
    # A single contact lies in one piece, several do not.
    for geoms, distances in ((pair[:1], np.zeros(1)), (pair[::2], np.zeros(4)[::2])):
        kernels().held_by(geoms, distances, holders, bodies, np.zeros(2, np.int64), one)
    joints, places, turns = np.full((1, 2), -1), np.zeros((1, 3)), np.ones((1, 4))
    state = np.ones(7), np.zeros(1), places, turns, np.zeros((1, 6)), places
    kernels().carry(one, holders, links, joints, one, *state, 0.002)
