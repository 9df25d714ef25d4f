"""How near an arm's links come to things that are not meant to be touched."""

from __future__ import annotations

import mujoco
import numpy as np

from bt_dualarm.motion.collision.scratch_model import ScratchModel
from bt_dualarm.world.names import name_of_geom
from bt_dualarm.world.world import World

NEAR_M = 0.02
"""Distance in metres below which an arm that comes nearer goes at half speed."""

_NEARER_M = 0.001  # than when the motion began: what turns beside its pedestal comes no nearer


class Clearance:
    """Distances of an arm's links to the scene and to objects; made anew after a recompilation.

    Tool and held objects are left out: they are there to touch things. So are the other arms, from
    which `FailSafeCheck` keeps clear.

    Args:
        world: World that the arm is in.
        arm: Name of the arm.

    Attributes:
        nearest: Smallest distance in m when it was looked at last, infinite above ``NEAR_M``.
    """

    def __init__(self, world: World, arm: str) -> None:
        self.nearest = float("inf")
        self._world = world
        self._scratch = scratch = ScratchModel(world)
        self._begun: dict[tuple[int, int], float] = {}
        body = world.arms[arm]
        held = {world.object_geom(one.object) for one in world.attachments}
        of_arms = held.union(*(other.geom_ids for other in world.arms.values()))
        others = scratch.solid & ~scratch.marks(of_arms)
        scratch.compare(scratch.marks(body.geom_ids - body.tool_geom_ids), others)
        scratch.report_gaps(others, NEAR_M)

    def begin(self) -> None:
        """Remember what is near at the beginning of a motion."""
        self._begun = self._gaps()

    @property
    def time_scale(self) -> tuple[float, str]:
        """That the arm should have, and why, if that is less than 1; looks at the world."""
        gaps = self._gaps()
        self.nearest = min(gaps.values(), default=float("inf"))
        for pair, gap in gaps.items():
            if gap < self._begun.get(pair, np.inf) - _NEARER_M:
                first, second = (name_of_geom(self._scratch.model, geom) for geom in pair)
                return 0.5, f"{first} is {1e3 * max(gap, 0.0):.0f} mm from {second}"
        return 1.0, ""

    def _gaps(self) -> dict[tuple[int, int], float]:
        """Of the pairs of a link and another thing that are near, in metres."""
        data = self._world.sensed  # of which nobody else wants contacts, so that no copy is needed
        mujoco.mj_collision(self._scratch.model, data)
        gaps: dict[tuple[int, int], float] = {}
        if data.ncon:
            for pair, gap in zip(data.contact.geom.tolist(), data.contact.dist, strict=True):
                key = (pair[0], pair[1])
                gaps[key] = min(gaps.get(key, np.inf), float(gap))
        return gaps
