"""How near an arm's links come to things that are not meant to be touched."""

from __future__ import annotations

import copy

import mujoco
import numpy as np

from bt_dualarm.world.world import World

NEAR_M = 0.02
"""Distance in metres below which an arm that comes nearer goes at half pace."""

_NEARER_M = 0.001  # than when the motion began: what turns beside its pedestal comes no nearer


class Surroundings:
    """Distances of an arm's links to the scene and to objects; made anew after a recompilation.

    Tool and held objects are left out: they are there to touch things. So are the other arms, from
    which `RightOfWay` keeps clear.

    Args:
        world: That the arm is in.
        arm: Its name.

    Attributes:
        nearest: The smallest distance when it was looked at last, infinite above ``NEAR_M``.
    """

    def __init__(self, world: World, arm: str) -> None:
        self.nearest = float("inf")
        self._world = world
        self._model = copy.copy(world.model)
        self._data = mujoco.MjData(self._model)
        self._begun: dict[tuple[int, int], float] = {}
        self._mark_pairs(arm)

    def begin(self) -> None:
        """Remember what is near at the beginning of a motion."""
        self._begun = self._gaps()

    @property
    def pace(self) -> tuple[float, str]:
        """That the arm should have, and why, if that is less than 1; looks at the world."""
        gaps = self._gaps()
        self.nearest = min(gaps.values(), default=float("inf"))
        for pair, gap in gaps.items():
            if gap < self._begun.get(pair, np.inf) - _NEARER_M:
                first, second = (self._name(geom) for geom in pair)
                return 0.5, f"{first} is {1e3 * max(gap, 0.0):.0f} mm from {second}"
        return 1.0, ""

    def _gaps(self) -> dict[tuple[int, int], float]:
        """Of the pairs of a link and another thing that are near, in metres."""
        data = self._data
        data.qpos[:] = self._world.data.qpos
        mujoco.mj_kinematics(self._model, data)
        mujoco.mj_collision(self._model, data)
        gaps: dict[tuple[int, int], float] = {}
        if data.ncon:
            for pair, gap in zip(data.contact.geom.tolist(), data.contact.dist, strict=True):
                key = (pair[0], pair[1])
                gaps[key] = min(gaps.get(key, np.inf), float(gap))
        return gaps

    def _mark_pairs(self, arm: str) -> None:
        """Let MuJoCo look only at this arm's links against what is of no arm."""
        world, model = self._world, self._model
        body = world.arms[arm]
        held = [world.object_geom(one.object) for one in world.attachments]
        arms = [geom for other in world.arms.values() for geom in other.geom_ids]
        solid = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
        model.geom_contype[:] = 0
        model.geom_contype[list(body.geom_ids - body.tool_geom_ids)] = 1
        solid[[*arms, *held]] = False
        model.geom_conaffinity[:] = solid
        model.geom_margin[:] = 0.0
        model.geom_margin[solid] = NEAR_M
        model.body_margin[np.unique(model.geom_bodyid[solid])] = NEAR_M

    def _name(self, geom: int) -> str:
        name = self._model.body(self._model.geom_bodyid[geom]).name
        if name in ("", "world"):
            name = self._model.geom(geom).name
        return str(name or "the scene")
