"""Does an arm, its tool or what it holds touch anything else?"""

from __future__ import annotations

import numpy as np

from bt_dualarm.world.names import name_of_geom
from bt_dualarm.world.world import World


class OutsideContacts:
    """Contacts of an arm and of what it holds with all else; made anew after a recompilation.

    It tells that something is touched, as a switch does, not how hard.

    Args:
        world: World that the arm is in.
        arm: Name of the arm.
    """

    def __init__(self, world: World, arm: str) -> None:
        self._world, self._arm = world, arm
        self._mine = np.zeros(world.model.ngeom, dtype=bool)
        self._mine[list(world.arms[arm].geom_ids)] = True
        for thing in world.attachments.attached_to(arm):
            self._mine[world.object_geom(thing)] = True

    def deepest(self) -> tuple[str, str] | None:
        """Names of what touches and of what it touches; None where nothing does."""
        data = self._world.data
        if not data.ncon:
            return None
        geoms, depths = data.contact.geom, -data.contact.dist
        mine = self._mine[geoms]
        outside = np.flatnonzero((mine[:, 0] != mine[:, 1]) & (depths > 0.0))
        for i in outside[np.argsort(-depths[outside])].tolist():
            pair = sorted(geoms[i].tolist(), key=lambda geom: not self._mine[geom])
            first, second = (name_of_geom(self._world.model, geom) for geom in pair)
            if second.partition("/")[0] != self._arm:  # its pedestal bears its name
                return first, second
        return None
