"""Images of a world for people: shadows, viewpoints, and renders after the fact."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.robots.mjspec import LOOP_GROUPS, OBJECT_GROUP, SCENE_GROUP
from bt_dualarm.sim.ray_kernel_arrays import Fan, Hits
from bt_dualarm.sim.ray_renderer import RayScene, Shading, fan_of
from bt_dualarm.sim.renderer import Image, RenderableWorld, Viewpoint, fitted

# Images for people, with shadows.
#
# Cameras in the loop have no shadows: they take time, and color ranges would have to be wider.
# Shadows are found by a second rendering of the scene from the lamp, in which a shadowed surface is
# hidden ("shadow mapping", L. Williams, SIGGRAPH 1978), smoothed by percentage-closer filtering
# (Reeves, Salesin, Cook, SIGGRAPH 1987).


_MAP_PX: Final = 800
"""Rays across a lamp's view: 4 to 8 mm on a table below a lamp 3 m up."""

_MOST_LAMPS: Final = 2
"""Lamps that cast shadows: the brightest; others light everything."""

_FAR_M: Final = 50.0
"""Distance from which a light without a place looks at the scene: its rays are nearly parallel."""

_WIDEST_DEG: Final = 150.0
_BIAS_M: Final = 2e-3

_CORNERS: Final = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)


