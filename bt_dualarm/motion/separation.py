"""How far an arm is from other arms, now or in configurations that they may come to."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from bt_dualarm.pose import Pose, Vector
from bt_dualarm.world.world import World

HORIZON = 0.10
"""Farthest distance in metres that is measured unless asked for: beyond it, nothing is near."""

_LINKS, _HELD = 1, 2  # bits: what may not come near a link, and what may not come near a thing held


@dataclass(frozen=True)
class Gap:
    """The smallest distance found.

    Attributes:
        metres: Infinite beyond the horizon.
        first: Name of the arm's body, or of what it holds.
        second: Name of the other arm's.
    """

    metres: float = float("inf")
    first: str = ""
    second: str = ""


class Separation:
    """Distances of one arm, and what it holds, to the other arms and what they hold.

    Its tool may come near what another arm holds: that is how things are handed over.

    Args:
        world: Looked at when a distance is asked for; to be made anew after a recompilation.
        arm: Name of the arm.

    Attributes:
        data: State of the world's model in which the gap was measured last.
    """

    def __init__(self, world: World, arm: str) -> None:
        self._world, self._arm = world, arm
        self._model = copy.copy(world.model)
        self.data = mujoco.MjData(self._model)
        self._carried = [
            (held.arm, held.relative, self._address(held.object)) for held in world.attachments
        ]
        self._mark_pairs()

    @property
    def alone(self) -> bool:
        """Whether there is no other arm."""
        return len(self._world.arms) < 2

    def gap(self, configurations: Mapping[str, Vector], horizon: float = HORIZON) -> Gap:
        """The smallest distance with arms, by name, in configurations of shape (dof,) each.

        Args:
            configurations: Arms that are not named are where they are now.
            horizon: Farthest distance in metres that is measured; farther ones cost more.
        """
        world, data = self._world, self.data
        self._look_as_far_as(horizon)
        data.qpos[:] = world.data.qpos
        for name, q in configurations.items():
            data.qpos[world.arms[name].qpos_ids] = q
        mujoco.mj_kinematics(self._model, data)
        if self._carried:
            self._carry()
            mujoco.mj_kinematics(self._model, data)
        mujoco.mj_collision(self._model, data)
        if data.ncon == 0:
            return Gap()
        distances = data.contact.dist
        nearest = int(np.argmin(distances))
        first, second = data.contact.geom[nearest].tolist()
        if not self._model.geom_contype[first]:
            first, second = second, first
        return Gap(float(distances[nearest]), self._name(first), self._name(second))

    def _mark_pairs(self) -> None:
        """Let MuJoCo look only at this arm against others, and report gaps."""
        model, world = self._model, self._world
        model.geom_contype[:] = model.geom_conaffinity[:] = 0
        for name, body in world.arms.items():
            geoms = list(body.geom_ids)
            if name == self._arm:
                model.geom_contype[geoms] = _LINKS | _HELD
                model.geom_contype[list(body.tool_geom_ids)] = _LINKS
            else:
                model.geom_conaffinity[geoms] = _LINKS
        for held in world.attachments:
            geom = world.object_geom(held.object)
            if held.arm == self._arm:
                model.geom_contype[geom] = _LINKS | _HELD
            else:
                model.geom_conaffinity[geom] = _HELD
        self._others = np.flatnonzero(model.geom_conaffinity)
        self._horizon = 0.0

    def _look_as_far_as(self, horizon: float) -> None:
        if horizon != self._horizon:
            model, self._horizon = self._model, horizon
            model.geom_margin[self._others] = horizon
            model.body_margin[np.unique(model.geom_bodyid[self._others])] = horizon

    def _carry(self) -> None:
        """Put what arms hold where their tool links now are."""
        data = self.data
        for arm, relative, address in self._carried:
            link = self._world.arms[arm].tool_body
            pose = Pose(data.xpos[link].copy(), data.xquat[link].copy()) @ relative
            data.qpos[address : address + 3] = pose.position
            data.qpos[address + 3 : address + 7] = pose.quaternion

    def _address(self, thing: str) -> int:
        joint = self._world.model.body_jntadr[self._world.object_body(thing)]
        return int(self._world.model.jnt_qposadr[joint])

    def _name(self, geom: int) -> str:
        body: Any = self._model.body(self._model.geom_bodyid[geom])
        return str(body.name)
