"""Interface of the renderers: exposures, blocks of pixels, and viewpoints.

A camera asks a `Renderer` for an `Exposure`: a region of its image, in full resolution or in blocks
of pixels that share a color. `ray_renderer` and `gl_renderer` implement the protocol.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, Protocol, TypeAlias

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.robots.mjspec import LOOP_GROUPS

Image: TypeAlias = npt.NDArray[np.uint8]
"""Red, green, blue, of shape (height, width, 3)."""

Region: TypeAlias = tuple[int, int, int, int]
"""Part of an image in pixels: left, top, right, bottom; right and bottom are outside."""

Blocks: TypeAlias = tuple[slice, slice]
"""Rows and columns of an image, counted in blocks of pixels that share a color."""

RendererKind: TypeAlias = Literal["auto", "gl", "ray"]


@dataclass(frozen=True)
class Exposure:
    """A region of a camera's image, and the resolution in which it is rendered.

    Attributes:
        camera_id: Id of the camera in the model.
        width: Width of the whole image in pixels.
        height: Height of the whole image in pixels.
        region: Region that is rendered, the rest stays black; None for the whole image.
        stride: Edge in pixels of the blocks that share a color; 1 for full resolution.
        groups: Geom groups that are visible.
        alone: Whether the result is an array of the blocks' colors, of shape (rows, columns, 3),
            instead of a full image.
    """

    camera_id: int
    width: int
    height: int
    region: Region | None = None
    stride: int = 1
    groups: tuple[int, ...] = LOOP_GROUPS
    alone: bool = False

    def paint(self, draw: Callable[[Blocks], Image]) -> Image:
        """Render the image, of shape (height, width, 3), or its blocks alone.

        Args:
            draw: Function that returns the colors of some blocks, of shape (rows, columns, 3); not
                called for an empty region.
        """
        if self.is_empty:
            return np.zeros((0, 0, 3) if self.alone else (self.height, self.width, 3), np.uint8)
        blocks = draw(self.blocks)
        return blocks if self.alone else self.image_of(blocks)

    def image_of(self, blocks: Image) -> Image:
        """The image with these colors of its blocks, of shape (height, width, 3)."""
        image = np.zeros((self.height, self.width, 3), dtype=np.uint8)
        enter_blocks(image, self.clipped, self.stride, blocks, self.corner)
        return image

    @property
    def is_empty(self) -> bool:
        """Whether the clipped region is empty."""
        left, top, right, bottom = self.clipped
        return right <= left or bottom <= top

    @property
    def blocks(self) -> Blocks:
        """Rows and columns of blocks that cover the region."""
        (left, top, right, bottom) = self.clipped
        step = self.stride
        return _covering(top, bottom, step), _covering(left, right, step)

    @property
    def corner(self) -> tuple[int, int]:
        """Column and row of the first pixel of the first block."""
        left, top, _, _ = self.clipped
        return left - left % self.stride, top - top % self.stride

    @cached_property
    def clipped(self) -> Region:
        """The region inside the image; may be empty."""
        return clip_region(self.region, self.width, self.height)


class RenderableWorld(Protocol):
    """The part of a world that images are rendered from."""

    @property
    def model(self) -> mujoco.MjModel:
        """Compiled model of the world."""

    @property
    def data(self) -> mujoco.MjData:
        """State of the model."""


class Renderer(Protocol):
    """Renders the images of a model's cameras."""

    @property
    def name(self) -> str:
        """``"gl"`` or ``"ray"``."""

    def render(self, model: mujoco.MjModel, data: mujoco.MjData, exposure: Exposure) -> Image:
        """Render an image of shape (height, width, 3), or its blocks alone.

        Needs kinematics and camera poses of ``data`` to be up to date (``mj_kinematics``,
        ``mj_camlight``).
        """

    def close(self) -> None:
        """Free the renderer's resources; harmless when repeated."""


def clip_region(region: Region | None, width: int, height: int) -> Region:
    """The part of ``region`` inside the image; the whole image for ``None``; may be empty."""
    if region is None:
        return 0, 0, width, height
    left = min(max(region[0], 0), width)
    top = min(max(region[1], 0), height)
    return left, top, max(left, min(region[2], width)), max(top, min(region[3], height))


def enter_blocks(
    image: Image, region: Region, step: int, blocks: Image, corner: tuple[int, int] | None = None
) -> None:
    """Write blocks into a region of an image, of shape (height, width, 3).

    Args:
        image: Image, changed in place.
        region: Region that they cover; the last blocks may be cut off.
        step: Edge of a block in pixels.
        blocks: Their colors, of shape (rows, columns, 3).
        corner: Column and row of the first pixel of the first block; by default the region's.
    """
    if step == 1:
        left, top, right, bottom = region
        image[top:bottom, left:right] = blocks
        return
    from bt_dualarm.sim.ray_trace_kernels import enter

    enter(image, region, corner or region[:2], step, np.ascontiguousarray(blocks))


def _covering(start: int, stop: int, stride: int) -> slice:
    """Indices of the blocks of ``stride`` pixels that cover the pixels from start to stop."""
    return slice(start // stride, -(-stop // stride))


# Viewpoints

_MARGIN = 1.06
"""Factor of the distance that leaves a margin around the points at the edge of the image."""


@dataclass(frozen=True, eq=False)
class Viewpoint:
    """A pinhole camera that is not part of the model, for images for people.

    Attributes:
        eye: Position of the camera in the world, of shape (3,), m.
        look_at: Point of the world in the middle of the image, of shape (3,), m.
        fov_deg: Vertical field of view.
    """

    eye: Vector
    look_at: Vector
    fov_deg: float

    @cached_property
    def axes(self) -> Matrix:
        """Axes as columns, of shape (3, 3), in MuJoCo's convention: x right, y up, z backward."""
        return _axes_toward(self.eye - self.look_at)

    def pixels(self, points: Matrix, width: int, height: int) -> Matrix:
        """Project points of the world, of shape (n, 3), to pixels, of shape (n, 2)."""
        inside = (points - self.eye) @ self.axes
        focal = height / 2 / math.tan(math.radians(self.fov_deg) / 2)
        x = width / 2 - focal * inside[:, 0] / inside[:, 2]
        y = height / 2 + focal * inside[:, 1] / inside[:, 2]
        return np.column_stack((x, y))


def fitted(points: Matrix, direction: Vector, fov_deg: float, aspect: float) -> Viewpoint:
    """The nearest viewpoint in a given direction whose image contains all points.

    Args:
        points: Points of the world, of shape (n, 3), at least one, m.
        direction: Vector from the scene to the camera, of shape (3,), not vertical.
        fov_deg: Vertical field of view.
        aspect: Width of the image over its height.
    """
    axes = _axes_toward(direction)
    inside = points @ axes
    middle = (inside.min(axis=0) + inside.max(axis=0)) / 2
    inside -= middle
    slope = math.tan(math.radians(fov_deg) / 2) / _MARGIN
    needs = np.abs(inside[:, :2]) / (slope * aspect, slope) + inside[:, 2:]
    look_at = axes @ middle
    return Viewpoint(look_at + float(needs.max()) * axes[:, 2], look_at, fov_deg)


def _axes_toward(backward: Vector) -> Matrix:
    """Camera axes as columns, z along ``backward``, x horizontal."""
    z = backward / np.linalg.norm(backward)
    x = np.cross((0.0, 0.0, 1.0), z)
    x /= np.linalg.norm(x)
    return np.column_stack((x, np.cross(z, x), z))
