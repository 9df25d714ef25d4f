"""Compiled kernels of images: the first surface on each ray, its color, and the camera's motion."""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from bt_dualarm.core.kernel import kernel
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.sim.kernel_arrays import (
    HULL,
    NOTHING,
    Fan,
    Hits,
    Lights,
    Marks,
    Numbers,
    Shapes,
    Skins,
)
from bt_dualarm.sim.ray_intersection_kernels import meet_hull, meet_round, outward, sphere_is_seen

# First intersections


@kernel
def trace(shapes: Shapes, positions: Matrix, axes: Matrix, fan: Fan) -> Marks:
    """Find the nearest surface on each ray.

    Shapes are visited from near to far, so that later ones are mostly hidden and cost little.

    Args:
        shapes: The shapes of n geoms.
        positions: Positions of all geoms of the model, of shape (ngeom, 3), m.
        axes: Rotation matrices of all geoms of the model, row by row, of shape (ngeom, 9).
        fan: The rays.

    Returns:
        The intersections in compact form.
    """
    marks = _no_marks(shapes, fan)
    for index in _visible_by_distance(shapes, positions, fan):
        geom = shapes.geoms[index]
        own = axes[geom].reshape(3, 3)
        eye = marks.eyes[index]
        turn = marks.turns[index]
        for one in range(3):
            eye[one] = 0.0
            for other in range(3):
                eye[one] += (fan.eye[other] - positions[geom, other]) * own[other, one]
                turn[one, other] = 0.0
                for between in range(3):
                    turn[one, other] += own[between, one] * fan.axes[between, other]
        if shapes.kinds[index] == HULL:
            meet_hull(shapes, index, own, fan, marks)
        else:
            meet_round(shapes, index, own, fan, marks)
    return marks


@kernel
def _no_marks(shapes: Shapes, fan: Fan) -> Marks:
    """Marks of rays that hit nothing."""
    rows = fan.rays.shape[1]
    columns = fan.rays.shape[2]
    count = len(shapes.geoms)
    faces = np.empty((rows, columns), np.int32)
    distances = np.empty((rows, columns))
    faces[:] = -1
    distances[:] = math.inf
    normals = np.empty((len(shapes.owners), 3))
    return Marks(faces, distances, normals, np.empty((count, 3)), np.empty((count, 3, 3)))


@kernel
def describe(shapes: Shapes, axes: Matrix, fan: Fan, marks: Marks) -> Hits:
    """Convert marks to hits; arguments as for `trace`."""
    rows, columns = marks.faces.shape
    hits = Hits(np.empty((rows, columns), np.int32), marks.distances, np.empty((3, rows, columns)))
    faces, owners, normals = facets(shapes, axes, fan, marks)
    for row in range(rows):
        for column in range(columns):
            face = faces[row, column]
            hits.geoms[row, column] = owners[face] if face >= 0 else -1
            for axis in range(3):
                hits.normals[axis, row, column] = normals[face, axis] if face >= 0 else 0.0
    return hits


@kernel
def facets(
    shapes: Shapes, axes: Matrix, fan: Fan, marks: Marks
) -> tuple[npt.NDArray[np.int32], Numbers, Matrix]:
    """Faces that rays hit, with one face per ray for curved shapes; arguments as for `describe`.

    Returns:
        Index of the face that each ray hits, -1 for none, of shape (rows, columns); ids of the
        faces' geoms, of shape (n,); their outward unit normals in the world, of shape (n, 3).
    """
    count = 0
    for row in range(marks.faces.shape[0]):
        for column in range(marks.faces.shape[1]):
            count += marks.faces[row, column] < NOTHING
    if count == 0:
        return marks.faces, shapes.owners, marks.normals
    known = len(shapes.owners)
    faces = marks.faces.copy()
    owners = np.empty(known + count, np.int64)
    normals = np.empty((known + count, 3))
    owners[:known] = shapes.owners
    normals[:known] = marks.normals
    _add_rounds(shapes, axes, fan, marks, faces, owners, normals)
    return faces, owners, normals


