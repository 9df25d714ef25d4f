"""Does the lip of a suction cup lie on a thing all round? Only then there is a vacuum."""

from __future__ import annotations

from typing import Final

import mujoco
import numpy as np

from bt_dualarm.pose import Vector
from bt_dualarm.world.grippers.gripper import Cup

_PLACES: Final = 12
"""Places of the rim that are looked at."""

_INNER: Final = 0.97
"""Share of the radius at which they lie: a thing as wide as the cup is wide enough."""

_YIELDS: Final = 0.25
"""Share of a lip's depth by which it gives way, or reaches out: it follows a slant, and a curve."""


class Seal:
    """The lip of one cup of the plant; to be made anew after a recompilation.

    Args:
        model: The plant.
        data: Its state.
        lip: Shape of the lip: a cylinder whose rim is its end along z.
        cup: Sizes of the cup.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, lip: int, cup: Cup) -> None:
        self._model, self._data, self._lip, self._cup = model, data, lip, cup
        turn = 2.0 * np.pi * np.arange(_PLACES) / _PLACES
        radius, depth = _INNER * cup.radius, cup.depth
        # From the lip's far end, so that what has sunk in a little is met, too.
        self._starts = np.stack(
            (radius * np.cos(turn), radius * np.sin(turn), np.full(_PLACES, -0.5 * depth)), axis=1
        )

    @property
    def is_tight(self) -> bool:
        """Whether it lies on one thing with as much of its rim as it needs."""
        things = self._touched()
        return any(self._share_on(thing) >= self._cup.seal for thing in things)

    def _touched(self) -> set[int]:
        """Shapes that the lip touches."""
        if not self._data.ncon:
            return set()
        geoms = self._data.contact.geom
        mine = (geoms == self._lip).any(axis=1)
        return {int(geom) for pair in geoms[mine].tolist() for geom in pair if geom != self._lip}

    def _share_on(self, thing: int) -> float:
        """Share of the rim's places in whose front the thing's surface lies, near enough."""
        data, cup = self._data, self._cup
        turn = data.geom_xmat[self._lip].reshape(3, 3)
        ahead = turn[:, 2].copy()
        near = _YIELDS * cup.depth
        on = 0
        for start in data.geom_xpos[self._lip] + self._starts @ turn.T:
            away = self._way_to(thing, start, ahead)
            on += away >= 0.0 and abs(away - cup.depth) <= near
        return on / _PLACES

    def _way_to(self, thing: int, start: Vector, ahead: Vector) -> float:
        """Metres along a ray to the thing's surface; negative where it misses."""
        model, data = self._model, self._data
        kind = int(model.geom_type[thing])
        if kind == mujoco.mjtGeom.mjGEOM_MESH:
            return float(mujoco.mj_rayMesh(model, data, thing, start, ahead))
        place, turn = data.geom_xpos[thing], data.geom_xmat[thing]
        return float(mujoco.mju_rayGeom(place, turn, model.geom_size[thing], start, ahead, kind))
