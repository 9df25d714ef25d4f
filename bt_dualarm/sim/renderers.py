"""The renderers: ray casting, the default, and OpenGL; and the choice between them.

The ray caster makes the same pixels on every machine, without a system library. One call of
``mj_multiRay`` for a whole image takes 0.3 to 3 µs per ray. Most geoms cover few pixels, so
compiled kernels intersect only these rays with planes, spheres, cylinders, capsules, boxes and
convex meshes; the other shapes are left to ``mj_multiRay``. Colors follow the diffuse part of
MuJoCo's lighting, so that one color range serves both renderers: base color, head light and lights,
without shadows and highlights. Textures of objects are drawn (`sim/skins.py`); others, which scenes
may have, are reduced to their mean color.

Images by OpenGL are equivalent for a color filter; nothing else in the package depends on the
choice.
"""

from __future__ import annotations

import copy
import ctypes
import importlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Final, NamedTuple, Protocol, get_args

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.core.errors import RendererError
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.robots.mjspec import LOOP_GROUPS
from bt_dualarm.sim.frame import Blocks, Exposure, Image, Renderer, RendererKind, Viewpoint
from bt_dualarm.sim.kernel_arrays import (
    CAPSULE,
    CYLINDER,
    HULL,
    PLANE,
    SPHERE,
    Fan,
    Hits,
    Lights,
    Numbers,
    Shapes,
)
from bt_dualarm.sim.skins import add_image, image_coordinates, skins_of, surface_of, user_data

# Shapes

_CONVEX_TOLERANCE = 1e-4  # tolerance for corners outside a face, as a fraction of the mesh's size
_Type = mujoco.mjtGeom

_ROUND: Final = {
    _Type.mjGEOM_SPHERE: SPHERE,
    _Type.mjGEOM_CYLINDER: CYLINDER,
    _Type.mjGEOM_CAPSULE: CAPSULE,
}


class RayHull(NamedTuple):
    """A convex polyhedron.

    Attributes:
        corners: Positions of the corners, of shape (c, 3), m.
        triangles: Corner indices of each triangle, counterclockwise from outside, (f, 3).
        normals: Outward unit normals of the triangles, of shape (f, 3).
        offsets: Distances of their planes from the origin along the normals, of shape (f,).
    """

    corners: Matrix
    triangles: Numbers
    normals: Matrix
    offsets: Vector


def shapes_of(model: mujoco.MjModel, geoms: Sequence[int]) -> tuple[Shapes, list[int]]:
    """Convert geoms to arrays; returns also the ids of those without a closed-form intersection."""
    hulls = {geom: _hull(model, geom) for geom in geoms}
    known = [geom for geom in geoms if hulls[geom] is not None or _kind(model, geom) != HULL]
    bodies = [hulls[geom] or _NO_HULL for geom in known]
    ends = np.cumsum([(0, 0), *((len(body.corners), len(body.triangles)) for body in bodies)], 0)
    shifted = [body.triangles + first for body, first in zip(bodies, ends[:-1, 0], strict=True)]
    sizes = model.geom_size[known].reshape(-1, 3).astype(float)
    kinds = np.array([_kind(model, geom) for geom in known], dtype=np.int64)
    is_infinite = (kinds == PLANE)[:, None] & (sizes <= 0.0)
    # A plane has no bounding sphere; MuJoCo gives it the radius 0.
    bounds = model.geom_rbound[known].astype(float)
    shapes = Shapes(
        geoms=np.array(known, dtype=np.int64),
        kinds=kinds,
        sizes=np.where(is_infinite, math.inf, sizes),
        radii=np.where(bounds > 0.0, bounds, math.inf),
        corners=np.vstack([_NO_HULL.corners, *(body.corners for body in bodies)]),
        triangles=np.vstack([_NO_HULL.triangles, *shifted]),
        normals=np.vstack([_NO_HULL.normals, *(body.normals for body in bodies)]),
        offsets=np.concatenate([_NO_HULL.offsets, *(body.offsets for body in bodies)]),
        mesh_ranges=np.column_stack((ends[:-1, 0], ends[1:, 0], ends[:-1, 1], ends[1:, 1])),
        owners=np.concatenate([np.repeat(known, np.diff(ends[:, 1])), known]).astype(np.int64),
    )
    return shapes, sorted(set(geoms) - set(known))


