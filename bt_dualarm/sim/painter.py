"""Images of a world for people: with shadows, from a good viewpoint, by ray casting.

They are rendered from copies of the state, so rendering does not change the world. Cameras in the
control loop have no shadows: these take time, and would need wider color ranges. Shadows are found
by shadow mapping (L. Williams, SIGGRAPH 1978): the scene is rendered from each lamp, which does not
see a shadowed surface. Percentage-closer filtering smooths them (Reeves, Salesin, Cook, SIGGRAPH
1987).
"""

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
from bt_dualarm.sim.frame import Exposure, Image, RenderableWorld, Viewpoint, fitted
from bt_dualarm.sim.kernel_arrays import Fan, Hits
from bt_dualarm.sim.renderers import RayRenderer, RayScene, Shading, fan_of

# Shadows


_MAP_PX: Final = 800
"""Rays across a lamp's view: 4 to 8 mm on a table below a lamp 3 m up."""

_MAX_LAMPS: Final = 2
"""Number of lamps that cast shadows, the brightest ones; the others light everything."""

_FAR_M: Final = 50.0
"""Distance of a directional light's viewpoint: its rays are nearly parallel."""

_WIDEST_DEG: Final = 150.0
_BIAS_M: Final = 2e-3  # against self-shadowing by the limited precision of the depths

_LOST_M: Final = 2.0
"""Distance from all arms beyond which objects are ignored: they would make the rest tiny."""

_CORNERS: Final = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)


def are_lost(points: Matrix, arms: Matrix) -> npt.NDArray[np.bool_]:
    """Which points of objects are so far from all arms that pictures ignore them, of shape (...).

    Args:
        points: Points in the world, of shape (..., 3), m; NaN is not lost.
        arms: Points of all arms, of shape (n, 3), m, with at least one that is not NaN.
    """
    low = np.nanmin(arms, axis=0) - _LOST_M
    high = np.nanmax(arms, axis=0) + _LOST_M
    lost: npt.NDArray[np.bool_] = ((points < low) | (points > high)).any(axis=-1)
    return lost