class ScenePainter:
    """Draws states of one model.

    Args:
        model: Compiled; nothing of it is changed.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self.model = model
        self._shapes = RayScene(model, LOOP_GROUPS)
        self._shading = Shading(model)
        lights = self._shading.lights
        casting = [n for n, light in enumerate(lights.active) if model.light_castshadow[light]]
        casting.sort(key=lambda number: -float(lights.diffuse[number].sum()))
        self._lamps = casting[:_MOST_LAMPS]
        self._planes = model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
        drawn = np.isin(model.geom_group, LOOP_GROUPS) & ~self._planes
        self._casters = np.flatnonzero(drawn)

    def trace(self, data: mujoco.MjData, fan: Fan) -> Hits:
        """What rays meet."""
        return self._shapes.trace(data, fan)

    def draw(
        self, data: mujoco.MjData, viewpoint: Viewpoint, size: tuple[int, int], finer: int = 1
    ) -> Image:
        """An image of shape (height, width, 3).

        Args:
            data: State with positions of geoms and lights that are up to date.
            viewpoint: Where it is seen from.
            size: Width and height in pixels.
            finer: Pixels along each direction that get one share of shadow, where they are to be
                averaged anyway; both sizes are multiples of it.
        """
        fan = fan_of(viewpoint, *size)
        hits = self.trace(data, fan)
        picture = self._shading.colors(data, fan, hits)
        if not self._lamps:
            return picture
        seen = np.stack([self._visibility(data, fan, hits, lamp, finer) for lamp in self._lamps])
        seen = seen.repeat(finer, axis=1).repeat(finer, axis=2).reshape(len(self._lamps), -1)
        shaded = np.flatnonzero((seen < 1.0).any(axis=0))
        if len(shaded):
            # Little of an image is in shadow: that alone is colored again.
            part = fan._replace(rays=fan.rays.reshape(3, 1, -1)[..., shaded])
            met = Hits(
                hits.geoms.reshape(1, -1)[:, shaded],
                hits.distances.reshape(1, -1)[:, shaded],
                hits.normals.reshape(3, 1, -1)[..., shaded],
            )
            picture.reshape(-1, 3)[shaded] = self._shadowed(data, part, met, seen[:, shaded])
        return picture

    def _shadowed(
        self, data: mujoco.MjData, fan: Fan, hits: Hits, seen: npt.NDArray[np.float32]
    ) -> Image:
        """Colors of n rays of which each lamp lights a share, of shape (lamps, n): (n, 3)."""
        lights = self._shading.lights
        dark = lights.diffuse.copy()
        dark[self._lamps] = 0.0
        base = self._colors(data, fan, hits, dark)[0].astype(np.float32)
        mixed = base.copy()
        for lamp, share in zip(self._lamps, seen, strict=True):
            lit = dark.copy()
            lit[lamp] = lights.diffuse[lamp]
            mixed += share[:, None] * (self._colors(data, fan, hits, lit)[0] - base)
        image: Image = np.clip(mixed + 0.5, 0.0, 255.0).astype(np.uint8)
        return image

    def _colors(self, data: mujoco.MjData, fan: Fan, hits: Hits, diffuse: Matrix) -> Image:
        """Colors by lamps of these diffuse colors, of shape (n, 3), without shadows."""
        from bt_dualarm.sim.ray_trace_kernels import shade

        pixels: Image = np.empty((*hits.geoms.shape, 3), dtype=np.uint8)
        lights = self._shading.lights._replace(diffuse=diffuse)
        shade(lights, data.light_xpos, data.light_xdir, fan, hits, pixels)
        return pixels

    def _visibility(
        self, data: mujoco.MjData, fan: Fan, hits: Hits, lamp: int, finer: int
    ) -> npt.NDArray[np.float32]:
        """Share of a lamp's light that reaches what rays met: every ``finer``-th, both ways."""
        some = (slice(None, None, finer), slice(None, None, finer))
        geoms = hits.geoms[some]
        distances = hits.distances[some].astype(np.float32).ravel()
        view = self._view_from(data, lamp)
        if view is None:
            return np.ones(geoms.shape, np.float32)
        depths = self._depths(data, view)
        texel = 2.0 * math.tan(math.radians(view.fov_deg) / 2.0) / _MAP_PX
        distances[geoms.ravel() < 0] = 0.0  # the sky is not asked
        # All in the lamp's axes, of shape (3, rays).
        turn = (view.axes.T @ fan.axes).astype(np.float32)
        eye = (view.axes.T @ (fan.eye - view.eye)).astype(np.float32)
        rays = fan.rays[:, *some].astype(np.float32).reshape(3, -1)
        normals = hits.normals[:, *some].astype(np.float32).reshape(3, -1)
        points = turn @ rays
        points *= distances
        points += eye[:, None]
        # A surface must not shade itself: compared is a point off it by some rays of the lamp.
        off = np.float32(1.5 * texel) * np.sqrt(np.einsum("ij,ij->j", points, points))
        points += (view.axes.T.astype(np.float32) @ normals) * off
        away = np.sqrt(np.einsum("ij,ij->j", points, points)) - np.float32(_BIAS_M)
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = np.float32(-1.0 / texel) / points[2]
            across = points[0] * scale + np.float32(_MAP_PX / 2 - 0.5)
            down = -points[1] * scale + np.float32(_MAP_PX / 2 - 0.5)
        across[points[2] >= 0.0] = -1.0  # behind the lamp
        return _filtered(depths, across, down, away).reshape(geoms.shape)

    def _view_from(self, data: mujoco.MjData, lamp: int) -> Viewpoint | None:
        """The view of what can cast a shadow, as far as a view can be wide; None without any."""
        lights = self._shading.lights
        light = int(lights.active[lamp])
        boxes = self.model.geom_aabb[self._casters]
        local = boxes[:, None, :3] + _CORNERS * boxes[:, None, 3:]
        axes = data.geom_xmat[self._casters].reshape(-1, 3, 3)
        places = data.geom_xpos[self._casters][:, None]
        points = (np.einsum("gij,gcj->gci", axes, local) + places).reshape(-1, 3)
        if not len(points):
            return None
        middle: Vector = (points.min(axis=0) + points.max(axis=0)) / 2
        eye = data.light_xpos[light].copy()
        if lights.distant[lamp]:
            eye = middle - _FAR_M * data.light_xdir[light]
        if np.linalg.norm((middle - eye)[:2]) < 1e-6:
            middle[0] += 1e-3  # a viewpoint cannot look straight down
        inside = (points - eye) @ Viewpoint(eye, middle, 90.0).axes
        fov_deg = _WIDEST_DEG
        if (inside[:, 2] < -1e-2).all():  # else some stand beside the lamp, or above it
            slope = float(np.abs(inside[:, :2] / inside[:, 2:]).max()) * 1.02
            fov_deg = min(2.0 * math.degrees(math.atan(slope)), _WIDEST_DEG)
        return Viewpoint(eye, middle, fov_deg)

    def _depths(self, data: mujoco.MjData, view: Viewpoint) -> npt.NDArray[np.float32]:
        """How far a lamp sees, m, inf where nothing casts a shadow, of shape (px, px)."""
        hits = self.trace(data, _even(fan_of(view, _MAP_PX, _MAP_PX)))
        ground = self._planes[hits.geoms] | (hits.geoms < 0)
        return np.where(ground, np.inf, hits.distances).astype(np.float32)


