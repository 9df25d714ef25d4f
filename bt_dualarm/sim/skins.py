"""Textures in a compiled model: how geoms carry them, and the arrays from which they are drawn.

MuJoCo has no projection that suits every shape: an image is projected along the z axis of a geom,
or from its center onto a cube. Here an image is projected along the axis of the texture's frame
that is nearest to the normal of the surface. What that takes is user data of the geom, so that a
record's models have it, too.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.core.later import Later
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.sim.kernel_arrays import Skins

if TYPE_CHECKING:
    import cv2
else:
    cv2 = Later("cv2")

TEXTURE_PREFIX: Final = "texture#"
"""Begin of the names of textures and materials of objects."""

USER_DATA: Final = 13
"""Numbers of user data of each geom of a model with textures: widths and heights of the image in
the projections along x, y and z, m; position and quaternion of the texture's frame in the body.
Zeros for a geom without a texture."""

_LEAST_M: Final = 1e-4
_MOST_M: Final = 1e4


def user_data(size: tuple[float, float] | None, extents: Vector, frame: Pose) -> list[float]:
    """User data of a geom with a texture.

    Args:
        size: Width and height of the image, m; None to stretch it over each side.
        extents: Extents of the shape along the axes of the texture's frame, of shape (3,), m.
        frame: Pose of that frame, in the middle of the shape, in the body.
    """
    x, y, z = (max(float(extent), _LEAST_M) for extent in extents)
    tiles = (y, z, x, z, x, y) if size is None else 3 * size
    return [*tiles, *frame.position.tolist(), *frame.quaternion.tolist()]


def add_image(spec: mujoco.MjSpec, name: str, pixels: npt.NDArray[np.uint8]) -> None:
    """Add a material with an image, of shape (rows, columns, 3), to the elements of a model."""
    rows, columns, channels = pixels.shape
    kind = mujoco.mjtTexture.mjTEXTURE_2D
    texture = spec.add_texture(name=name, type=kind, width=columns, height=rows, nchannel=channels)
    texture.data = pixels.tobytes()
    material = spec.add_material(name=name)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name


def skins_of(model: mujoco.MjModel) -> Skins | None:
    """The textures of a model; None if no geom has one.

    Numbers that no object can have, which a damaged record may contain, count as no texture.
    """
    if model.nuser_geom != USER_DATA or not model.ntex:
        return None
    role = mujoco.mjtTextureRole.mjTEXROLE_RGB
    numbers = np.full(model.ngeom, -1, np.int64)
    firsts: dict[int, int] = {}
    texels: list[npt.NDArray[np.float32]] = []
    count = 0
    tiles: list[Vector] = []
    turns: list[Matrix] = []
    shifts: list[Vector] = []
    images: list[tuple[int, int, int]] = []
    for geom in np.flatnonzero((model.geom_matid >= 0) & (model.geom_user[:, :6] > 0).all(axis=1)):
        texture = int(model.mat_texid[model.geom_matid[geom], role])
        own = model.geom_user[geom]
        length = float(np.linalg.norm(own[9:]))
        if texture < 0 or model.tex_nchannel[texture] != 3 or own[:6].min() < 0.5 * _LEAST_M:
            continue
        if not (0.9 < length < 1.1 and np.abs(own).max() < _MOST_M):
            continue
        rows, columns = int(model.tex_height[texture]), int(model.tex_width[texture])
        if texture not in firsts:
            firsts[texture] = count
            count += rows * columns
            start = int(model.tex_adr[texture])
            levels = model.tex_data[start : start + 3 * rows * columns].reshape(-1, 3)
            texels.append(levels.astype(np.float32) / np.float32(255.0))
        in_body = Pose(own[6:9].copy(), own[9:] / length)
        geom_in_body = Pose(model.geom_pos[geom].copy(), model.geom_quat[geom].copy())
        to_texture = in_body.inverse @ geom_in_body
        numbers[geom] = len(tiles)
        tiles.append(own[:6].copy())
        turns.append(to_texture.rotation_matrix)
        shifts.append(to_texture.position)
        images.append((firsts[texture], rows, columns))
    if not tiles:
        return None
    return Skins(
        numbers=numbers,
        geoms=np.flatnonzero(numbers >= 0),
        tiles=np.array(tiles),
        turns=np.array(turns),
        shifts=np.array(shifts),
        images=np.array(images, np.int64),
        texels=np.concatenate(texels),
    )


def image_of(skins: Skins, skin: int) -> npt.NDArray[np.uint8]:
    """The image of a texture, of shape (rows, columns, 3)."""
    first, rows, columns = skins.images[skin].tolist()
    texels = skins.texels[first : first + rows * columns]
    levels: npt.NDArray[np.uint8] = np.rint(255.0 * texels).astype(np.uint8)
    return levels.reshape(rows, columns, 3)


def as_png(image: npt.NDArray[np.uint8]) -> bytes:
    """An image, of shape (rows, columns, 3), as the content of a PNG file."""
    return bytes(cv2.imencode(".png", np.ascontiguousarray(image[..., ::-1]))[1])


# Surfaces as triangles, for renderers that project no images

_STEPS: Final = 16
"""Squares along the edge of a side of a cube that becomes a ball, and around a quarter of a
cylinder; an even number, so that projections change at the edges of triangles."""


class Surface(NamedTuple):
    """The surface of a geom in its frame, as triangles that no projection divides.

    Attributes:
        points: Corners, counterclockwise from outside, of shape (n, 3, 3), m.
        normals: Outward normals at the corners, of shape (n, 3, 3).
    """

    points: npt.NDArray[np.float64]
    normals: npt.NDArray[np.float64]


def surface_of(model: mujoco.MjModel, geom: int) -> Surface | None:
    """The surface of a box, ball, ellipsoid, cylinder, capsule or mesh; None of other geoms."""
    size = model.geom_size[geom].astype(float)
    kind = mujoco.mjtGeom(int(model.geom_type[geom]))
    kinds = mujoco.mjtGeom
    if kind == kinds.mjGEOM_MESH:
        return _flat(_triangles(model, int(model.geom_dataid[geom])))
    if kind == kinds.mjGEOM_BOX:
        return _flat(_cube(1) * size)
    ball = _cube(_STEPS)
    # Squares evenly spread over the angle; a cube keeps the projections apart.
    ball = np.tan(0.25 * np.pi * ball)
    ball /= np.linalg.norm(ball, axis=2, keepdims=True)
    if kind == kinds.mjGEOM_SPHERE:
        return Surface(ball * size[0], ball)
    if kind == kinds.mjGEOM_ELLIPSOID:
        # The point with a given normal n of an ellipsoid with half axes a: a² n / |a n|.
        return Surface(ball * size**2 / np.linalg.norm(ball * size, axis=2, keepdims=True), ball)
    if kind not in (kinds.mjGEOM_CYLINDER, kinds.mjGEOM_CAPSULE):
        return None
    radius, half = size[:2]
    around = 2.0 * np.pi * np.arange(4 * _STEPS + 1) / (4 * _STEPS)
    ring = np.stack((np.cos(around), np.sin(around)), axis=1)
    start, end = ring[:-1], ring[1:]
    low, high = (np.full((len(start), 1), height) for height in (-half, half))
    corners = [np.hstack((radius * edge, z)) for edge, z in
               ((start, low), (end, low), (end, high), (start, high))]  # fmt: skip
    outward = [np.hstack((edge, np.zeros_like(low))) for edge in (start, end, end, start)]
    order = ((0, 1, 2), (0, 2, 3))
    sides = np.concatenate([np.stack([corners[i] for i in three], axis=1) for three in order])
    normals = np.concatenate([np.stack([outward[i] for i in three], axis=1) for three in order])
    if kind == kinds.mjGEOM_CAPSULE:
        lifts = half * np.sign(ball[:, :, 2].sum(axis=1))[:, None, None] * (0.0, 0.0, 1.0)
        return Surface(
            np.concatenate((sides, radius * ball + lifts)), np.concatenate((normals, ball))
        )
    middle = np.zeros((len(start), 2))
    top = [np.hstack((edge, high)) for edge in (middle, radius * start, radius * end)]
    bottom = [np.hstack((edge, low)) for edge in (middle, radius * end, radius * start)]
    caps = np.concatenate((np.stack(top, axis=1), np.stack(bottom, axis=1)))
    up = np.sign(caps[..., 2:]) * (0.0, 0.0, 1.0)
    return Surface(np.concatenate((sides, caps)), np.concatenate((normals, up)))


def _cube(steps: int) -> npt.NDArray[np.float64]:
    """Triangles of a cube of half length 1, with so many squares along each edge, (n, 3, 3)."""
    ends = 2.0 * np.arange(steps + 1) / steps - 1.0
    low, high = ends[:-1], ends[1:]
    corners = ((low, low), (high, low), (high, high), (low, high))
    square = [np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
              for u, v in corners]  # fmt: skip
    flat = np.concatenate(
        [np.stack([square[i] for i in three], axis=1) for three in ((0, 1, 2), (0, 2, 3))]
    )
    sides = []
    for axis in range(3):
        plus = np.empty((*flat.shape[:2], 3))
        plus[..., axis] = 1.0
        plus[..., (axis + 1) % 3] = flat[..., 0]
        plus[..., (axis + 2) % 3] = flat[..., 1]
        minus = plus[:, ::-1].copy()
        minus[..., axis] = -1.0
        sides += [plus, minus]
    return np.concatenate(sides)


def _flat(points: npt.NDArray[np.float64]) -> Surface:
    """Surface of plane triangles, of shape (n, 3, 3)."""
    normals = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    return Surface(points, np.repeat(normals[:, None], 3, axis=1))


def _triangles(model: mujoco.MjModel, mesh: int) -> npt.NDArray[np.float64]:
    """Triangles of a mesh, of shape (n, 3, 3), m."""
    first, face = int(model.mesh_vertadr[mesh]), int(model.mesh_faceadr[mesh])
    vertices = model.mesh_vert[first : first + int(model.mesh_vertnum[mesh])].astype(float)
    faces = model.mesh_face[face : face + int(model.mesh_facenum[mesh])]
    triangles: npt.NDArray[np.float64] = vertices[faces]
    return triangles


def image_coordinates(skins: Skins, skin: int, surface: Surface) -> npt.NDArray[np.float64]:
    """Coordinates of a surface's corners in the image, from its top left, of shape (n, 3, 2).

    From 0 to 1 across the image and down; beyond that it repeats. `texel_at` is the same for the
    points that rays hit.
    """
    turn = skins.turns[skin]
    places = surface.points @ turn.T + skins.shifts[skin]
    facing = surface.normals.sum(axis=1) @ turn.T
    size = np.abs(facing)
    up = size[:, 2] >= size.max(axis=1) - 1e-9
    side = np.where(up, 2, np.where(size[:, 0] >= size[:, 1] - 1e-9, 0, 1))
    sign = np.where(facing[np.arange(len(side)), side] > 0.0, 1.0, -1.0)[:, None]
    x, y, z = np.moveaxis(places, 2, 0)
    u = np.choose(side[:, None], (sign * y, -sign * x, x))
    v = np.choose(side[:, None], (z, z, sign * y))
    tiles = skins.tiles[skin].reshape(3, 2)[side]
    return np.stack((u / tiles[:, :1] + 0.5, 0.5 - v / tiles[:, 1:]), axis=2)