class ScenePainter:
    """Renders states of one model, with shadows.

    Args:
        model: Compiled model; it is not changed.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self.model = model
        self._shapes = RayScene(model, LOOP_GROUPS)
        self._shading = Shading(model)
        lights = self._shading.lights
        casters = [n for n, light in enumerate(lights.active) if model.light_castshadow[light]]
        casters.sort(key=lambda number: -float(lights.diffuse[number].sum()))
        self._lamps = casters[:_MAX_LAMPS]
        self._planes = model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
        drawn = np.isin(model.geom_group, LOOP_GROUPS) & ~self._planes
        self._casters = np.flatnonzero(drawn)
        groups = model.geom_group[self._casters]
        is_object = groups == OBJECT_GROUP
        self._of_arms = ~is_object & (groups != SCENE_GROUP)
        self._movable = is_object & (model.body_weldid[model.geom_bodyid[self._casters]] != 0)

    def trace(self, data: mujoco.MjData, fan: Fan) -> Hits:
        """Trace rays; returns what they hit."""
        return self._shapes.trace(data, fan)

    def draw(
        self, data: mujoco.MjData, viewpoint: Viewpoint, size: tuple[int, int], finer: int = 1
    ) -> Image:
        """Render an image of shape (height, width, 3).

        Args:
            data: State with up-to-date positions of geoms and lights.
            viewpoint: Viewpoint of the image.
            size: Width and height in pixels, multiples of ``finer``.
            finer: Edge in pixels of blocks that share one shadow value, for images that are
                averaged down by that factor afterwards.
        """
        fan = fan_of(viewpoint, *size)
        hits = self.trace(data, fan)
        image = self._shading.colors(data, fan, hits)
        if not self._lamps:
            return image
        seen = np.stack([self._visibility(data, fan, hits, lamp, finer) for lamp in self._lamps])
        seen = seen.repeat(finer, axis=1).repeat(finer, axis=2).reshape(len(self._lamps), -1)
        shaded = np.flatnonzero((seen < 1.0).any(axis=0))
        if len(shaded):
            # Only pixels in shadow, usually few, are shaded again.
            part = fan._replace(rays=fan.rays.reshape(3, 1, -1)[..., shaded])
            shaded_hits = Hits(
                hits.geoms.reshape(1, -1)[:, shaded],
                hits.distances.reshape(1, -1)[:, shaded],
                hits.normals.reshape(3, 1, -1)[..., shaded],
            )
            image.reshape(-1, 3)[shaded] = self._shadowed(data, part, shaded_hits, seen[:, shaded])
        return image

    def _shadowed(
        self, data: mujoco.MjData, fan: Fan, hits: Hits, seen: npt.NDArray[np.float32]
    ) -> Image:
        """Colors, of shape (n, 3), of n rays whose hits each lamp lights by a share, (lamps, n)."""
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
        """Colors of n rays, of shape (n, 3), without shadows, by given diffuse colors of lamps."""
        lights = self._shading.lights._replace(diffuse=diffuse)
        return self._shading.colors(data, fan, hits, lights)

    def _visibility(
        self, data: mujoco.MjData, fan: Fan, hits: Hits, lamp: int, finer: int
    ) -> npt.NDArray[np.float32]:
        """Fraction of a lamp's light at the hit of every ``finer``-th ray per row and column."""
        subset = (slice(None, None, finer), slice(None, None, finer))
        geoms = hits.geoms[subset]
        distances = hits.distances[subset].astype(np.float32).ravel()
        view = self._view_from(data, lamp)
        if view is None:
            return np.ones(geoms.shape, np.float32)
        depths = self._depths(data, view)
        texel = 2.0 * math.tan(math.radians(view.fov_deg) / 2.0) / _MAP_PX
        distances[geoms.ravel() < 0] = 0.0  # the sky, at infinity
        # From here on in the lamp's axes, of shape (3, rays).
        turn = (view.axes.T @ fan.axes).astype(np.float32)
        eye = (view.axes.T @ (fan.eye - view.eye)).astype(np.float32)
        rays = fan.rays[:, *subset].astype(np.float32).reshape(3, -1)
        normals = hits.normals[:, *subset].astype(np.float32).reshape(3, -1)
        points = turn @ rays
        points *= distances
        points += eye[:, None]
        # A surface must not shade itself: the point is moved off it by 1.5 texels of the depth map.
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
        """Viewpoint of a lamp that shows all shadow casters, if it can; None if there are none."""
        lights = self._shading.lights
        light = int(lights.active[lamp])
        boxes = self.model.geom_aabb[self._casters]
        local = boxes[:, None, :3] + _CORNERS * boxes[:, None, 3:]
        axes = data.geom_xmat[self._casters].reshape(-1, 3, 3)
        places = data.geom_xpos[self._casters][:, None]
        corners = np.einsum("gij,gcj->gci", axes, local) + places
        arms = corners[self._of_arms].reshape(-1, 3)
        if len(arms):
            corners = corners[~(self._movable & are_lost(corners, arms).any(axis=1))]
        points = corners.reshape(-1, 3)
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
        if (inside[:, 2] < -1e-2).all():  # otherwise some casters are beside the lamp or above it
            slope = float(np.abs(inside[:, :2] / inside[:, 2:]).max()) * 1.02
            fov_deg = min(2.0 * math.degrees(math.atan(slope)), _WIDEST_DEG)
        return Viewpoint(eye, middle, fov_deg)

    def _depths(self, data: mujoco.MjData, view: Viewpoint) -> npt.NDArray[np.float32]:
        """Depth map of a lamp, m, of shape (px, px); inf where nothing casts a shadow."""
        hits = self.trace(data, _even(fan_of(view, _MAP_PX, _MAP_PX)))
        ground = self._planes[hits.geoms] | (hits.geoms < 0)
        return np.where(ground, np.inf, hits.distances).astype(np.float32)


