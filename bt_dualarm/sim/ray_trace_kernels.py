"""Which surface each ray meets first, and what color it has there: compiled."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from bt_dualarm.core.kernel import kernel
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.sim.ray_intersection_kernels import meet_hull, meet_round, outward, sphere_is_seen
from bt_dualarm.sim.ray_kernel_arrays import (
    HULL,
    NOTHING,
    Fan,
    Hits,
    Lights,
    Marks,
    Numbers,
    Shapes,
)

# What each ray of a fan meets first.


@kernel
def trace(shapes: Shapes, places: Matrix, axes: Matrix, fan: Fan) -> Marks:
    """Mark the nearest surfaces.

    Args:
        shapes: The shapes of n geoms.
        places: Places of all geoms of the model, of shape (ngeom, 3), in m.
        axes: Axes of all geoms of the model, row by row, of shape (ngeom, 9).
        fan: The rays.

    Returns:
        What they meet.
    """
    marks = _nothing(shapes, fan)
    for index in _ahead(shapes, places, fan):
        geom = shapes.geoms[index]
        own = axes[geom].reshape(3, 3)
        eye = marks.eyes[index]
        turn = marks.turns[index]
        for one in range(3):
            eye[one] = 0.0
            for other in range(3):
                eye[one] += (fan.eye[other] - places[geom, other]) * own[other, one]
                turn[one, other] = 0.0
                for between in range(3):
                    turn[one, other] += own[between, one] * fan.axes[between, other]
        if shapes.kinds[index] == HULL:
            meet_hull(shapes, index, own, fan, marks)
        else:
            meet_round(shapes, index, own, fan, marks)
    return marks


@kernel
def _nothing(shapes: Shapes, fan: Fan) -> Marks:
    """Marks of rays that have met nothing yet."""
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
    """What is marked; arguments as of `trace`."""
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
    """The faces that rays meet; of what is curved, one for each ray; arguments as of `describe`.

    Returns:
        Number of the face that each ray meets, -1 for nothing, of shape (rows, columns); numbers
        of the faces' geoms, of shape (n,); their outward unit normals in the world, (n, 3).
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
    """Enter a face for each ray that meets what is curved, after all others."""
    rays = fan.rays
    eyes = marks.eyes
    turns = marks.turns
    size = shapes.sizes
    place = np.empty(3)
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
                place[axis] = eyes[index, axis] + away * along
            kind = shapes.kinds[index]
            radius = size[index, 0]
            half = size[index, 1]
            u, v, w = outward(kind, radius, half, place[0], place[1], place[2])
            own = axes[geom]
            for axis in range(3):
                along = own[3 * axis] * u + own[3 * axis + 1] * v
                normals[face, axis] = along + own[3 * axis + 2] * w
            faces[row, column] = face
            owners[face] = geom
            face += 1


@kernel
def _ahead(shapes: Shapes, places: Matrix, fan: Fan) -> Numbers:
    """Numbers of the shapes whose bounding sphere reaches into the fan, planes last.

    In the order of distance; of shapes that lie in one surface, the first is seen.
    """
    count = len(shapes.geoms)
    closest = np.empty(count)
    center = np.empty(3)
    for index in range(count):
        closest[index] = math.nan
        for axis in range(3):
            center[axis] = 0.0
            for along in range(3):
                offset = places[shapes.geoms[index], along] - fan.eye[along]
                center[axis] += offset * fan.axes[along, axis]
        radius = shapes.radii[index]
        if sphere_is_seen(fan, center, radius):
            away = math.sqrt(center[0] ** 2 + center[1] ** 2 + center[2] ** 2)
            closest[index] = math.inf if math.isinf(radius) else max(away - radius, 0.0)
    return _by_distance(closest)


@kernel
def _by_distance(closest: Vector) -> Numbers:
    """Numbers of those that are not NaN, nearest first, equal ones as they come."""
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


# Colors of what rays have met.


@kernel
def draw(
    shapes: Shapes, places: Matrix, axes: Matrix, fan: Fan, lights: Lights,
    lit_from: Matrix, lit_along: Matrix, pixels: npt.NDArray[np.uint8],
) -> None:  # fmt: skip
    """Enter the colors of what the rays meet; arguments as of `trace` and `shade`."""
    marks = trace(shapes, places, axes, fan)
    faces, owners, normals = facets(shapes, axes, fan, marks)
    sun = _sun(lights, lit_from, lit_along)
    _shade(lights, sun, fan, faces, owners, normals, marks.distances, pixels)


@kernel
def shade(
    lights: Lights, lit_from: Matrix, lit_along: Matrix, fan: Fan, hits: Hits,
    pixels: npt.NDArray[np.uint8],
) -> None:  # fmt: skip
    """Enter colors into the pixels, of shape (rows, columns, 3): sky where nothing was met.

    Args:
        lights: The lights.
        lit_from: Places of all lights of the model, of shape (nlight, 3), in m.
        lit_along: Unit vectors along which they shine, of shape (nlight, 3).
        fan: The rays.
        hits: What they met.
        pixels: The pixels.
    """
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
    sun = _sun(lights, lit_from, lit_along)
    _shade(lights, sun, fan, faces, owners, normals, hits.distances, pixels)


@kernel
def _shade(
    lights: Lights, sun: Matrix, fan: Fan, faces: npt.NDArray[np.int32], owners: Numbers,
    normals: Matrix, distances: Matrix, pixels: npt.NDArray[np.uint8],
) -> None:  # fmt: skip
    """As `shade`, of faces as of `facets`; lights are at, or toward, `sun`, of shape (n, 3)."""
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
    """The color of the sky, which no light falls on, of shape (3,)."""
    sky = np.empty(3, np.uint8)
    for channel in range(3):
        sky[channel] = _level(lights.base[-1, channel])
    return sky


@kernel
def _level(shaded: float) -> np.uint8:
    """The level, of 255, of a share of full brightness."""
    return np.uint8(min(max(shaded, 0.0), 1.0) * 255.0 + 0.5)


@kernel
def _sun(lights: Lights, lit_from: Matrix, lit_along: Matrix) -> Matrix:
    """Places of the lights that are on, the direction toward those that are distant, (n, 3)."""
    sun = np.empty((len(lights.active), 3))
    for index in range(len(sun)):
        for axis in range(3):
            if lights.distant[index]:
                sun[index, axis] = -lit_along[lights.active[index], axis]
            else:
                sun[index, axis] = lit_from[lights.active[index], axis]
    return sun


# Blocks of pixels that share a color, in an image.


@kernel
def enter(
    image: npt.NDArray[np.uint8],
    region: tuple[int, int, int, int],
    corner: tuple[int, int],
    step: int,
    blocks: npt.NDArray[np.uint8],
) -> None:
    """Enter blocks into a region of an image, of shape (height, width, 3).

    Args:
        image: Image that takes them.
        region: Part that they cover: left, top, right, bottom.
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
            for place in range(len(part)):
                part[place] = inside[place]