def _even(fan: Fan) -> Fan:
    """The fan with each ray in the middle of its cell: edges of shadows are not jittered."""
    rows, columns = fan.rays.shape[1:]
    y, x = np.indices((rows, columns)) + 0.5
    x = fan.spacing * (x - fan.center[0])
    y = fan.spacing * (fan.center[1] - y)
    rays = np.stack((x, y, np.full_like(x, -1.0))) / np.sqrt(x * x + y * y + 1.0)
    return fan._replace(rays=rays)


def _filtered(
    depths: npt.NDArray[np.float32],
    across: npt.NDArray[np.float32],
    down: npt.NDArray[np.float32],
    away: npt.NDArray[np.float32],
) -> npt.NDArray[np.float32]:
    """Share of four neighbors in a lamp's view that do not hide a point, weighted by nearness."""
    edge = _MAP_PX - 1
    share = np.ones(len(away), np.float32)
    inside = np.flatnonzero((across >= 0) & (down >= 0) & (across < edge) & (down < edge))
    across = across[inside]
    down = down[inside]
    away = away[inside]
    column = across.astype(np.int32)
    row = down.astype(np.int32)
    right = across - column
    low = down - row
    first = row * _MAP_PX + column
    flat = depths.ravel()
    found = np.zeros(len(away), np.float32)
    for step, weight in (
        (0, (1 - low) * (1 - right)),
        (1, (1 - low) * right),
        (_MAP_PX, low * (1 - right)),
        (_MAP_PX + 1, low * right),
    ):
        found += weight * (flat[first + step] >= away)
    share[inside] = found
    return share


# Images of a world from outside, by ray casting alone.
#
# They are rendered from copies of the state, so that rendering changes nothing in the world.


_FOV_DEG: Final = 35.0
_RISE: Final = 0.55
"""How far up the eye is for each meter that it is away, as people stand before a cell."""

_AZIMUTHS_DEG: Final = tuple(range(30, 390, 45))
_SKETCH: Final = (120, 90)
"""Pixels that tell well enough who hides whom."""

_LOST_M: Final = 2.0
"""What is farther away from all arms is left out: it would make everything else tiny."""

_BOX_CORNERS: Final = np.array(
    [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float
)


@dataclass(frozen=True, eq=False)
class StillRenderer:
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
    def of(cls, world: RenderableWorld) -> StillRenderer:
        """The world as it is now."""
        return cls(world.model, world.data.qpos.copy(), float(world.data.time))

    @property
    def is_sound(self) -> bool:
        """False after a divergence."""
        return bool(np.isfinite(self.qpos).all())

    def draw(self, viewpoint: Viewpoint, width: int, height: int) -> Image:
        """An image of scene, arms and objects, of shape (height, width, 3)."""
        return self._painter.draw(self.data, viewpoint, (width, height))

    def subjects(self) -> Matrix:
        """Corners of the boxes around all shapes of arms and objects, of shape (n, 3)."""
        groups = self.model.geom_group
        arms = self.corners((groups != SCENE_GROUP) & (groups != OBJECT_GROUP))
        objects = self.corners(groups == OBJECT_GROUP)
        if len(arms):
            low = arms.min(axis=0) - _LOST_M
            high = arms.max(axis=0) + _LOST_M
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
        local = boxes[:, None, :3] + _BOX_CORNERS * boxes[:, None, 3:]
        axes = self.data.geom_xmat[geoms].reshape(-1, 3, 3)
        places = self.data.geom_xpos[geoms][:, None]
        corners: Matrix = (np.einsum("gij,gcj->gci", axes, local) + places).reshape(-1, 3)
        return corners


def best_viewpoint(stills: Sequence[StillRenderer], aspect: float) -> Viewpoint | None:
    """Viewpoint that shows arms and objects of all the stills best; None if there are none.

    Args:
        stills: Moments of a world, each to be seen whole.
        aspect: Width of an image by its height.
    """
    points = np.vstack([np.zeros((0, 3)), *(still.subjects() for still in stills)])
    if not len(points):
        return None
    azimuths = (math.radians(azimuth) for azimuth in _AZIMUTHS_DEG)
    directions = (np.array((math.cos(turn), math.sin(turn), _RISE)) for turn in azimuths)
    candidates = [fitted(points, direction, _FOV_DEG, aspect) for direction in directions]
    return max(candidates, key=lambda one: sum(still.clarity(one) for still in stills))