@kernel
def _add_rounds(
    shapes: Shapes, axes: Matrix, fan: Fan, marks: Marks,
    faces: npt.NDArray[np.int32], owners: Numbers, normals: Matrix,
) -> None:  # fmt: skip
    """Append a face, with the local normal, for each ray that hits a curved shape."""
    rays = fan.rays
    eyes = marks.eyes
    turns = marks.turns
    size = shapes.sizes
    point = np.empty(3)
    face = len(shapes.owners)
    for row in range(faces.shape[0]):
        for column in range(faces.shape[1]):
            if faces[row, column] >= NOTHING:
                continue
            index = -2 - faces[row, column]
            geom = shapes.geoms[index]
            away = marks.distances[row, column]
            x = rays[0, row, column]
            y = rays[1, row, column]
            z = rays[2, row, column]
            for axis in range(3):
                along = turns[index, axis, 0] * x + turns[index, axis, 1] * y
                along += turns[index, axis, 2] * z
                point[axis] = eyes[index, axis] + away * along
            kind = shapes.kinds[index]
            radius = size[index, 0]
            half = size[index, 1]
            u, v, w = outward(kind, radius, half, point[0], point[1], point[2])
            own = axes[geom]
            for axis in range(3):
                along = own[3 * axis] * u + own[3 * axis + 1] * v
                normals[face, axis] = along + own[3 * axis + 2] * w
            faces[row, column] = face
            owners[face] = geom
            face += 1


@kernel
def _visible_by_distance(shapes: Shapes, positions: Matrix, fan: Fan) -> Numbers:
    """Indices of the shapes whose bounding sphere reaches into the fan, near ones first.

    Planes, which have no bounding sphere, come last. Of coplanar surfaces the first one is visible.
    """
    count = len(shapes.geoms)
    closest = np.empty(count)
    center = np.empty(3)
    for index in range(count):
        closest[index] = math.nan
        for axis in range(3):
            center[axis] = 0.0
            for along in range(3):
                offset = positions[shapes.geoms[index], along] - fan.eye[along]
                center[axis] += offset * fan.axes[along, axis]
        radius = shapes.radii[index]
        if sphere_is_seen(fan, center, radius):
            away = math.sqrt(center[0] ** 2 + center[1] ** 2 + center[2] ** 2)
            closest[index] = math.inf if math.isinf(radius) else max(away - radius, 0.0)
    return _by_distance(closest)


@kernel
def _by_distance(closest: Vector) -> Numbers:
    """Indices of the values that are not NaN, in ascending order (a stable insertion sort)."""
    order = np.empty(len(closest), np.int64)
    filled = 0
    for index in range(len(closest)):
        if math.isnan(closest[index]):
            continue
        place = filled
        while place > 0 and closest[order[place - 1]] > closest[index]:
            order[place] = order[place - 1]
            place -= 1
        order[place] = index
        filled += 1
    return order[:filled]


# Colors


@kernel
def draw(
    shapes: Shapes, positions: Matrix, axes: Matrix, fan: Fan, lights: Lights,
    lit_from: Matrix, lit_along: Matrix, pixels: npt.NDArray[np.uint8],
) -> None:  # fmt: skip
    """Trace rays and enter the colors of what they hit; arguments as for `trace` and `shade`."""
    marks = trace(shapes, positions, axes, fan)
    faces, owners, normals = facets(shapes, axes, fan, marks)
    sun = _sun(lights, lit_from, lit_along)
    _shade(lights, sun, fan, faces, owners, normals, marks.distances, pixels)


@kernel
def shade(
    lights: Lights, lit_from: Matrix, lit_along: Matrix, fan: Fan, hits: Hits,
    pixels: npt.NDArray[np.uint8],
) -> None:  # fmt: skip
    """Enter the colors of hits, of shape (rows, columns, 3), the sky's where there is none.

    Args:
        lights: The lights.
        lit_from: Positions of all lights of the model, of shape (nlight, 3), m.
        lit_along: Unit vectors of their directions, of shape (nlight, 3).
        fan: The rays.
        hits: Their hits.
        pixels: The pixels; changed.
    """
    faces, owners, normals = _faces_of(hits)
    sun = _sun(lights, lit_from, lit_along)
    _shade(lights, sun, fan, faces, owners, normals, hits.distances, pixels)


