"""Does a link of an arm touch what it should not?"""

from __future__ import annotations

import numpy as np

from bt_dualarm.errors import TouchFailure
from bt_dualarm.world.names import name_of_geom
from bt_dualarm.world.world import World

_DEPTH = 5e-4  # metres: less is a touch


class LinkContacts:
    """Contacts of an arm's links other than its tool; to be made anew after a recompilation.

    Args:
        world: World that the arm is in.
        arm: Name of the arm.
    """

    def __init__(self, world: World, arm: str) -> None:
        self._world = world
        body = world.arms[arm]
        self._mine = np.zeros(world.model.ngeom, dtype=bool)
        self._mine[list(body.geom_ids)] = True
        self._links = self._mine.copy()
        self._links[list(body.tool_geom_ids)] = False

    def unwanted(self) -> TouchFailure | None:
        """``IN_COLLISION`` if a link is in something that is not of this arm."""
        data = self._world.data
        if data.ncon == 0 or data.contact.dist.min() >= -_DEPTH:
            return None
        geoms = data.contact.geom
        links = self._links[geoms]
        hits = np.flatnonzero((links[:, 0] != links[:, 1]) & ~self._mine[geoms].all(axis=1))
        for i in hits.tolist():
            depth = -float(data.contact.dist[i])
            if depth > _DEPTH:
                return self._failure_of(geoms[i].tolist(), depth)
        return None

    def _failure_of(self, geoms: list[int], depth: float) -> TouchFailure:
        model = self._world.model
        pair = sorted(geoms, key=lambda geom: not self._links[geom])
        first, second = (name_of_geom(model, geom) for geom in pair)
        return TouchFailure(f"{first} touches {second}", first, second, depth_m=depth)
