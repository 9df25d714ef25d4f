"""Pictures of a world for people: from outside, after the fact, by rays alone.

They are drawn from copies, so that looking at a world changes nothing of it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final, Protocol

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.rendering.kernel_arrays import Fan, Hits
from bt_dualarm.world.rendering.painter import ScenePainter
from bt_dualarm.world.rendering.raycast import fan_of
from bt_dualarm.world.rendering.renderer import Image
from bt_dualarm.world.rendering.viewpoint import Viewpoint, fitted
from bt_dualarm.world.robots.geom_groups import LOOP_GROUPS, OBJECT_GROUP, SCENE_GROUP

_FOV_DEG: Final = 35.0
_RISE: Final = 0.55
"""How far up the eye is for each metre that it is away, as people stand before a cell."""

_AZIMUTHS_DEG: Final = tuple(range(30, 390, 45))
_SKETCH: Final = (120, 90)
"""Pixels that tell well enough who hides whom."""

_LOST_M: Final = 2.0
"""What is farther away from all arms is left out: it would make everything else tiny."""

_CORNERS: Final = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)


class PicturedWorld(Protocol):
    """What is read of the world."""

    model: mujoco.MjModel
    data: mujoco.MjData


@dataclass(frozen=True, eq=False)
class Still:
    """A world at one moment.

    Attributes:
        model: Compiled; nothing of it is changed.
        qpos: Positions of all joints, a copy.
        time: Simulated time in seconds.
    """

    model: mujoco.MjModel
    qpos: Vector
    time: float

    @classmethod
    def of(cls, world: PicturedWorld) -> Still:
        """The world as it is now."""
        return cls(world.model, world.data.qpos.copy(), float(world.data.time))

    @property
    def is_sound(self) -> bool:
        """False after a divergence."""
        return bool(np.isfinite(self.qpos).all())

    def draw(self, viewpoint: Viewpoint, width: int, height: int) -> Image:
        """A picture of scene, arms and objects, of shape (height, width, 3)."""
        return self._painter.draw(self.data, viewpoint, (width, height))

    def subjects(self) -> Matrix:
        """Corners of the boxes around all shapes of arms and objects, of shape (n, 3)."""
        groups = self.model.geom_group
        arms = self.corners((groups != SCENE_GROUP) & (groups != OBJECT_GROUP))
        objects = self.corners(groups == OBJECT_GROUP)
        if len(arms):
            low, high = arms.min(axis=0) - _LOST_M, arms.max(axis=0) + _LOST_M
            objects = objects[((objects > low) & (objects < high)).all(axis=1)]
        return np.vstack((arms, objects))

    def clarity(self, viewpoint: Viewpoint) -> float:
        """How well all arms and objects are seen: a hidden one costs more than a big one gains."""
        geoms = self._trace(fan_of(viewpoint, *_SKETCH)).geoms
        seen = geoms[geoms >= 0]
        seen = seen[self.model.geom_group[seen] != SCENE_GROUP]
        roots = self.model.body_rootid[self.model.geom_bodyid[seen]]
        return float(np.log1p(np.bincount(roots)).sum())

    @cached_property
    def data(self) -> mujoco.MjData:
        """Where everything is."""
        data = mujoco.MjData(self.model)
        data.qpos[:] = self.qpos
        mujoco.mj_kinematics(self.model, data)
        mujoco.mj_camlight(self.model, data)
        return data

    def _trace(self, fan: Fan) -> Hits:
        return self._painter.trace(self.data, fan)

    @cached_property
    def _painter(self) -> ScenePainter:
        """What draws it: read from the model once for all viewpoints."""
        return ScenePainter(self.model)

    def corners(self, which: npt.NDArray[np.bool_]) -> Matrix:
        """Corners of the boxes around some shapes, of shape (n, 3), m."""
        geoms = np.flatnonzero(which & np.isin(self.model.geom_group, LOOP_GROUPS))
        boxes = self.model.geom_aabb[geoms]
        local = boxes[:, None, :3] + _CORNERS * boxes[:, None, 3:]
        axes = self.data.geom_xmat[geoms].reshape(-1, 3, 3)
        places = self.data.geom_xpos[geoms][:, None]
        corners: Matrix = (np.einsum("gij,gcj->gci", axes, local) + places).reshape(-1, 3)
        return corners


def best_viewpoint(stills: Sequence[Still], aspect: float) -> Viewpoint | None:
    """Viewpoint that shows arms and objects of all the stills best; None if there are none.

    Args:
        stills: Moments of a world, each to be seen whole.
        aspect: Width of a picture by its height.
    """
    points = np.vstack([np.zeros((0, 3)), *(still.subjects() for still in stills)])
    if not len(points):
        return None
    azimuths = (math.radians(azimuth) for azimuth in _AZIMUTHS_DEG)
    directions = (np.array((math.cos(turn), math.sin(turn), _RISE)) for turn in azimuths)
    candidates = [fitted(points, direction, _FOV_DEG, aspect) for direction in directions]
    return max(candidates, key=lambda one: sum(still.clarity(one) for still in stills))
