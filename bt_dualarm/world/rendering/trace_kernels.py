"""What each ray of a fan meets first."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.rendering.hull_kernels import meet_hull
from bt_dualarm.world.rendering.kernel_arrays import (
    HULL,
    NOTHING,
    Fan,
    Hits,
    Marks,
    Numbers,
    Shapes,
)
from bt_dualarm.world.rendering.round_kernels import meet_round, outward
from bt_dualarm.world.rendering.screen_kernels import sphere_is_seen


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
        eye, turn = marks.eyes[index], marks.turns[index]
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
    rows, columns, count = fan.rays.shape[1], fan.rays.shape[2], len(shapes.geoms)
    faces, distances = np.empty((rows, columns), np.int32), np.empty((rows, columns))
    faces[:], distances[:] = -1, math.inf
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
    faces, owners = marks.faces.copy(), np.empty(known + count, np.int64)
    normals = np.empty((known + count, 3))
    owners[:known], normals[:known] = shapes.owners, marks.normals
    _add_rounds(shapes, axes, fan, marks, faces, owners, normals)
    return faces, owners, normals


@kernel
def _add_rounds(
    shapes: Shapes, axes: Matrix, fan: Fan, marks: Marks,
    faces: npt.NDArray[np.int32], owners: Numbers, normals: Matrix,
) -> None:  # fmt: skip
    """Enter a face for each ray that meets what is curved, after all others."""
    rays, eyes, turns, size = fan.rays, marks.eyes, marks.turns, shapes.sizes
    place, face = np.empty(3), len(shapes.owners)
    for row in range(faces.shape[0]):
        for column in range(faces.shape[1]):
            if faces[row, column] >= NOTHING:
                continue
            index = -2 - faces[row, column]
            geom, away = shapes.geoms[index], marks.distances[row, column]
            x, y, z = rays[0, row, column], rays[1, row, column], rays[2, row, column]
            for axis in range(3):
                along = turns[index, axis, 0] * x + turns[index, axis, 1] * y
                along += turns[index, axis, 2] * z
                place[axis] = eyes[index, axis] + away * along
            kind, radius, half = shapes.kinds[index], size[index, 0], size[index, 1]
            u, v, w = outward(kind, radius, half, place[0], place[1], place[2])
            own = axes[geom]
            for axis in range(3):
                along = own[3 * axis] * u + own[3 * axis + 1] * v
                normals[face, axis] = along + own[3 * axis + 2] * w
            faces[row, column], owners[face] = face, geom
            face += 1


@kernel
def _ahead(shapes: Shapes, places: Matrix, fan: Fan) -> Numbers:
    """Numbers of the shapes whose bounding sphere reaches into the fan, planes last.

    In the order of distance; of shapes that lie in one surface, the first is seen.
    """
    count = len(shapes.geoms)
    closest, center = np.empty(count), np.empty(3)
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
