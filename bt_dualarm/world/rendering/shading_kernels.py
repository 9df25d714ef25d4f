"""Colours of what rays have met."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.pose import Vector
from bt_dualarm.world.rendering.kernel_arrays import Fan, Hits, Lights


@kernel
def shade(lights: Lights, fan: Fan, hits: Hits, pixels: npt.NDArray[np.uint8]) -> None:
    """Enter colours into the pixels, of shape (rows, columns, 3): sky where nothing was met."""
    light, ray, normal = np.empty(3), np.empty(3), np.empty(3)
    for row in range(pixels.shape[0]):
        for column in range(pixels.shape[1]):
            geom = hits.geoms[row, column]
            if geom < 0:
                for channel in range(3):
                    light[channel] = 1.0
            else:
                for axis in range(3):
                    ray[axis] = 0.0
                    for other in range(3):
                        ray[axis] += fan.axes[axis, other] * fan.rays[other, row, column]
                    normal[axis] = hits.normals[axis, row, column]
                _illuminate(lights, fan.eye, ray, hits.distances[row, column], normal, light)
            for channel in range(3):
                shaded = min(max(lights.base[geom, channel] * light[channel], 0.0), 1.0)
                pixels[row, column, channel] = np.uint8(shaded * 255.0 + 0.5)


@kernel
def _illuminate(
    lights: Lights, eye: Vector, ray: Vector, distance: float, normal: Vector, light: Vector
) -> None:
    """The light on a surface, into ``light`` of shape (3,)."""
    facing = -(normal[0] * ray[0] + normal[1] * ray[1] + normal[2] * ray[2])
    for channel in range(3):
        light[channel] = lights.ambient[channel] + facing * lights.head[channel]
    for index in range(len(lights.places)):
        x, y, z = lights.places[index, 0], lights.places[index, 1], lights.places[index, 2]
        if not lights.distant[index]:
            x -= eye[0] + ray[0] * distance
            y -= eye[1] + ray[1] * distance
            z -= eye[2] + ray[2] * distance
            length = math.sqrt(x * x + y * y + z * z)
            x, y, z = x / length, y / length, z / length
        lambert = max(normal[0] * x + normal[1] * y + normal[2] * z, 0.0)
        for channel in range(3):
            light[channel] += lambert * lights.diffuse[index, channel]
