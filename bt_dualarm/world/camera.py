"""Cameras on the simulated clock: when they expose, what they saw, and when others learn of it."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import mujoco
import numpy as np
import scipy

from bt_dualarm.errors import WorldError
from bt_dualarm.pose import Pose, Vector
from bt_dualarm.world.rendering import Image, Region, Renderer, clip_region

_CLOCK_TOLERANCE_S = 1e-9


@dataclass(frozen=True, eq=False)
class Frame:
    """One exposure.

    Pixel coordinates have their origin at the outer corner of the top left pixel, x to the
    right, y down: the centre of that pixel is (0.5, 0.5), that of the image (width/2, height/2).

    Args:
        stamp: Simulated time of the exposure in s.
        image: Red, green, blue, of shape (height, width, 3), black outside ``region``.
        pose: The camera in the world at the exposure (x right, y down, z forward: OpenCV).
        fov_rad: Vertical field of view.
        region: Part of the image that was exposed.
        stride: Edge of the blocks of pixels that share one sample; 1 for a full image.
        noise_px: Standard deviation along x and y of a shift of the whole image.
    """

    stamp: float
    image: Image
    pose: Pose
    fov_rad: float
    region: Region
    stride: int = 1
    noise_px: float = 0.0

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


class CameraTiming(Protocol):
    """The part of a camera's specification that is used here."""

    @property
    def resolution(self) -> tuple[int, int]:
        """Width and height in pixels."""

    @property
    def fps(self) -> float:
        """Frames a second."""

    @property
    def latency(self) -> float:
        """From the exposure to the delivery of a frame, in s."""

    @property
    def drop(self) -> float:
        """Share of the frames that are never delivered."""

    @property
    def noise(self) -> float:
        """Standard deviation of the shake along x and y, in pixels."""


class SeenWorld(Protocol):
    """The part of a world that a camera looks at."""

    @property
    def model(self) -> Any:
        """MuJoCo's model."""

    @property
    def data(self) -> Any:
        """MuJoCo's state."""


FrameCallback = Callable[[Frame], None]
Aim = Callable[[float, Pose, int, int], Window]
"""Asked before each exposure, with stamp, camera pose, width and height: what to expose."""


class Camera:
    """A camera of the model, exposing at k / fps as long as somebody listens.

    The runner asks ``due`` after each physics step, then calls ``capture`` and ``deliver``.

    Args:
        name: Of the camera in the model, for example ``arm2/camera``.
        spec: Resolution, frame rate, latency and faults; the field of view is the model's.
        renderer: Draws the images; may serve several cameras.
        rng: Of its faults.
    """

    def __init__(
        self,
        name: str,
        spec: CameraTiming,
        renderer: Renderer,
        rng: np.random.Generator | None = None,
    ) -> None:
        self.name = name
        self.latency = float(spec.latency)
        self.drop, self.noise = float(spec.drop), float(spec.noise)
        self.period = 1.0 / float(spec.fps)
        self.width, self.height = (int(n) for n in spec.resolution)
        self.aim: Aim | None = None
        self.latest: Frame | None = None
        self.frames = 0
        self._renderer = renderer
        self._rng = rng or np.random.default_rng(0)
        self._next_index = 0
        self._pending: deque[Frame] = deque()
        self._callbacks: list[FrameCallback] = []

    @property
    def listened_to(self) -> bool:
        """Whether anybody has subscribed; a camera that nobody listens to is never due."""
        return bool(self._callbacks)

    def subscribe(self, callback: FrameCallback) -> Callable[[], None]:
        """Have every delivered frame handed to ``callback``, in order; returns how to stop it."""
        self._callbacks.append(callback)

        def unsubscribe() -> None:
            if callback in self._callbacks:
                self._callbacks.remove(callback)

        return unsubscribe

    def due(self, time: float) -> bool:
        """Whether the next exposure on the grid k / fps has come."""
        if not self._callbacks:
            return False
        return time >= self._next_index * self.period - _CLOCK_TOLERANCE_S

    def capture(self, world: SeenWorld) -> Frame:
        """Expose now, whether due or not; the frame waits for ``deliver``, unless it gets lost.

        Raises:
            WorldError: The model has no camera of this name (any more).
        """
        model, data = world.model, world.data
        camera_id = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, self.name)
        if camera_id < 0:
            raise WorldError(f"the world has no camera {self.name!r}")
        # After mj_step positions of bodies are those before the step: bring them up to date,
        # else a camera at 2 ms a step would see everything 2 ms late.
        mujoco.mj_kinematics(model, data)
        mujoco.mj_camlight(model, data)
        time, pose = float(data.time), camera_pose(data, camera_id)
        window = self.aim(time, pose, self.width, self.height) if self.aim else Window()
        region = self._exposed(window)
        fov_rad = math.radians(float(model.cam_fovy[camera_id]))
        shake = self._rng.normal(0.0, self.noise / focal_length_px(self.height, fov_rad), 2)
        with _turned(data, camera_id, shake):
            image = self._renderer.render(
                model, data, camera_id, self.width, self.height, region, stride=window.stride
            )
        frame = Frame(time, image, pose, fov_rad, region, window.stride, self.noise)
        if self._rng.random() >= self.drop:
            self._pending.append(frame)
        self._next_index = math.floor((time + _CLOCK_TOLERANCE_S) / self.period) + 1
        self.frames += 1
        return frame

    def _exposed(self, window: Window) -> Region:
        """The window's region inside the image, its corner on the grid of blocks."""
        left, top, right, bottom = clip_region(window.region, self.width, self.height)
        return left - left % window.stride, top - top % window.stride, right, bottom

    def deliver(self, time: float) -> list[Frame]:
        """Hand out, oldest first, the frames whose latency has passed."""
        ready = []
        while self._pending and self._pending[0].stamp + self.latency <= time + _CLOCK_TOLERANCE_S:
            frame = self._pending.popleft()
            self.latest = frame
            ready.append(frame)
            for callback in tuple(self._callbacks):
                callback(frame)
        return ready


def focal_length_px(height: int, fov_rad: float) -> float:
    """Focal length in pixels of an image ``height`` pixels high."""
    return height / 2.0 / math.tan(fov_rad / 2.0)


@contextmanager
def _turned(data: Any, camera_id: int, angles: Vector) -> Iterator[None]:
    """The camera turned about its x and y axes by ``angles`` of shape (2,), in rad, meanwhile."""
    if not angles.any():
        yield
        return
    straight = data.cam_xmat[camera_id].copy()
    turn = scipy.spatial.transform.Rotation.from_rotvec([*angles, 0.0]).as_matrix()
    data.cam_xmat[camera_id] = (straight.reshape(3, 3) @ turn).ravel()
    try:
        yield
    finally:
        data.cam_xmat[camera_id] = straight


def camera_pose(data: Any, camera_id: int) -> Pose:
    """The camera in the world, x right, y down, z forward; MuJoCo's own looks along -z, y up."""
    axes = data.cam_xmat[camera_id].reshape(3, 3) * np.array([1.0, -1.0, -1.0])
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = axes, data.cam_xpos[camera_id]
    return Pose.from_matrix(transform)