def _even(fan: Fan) -> Fan:
    """The fan without jitter, each ray in the middle of its cell: shadows get smooth edges."""
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
    """Fraction of the four nearest texels that do not occlude a point, with bilinear weights."""
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


# Stills

_FOV_DEG: Final = 35.0
_RISE: Final = 0.55
"""Height of the viewpoint per meter of distance, as of people who stand in front of a cell."""

_AZIMUTHS_DEG: Final = tuple(range(30, 390, 45))
_SKETCH: Final = (120, 90)
"""Size in pixels of the images in which candidate viewpoints are compared."""


@dataclass(frozen=True, eq=False)
class StillRenderer:
    """Renderer of a world at one moment, independent of the world from then on.

    Attributes:
        model: Compiled model; it is not changed.
        qpos: Positions of all joints, a copy.
        time: Simulated time in seconds.
    """

    model: mujoco.MjModel
    qpos: Vector
    time: float

    @classmethod
    def of(cls, world: RenderableWorld) -> StillRenderer:
        """Copy the current state of a world."""
        return cls(world.model, world.data.qpos.copy(), float(world.data.time))

    @property
    def is_sound(self) -> bool:
        """False after a divergence."""
        return bool(np.isfinite(self.qpos).all())

    def draw(self, viewpoint: Viewpoint, width: int, height: int) -> Image:
        """Render scene, arms and objects, of shape (height, width, 3)."""
        return self._painter.draw(self.data, viewpoint, (width, height))

    def through(self, camera: int, width: int, height: int) -> Image:
        """Render what a camera of the model sees, of shape (height, width, 3).

        The image is ideal: without shadows, noise, blur and distortion of the lens.
        """
        return RayRenderer().render(self.model, self.data, Exposure(camera, width, height))

    def subjects(self) -> Matrix:
        """Corners of the bounding boxes of all geoms of arms and objects, of shape (n, 3), m."""
        groups = self.model.geom_group
        arms = self.corners((groups != SCENE_GROUP) & (groups != OBJECT_GROUP))
        objects = self.corners(groups == OBJECT_GROUP)
        if len(arms):
            objects = objects[~are_lost(objects, arms)]
        return np.vstack((arms, objects))

    def clarity(self, viewpoint: Viewpoint) -> float:
        """Score of a viewpoint: sum over arms and objects of the logarithm of their visible pixels.

        By the logarithm a hidden object costs more than a large one gains.
        """
        geoms = self._painter.trace(self.data, fan_of(viewpoint, *_SKETCH)).geoms
        seen = geoms[geoms >= 0]
        seen = seen[self.model.geom_group[seen] != SCENE_GROUP]
        roots = self.model.body_rootid[self.model.geom_bodyid[seen]]
        return float(np.log1p(np.bincount(roots)).sum())

    @cached_property
    def data(self) -> mujoco.MjData:
        """State of the model with up-to-date kinematics."""
        data = mujoco.MjData(self.model)
        data.qpos[:] = self.qpos
        mujoco.mj_kinematics(self.model, data)
        mujoco.mj_camlight(self.model, data)
        return data

    def fixed_outlines(self) -> dict[str, list[Matrix]]:
        """Points whose convex hulls are the shapes that stand still, each of shape (n, 3), m.

        Keys are names of objects, of shapes of the scene, and of pedestals (``ARM/pedestal``);
        planes, which have no outline, are left out, as are markers and arms.
        """
        model = self.model
        found: dict[str, list[Matrix]] = {}
        for geom in np.flatnonzero(np.isin(model.geom_group, (SCENE_GROUP, OBJECT_GROUP))).tolist():
            body = int(model.geom_bodyid[geom])
            is_plane = model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE
            is_marker = not (model.geom_contype[geom] or model.geom_conaffinity[geom])
            if is_plane or is_marker or model.body_weldid[body]:
                continue
            name = str((model.body(body) if body else model.geom(geom)).name)
            axes = self.data.geom_xmat[geom].reshape(3, 3)
            points = _hull_points(model, geom) @ axes.T + self.data.geom_xpos[geom]
            found.setdefault(name, []).append(points)
        return found

    @cached_property
    def _painter(self) -> ScenePainter:
        return ScenePainter(self.model)

    def corners(self, which: npt.NDArray[np.bool_]) -> Matrix:
        """Corners of the bounding boxes of selected geoms, of shape (n, 3), m."""
        geoms = np.flatnonzero(which & np.isin(self.model.geom_group, LOOP_GROUPS))
        boxes = self.model.geom_aabb[geoms]
        local = boxes[:, None, :3] + _CORNERS * boxes[:, None, 3:]
        axes = self.data.geom_xmat[geoms].reshape(-1, 3, 3)
        places = self.data.geom_xpos[geoms][:, None]
        corners: Matrix = (np.einsum("gij,gcj->gci", axes, local) + places).reshape(-1, 3)
        return corners