_NO_HULL: Final = RayHull(
    np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64), np.zeros((0, 3)), np.zeros(0)
)


def _kind(model: mujoco.MjModel, geom: int) -> int:
    """Kind of a geom; `HULL` for polyhedra, and for geoms without a closed form."""
    kind = int(model.geom_type[geom])
    return PLANE if kind == _Type.mjGEOM_PLANE else _ROUND.get(_Type(kind), HULL)


def _hull(model: mujoco.MjModel, geom: int) -> RayHull | None:
    """The geom as a convex polyhedron, None if it is not one."""
    kind = model.geom_type[geom]
    if kind == _Type.mjGEOM_BOX:
        return box(model.geom_size[geom].astype(float))
    if kind == _Type.mjGEOM_MESH:
        return _convex_mesh(model, int(model.geom_dataid[geom]))
    return None


def box(half: Vector) -> RayHull:
    """A box about the origin, with two triangles per side.

    Args:
        half: Half lengths along x, y and z, of shape (3,), m.
    """
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    # Sides +x, +y, +z, -x, -y, -z: corners counterclockwise from outside.
    sides = ((4, 6, 7, 5), (2, 3, 7, 6), (1, 5, 7, 3), (0, 1, 3, 2), (0, 4, 5, 1), (0, 2, 6, 4))
    triangles = [half_side for a, b, c, d in sides for half_side in ((a, b, c), (a, c, d))]
    normals = np.vstack([np.eye(3), -np.eye(3)]).repeat(2, axis=0)
    offsets = np.concatenate([half, half]).repeat(2)
    return RayHull(signs * half, np.array(triangles, dtype=np.int64), normals, offsets)