@kernel
def _faces_of(hits: Hits) -> tuple[npt.NDArray[np.int32], Numbers, Matrix]:
    """Hits as faces, as in `facets`: one face per ray."""
    rows, columns = hits.geoms.shape
    faces = np.empty((rows, columns), np.int32)
    owners = np.empty(rows * columns, np.int64)
    normals = np.empty((rows * columns, 3))
    for row in range(rows):
        for column in range(columns):
            face = row * columns + column
            owners[face] = hits.geoms[row, column]
            faces[row, column] = face if owners[face] >= 0 else NOTHING
            normals[face] = hits.normals[:, row, column]
    return faces, owners, normals


@kernel
def draw_textured(
    shapes: Shapes, positions: Matrix, axes: Matrix, fan: Fan, lights: Lights,
    lit_from: Matrix, lit_along: Matrix, skins: Skins, pixels: npt.NDArray[np.uint8],
) -> None:  # fmt: skip
    """Like `draw`, with textures."""
    marks = trace(shapes, positions, axes, fan)
    faces, owners, normals = facets(shapes, axes, fan, marks)
    sun = _sun(lights, lit_from, lit_along)
    far = marks.distances
    _shade_textured(
        lights, sun, skins, positions, axes, fan, faces, owners, normals, far, pixels
    )  # fmt: skip


@kernel
def shade_textured(
    lights: Lights, lit_from: Matrix, lit_along: Matrix, skins: Skins, positions: Matrix,
    axes: Matrix, fan: Fan, hits: Hits, pixels: npt.NDArray[np.uint8],
) -> None:  # fmt: skip
    """Like `shade`, with textures; positions and axes are of all geoms, as for `trace`."""
    faces, owners, normals = _faces_of(hits)
    sun = _sun(lights, lit_from, lit_along)
    far = hits.distances
    _shade_textured(
        lights, sun, skins, positions, axes, fan, faces, owners, normals, far, pixels
    )  # fmt: skip


@kernel
def _shade_textured(
    lights: Lights, sun: Matrix, skins: Skins, positions: Matrix, axes: Matrix, fan: Fan,
    faces: npt.NDArray[np.int32], owners: Numbers, normals: Matrix, distances: Matrix,
    pixels: npt.NDArray[np.uint8],
) -> None:  # fmt: skip
    """Like `_shade`: each ray that hits a texture gets a face, and a color, of its own."""
    rows, columns = faces.shape
    count = 0
    for row in range(rows):
        for column in range(columns):
            face = faces[row, column]
            if face >= 0 and skins.numbers[owners[face]] >= 0:
                count += 1
    if count == 0:
        _shade(lights, sun, fan, faces, owners, normals, distances, pixels)
        return
    known = len(owners)
    geoms = len(lights.base) - 1
    own_faces = faces.copy()
    own_owners = np.empty(known + count, np.int64)
    own_normals = np.empty((known + count, 3))
    base = np.empty((geoms + count + 1, 3))
    own_owners[:known] = owners
    own_normals[:known] = normals
    base[:geoms] = lights.base[:geoms]
    base[geoms + count] = lights.base[geoms]  # the sky
    eyes, turns, looks = _into_textures(skins, positions, axes, fan)
    rays = fan.rays
    added = 0
    for row in range(rows):
        for column in range(columns):
            face = faces[row, column]
            if face < 0 or skins.numbers[owners[face]] < 0:
                continue
            skin = skins.numbers[owners[face]]
            look = looks[skin]
            turn = turns[skin]
            eye = eyes[skin]
            away = distances[row, column]
            x = away * rays[0, row, column]
            y = away * rays[1, row, column]
            z = away * rays[2, row, column]
            u = normals[face, 0]
            v = normals[face, 1]
            w = normals[face, 2]
            texel = texel_at(
                skins, skin,
                eye[0] + look[0, 0] * x + look[0, 1] * y + look[0, 2] * z,
                eye[1] + look[1, 0] * x + look[1, 1] * y + look[1, 2] * z,
                eye[2] + look[2, 0] * x + look[2, 1] * y + look[2, 2] * z,
                turn[0, 0] * u + turn[0, 1] * v + turn[0, 2] * w,
                turn[1, 0] * u + turn[1, 1] * v + turn[1, 2] * w,
                turn[2, 0] * u + turn[2, 1] * v + turn[2, 2] * w,
            )  # fmt: skip
            own_faces[row, column] = known + added
            own_owners[known + added] = geoms + added
            for axis in range(3):
                own_normals[known + added, axis] = normals[face, axis]
                base[geoms + added, axis] = skins.texels[texel, axis]
            added += 1
    own_lights = Lights(
        base, lights.ambient, lights.head, lights.active, lights.distant, lights.diffuse
    )
    _shade(own_lights, sun, fan, own_faces, own_owners, own_normals, distances, pixels)


