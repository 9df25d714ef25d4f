"""Colours of what rays have met."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.pose import Matrix
from bt_dualarm.world.rendering.kernel_arrays import NOTHING, Fan, Hits, Lights, Numbers, Shapes
from bt_dualarm.world.rendering.trace_kernels import facets, trace


@kernel
def draw(
    shapes: Shapes, places: Matrix, axes: Matrix, fan: Fan, lights: Lights,
    lit_from: Matrix, lit_along: Matrix, pixels: npt.NDArray[np.uint8],
) -> None:  # fmt: skip
    """Enter the colours of what the rays meet; arguments as of `trace` and `shade`."""
    marks = trace(shapes, places, axes, fan)
    faces, owners, normals = facets(shapes, axes, fan, marks)
    sun = _sun(lights, lit_from, lit_along)
    _shade(lights, sun, fan, faces, owners, normals, marks.distances, pixels)


@kernel
def shade(
    lights: Lights, lit_from: Matrix, lit_along: Matrix, fan: Fan, hits: Hits,
    pixels: npt.NDArray[np.uint8],
) -> None:  # fmt: skip
    """Enter colours into the pixels, of shape (rows, columns, 3): sky where nothing was met.

    Args:
        lights: The lights.
        lit_from: Places of all lights of the model, of shape (nlight, 3), in m.
        lit_along: Unit vectors along which they shine, of shape (nlight, 3).
        fan: The rays.
        hits: What they met.
        pixels: The pixels.
    """
    rows, columns = hits.geoms.shape
    faces, owners = np.empty((rows, columns), np.int32), np.empty(rows * columns, np.int64)
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
    """As `shade`, of faces as of `facets`; lights are at, or towards, `sun`, of shape (n, 3)."""
    light, sky = np.empty(3), _sky(lights)
    rays, axes, eye = fan.rays, fan.axes, fan.eye
    for row in range(pixels.shape[0]):
        for column in range(pixels.shape[1]):
            face = faces[row, column]
            if face < 0:
                for channel in range(3):
                    pixels[row, column, channel] = sky[channel]
                continue
            right, up, back = rays[0, row, column], rays[1, row, column], rays[2, row, column]
            rx = axes[0, 0] * right + axes[0, 1] * up + axes[0, 2] * back
            ry = axes[1, 0] * right + axes[1, 1] * up + axes[1, 2] * back
            rz = axes[2, 0] * right + axes[2, 1] * up + axes[2, 2] * back
            u, v, w = normals[face, 0], normals[face, 1], normals[face, 2]
            facing = -(u * rx + v * ry + w * rz)
            for channel in range(3):
                light[channel] = lights.ambient[channel] + facing * lights.head[channel]
            for index in range(len(sun)):
                x, y, z = sun[index, 0], sun[index, 1], sun[index, 2]
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
    """The colour of the sky, which no light falls on, of shape (3,)."""
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
    """Places of the lights that are on, the direction towards those that are distant, (n, 3)."""
    sun = np.empty((len(lights.active), 3))
    for index in range(len(sun)):
        for axis in range(3):
            if lights.distant[index]:
                sun[index, axis] = -lit_along[lights.active[index], axis]
            else:
                sun[index, axis] = lit_from[lights.active[index], axis]
    return sun
