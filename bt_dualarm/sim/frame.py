"""Frames: one exposure of a camera, drawn when somebody looks at it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, Protocol, TypeAlias

import mujoco
import numpy as np

from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.sim.renderer import Image, Region, enter_blocks

# Annotations of a frame for the record, which no decision uses


@dataclass(frozen=True)
class FrameFinding:
    """A target, or none, in one frame.

    Attributes:
        stamp: Simulated time of the exposure in s.
        pixel: Center of what was taken for the target, from the image's top left corner; None
            where nothing was.
        area_px: Area of it in square pixels, 0 where nothing was.
        point: Estimated position of the target at the exposure, in the world, m; None before it
            was first seen.
        locked: Whether it had been seen in enough frames in a row.
    """

    stamp: float
    pixel: tuple[float, float] | None
    area_px: float
    point: tuple[float, float, float] | None
    locked: bool


JsonList: TypeAlias = list[Any]
"""What was found in an image as JSON can say it: numbers, texts, lists of them."""


class FrameMemory(Protocol):
    """What was found in a camera's images: kept for a record, or known from one."""

    @property
    def keeps(self) -> bool:
        """Whether anything is kept or known: else images do without."""

    def knows(self, stamp: float, region: Region, stride: int) -> bool:
        """Whether such an image is known, and what those who looked at it found."""

    def recall(self, stamp: float, question: str, look: Callable[[], JsonList]) -> JsonList:
        """The answer to a question about the image of a stamp.

        Args:
            stamp: Stamp of the image in s.
            question: Text that says what is looked for, and how.
            look: Function that looks at the pixels for it.
        """


@dataclass(frozen=True, eq=False)
class Frame:
    """One exposure.

    Pixel coordinates have their origin at the outer corner of the top left pixel, x to the
    right, y down: the center of that pixel is (0.5, 0.5), that of the image (width/2, height/2).

    Attributes:
        stamp: Simulated time of the exposure in s.
        image: Red, green, blue, of shape (height, width, 3), black outside ``region``.
        pose: Pose of the camera in the world at the exposure (x right, y down, z forward: OpenCV).
        fov_rad: Vertical field of view in rad.
        region: Part of the image that was exposed.
        stride: Edge of the blocks of pixels that share one sample; 1 for a full image.
        noise_px: Standard deviation along x and y of a shift of the whole image.
        memory: Memory of what is found in it, None where nobody keeps that.
        merges: Number of images that it is the mean of.
    """

    stamp: float
    image: Image
    pose: Pose
    fov_rad: float
    region: Region
    stride: int = 1
    noise_px: float = 0.0
    memory: FrameMemory | None = None
    merges: int = 1

    @cached_property
    def blocks(self) -> Image:
        """Colors of the blocks of what was exposed, of shape (rows, columns, 3)."""
        left, top, right, bottom = self.region
        return np.ascontiguousarray(
            self.image[top : bottom : self.stride, left : right : self.stride]
        )

    def posed(self, pose: Pose) -> Frame:
        """The same image, by a camera that is believed to have been elsewhere."""
        seen = self
        return Frame(
            seen.stamp, seen.image, pose, seen.fov_rad, seen.region, seen.stride, seen.noise_px,
            seen.memory, seen.merges,
        )  # fmt: skip

    def answer(self, question: str, look: Callable[[], JsonList]) -> JsonList:
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
        w = w / length
        x = x / length
        y = y / length
        z = z / length
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


# Lazy frame, rendered on first access in the state of its exposure


_KNOWN = tuple(field for field in fields(Frame) if field.name != "image")


class LazyFrame(Frame):
    """As `Frame`; what was exposed is drawn once, and not at all where nobody asks for it.

    Args:
        size: Width and height of the whole image in pixels.
        draw: Function that draws the blocks that were exposed, of shape (rows, columns, 3).
        known: All other attributes of a frame, in their order.
    """

    def __init__(self, size: tuple[int, int], draw: Callable[[], Image], *known: object) -> None:
        own = vars(self)
        own["_size"] = size
        own["_draw"] = draw
        for number, field in enumerate(_KNOWN):
            own[field.name] = known[number] if number < len(known) else field.default

    @classmethod
    def of(cls, frame: Frame, draw: Callable[[], Image], **changed: object) -> LazyFrame:
        """One as another frame is, of another image."""
        known = {**vars(frame), **changed}
        return cls((frame.width, frame.height), draw, *(known[field.name] for field in _KNOWN))

    def posed(self, pose: Pose) -> Frame:
        """The same image, by a camera that is believed to have been elsewhere."""
        return LazyFrame.of(self, lambda: self.blocks, pose=pose)

    @cached_property
    def blocks(self) -> Image:
        """Colors of the blocks of what was exposed, of shape (rows, columns, 3)."""
        draw: Callable[[], Image] = vars(self)["_draw"]
        return draw()

    @cached_property
    def image(self) -> Image:
        """Red, green, blue, of shape (height, width, 3), black outside ``region``."""
        image: Image = np.zeros((self.height, self.width, 3), np.uint8)
        if self.blocks.size:
            enter_blocks(image, self.region, self.stride, self.blocks)
        return image

    @property
    def width(self) -> int:
        """Width of the whole image in pixels."""
        return int(vars(self)["_size"][0])

    @property
    def height(self) -> int:
        """Height of the whole image in pixels."""
        return int(vars(self)["_size"][1])


@dataclass(frozen=True, eq=False)
class Scenery:
    """All that an image hangs on, at one moment: copies, for who draws it later.

    Attributes:
        model: Compiled world, which nobody changes.
        qpos: Positions in MuJoCo's order, of shape (nq,).
        qvel: Velocities in MuJoCo's order, of shape (nv,).
        mocap_pos: Positions of bodies that are moved from outside, of shape (nmocap, 3), m.
        mocap_quat: Their turns, of shape (nmocap, 4).
        cvel: Velocities of bodies, of shape (nbody, 6).
        subtree_com: Centers of mass that these are about, of shape (nbody, 3), m.
    """

    model: mujoco.MjModel
    qpos: Vector
    qvel: Vector
    mocap_pos: Matrix
    mocap_quat: Matrix
    cvel: Matrix
    subtree_com: Matrix

    @classmethod
    def of(cls, model: mujoco.MjModel, data: mujoco.MjData) -> Scenery:
        """The world as it is now."""
        names = [field.name for field in fields(cls) if field.name != "model"]
        return cls(model, *(getattr(data, name).copy() for name in names))

    def data(self) -> mujoco.MjData:
        """A state of its own, its kinematics up to date."""
        data = mujoco.MjData(self.model)
        for field in fields(self):
            if field.name != "model":
                getattr(data, field.name)[:] = getattr(self, field.name)
        cvel = data.cvel.copy()
        subtree_com = data.subtree_com.copy()
        mujoco.mj_kinematics(self.model, data)
        mujoco.mj_camlight(self.model, data)
        data.cvel[:] = cvel
        data.subtree_com[:] = subtree_com
        return data
