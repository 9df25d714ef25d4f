"""Camera frames: one exposure each, rendered when its pixels are first read.

`Frame` is the image with the pose of the camera. `LazyFrame` renders on demand: when a record
already knows what perception found in a frame, its pixels are never needed. `Scenery` is the copied
state that such a frame is rendered from.
"""

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


@dataclass(frozen=True)
class FrameFinding:
    """Annotation of a frame for the record: the tracked target, if it was detected.

    Attributes:
        stamp: Simulated time of the exposure in s.
        pixel: Center of the detection, from the image's top left corner; None without one.
        area_px: Area of the detection in square pixels, 0 without one.
        point: Estimated position of the target at the exposure, in the world, m; None before the
            first detection.
        locked: Whether the target was detected in enough consecutive frames.
    """

    stamp: float
    pixel: tuple[float, float] | None
    area_px: float
    point: tuple[float, float, float] | None
    locked: bool


JsonList: TypeAlias = list[Any]
"""Results of image processing in JSON's types: numbers, strings, lists of them."""


class FrameMemory(Protocol):
    """Results of image processing, kept for a record or read back from one."""

    @property
    def keeps(self) -> bool:
        """Whether results are kept at all; if not, frames ignore the memory."""

    def knows(self, stamp: float, region: Region, stride: int) -> bool:
        """Whether the results for this image are known, so that it need not be rendered."""

    def recall(self, stamp: float, question: str, look: Callable[[], JsonList]) -> JsonList:
        """Result of one processing step on the image of a stamp, known or computed.

        Args:
            stamp: Stamp of the image in s.
            question: Text that identifies the step and all its parameters.
            look: Function that computes the result from the pixels.
        """


@dataclass(frozen=True, eq=False)
class Frame:
    """One exposure of a camera.

    Pixel coordinates have their origin at the outer corner of the top left pixel, x to the
    right, y down: the center of that pixel is (0.5, 0.5), that of the image (width/2, height/2).

    Attributes:
        stamp: Simulated time of the exposure in s.
        image: Red, green, blue, of shape (height, width, 3), black outside ``region``.
        pose: Pose of the camera in the world at the exposure (OpenCV: x right, y down, z forward).
        fov_rad: Vertical field of view in rad.
        region: Part of the image that was exposed.
        stride: Edge of the blocks of pixels that share one sample; 1 for a full image.
        noise_px: Standard deviation along x and y of the camera's shake, in pixels.
        memory: Memory of the results of image processing, if they are kept.
        merges: Number of images that were averaged.
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
        """Colors of the blocks in the exposed region, of shape (rows, columns, 3)."""
        left, top, right, bottom = self.region
        return np.ascontiguousarray(
            self.image[top : bottom : self.stride, left : right : self.stride]
        )

    def posed(self, pose: Pose) -> Frame:
        """The same image with a corrected camera pose."""
        return Frame(
            self.stamp, self.image, pose, self.fov_rad, self.region, self.stride, self.noise_px,
            self.memory, self.merges,
        )  # fmt: skip

    def answer(self, question: str, look: Callable[[], JsonList]) -> JsonList:
        """Result of a processing step, recalled or computed; see `FrameMemory.recall`."""
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
        """Pose of the world in the camera: the inverse of ``pose``."""
        return self.pose.inverse

    @cached_property
    def right(self) -> Vector:
        """Unit vector of the image's x axis in the world, of shape (3,)."""
        # First column of the rotation matrix, in floats: faster than NumPy here.
        w, x, y, z = self.pose.quaternion.tolist()
        length = math.sqrt(x * x + y * y + z * z + w * w)
        w = w / length
        x = x / length
        y = y / length
        z = z / length
        return np.array((x * x - y * y - z * z + w * w, 2 * (x * y + z * w), 2 * (x * z - y * w)))

    def ray(self, pixel: tuple[float, float]) -> Vector:
        """Viewing ray through a pixel in the world, of shape (3,), with a depth of 1 m."""
        x = (pixel[0] - self.width / 2.0) / self.focal_px
        y = (pixel[1] - self.height / 2.0) / self.focal_px
        direction: Vector = self.pose.turn(np.array((x, y, 1.0)))
        return direction


@dataclass(frozen=True)
class Window:
    """Requested exposure: a region of the image (None: all of it) and the edge of its blocks."""

    region: Region | None = None
    stride: int = 1


def focal_length_px(height: int, fov_rad: float) -> float:
    """Focal length in pixels of an image ``height`` pixels high."""
    return height / 2.0 / math.tan(fov_rad / 2.0)


_METADATA = tuple(field for field in fields(Frame) if field.name != "image")


class LazyFrame(Frame):
    """A frame whose pixels are rendered on first access, and never if they are not needed.

    Args:
        size: Width and height of the whole image in pixels.
        draw: Function that renders the exposed blocks, of shape (rows, columns, 3).
        metadata: All other attributes of a frame, in their order.
    """

    def __init__(self, size: tuple[int, int], draw: Callable[[], Image], *metadata: object) -> None:
        own = vars(self)  # the dataclass is frozen: no attribute can be assigned
        own["_size"] = size
        own["_draw"] = draw
        for number, field in enumerate(_METADATA):
            own[field.name] = metadata[number] if number < len(metadata) else field.default

    @classmethod
    def of(cls, frame: Frame, draw: Callable[[], Image], **changed: object) -> LazyFrame:
        """A frame with the metadata of another one, some of it changed, and another image."""
        values = {**vars(frame), **changed}
        metadata = (values[field.name] for field in _METADATA)
        return cls((frame.width, frame.height), draw, *metadata)

    def posed(self, pose: Pose) -> Frame:
        """The same image with a corrected camera pose."""
        return LazyFrame.of(self, lambda: self.blocks, pose=pose)

    @cached_property
    def blocks(self) -> Image:
        """Colors of the blocks in the exposed region, of shape (rows, columns, 3)."""
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
    """A copy of the state that an image depends on, from which it can be rendered later.

    Attributes:
        model: Compiled world, which must not change.
        qpos: Positions in MuJoCo's order, of shape (nq,).
        qvel: Velocities in MuJoCo's order, of shape (nv,).
        mocap_pos: Positions of mocap bodies, of shape (nmocap, 3), m.
        mocap_quat: Their orientations, of shape (nmocap, 4).
        cvel: Velocities of bodies, of shape (nbody, 6); for motion blur.
        subtree_com: Centers of mass that ``cvel`` refers to, of shape (nbody, 3), m.
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
        """Copy the current state of a world."""
        names = [field.name for field in fields(cls) if field.name != "model"]
        return cls(model, *(getattr(data, name).copy() for name in names))

    def data(self) -> mujoco.MjData:
        """Create a MuJoCo state from the copy, its kinematics up to date."""
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
