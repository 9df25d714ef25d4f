"""How far an arm is from other arms, now or in configurations that they may come to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from bt_dualarm.motion.collision.scratch_model import Marks, ScratchModel
from bt_dualarm.pose import Vector
from bt_dualarm.world.names import name_of_geom
from bt_dualarm.world.world import World

HORIZON = 0.10
"""Farthest distance in metres that is measured unless asked for: beyond it, nothing is near."""

_LINKS, _HELD = 1, 2  # bits: what may not come near a link, and what may not come near a thing held


@dataclass(frozen=True)
class Gap:
    """The smallest distance found.

    Attributes:
        metres: Distance; infinite beyond the horizon.
        first: Name of the arm's body, or of what it holds.
        second: Name of the other arm's.
    """

    metres: float = float("inf")
    first: str = ""
    second: str = ""


class ArmDistance:
    """Distances of one arm, and what it holds, to the other arms and what they hold.

    Its tool may come near what another arm holds: that is how things are handed over.

    Args:
        world: World to look at when a distance is asked for; to be made anew after a
            recompilation.
        arm: Name of the arm.
    """

    def __init__(self, world: World, arm: str) -> None:
        self._world = world
        self._scratch = ScratchModel(world, world.arms)
        self._others = [name for name in world.arms if name != arm]
        own = list(world.arms[arm].geom_ids)
        asking, answering = np.zeros((2, world.model.ngeom), dtype=np.int32)
        asking[own] = _LINKS | _HELD
        asking[list(world.arms[arm].tool_geom_ids)] = _LINKS
        self._owner = np.full(world.model.ngeom, -1)  # index of the other arm, -1 for none
        for index, name in enumerate(self._others):
            geoms = list(world.arms[name].geom_ids)
            answering[geoms] = _LINKS
            self._owner[geoms] = index
        for held in world.attachments:
            geom = world.object_geom(held.object)
            if held.arm == arm:
                asking[geom] = _LINKS | _HELD
            else:
                answering[geom] = _HELD
                self._owner[geom] = self._others.index(held.arm)
        self._scratch.compare(asking, answering)
        self._horizons = dict.fromkeys(self._others, 0.0)

    @property
    def data(self) -> mujoco.MjData:
        """State of the world's model in which a gap was measured last."""
        return self._scratch.data

    def gap(self, configurations: Mapping[str, Vector], horizon: float = HORIZON) -> Gap:
        """The smallest distance to any other arm; arguments as in `gaps`."""
        gaps = self.gaps(configurations, dict.fromkeys(self._others, horizon))
        return min(gaps.values(), key=lambda gap: gap.metres, default=Gap())

    def gaps(
        self, configurations: Mapping[str, Vector], horizons: Mapping[str, float]
    ) -> dict[str, Gap]:
        """The smallest distance to each of some other arms.

        Args:
            configurations: Configurations by arm, of shape (dof,), rad; arms that are not named
                are where they are now.
            horizons: Farthest distance in metres that is measured, by other arm; farther ones cost
                more.
        """
        world, data = self._world, self.data
        self._look_as_far_as(horizons)
        data.qpos[:] = world.sensed.qpos
        for name, q in configurations.items():
            data.qpos[world.arms[name].qpos_ids] = q
        self._scratch.settle()
        if data.ncon == 0:
            return dict.fromkeys(horizons, Gap())
        owners = self._owner[data.contact.geom].max(axis=1)
        return {name: self._nearest(owners == self._others.index(name)) for name in horizons}

    def _nearest(self, contacts: Marks) -> Gap:
        """The smallest distance among some of the contacts that MuJoCo reports."""
        candidates = np.flatnonzero(contacts)
        if not len(candidates):
            return Gap()
        contact = self.data.contact
        nearest = int(candidates[contact.dist[candidates].argmin()])
        pair = sorted(contact.geom[nearest].tolist(), key=lambda geom: int(self._owner[geom]))
        first, second = (name_of_geom(self._scratch.model, geom) for geom in pair)
        return Gap(float(contact.dist[nearest]), first, second)

    def _look_as_far_as(self, horizons: Mapping[str, float]) -> None:
        for name, horizon in horizons.items():
            if horizon != self._horizons[name]:
                self._horizons[name] = horizon
                self._scratch.report_gaps(self._owner == self._others.index(name), horizon)