_ROUND: Final = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
_RING: Final = np.column_stack([np.cos(_ROUND), np.sin(_ROUND)])
_BALL: Final = np.vstack(
    [np.column_stack([_RING * math.cos(up), np.full(len(_RING), math.sin(up))])
     for up in np.radians(np.arange(-90.0, 91.0, 7.5))]
)  # fmt: skip
"""Points on the unit sphere, of shape (n, 3)."""


def _hull_points(model: mujoco.MjModel, geom: int) -> Matrix:
    """Points in a geom's frame whose convex hull is its shape, of shape (n, 3), m."""
    kinds = mujoco.mjtGeom
    kind = int(model.geom_type[geom])  # NumPy's integers are in no tuple of MuJoCo's names
    size = model.geom_size[geom]
    if kind in (kinds.mjGEOM_SPHERE, kinds.mjGEOM_ELLIPSOID):
        round_size = size if kind == kinds.mjGEOM_ELLIPSOID else np.full(3, size[0])
        return np.asarray(_BALL * round_size)
    if kind == kinds.mjGEOM_CAPSULE:
        ends = np.sign(_BALL[:, 2:]) * np.array([0.0, 0.0, size[1]])
        return np.asarray(_BALL * size[0] + ends)
    if kind == kinds.mjGEOM_CYLINDER:
        ends = np.repeat([-size[1], size[1]], len(_RING))
        return np.column_stack([np.tile(_RING * size[0], (2, 1)), ends])
    if kind == kinds.mjGEOM_MESH:
        mesh = int(model.geom_dataid[geom])
        first = int(model.mesh_vertadr[mesh])
        vertices: Matrix = model.mesh_vert[first : first + int(model.mesh_vertnum[mesh])]
        return vertices.astype(float)
    box = model.geom_aabb[geom]
    return np.asarray(box[:3] + _CORNERS * box[3:])


def best_viewpoint(stills: Sequence[StillRenderer], aspect: float) -> Viewpoint | None:
    """The clearest viewpoint for all stills; None if they contain no arm or object.

    Args:
        stills: Moments of a world.
        aspect: Width of an image over its height.
    """
    points = np.vstack([np.zeros((0, 3)), *(still.subjects() for still in stills)])
    if not len(points):
        return None
    azimuths = (math.radians(azimuth) for azimuth in _AZIMUTHS_DEG)
    directions = (np.array((math.cos(turn), math.sin(turn), _RISE)) for turn in azimuths)
    candidates = [fitted(points, direction, _FOV_DEG, aspect) for direction in directions]
    return max(candidates, key=lambda one: sum(still.clarity(one) for still in stills))
