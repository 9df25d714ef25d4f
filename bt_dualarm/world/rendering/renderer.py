"""What a camera draws with: the interface that both renderers have, and what it is asked for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, Protocol, TypeAlias

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.world.robots.geom_groups import LOOP_GROUPS

Image: TypeAlias = npt.NDArray[np.uint8]
"""Red, green, blue, of shape (height, width, 3)."""

Region: TypeAlias = tuple[int, int, int, int]
"""Part of an image in pixels: left, top, right, bottom; right and bottom are outside."""

Blocks: TypeAlias = tuple[slice, slice]
"""Rows and columns of an image, counted in blocks of pixels that share a colour."""

RendererKind: TypeAlias = Literal["auto", "gl", "ray"]


@dataclass(frozen=True)
class Exposure:
    """What is drawn of a camera's image, and how finely.

    Attributes:
        camera_id: Number of the camera in the model.
        width: Width of the whole image in pixels.
        height: Height of the whole image in pixels.
        region: Part that is drawn, the rest stays black; None for the whole image.
        stride: Edge in pixels of the blocks that share a colour; 1 for a full image.
        groups: Geom groups that are visible.
        alone: Whether the colours of its blocks are asked for, of shape (rows, columns, 3), and no
            image that is black around them.
    """

    camera_id: int
    width: int
    height: int
    region: Region | None = None
    stride: int = 1
    groups: tuple[int, ...] = LOOP_GROUPS
    alone: bool = False

    def paint(self, draw: Callable[[Blocks], Image]) -> Image:
        """What is asked for: the image, of shape (height, width, 3), or its blocks alone.

        Args:
            draw: Colours of some blocks, of shape (rows, columns, 3); not called where the region
                is empty.
        """
        if self.is_empty:
            return np.zeros((0, 0, 3) if self.alone else (self.height, self.width, 3), np.uint8)
        blocks = draw(self.blocks)
        return blocks if self.alone else self.image_of(blocks)

    def image_of(self, blocks: Image) -> Image:
        """The image with these colours of its blocks, of shape (height, width, 3)."""
        image = np.zeros((self.height, self.width, 3), dtype=np.uint8)
        enter_blocks(image, self.clipped, self.stride, blocks, self.corner)
        return image

    @property
    def is_empty(self) -> bool:
        """Whether nothing is drawn."""
        left, top, right, bottom = self.clipped
        return right <= left or bottom <= top

    @property
    def blocks(self) -> Blocks:
        """Rows and columns of blocks that cover the region."""
        (left, top, right, bottom), step = self.clipped, self.stride
        return _covering(top, bottom, step), _covering(left, right, step)

    @property
    def corner(self) -> tuple[int, int]:
        """Column and row of the first pixel of the first block."""
        left, top, _, _ = self.clipped
        return left - left % self.stride, top - top % self.stride

    @cached_property
    def clipped(self) -> Region:
        """The part that is drawn, inside the image; may be empty."""
        return clip_region(self.region, self.width, self.height)


class Renderer(Protocol):
    """Draws what a camera of the model sees."""

    @property
    def name(self) -> str:
        """``"gl"`` or ``"ray"``."""

    def render(self, model: mujoco.MjModel, data: mujoco.MjData, exposure: Exposure) -> Image:
        """The image that is asked for, of shape (height, width, 3), or its blocks alone.

        Needs kinematics and camera poses of ``data`` to be up to date (``mj_kinematics``,
        ``mj_camlight``).
        """

    def close(self) -> None:
        """Give back what the renderer holds; harmless when repeated."""


def clip_region(region: Region | None, width: int, height: int) -> Region:
    """The part of ``region`` inside the image; the whole image for ``None``; may be empty."""
    if region is None:
        return 0, 0, width, height
    left, top = min(max(region[0], 0), width), min(max(region[1], 0), height)
    return left, top, max(left, min(region[2], width)), max(top, min(region[3], height))


def enter_blocks(
    image: Image, region: Region, step: int, blocks: Image, corner: tuple[int, int] | None = None
) -> None:
    """Enter blocks into a region of an image, of shape (height, width, 3).

    Args:
        image: Image that takes them.
        region: Part that they cover; the last ones may be cut off.
        step: Edge of a block in pixels.
        blocks: Their colours, of shape (rows, columns, 3).
        corner: Column and row of the first pixel of the first block; by default the region's.
    """
    if step == 1:
        left, top, right, bottom = region
        image[top:bottom, left:right] = blocks
        return
    from bt_dualarm.world.rendering.block_kernels import enter

    enter(image, region, corner or region[:2], step, np.ascontiguousarray(blocks))


def _covering(start: int, stop: int, stride: int) -> slice:
    """Numbers of the blocks of ``stride`` pixels that cover the pixels from start to stop."""
    return slice(start // stride, -(-stop // stride))
