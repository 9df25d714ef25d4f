"""Camera frames, and the interface of the renderers that draw them.

`Frame` is the image with the pose of the camera. `LazyFrame` renders on demand: when a record
already knows what perception found in a frame, its pixels are never needed. `Scenery` is the copied
state that such a frame is rendered from.

A camera asks a `Renderer` for an `Exposure`: a region of its image, in full resolution or in blocks
of pixels that share a color. `renderers` implements the protocol.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, Literal, Protocol, TypeAlias

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.core.pose import Matrix, Pose, Vector
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

    @property
    def shake_rad(self) -> float:
        """Standard deviation of the camera's mean rotation about its x and y axes by shake, rad."""
        return self.noise_px / math.sqrt(self.merges) / self.focal_px

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
        """Red, green, blue, of shape (height, width, 3), black outside ``region``; read-only.

        All subscribers get the same array, and so does the record.
        """
        image: Image = np.zeros((self.height, self.width, 3), np.uint8)
        if self.blocks.size:
            enter_blocks(image, self.region, self.stride, self.blocks)
        image.flags.writeable = False
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