def _convex_mesh(model: mujoco.MjModel, mesh: int) -> RayHull | None:
    """A mesh as a convex polyhedron, None if it is concave."""
    start = model.mesh_vertadr[mesh]
    count = model.mesh_vertnum[mesh]
    vertices = model.mesh_vert[start : start + count].astype(float)
    first = model.mesh_faceadr[mesh]
    faces = model.mesh_facenum[mesh]
    triangles = model.mesh_face[first : first + faces].astype(np.int64)
    corners = vertices[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    is_regular = areas > areas.max() * _CONVEX_TOLERANCE**2
    normals = normals[is_regular] / areas[is_regular, None]
    offsets = np.einsum("ij,ij->i", normals, corners[is_regular].mean(axis=1))
    size = float(np.ptp(vertices, axis=0).max())
    if (normals @ vertices.T - offsets[:, None]).max() > _CONVEX_TOLERANCE * size:
        return None
    return RayHull(vertices, triangles[is_regular], normals, offsets)


# Colors


_DEFAULT_RGBA = (0.5, 0.5, 0.5, 1.0)


class Shading:
    """Colors and lights of one model.

    Args:
        model: Compiled model.

    Attributes:
        lights: Arrays for the kernels.
        skins: Textures of objects, None if there are none.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self.skins = skins_of(model)
        active = np.flatnonzero(model.light_active)
        head = model.vis.headlight
        ambient = np.array(head.ambient, dtype=float) * bool(head.active)
        self.lights = Lights(
            # The last row is the sky's: rays that hit nothing have the geom id -1.
            base=np.vstack([geom_colors(model), _sky_color(model)]),
            ambient=ambient + model.light_ambient[active].sum(axis=0),
            head=np.array(head.diffuse, dtype=float) * bool(head.active),
            active=active,
            distant=model.light_type[active] == mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
            diffuse=model.light_diffuse[active].astype(float),
        )

    def colors(
        self, data: mujoco.MjData, fan: Fan, hits: Hits, lights: Lights | None = None
    ) -> Image:
        """Colors of the hits of ``fan``, of shape (rows, columns, 3).

        Args:
            data: State with up-to-date positions of geoms and lights.
            fan: The rays.
            hits: Their hits.
            lights: Lights instead of those of the model.
        """
        from bt_dualarm.sim.ray_trace_kernels import shade, shade_textured

        pixels: Image = np.empty((*hits.geoms.shape, 3), dtype=np.uint8)
        lights = lights or self.lights
        if self.skins is None:
            shade(lights, data.light_xpos, data.light_xdir, fan, hits, pixels)
        else:
            shade_textured(
                lights, data.light_xpos, data.light_xdir, self.skins,
                data.geom_xpos, data.geom_xmat, fan, hits, pixels,
            )  # fmt: skip
        return pixels


def geom_colors(model: mujoco.MjModel) -> Matrix:
    """Color of each geom, of shape (ngeom, 3): its own, otherwise its material's."""
    colors: Matrix = model.geom_rgba[:, :3].astype(float)
    materials = model.geom_matid
    has_default = (model.geom_rgba == np.array(_DEFAULT_RGBA, dtype=np.float32)).all(axis=1)
    from_material = (materials >= 0) & has_default
    colors[from_material] = model.mat_rgba[materials[from_material], :3]
    role = mujoco.mjtTextureRole.mjTEXROLE_RGB
    for geom in np.flatnonzero(materials >= 0):
        texture = model.mat_texid[materials[geom], role]
        if texture >= 0:
            colors[geom] *= _mean_color(model, texture)
    return colors


def _sky_color(model: mujoco.MjModel) -> Vector:
    """Mean color of the sky box, of shape (3,); black, as in OpenGL, if there is none."""
    skies = np.flatnonzero(model.tex_type == mujoco.mjtTexture.mjTEXTURE_SKYBOX)
    return _mean_color(model, int(skies[0])) if len(skies) else np.zeros(3)


def _mean_color(model: mujoco.MjModel, texture: int) -> Vector:
    start = int(model.tex_adr[texture])
    channels = int(model.tex_nchannel[texture])
    count = int(model.tex_height[texture]) * int(model.tex_width[texture])
    texels = model.tex_data[start : start + count * channels].reshape(count, channels)
    mean: Vector = (
        np.resize(texels.mean(axis=0) / 255.0, 3)
        if channels < 3
        else (texels[:, :3].mean(axis=0) / 255.0)
    )
    return mean


# Rays


_NO_LIMIT_M = 1e10


class RayScene:
    """The visible geoms of a model, ready for ray casting.

    Args:
        model: Compiled model; its shapes are read once, poses come with the state.
        groups: Geom groups that are visible.
    """

    def __init__(self, model: mujoco.MjModel, groups: Sequence[int]) -> None:
        self.model = model
        visible = [g for g in range(model.ngeom) if _is_visible(model, g, groups)]
        self._shapes, others = shapes_of(model, visible)
        self._others = _model_with_only(model, others) if others else None

    def trace(self, data: mujoco.MjData, fan: Fan) -> Hits:
        """Find the first intersection of each ray."""
        from bt_dualarm.sim.ray_trace_kernels import describe, trace

        axes = data.geom_xmat
        hits = describe(self._shapes, axes, fan, trace(self._shapes, data.geom_xpos, axes, fan))
        if self._others is not None:
            _cast(self._others, data, fan, hits)
        return hits

    def colors(self, shading: Shading, data: mujoco.MjData, fan: Fan) -> Image:
        """Colors of the first intersections, of shape (rows, columns, 3).

        Args:
            shading: Colors and lights of the model.
            data: State with up-to-date positions of geoms and lights.
            fan: The rays.
        """
        if self._others is not None:
            return shading.colors(data, fan, self.trace(data, fan))
        from bt_dualarm.sim.ray_trace_kernels import draw, draw_textured

        pixels = np.empty((*fan.rays.shape[1:], 3), np.uint8)
        scene = self._shapes, data.geom_xpos, data.geom_xmat, fan, shading.lights
        lit = data.light_xpos, data.light_xdir
        if shading.skins is None:
            draw(*scene, *lit, pixels)
        else:
            draw_textured(*scene, *lit, shading.skins, pixels)
        return pixels


def _is_visible(model: mujoco.MjModel, geom: int, groups: Sequence[int]) -> bool:
    """Whether a geom is in a visible group and not fully transparent, as in ``mj_multiRay``."""
    material = model.geom_matid[geom]
    opaque = model.geom_rgba[geom, 3] > 0.0 or (material >= 0 and model.mat_rgba[material, 3] > 0.0)
    return bool(opaque and model.geom_group[geom] in groups)


def _model_with_only(model: mujoco.MjModel, geoms: Sequence[int]) -> mujoco.MjModel:
    """A copy of the model in which only these geoms are in group 0."""
    alone = copy.copy(model)
    alone.geom_group[:] = 1
    alone.geom_group[list(geoms)] = 0
    return alone


def _cast(model: mujoco.MjModel, data: mujoco.MjData, fan: Fan, hits: Hits) -> None:
    """Update the hits with the geoms in group 0 of ``model``, by ``mj_multiRay``."""
    rays = fan.axes @ fan.rays.reshape(3, -1)
    count = rays.shape[1]
    first_group = np.array([1, 0, 0, 0, 0, 0], dtype=np.uint8)
    geoms = np.empty(count, dtype=np.int32)
    distances = np.empty(count)
    normals = np.empty(3 * count)
    mujoco.mj_multiRay(
        model, data, fan.eye, np.ascontiguousarray(rays.T).ravel(), first_group, True, -1,
        geoms, distances, normals, count, _NO_LIMIT_M,
    )  # fmt: skip
    nearer = (geoms >= 0) & (distances < hits.distances.ravel())
    rows, columns = np.unravel_index(np.flatnonzero(nearer), hits.geoms.shape)
    hits.geoms[rows, columns] = geoms[nearer]
    hits.distances[rows, columns] = distances[nearer]
    hits.normals[:, rows, columns] = normals.reshape(-1, 3)[nearer].T


_JITTER_SEED = 7


class RayRenderer:
    """Renders with one ray per pixel or block of pixels, through a random but fixed point of it.

    The jitter makes centroids more precise: rays on a regular grid all cross a straight edge at the
    same moment, jittered ones one after the other (standard deviation 0.05 instead of 0.15 px).
    """

    name = "ray"

    def __init__(self) -> None:
        self._cached: _ModelCache | None = None

    def render(self, model: mujoco.MjModel, data: mujoco.MjData, exposure: Exposure) -> Image:
        """See `Renderer`."""
        return exposure.paint(lambda blocks: self._colors(model, data, exposure, blocks))

    def _colors(
        self, model: mujoco.MjModel, data: mujoco.MjData, exposure: Exposure, blocks: Blocks
    ) -> Image:
        """Colors of some blocks of the image, of shape (rows, columns, 3)."""
        if self._cached is None or self._cached.model is not model:
            self._cached = _ModelCache(model)
        scene = self._cached.scene(exposure.groups)
        fan = _fan(model, data, exposure, blocks)
        return scene.colors(self._cached.shading, data, fan)

    def close(self) -> None:
        """Release the last model."""
        self._cached = None


class _ModelCache:
    """Shading and scenes of one model, read once for all its images.

    Args:
        model: Compiled model.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self.model = model
        self.shading = Shading(model)
        self._scenes: dict[tuple[int, ...], RayScene] = {}

    def scene(self, groups: tuple[int, ...]) -> RayScene:
        """The scene with the geoms in these groups."""
        if groups not in self._scenes:
            self._scenes[groups] = RayScene(self.model, groups)
        return self._scenes[groups]


def warm_up_renderer() -> None:
    """Compile the kernels of the ray caster."""
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(size=(0.1, 0.1, 0.1))
    spec.worldbody.add_camera()
    model = spec.compile()
    RayRenderer().render(model, mujoco.MjData(model), Exposure(0, 2, 2))


def warm_up_textures() -> None:
    """Compile the kernels of the ray caster for textures."""
    spec = mujoco.MjSpec()
    add_image(spec, "white", np.full((1, 1, 3), 255, np.uint8))
    geom = spec.worldbody.add_geom(size=(0.1, 0.1, 0.1), material="white")
    geom.userdata = user_data(None, np.full(3, 0.2), Pose.identity())
    spec.worldbody.add_camera(pos=(0.0, 0.0, 1.0))
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_camlight(model, data)
    RayRenderer().render(model, data, Exposure(0, 2, 2))
    fan = fan_of(Viewpoint(np.array((0.0, 0.1, 1.0)), np.zeros(3), 45.0), 2, 2)
    Shading(model).colors(data, fan, RayScene(model, LOOP_GROUPS).trace(data, fan))


def fan_of(viewpoint: Viewpoint, width: int, height: int) -> Fan:
    """The rays of a whole image, one per pixel."""
    return Fan(
        eye=viewpoint.eye,
        axes=viewpoint.axes,
        rays=camera_rays(width, height, viewpoint.fov_deg, 1).copy(),
        spacing=2.0 * math.tan(math.radians(viewpoint.fov_deg) / 2.0) / height,
        center=(width / 2.0, height / 2.0),
    )


def _fan(model: mujoco.MjModel, data: mujoco.MjData, exposure: Exposure, blocks: Blocks) -> Fan:
    """The rays of some blocks of a camera's image."""
    camera_id = exposure.camera_id
    stride = exposure.stride
    width = exposure.width
    height = exposure.height
    rows, columns = blocks
    fovy_deg = float(model.cam_fovy[camera_id])
    return Fan(
        eye=data.cam_xpos[camera_id].copy(),
        axes=data.cam_xmat[camera_id].reshape(3, 3).copy(),
        rays=_rays_of(
            (width, height, fovy_deg, stride), rows.start, rows.stop, columns.start, columns.stop
        ),
        spacing=stride * 2.0 * math.tan(math.radians(fovy_deg) / 2.0) / height,
        center=(width / 2.0 / stride - columns.start, height / 2.0 / stride - rows.start),
    )


@lru_cache(maxsize=16)
def _rays_of(
    grid: tuple[int, int, float, int], top: int, bottom: int, left: int, right: int
) -> npt.NDArray[np.float64]:
    """Part of a camera's rays, cached: a target at rest stays in the same region."""
    return camera_rays(*grid)[:, top:bottom, left:right].copy()


@lru_cache(maxsize=16)
def camera_rays(width: int, height: int, fovy_deg: float, stride: int) -> npt.NDArray[np.float64]:
    """Unit vectors in MuJoCo's camera frame (x right, y up, looking along -z).

    Returns:
        Array of shape (3, ceil(height / stride), ceil(width / stride)), read-only.
    """
    focal_px = height / 2.0 / math.tan(math.radians(fovy_deg) / 2.0)
    rows = -(-height // stride)
    columns = -(-width // stride)
    within = np.random.default_rng(_JITTER_SEED).random((2, rows, columns))
    y, x = (np.indices((rows, columns)) + within) * stride
    rays = np.stack([x - width / 2.0, height / 2.0 - y, np.full_like(x, -focal_px)])
    rays /= np.linalg.norm(rays, axis=0)
    rays.flags.writeable = False
    return rays


# Headless contexts
#
# The context is found by trying, never by setting ``MUJOCO_GL``: a wrong value breaks
# ``import mujoco`` itself, and a missing library raises errors deep inside PyOpenGL. Therefore
# ctypes looks for the libraries before MuJoCo's module is imported.


_EGL_PLATFORM_DEVICE = 0x313F
_MAX_DEVICES = 16


class OpenedContext(Protocol):
    """The common part of ``mujoco.egl.GLContext`` and ``mujoco.osmesa.GLContext``."""

    def make_current(self) -> None:
        """Make the context current in this thread."""


@dataclass(frozen=True, eq=False)
class GlContext:
    """An open context and the name of its platform."""

    platform: str
    context: OpenedContext

    def make_current(self) -> None:
        """Make the context current in this thread."""
        self.context.make_current()


_OSMESA_SIZE: Final = 640, 480
"""Largest width and height in pixels of an image by OSMesa; EGL has no such limit."""


def open_context() -> GlContext:
    """Open the first context that works: EGL, else OSMesa.

    Raises:
        RendererError: Neither works; the message states why, for each.
    """
    reasons = []
    for platform, module, probe in (
        ("EGL", "mujoco.egl", probe_egl),
        ("OSMesa", "mujoco.osmesa", probe_osmesa),
    ):
        try:
            probe()
            context = importlib.import_module(module).GLContext(*_OSMESA_SIZE)
            context.make_current()
        # PyOpenGL raises any of these for a library that it cannot use.
        except (RendererError, ImportError, AttributeError, RuntimeError, OSError) as error:
            reasons.append(f"{platform}: {error}")
        else:
            return GlContext(platform, context)
    raise RendererError("; ".join(reasons))


def probe_egl() -> None:
    """Check that EGL has a device that can be initialized.

    Raises:
        RendererError: There is no EGL library, no OpenGL library, or no such device.
    """
    egl = _load(("libEGL.so.1",))
    _load(("libOpenGL.so.0", "libGL.so.1"))
    address = egl.eglGetProcAddress
    address.restype = ctypes.c_void_p
    address.argtypes = [ctypes.c_char_p]
    query = address(b"eglQueryDevicesEXT")
    display_of = address(b"eglGetPlatformDisplayEXT")
    if not query or not display_of:
        raise RendererError("libEGL cannot list devices")
    if not _any_device_starts(egl, query, display_of):
        raise RendererError("no EGL device can be initialized")


def probe_osmesa() -> None:
    """Check that the off-screen Mesa library is installed.

    Raises:
        RendererError: It is not installed.
    """
    _load(("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so"))


def _load(names: Sequence[str]) -> ctypes.CDLL:
    for name in names:
        try:
            return ctypes.CDLL(name)
        except OSError:
            continue
    raise RendererError(f"{' and '.join(names)} not found")


def _any_device_starts(egl: ctypes.CDLL, query: int, display_of: int) -> bool:
    pointer = ctypes.c_void_p
    devices = (pointer * _MAX_DEVICES)()
    count = ctypes.c_int(0)
    query_devices = ctypes.CFUNCTYPE(
        ctypes.c_uint, ctypes.c_int, ctypes.POINTER(pointer), ctypes.POINTER(ctypes.c_int)
    )(query)
    get_display = ctypes.CFUNCTYPE(pointer, ctypes.c_uint, pointer, pointer)(display_of)
    egl.eglInitialize.argtypes = [pointer, pointer, pointer]
    if not query_devices(_MAX_DEVICES, devices, ctypes.byref(count)):
        return False
    # No eglTerminate: the display belongs to the process, and a context may be open on it.
    return any(
        display and egl.eglInitialize(display, None, None)
        for display in (
            get_display(_EGL_PLATFORM_DEVICE, device, None) for device in devices[: count.value]
        )
    )


_SPARE_GEOMS = 100


class GlRenderer:
    """Renders with MuJoCo's classic renderer in its own context.

    By default without shadows and reflections, at the quality that a color filter needs and a CPU
    can afford. It changes ``model.vis`` (image buffer, samples), which has no effect on physics.

    Args:
        context: Result of `open_context`.
        samples: Samples per pixel; 0 is the fastest, 4 give three times finer centroids.
        effects: Render shadows and reflections: 10 times slower without a GPU.
    """

    name = "gl"

    def __init__(self, context: GlContext, samples: int = 4, effects: bool = False) -> None:
        self._context = context
        self._samples = samples
        self._effects = effects
        self._upload: _Upload | None = None
        self._option = mujoco.MjvOption()
        self._option.sitegroup[:] = 0
        self._camera = mujoco.MjvCamera()
        self._camera.type = mujoco.mjtCamera.mjCAMERA_FIXED

    def render(self, model: mujoco.MjModel, data: mujoco.MjData, exposure: Exposure) -> Image:
        """See `Renderer`."""
        return exposure.paint(partial(self._samples_of, model, data, exposure))

    def _samples_of(
        self, model: mujoco.MjModel, data: mujoco.MjData, exposure: Exposure, blocks: Blocks
    ) -> Image:
        """Colors of some blocks of the image, of shape (rows, columns, 3)."""
        self._context.make_current()
        upload = self._uploaded(model, exposure.width, exposure.height)
        self._update(upload.scene, model, data, exposure)
        _narrow(upload.scene, exposure, blocks, float(model.cam_fovy[exposure.camera_id]))
        rows, columns = (part.stop - part.start for part in blocks)
        part = np.empty((rows, columns, 3), dtype=np.uint8)
        rectangle = mujoco.MjrRect(0, 0, columns, rows)
        mujoco.mjr_render(rectangle, upload.scene, upload.buffers)
        mujoco.mjr_readPixels(part, None, rectangle, upload.buffers)
        return np.ascontiguousarray(part[::-1])

    def close(self) -> None:
        """Free the scene's buffers; the context itself lives as long as the process."""
        if self._upload is not None:
            self._context.make_current()
            self._upload.free()
        self._upload = None

    def _uploaded(self, model: mujoco.MjModel, width: int, height: int) -> _Upload:
        """Meshes on the GPU, uploaded once per model, and again if a larger image is requested."""
        if self._upload is None or not self._upload.serves(model, width, height):
            self.close()
            visual = model.vis
            visual.quality.offsamples = self._samples
            visual.global_.offwidth = max(width, visual.global_.offwidth)
            visual.global_.offheight = max(height, visual.global_.offheight)
            self._upload = _upload(model, effects=self._effects)
        return self._upload

    def _update(
        self,
        scene: mujoco.MjvScene,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        exposure: Exposure,
    ) -> None:
        """Update the scene to the current state and the camera of the exposure."""
        self._option.geomgroup[:] = 0
        self._option.geomgroup[list(exposure.groups)] = 1
        self._camera.fixedcamid = exposure.camera_id
        visible = mujoco.mjtCatBit.mjCAT_STATIC.value | mujoco.mjtCatBit.mjCAT_DYNAMIC.value
        mujoco.mjv_updateScene(model, data, self._option, None, self._camera, visible, scene)
        if self._upload is not None and self._upload.dresses:
            self._upload.dress(scene)


@dataclass(frozen=True, eq=False)
class _Upload:
    """The resources of one model in OpenGL.

    Attributes:
        model: Compiled model; its buffer size is that of ``buffers``.
        scene: Geoms, lights and cameras, for MuJoCo's renderer.
        buffers: Meshes, textures and the offscreen image.
        dresses: How to draw geoms with textures, by geom.
    """

    model: mujoco.MjModel
    scene: mujoco.MjvScene
    buffers: mujoco.MjrContext
    dresses: Mapping[int, _Dress]

    def dress(self, scene: mujoco.MjvScene) -> None:
        """Let the geoms of a scene have their textures."""
        for geom in scene.geoms[: scene.ngeom]:
            if geom.objtype == mujoco.mjtObj.mjOBJ_GEOM and geom.objid in self.dresses:
                dress = self.dresses[geom.objid]
                geom.type = mujoco.mjtGeom.mjGEOM_MESH.value
                geom.size[:] = 1.0
                geom.dataid = dress.mesh
                geom.texid = dress.texture
                geom.texcoord = 1
                geom.texuniform = 0

    def free(self) -> None:
        """Free the buffers."""
        if self.dresses:
            from OpenGL import GL

            for dress in self.dresses.values():
                GL.glDeleteLists(dress.mesh + self.buffers.baseMesh, 1)
        self.buffers.free()

    def serves(self, model: mujoco.MjModel, width: int, height: int) -> bool:
        """Whether an image of this size of a model can be rendered."""
        wide = self.buffers.offWidth
        high = self.buffers.offHeight
        return model is self.model and width <= wide and height <= high


def _upload(model: mujoco.MjModel, *, effects: bool) -> _Upload:
    scene = mujoco.MjvScene(model, maxgeom=model.ngeom + _SPARE_GEOMS)
    if not effects:
        scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0
        scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = 0
    buffers = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
    mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, buffers)
    return _Upload(model, scene, buffers, _dresses(model, buffers))


# Textures in OpenGL
#
# MuJoCo projects an image onto a geom along one axis only. What has a texture is therefore drawn as
# a mesh whose vertices have coordinates in the image, from a list of commands like those that
# MuJoCo's renderer makes of meshes.


class _Dress(NamedTuple):
    """How MuJoCo's renderer draws a geom with a texture.

    Attributes:
        mesh: Number of the mesh, counted from the renderer's first list of commands.
        texture: Number of the texture.
    """

    mesh: int
    texture: int


def _dresses(model: mujoco.MjModel, buffers: mujoco.MjrContext) -> dict[int, _Dress]:
    """Meshes and textures of the geoms with a texture, in OpenGL, by geom."""
    skins = skins_of(model)
    if skins is None:
        return {}
    from OpenGL import GL

    found = {}
    for geom in np.flatnonzero(skins.numbers >= 0).tolist():
        surface = surface_of(model, geom)
        if surface is None:
            continue
        texture = int(model.mat_texid[model.geom_matid[geom], mujoco.mjtTextureRole.mjTEXROLE_RGB])
        GL.glBindTexture(GL.GL_TEXTURE_2D, int(buffers.texture[texture]))
        for parameter, value in (
            (GL.GL_TEXTURE_MIN_FILTER, GL.GL_NEAREST_MIPMAP_LINEAR),
            (GL.GL_TEXTURE_MAG_FILTER, GL.GL_NEAREST),
            (GL.GL_TEXTURE_WRAP_S, GL.GL_REPEAT),
            (GL.GL_TEXTURE_WRAP_T, GL.GL_REPEAT),
        ):
            GL.glTexParameteri(GL.GL_TEXTURE_2D, parameter, value)
        places = image_coordinates(skins, int(skins.numbers[geom]), surface)
        commands = GL.glGenLists(1)
        GL.glNewList(commands, GL.GL_COMPILE)
        GL.glBegin(GL.GL_TRIANGLES)
        for (u, v), normal, point in zip(
            places.reshape(-1, 2).tolist(),
            surface.normals.reshape(-1, 3).tolist(),
            surface.points.reshape(-1, 3).tolist(),
            strict=True,
        ):
            GL.glTexCoord2f(u, v)
            GL.glNormal3f(*normal)
            GL.glVertex3f(*point)
        GL.glEnd()
        GL.glEndList()
        found[geom] = _Dress(int(commands) - int(buffers.baseMesh), texture)
    return found


def _narrow(scene: mujoco.MjvScene, exposure: Exposure, blocks: Blocks, fovy_deg: float) -> None:
    """Narrow the view frustum to some blocks, so that the rest costs nothing."""
    (top, bottom), (left, right) = (
        (part.start * exposure.stride, part.stop * exposure.stride) for part in blocks
    )
    for camera in scene.camera:
        slope = math.tan(math.radians(fovy_deg) / 2.0)
        pixel = 2.0 * camera.frustum_near * slope / exposure.height
        camera.frustum_top = (exposure.height / 2.0 - top) * pixel
        camera.frustum_bottom = (exposure.height / 2.0 - bottom) * pixel
        camera.frustum_center = ((left + right) / 2.0 - exposure.width / 2.0) * pixel
        camera.frustum_width = 0.5 * (right - left) * pixel


# Choice

GL_PACKAGES = "libegl1 and libgl1 (or libosmesa6)"
"""Packages of Debian and Ubuntu that provide OpenGL without a screen."""


class RendererChoice(NamedTuple):
    """Factory of the chosen renderer, and one sentence about it for the user."""

    create: Callable[[], Renderer]
    message: str


def choose_renderer(
    kind: RendererKind = "ray", find_context: Callable[[], GlContext] = open_context
) -> RendererChoice:
    """Choose the renderer for this machine.

    Args:
        kind: ``"gl"`` insists on OpenGL, ``"ray"`` never touches it, ``"auto"`` takes OpenGL
            where it works.
        find_context: Function that opens an off-screen context or raises RendererError; tests
            replace it.

    Raises:
        RendererError: OpenGL was requested and does not work here, or the kind is unknown.
    """
    if kind not in get_args(RendererKind):
        raise RendererError(f"no renderer {kind!r}; there are 'auto', 'gl' and 'ray'")
    if kind == "ray":
        return RendererChoice(
            RayRenderer, "Camera images are made by ray casting, as on every machine."
        )
    try:
        context = find_context()
    except RendererError as error:
        advice = f"On Debian or Ubuntu the packages {GL_PACKAGES} bring OpenGL without a screen."
        if kind == "gl":
            raise RendererError(
                f"OpenGL does not work on this machine: {error}. {advice}"
            ) from None
        return RendererChoice(
            RayRenderer,
            f"Camera images are made by ray casting, because OpenGL is missing ({error}). "
            f"Everything works without it. {advice}",
        )
    return RendererChoice(
        lambda: GlRenderer(context), f"Camera images are drawn by OpenGL ({context.platform})."
    )