@kernel
def _into_textures(
    skins: Skins, positions: Matrix, axes: Matrix, fan: Fan
) -> tuple[Matrix, npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """What brings rays into the frames of textures.

    Returns:
        Positions of the eye in these frames, of shape (n, 3), m; rotations from the world, and from
        the camera's axes, of shape (n, 3, 3) each.
    """
    count = len(skins.geoms)
    eyes = np.empty((count, 3))
    turns = np.zeros((count, 3, 3))
    looks = np.zeros((count, 3, 3))
    for skin in range(count):
        geom = skins.geoms[skin]
        for axis in range(3):
            eyes[skin, axis] = skins.shifts[skin, axis]
            for along in range(3):
                for between in range(3):
                    own = axes[geom, 3 * along + between]
                    turns[skin, axis, along] += skins.turns[skin, axis, between] * own
                offset = fan.eye[along] - positions[geom, along]
                eyes[skin, axis] += turns[skin, axis, along] * offset
            for along in range(3):
                for between in range(3):
                    one = turns[skin, axis, between] * fan.axes[between, along]
                    looks[skin, axis, along] += one
    return eyes, turns, looks


@kernel
def texel_at(
    skins: Skins, skin: int, x: float, y: float, z: float, u: float, v: float, w: float
) -> int:
    """Index of the texel that a point x, y, z in a texture's frame shows, with normal u, v, w."""
    across = abs(u)
    deep = abs(v)
    # Where two sides meet at 45°, one must win on every machine, in spite of rounding.
    up = abs(w) + 1e-9
    if up >= across and up >= deep:
        side = 2
        right = x
        above = y if w > 0.0 else -y
    elif across + 1e-9 >= deep:
        side = 0
        right = y if u > 0.0 else -y
        above = z
    else:
        side = 1
        right = -x if v > 0.0 else x
        above = z
    right = right / skins.tiles[skin, 2 * side] + 0.5
    above = above / skins.tiles[skin, 2 * side + 1] + 0.5
    rows = skins.images[skin, 1]
    columns = skins.images[skin, 2]
    column = min(max(int((right - math.floor(right)) * columns), 0), columns - 1)
    row = min(max(int((1.0 - (above - math.floor(above))) * rows), 0), rows - 1)
    return int(skins.images[skin, 0] + row * columns + column)


@kernel
def _shade(
    lights: Lights, sun: Matrix, fan: Fan, faces: npt.NDArray[np.int32], owners: Numbers,
    normals: Matrix, distances: Matrix, pixels: npt.NDArray[np.uint8],
) -> None:  # fmt: skip
    """Like `shade`, for faces as in `facets`, and lights at, or toward, ``sun`` of shape (n, 3)."""
    light = np.empty(3)
    sky = _sky(lights)
    rays = fan.rays
    axes = fan.axes
    eye = fan.eye
    for row in range(pixels.shape[0]):
        for column in range(pixels.shape[1]):
            face = faces[row, column]
            if face < 0:
                for channel in range(3):
                    pixels[row, column, channel] = sky[channel]
                continue
            right = rays[0, row, column]
            up = rays[1, row, column]
            back = rays[2, row, column]
            rx = axes[0, 0] * right + axes[0, 1] * up + axes[0, 2] * back
            ry = axes[1, 0] * right + axes[1, 1] * up + axes[1, 2] * back
            rz = axes[2, 0] * right + axes[2, 1] * up + axes[2, 2] * back
            u = normals[face, 0]
            v = normals[face, 1]
            w = normals[face, 2]
            facing = -(u * rx + v * ry + w * rz)
            for channel in range(3):
                light[channel] = lights.ambient[channel] + facing * lights.head[channel]
            for index in range(len(sun)):
                x = sun[index, 0]
                y = sun[index, 1]
                z = sun[index, 2]
                length = 1.0
                if not lights.distant[index]:
                    away = distances[row, column]
                    x -= eye[0] + rx * away
                    y -= eye[1] + ry * away
                    z -= eye[2] + rz * away
                    length = math.sqrt(x * x + y * y + z * z)
                lambert = max((u * x + v * y + w * z) / length, 0.0)
                for channel in range(3):
                    light[channel] += lambert * lights.diffuse[index, channel]
            for channel in range(3):
                shaded = lights.base[owners[face], channel] * light[channel]
                pixels[row, column, channel] = _level(shaded)


@kernel
def _sky(lights: Lights) -> npt.NDArray[np.uint8]:
    """Color of the sky, which is not shaded, of shape (3,)."""
    sky = np.empty(3, np.uint8)
    for channel in range(3):
        sky[channel] = _level(lights.base[-1, channel])
    return sky


@kernel
def _level(shaded: float) -> np.uint8:
    """Pixel value, 0 to 255, of a brightness from 0 to 1."""
    return np.uint8(min(max(shaded, 0.0), 1.0) * 255.0 + 0.5)


@kernel
def _sun(lights: Lights, lit_from: Matrix, lit_along: Matrix) -> Matrix:
    """Positions of the active lights, or the directions toward directional ones, (n, 3)."""
    sun = np.empty((len(lights.active), 3))
    for index in range(len(sun)):
        for axis in range(3):
            if lights.distant[index]:
                sun[index, axis] = -lit_along[lights.active[index], axis]
            else:
                sun[index, axis] = lit_from[lights.active[index], axis]
    return sun


# Blocks


@kernel
def enter(
    image: npt.NDArray[np.uint8],
    region: tuple[int, int, int, int],
    corner: tuple[int, int],
    step: int,
    blocks: npt.NDArray[np.uint8],
) -> None:
    """Write blocks into a region of an image, of shape (height, width, 3).

    Args:
        image: Image; changed.
        region: Region that they cover: left, top, right, bottom.
        corner: Column and row of the first pixel of the first block, at most those of the region.
        step: Edge of a block in pixels.
        blocks: Their colors, of shape (rows, columns, 3).
    """
    left, top, right, bottom = region
    flat = image.reshape(image.shape[0], 3 * image.shape[1])
    line = np.empty(3 * step * blocks.shape[1], np.uint8)
    inside = line[3 * (left - corner[0]) : 3 * (right - corner[0])]
    for row in range(blocks.shape[0]):
        filled = 0
        for column in range(blocks.shape[1]):
            for _ in range(step):
                for channel in range(3):
                    line[filled] = blocks[row, column, channel]
                    filled += 1
        first = corner[1] + row * step
        for y in range(max(first, top), min(first + step, bottom)):
            part = flat[y, 3 * left : 3 * right]
            for i in range(len(part)):
                part[i] = inside[i]


# Motion blur

_NEAREST_M = 1e-3  # depth in front of the camera below which nothing is visible


class Bodies(NamedTuple):
    """Positions and velocities of all bodies of a model, in MuJoCo's arrays.

    Attributes:
        positions: Positions in the world (``xpos``), of shape (nbody, 3), m.
        velocities: Angular, then linear velocity (``cvel``) along the world's axes, the latter at
            the center of mass of the body's tree, of shape (nbody, 6), rad/s and m/s.
        centers: Centers of mass of the subtrees (``subtree_com``), of shape (nbody, 3), m.
        roots: Ids of the roots of the bodies' trees (``body_rootid``), of shape (nbody,).
    """

    positions: Matrix
    velocities: Matrix
    centers: Matrix
    roots: npt.NDArray[np.int32]


@kernel
def fastest(
    ids: npt.NDArray[np.int64], radii: Vector, holder: int, bodies: Bodies,
    eye: Vector, axes: Matrix, focal_px: float,
    size: tuple[int, int], region: tuple[int, int, int, int],
) -> float:  # fmt: skip
    """Highest image speed of the bodies that may be visible in a region, in pixels per second.

    Args:
        ids: Ids of the bodies to consider, of shape (n,).
        radii: Bounding radii about their positions, of shape (n,), m.
        holder: Id of the body that carries the camera.
        bodies: Positions and velocities of all bodies.
        eye: Position of the camera, of shape (3,), m.
        axes: Camera's x (right), y (up) and z (backward) as columns, of shape (3, 3).
        focal_px: Focal length in pixels.
        size: Width and height of the whole image in pixels.
        region: Region of the image: left, top, right, bottom.
    """
    most = 0.0
    relative = np.empty(3)
    of_camera = np.empty(3)
    for number in range(len(ids)):
        position = bodies.positions[ids[number]]
        relative[:] = position - eye
        x, y, z = _in_camera(axes, relative)
        if not _is_shown(x, y, z, radii[number], focal_px, size, region):
            continue
        # The image shows the body's velocity relative to a point that moves with the camera.
        _velocity(bodies, ids[number], position, relative)
        _velocity(bodies, holder, position, of_camera)
        relative -= of_camera
        u, v, w = _in_camera(axes, relative)
        # Derivative of the projection (x / z, y / z), with z < 0 in front of the camera.
        across = math.sqrt((u - x * w / z) ** 2 + (v - y * w / z) ** 2)
        most = max(most, focal_px * across / -z)
    return most


@kernel
def _velocity(bodies: Bodies, body: int, point: Vector, velocity: Vector) -> None:
    """Enter the velocity of the point of a body at a position, of shape (3,), m/s."""
    motion = bodies.velocities[body]
    center = bodies.centers[bodies.roots[body]]
    for axis in range(3):
        after = (axis + 1) % 3
        last = (axis + 2) % 3
        velocity[axis] = motion[3 + axis] + motion[after] * (point[last] - center[last])
        velocity[axis] -= motion[last] * (point[after] - center[after])


@kernel
def _in_camera(axes: Matrix, direction: Vector) -> tuple[float, float, float]:
    """Rotate a direction of the world into the camera, whose axes are the columns of a matrix."""
    x = direction[0]
    y = direction[1]
    z = direction[2]
    return (
        axes[0, 0] * x + axes[1, 0] * y + axes[2, 0] * z,
        axes[0, 1] * x + axes[1, 1] * y + axes[2, 1] * z,
        axes[0, 2] * x + axes[1, 2] * y + axes[2, 2] * z,
    )


@kernel
def _is_shown(
    x: float, y: float, z: float, radius: float, focal_px: float,
    size: tuple[int, int], region: tuple[int, int, int, int],
) -> bool:  # fmt: skip
    """Whether a sphere at a position in the camera can be visible in a region."""
    if z > -_NEAREST_M:
        return False
    left, top, right, bottom = region
    scale = focal_px / -z
    column = size[0] / 2 + x * scale
    row = size[1] / 2 - y * scale
    room = radius * scale
    return left - room < column < right + room and top - room < row < bottom + room


# Lens

LensMap: TypeAlias = npt.NDArray[np.float32]
"""Source coordinate of each pixel along one axis, in pixels, of shape (height, width)."""


@kernel
def source_region(
    columns: LensMap, rows: LensMap, region: tuple[int, int, int, int], stride: int
) -> tuple[int, int, int, int]:
    """Region of the undistorted image that a region of the distorted image is computed from.

    Args:
        columns: Source coordinates along x; NaN where the lens shows nothing.
        rows: Source coordinates along y.
        region: Region of the distorted image: left, top, right, bottom.
        stride: Edge in pixels of the blocks, of which only the corners are computed.

    Returns:
        Left, top, right, bottom, inside the image, with the four pixels that bilinear interpolation
        needs around each source; the first pixel if the lens shows nothing.
        rows: Places along y.
        region: Part of the picture: left, top, right, bottom.
        stride: Edge in pixels of the blocks of which the corner alone is looked at.

    Returns:
        Left, top, right, bottom, inside the image: four pixels about each place; the first pixel
        where nothing is seen.
    """
    height, width = columns.shape
    left = np.inf
    right = -np.inf
    top = np.inf
    bottom = -np.inf
    for row in range(region[1], region[3], stride):
        for column in range(region[0], region[2], stride):
            x = columns[row, column]
            y = rows[row, column]
            if not np.isnan(x):
                left = min(left, x)
                right = max(right, x)
                top = min(top, y)
                bottom = max(bottom, y)
    if right < left:
        return 0, 0, 1, 1
    # Sources beyond the border take the color of the border.
    return (
        min(max(int(left), 0), width - 1), min(max(int(top), 0), height - 1),
        min(int(right) + 2, width), min(int(bottom) + 2, height),
    )  # fmt: skip
