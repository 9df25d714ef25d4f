"""How far an outline in a picture is from that of a known shape, and by what that changes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.vision.edges import INSIDE_PX, OutlineView
from bt_dualarm.vision.known_shape import KnownShape

UNKNOWNS: Final = 14
"""Place and turn of the thing (3 + 3), turn and shift of the mount (3 + 3), focal length, rim."""

PLACE: Final = slice(0, 3)
TURN: Final = slice(3, 6)
MOUNT_TURN: Final = slice(6, 9)
MOUNT_SHIFT: Final = slice(9, 12)
FOCAL: Final = 12
RIM: Final = 13

_NEAREST_M: Final = 0.01
"""Depth before the camera below which nothing is seen."""


@dataclass(frozen=True, eq=False)
class Scene:
    """All that is unknown about some pictures of one thing.

    Attributes:
        position: Centre of the thing in the world, of shape (3,), m.
        rotation: Its axes in the world, of shape (3, 3).
        mount_turn: Axes of the camera in the frame where it is believed to be, of shape (3, 3).
        mount_shift: Place of the camera there, of shape (3,), m.
        longer: Share by which the focal length is longer than believed.
        rim: Pixels by which outlines are wider than what they are of.
    """

    position: Vector
    rotation: Matrix
    mount_turn: Matrix
    mount_shift: Vector
    longer: float = 0.0
    rim: float = 0.0

    @classmethod
    def believed(cls, position: Vector, rotation: Matrix) -> Scene:
        """A thing there, and a camera as it is believed to be."""
        return cls(position, rotation, np.eye(3), np.zeros(3))

    def moved(self, step: Vector) -> Scene:
        """The scene after a step in all unknowns, of shape (`UNKNOWNS`,): m, rad, share, px."""
        return replace(
            self,
            position=self.position + step[PLACE],
            rotation=turn_by(step[TURN]) @ self.rotation,
            mount_turn=self.mount_turn @ turn_by(step[MOUNT_TURN]),
            mount_shift=self.mount_shift + step[MOUNT_SHIFT],
            longer=self.longer + float(step[FOCAL]),
            rim=self.rim + float(step[RIM]),
        )


def turn_by(vector: Vector) -> Matrix:
    """The rotation, of shape (3, 3), about a vector of shape (3,) by its length in rad."""
    return np.asarray(cv2.Rodrigues(np.asarray(vector, dtype=float))[0], dtype=float)


def vector_of(turn: Matrix) -> Vector:
    """The vector, of shape (3,), rad, that `turn_by` makes a rotation of shape (3, 3) of."""
    return np.asarray(cv2.Rodrigues(np.asarray(turn, dtype=float))[0][:, 0], dtype=float)


def cross_matrix(v: Vector) -> Matrix:
    """The matrix, of shape (3, 3), that takes a vector to its product with ``v`` before it."""
    x, y, z = v.tolist()
    return np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)))


@dataclass(frozen=True, eq=False)
class Projection:
    """Points of a shape in one picture, and by what they change.

    Attributes:
        pixels: Place of each point from the image's middle, of shape (n, 2), px.
        change: Change of each with the unknowns, of shape (n, 2, `UNKNOWNS`).
        hull: Which points make the outline, in its order, of shape (m,).
    """

    pixels: Matrix
    change: Matrix
    hull: npt.NDArray[np.intp]

    @property
    def area(self) -> float:
        """Area within the outline, square px."""
        return float(cv2.contourArea(self.pixels[self.hull].astype(np.float32)))

    @property
    def middle(self) -> Vector:
        """Middle of the outline's box from the image's middle, of shape (2,), px."""
        on = self.pixels[self.hull]
        middle: Vector = (on.min(axis=0) + on.max(axis=0)) / 2.0
        return middle


def project(scene: Scene, shape: KnownShape, view: OutlineView) -> Projection | None:
    """The shape as a picture would have it; None where a part of it is behind the camera."""
    from bt_dualarm.vision.outline_kernels import see

    camera = view.camera
    inward = np.ascontiguousarray(camera.rotation_matrix @ scene.mount_turn)
    eye = camera.apply(scene.mount_shift)
    about = np.ascontiguousarray(shape.seen_from(eye - scene.position, scene.rotation))
    focal = view.focal_px * (1.0 + scene.longer)
    pixels, change = np.empty((len(about), 2)), np.empty((len(about), 2, UNKNOWNS))
    offset, mount = scene.position - eye, np.ascontiguousarray(scene.mount_turn)
    focals = focal, view.focal_px
    if see(about, offset, inward, mount, focals, pixels, change) < _NEAREST_M:
        return None
    if shape.is_round:  # its outline does not turn with it, but the balls that have it do
        a, b, c = shape.ball_centers(scene.rotation).T[:, :, None]
        x, y, z = change[:, :, PLACE].transpose(2, 0, 1)
        turn = (b * z - c * y, c * x - a * z, a * y - b * x)  # the cross product
        change[:, :, TURN] = np.stack(turn, axis=2)
    around = cv2.convexHull(pixels.astype(np.float32), returnPoints=False)
    hull = np.asarray(around, dtype=np.intp)[:, 0]
    return Projection(pixels, change, hull)


def outline_error(projection: Projection, edge: Matrix, rim: float) -> tuple[Vector, Matrix]:
    """Distance of points from an outline, outside positive, and its change with the unknowns.

    Args:
        projection: Projection of the shape.
        edge: Points of shape (n, 2), px.
        rim: Pixels by which they are expected outside.

    Returns:
        Distances of shape (n,), px, and their change, of shape (n, `UNKNOWNS`).
    """
    from bt_dualarm.vision.outline_kernels import measure

    error, jacobian = np.empty(len(edge)), np.empty((len(edge), UNKNOWNS))
    corners, ends = projection.pixels[projection.hull], projection.change[projection.hull]
    measure(corners, ends, np.ascontiguousarray(edge), INSIDE_PX - rim, error, jacobian)
    return error, jacobian


def outline_something() -> None:
    """Have all kernels of outlines compiled."""
    from bt_dualarm.vision.outline_kernels import measure, see

    points, pixels, change = np.eye(4, 3), np.empty((4, 2)), np.empty((4, 2, UNKNOWNS))
    see(points, np.array((0.0, 0.0, 1.0)), np.eye(3), np.eye(3), (1.0, 1.0), pixels, change)
    measure(pixels, change, pixels, 0.0, np.empty(4), np.empty((4, UNKNOWNS)))
