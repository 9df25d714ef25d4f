"""Markers on objects, as thin white and black boxes: renderers draw them, nothing feels them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import cv2
import mujoco
import numpy as np

from bt_dualarm.spec.document import ObjectSpec
from bt_dualarm.spec.marker import MarkerSpec
from bt_dualarm.world.robots.geom_groups import OBJECT_GROUP

BOARD_M: Final = 1e-4
"""Half of the thickness of the white board; the black cells are as thick again above it."""

DICTIONARIES: Final = {
    "aruco_4x4_50": cv2.aruco.DICT_4X4_50,
    "aruco_5x5_50": cv2.aruco.DICT_5X5_50,
    "aruco_6x6_50": cv2.aruco.DICT_6X6_50,
    "apriltag_16h5": cv2.aruco.DICT_APRILTAG_16h5,
    "apriltag_36h11": cv2.aruco.DICT_APRILTAG_36h11,
}
"""OpenCV's numbers of the sets."""


def marker_height(thing: ObjectSpec) -> float:
    """Height in m of an object's marker above its centre, in its own frame."""
    return 0.5 * thing.size[-1] + 4 * BOARD_M


def add_marker(body: mujoco.MjsBody, thing: ObjectSpec) -> None:
    """Add the boxes of an object's marker to its body, if it has one."""
    marker = thing.marker
    if marker is None:
        return
    top, half = 0.5 * thing.size[-1], 0.5 * marker.board
    _box(body, (0.0, 0.0, top + BOARD_M), (half, half, BOARD_M), 0.95)
    for x, y, wide, high in black_parts(marker):
        place, size = (x, y, top + 3 * BOARD_M), (wide / 2, high / 2, BOARD_M)
        _box(body, place, size, 0.02)


def black_parts(marker: MarkerSpec) -> Iterator[tuple[float, float, float, float]]:
    """Middle (x, y) and edges of boxes that cover the black cells of a marker, m.

    The marker's first corner is at -x, +y: seen from above it stands as it is printed.
    """
    count, cell = marker.cells, marker.size / marker.cells
    found = cv2.aruco.getPredefinedDictionary(DICTIONARIES[marker.dictionary])
    image = np.asarray(found.generateImageMarker(marker.id, count))
    for row in range(count):
        column = 0
        while column < count:
            begin = column
            while column < count and image[row, column] == 0:
                column += 1
            if column > begin:
                x = (0.5 * (begin + column) - 0.5 * count) * cell
                yield x, (0.5 * count - row - 0.5) * cell, (column - begin) * cell, cell
            column += 1


def _box(
    body: mujoco.MjsBody,
    place: tuple[float, float, float],
    size: tuple[float, float, float],
    grey: float,
) -> None:
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=place,
        size=size,
        mass=0.0,
        contype=0,
        conaffinity=0,
        rgba=(grey, grey, grey, 1.0),
        group=OBJECT_GROUP,
    )
