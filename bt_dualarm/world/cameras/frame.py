"""What a camera saw: one exposure, and where its pixels look in the world."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol, TypeAlias

import numpy as np

from bt_dualarm.pose import Pose, Vector
from bt_dualarm.world.rendering.renderer import Image, Region

Plain: TypeAlias = list[Any]
"""What was found in a picture as JSON can say it: numbers, texts, lists of them."""


class Memory(Protocol):
    """What was found in a camera's pictures: kept for a record, or known from one."""

    @property
    def keeps(self) -> bool:
        """Whether anything is kept or known: else pictures do without."""

    def knows(self, stamp: float, region: Region, stride: int) -> bool:
        """Whether such a picture is known, and what those who looked at it found."""

    def recall(self, stamp: float, question: str, look: Callable[[], Plain]) -> Plain:
        """The answer to a question about the picture of a stamp.

        Args:
            stamp: Stamp of the picture in s.
            question: Text that says what is looked for, and how.
            look: Function that looks at the pixels for it.
        """


@dataclass(frozen=True, eq=False)
class Frame:
    """One exposure.

    Pixel coordinates have their origin at the outer corner of the top left pixel, x to the
    right, y down: the centre of that pixel is (0.5, 0.5), that of the image (width/2, height/2).

    Attributes:
        stamp: Simulated time of the exposure in s.
        image: Red, green, blue, of shape (height, width, 3), black outside ``region``.
        pose: Pose of the camera in the world at the exposure (x right, y down, z forward: OpenCV).
        fov_rad: Vertical field of view in rad.
        region: Part of the image that was exposed.
        stride: Edge of the blocks of pixels that share one sample; 1 for a full image.
        noise_px: Standard deviation along x and y of a shift of the whole image.
        memory: Memory of what is found in it, None where nobody keeps that.
        merges: Number of pictures that it is the mean of.
    """

    stamp: float
    image: Image
    pose: Pose
    fov_rad: float
    region: Region
    stride: int = 1
    noise_px: float = 0.0
    memory: Memory | None = None
    merges: int = 1

    @cached_property
    def blocks(self) -> Image:
        """Colours of the blocks of what was exposed, of shape (rows, columns, 3)."""
        left, top, right, bottom = self.region
        return np.ascontiguousarray(
            self.image[top : bottom : self.stride, left : right : self.stride]
        )

    def posed(self, pose: Pose) -> Frame:
        """The same picture, by a camera that is believed to have been elsewhere."""
        seen = self
        return Frame(
            seen.stamp, seen.image, pose, seen.fov_rad, seen.region, seen.stride, seen.noise_px,
            seen.memory, seen.merges,
        )  # fmt: skip

    def answer(self, question: str, look: Callable[[], Plain]) -> Plain:
        """What is found in it; not looked for where that is known; arguments as of `Memory`."""
        if self.memory is None:
            return look()
        return self.memory.recall(self.stamp, f"{question} in {self.merges}", look)

    @property
    def width(self) -> int:
        """Width of the whole image in pixels."""
        return int(self.image.shape[1])

    @property
    def height(self) -> int:
        """Height of the whole image in pixels."""
        return int(self.image.shape[0])

    @cached_property
    def focal_px(self) -> float:
        """Focal length in pixels, the same in x and y."""
        return focal_length_px(self.height, self.fov_rad)

    @cached_property
    def world_in_camera(self) -> Pose:
        """The inverse of ``pose``, worked out once."""
        return self.pose.inverse

    @cached_property
    def right(self) -> Vector:
        """Unit vector of the image's x axis in the world, of shape (3,), worked out once."""
        w, x, y, z = self.pose.quaternion.tolist()
        length = math.sqrt(x * x + y * y + z * z + w * w)
        w, x, y, z = w / length, x / length, y / length, z / length
        return np.array((x * x - y * y - z * z + w * w, 2 * (x * y + z * w), 2 * (x * z - y * w)))

    def ray(self, pixel: tuple[float, float]) -> Vector:
        """Direction in the world, of shape (3,), through a pixel; 1 m deep along the view axis."""
        x = (pixel[0] - self.width / 2.0) / self.focal_px
        y = (pixel[1] - self.height / 2.0) / self.focal_px
        direction: Vector = self.pose.turn(np.array((x, y, 1.0)))
        return direction


@dataclass(frozen=True)
class Window:
    """What a tracker wants exposed: a part of the image (all for ``None``) and how finely."""

    region: Region | None = None
    stride: int = 1


def focal_length_px(height: int, fov_rad: float) -> float:
    """Focal length in pixels of an image ``height`` pixels high."""
    return height / 2.0 / math.tan(fov_rad / 2.0)
