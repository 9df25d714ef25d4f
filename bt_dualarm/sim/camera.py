"""Cameras on the simulated clock: exposure, latency, lost frames, and the formation of images.

A `Camera` exposes at a fixed rate while it has subscribers, and delivers each frame after its
latency. An *aim* callback may restrict the next exposure to the region where a target is expected.
`GuardedCamera` is the view of a camera that skills get.

`Optics` renders an exposure as the true camera sees it: shake, shutter, lens distortion and
noise. `Calibration` is the camera as its arm knows it, and holds the errors of its images that
nobody can calibrate: noise and light.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache, partial
from types import ModuleType
from typing import TYPE_CHECKING, Final, NamedTuple, Protocol, TypeAlias

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.core import rotations
from bt_dualarm.core.errors import RAISED_BY_SKILLS, WorldError
from bt_dualarm.core.later import Later
from bt_dualarm.core.pose import Pose, Vector, camera_pose
from bt_dualarm.sim.arm_models import random_stream
from bt_dualarm.sim.frame import (
    Exposure,
    Frame,
    FrameFinding,
    FrameMemory,
    Image,
    LazyFrame,
    Region,
    RenderableWorld,
    Renderer,
    Scenery,
    Window,
    clip_region,
    enter_blocks,
    focal_length_px,
)
from bt_dualarm.sim.world import World
from bt_dualarm.spec.values import Uncertainty

if TYPE_CHECKING:
    import cv2
else:
    cv2 = Later("cv2")

# Lens distortion

_RADII: Final = 4096
"""Radii at which the distortion is tabulated, with linear interpolation between them."""


class Lens:
    """Radial distortion of the lens, by the first two terms of OpenCV's model.

    A point at radius ``r`` from the image center, in focal lengths, is imaged at
    ``r (1 + k1 r² + k2 r⁴)`` (Brown, Decentering distortion of lenses, 1966). Where this is not
    monotonic (the image would fold over), nothing is visible. It models the distortion that is left
    after rectification with an inexact calibration.

    Args:
        k1: Coefficient of the cubic term.
        k2: Coefficient of the quintic term.
        width: Width of the whole image in pixels.
        height: Height of the whole image in pixels.
        focal_px: True focal length in pixels.
    """

    def __init__(self, k1: float, k2: float, width: int, height: int, focal_px: float) -> None:
        y, x = np.indices((height, width)) + 0.5
        x = (x - width / 2) / focal_px
        y = (y - height / 2) / focal_px
        radius = np.hypot(x, y)
        scale = _undistorted_radius(k1, k2, radius) / radius.clip(1e-12)
        columns = x * scale * focal_px + width / 2
        rows = y * scale * focal_px + height / 2
        self._columns: npt.NDArray[np.float32] = (columns - 0.5).astype(np.float32)
        self._rows: npt.NDArray[np.float32] = (rows - 0.5).astype(np.float32)
        is_visible = np.isfinite(columns)
        self._is_visible = None if is_visible.all() else is_visible
        self._cached: tuple[Region, int, _Remap] | None = None
        self._scratch: Image = np.zeros((height, width, 3), np.uint8)

    def widened(self, exposure: Exposure) -> Exposure:
        """The exposure of the undistorted image from which an exposure can be computed."""
        if exposure.is_empty:
            return exposure
        return Exposure(
            exposure.camera_id, exposure.width, exposure.height, self._remap(exposure).source,
            exposure.stride, exposure.groups, exposure.alone,
        )  # fmt: skip

    def distorted(self, image: Image, exposure: Exposure) -> Image:
        """Distort a whole image; it is black outside the exposure's region."""
        left, top, right, bottom = self.widened(exposure).clipped
        source = image if exposure.stride > 1 else image[top:bottom, left:right]
        return exposure.paint(lambda _: self._distort(source, exposure))

    def distorted_blocks(self, blocks: Image, exposure: Exposure) -> Image:
        """Distort blocks of pixels, of shape (rows, columns, 3).

        Args:
            blocks: Colors of the blocks of the exposure that `widened` returns.
            exposure: Exposure that is not empty, its corner aligned with the grid of blocks.
        """
        if exposure.stride > 1:
            wide = self.widened(exposure)
            enter_blocks(self._scratch, wide.clipped, wide.stride, blocks, wide.corner)
            blocks = self._scratch
        return self._distort(blocks, exposure)

    def _distort(self, source: Image, exposure: Exposure) -> Image:
        """Distort the pixels of the source region; of coarse blocks, those of a whole image."""
        remap = self._remap(exposure)
        result = cv2.remap(
            source, remap.columns, remap.rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        if remap.is_visible is not None:
            result[~remap.is_visible] = 0
        return np.asarray(result, dtype=np.uint8)

    def _remap(self, exposure: Exposure) -> _Remap:
        """Source coordinates of an exposure, cached: a target at rest stays in its region."""
        region = exposure.clipped
        step = exposure.stride
        if self._cached is None or self._cached[:2] != (region, step):
            source_region = _kernels().source_region
            left, top, right, bottom = source_region(self._columns, self._rows, region, step)
            source = left - left % step, top - top % step, right, bottom
            part = slice(region[1], region[3], step), slice(region[0], region[2], step)
            is_visible = None if self._is_visible is None else self._is_visible[part]
            # Subtracting integers loses no precision.
            left, top = source[:2] if step == 1 else (0, 0)
            columns = self._columns[part] - np.float32(left)
            rows = self._rows[part] - np.float32(top)
            self._cached = region, step, _Remap(columns, rows, is_visible, source)
        return self._cached[2]


class _Remap(NamedTuple):
    """Source coordinates of a region of the distorted image.

    Attributes:
        columns: Coordinates along x, of shape (rows, columns), px from the corner of the source
            region, or of the whole image for coarse blocks.
        rows: Coordinates along y, of the same shape.
        is_visible: Where the lens shows something, None if everywhere.
        source: Region of the undistorted image that contains all sources.
    """

    columns: npt.NDArray[np.float32]
    rows: npt.NDArray[np.float32]
    is_visible: npt.NDArray[np.bool_] | None
    source: Region


def _undistorted_radius(
    k1: float, k2: float, imaged: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Invert the distortion for radii in the image; NaN where the lens shows nothing."""
    # Lenses within the valid ranges of k1 and k2 show nothing from beyond twice the largest radius.
    radius = np.linspace(0.0, 2.0 * float(imaged.max()), _RADII)
    bent = radius * (1.0 + k1 * radius**2 + k2 * radius**4)
    falls = np.flatnonzero(np.diff(bent) <= 0)
    end = int(falls[0]) + 1 if len(falls) else _RADII
    return np.interp(imaged, bent[:end], radius[:end], right=math.nan)


def warm_up_lens() -> None:
    """Compile the kernel of the lens."""
    Lens(0.1, 0.1, 2, 2, 1.0).widened(Exposure(0, 2, 2, (0, 0, 1, 1)))


# Motion blur


SHARP_PX: Final = 0.5
"""Motion during an exposure, in pixels, below which an image is sharp: it is rendered once."""

MAX_SUBIMAGES: Final = 8
"""Largest number of images that are averaged; up to it they are at most a pixel apart."""

Draw: TypeAlias = Callable[[mujoco.MjData, Exposure], Image]
"""Renders a camera's image of a state whose kinematics are up to date."""


class Shutter:
    """Motion blur: averages images at evenly spaced times around the stamp.

    Their number is the distance in pixels that the fastest visible object moves during the
    exposure; links of arms do not count.

    Args:
        exposure_s: Exposure time in s.
    """

    def __init__(self, exposure_s: float) -> None:
        self._open_s = exposure_s
        self._model: mujoco.MjModel | None = None

    def render(
        self, model: mujoco.MjModel, data: mujoco.MjData, exposure: Exposure, draw: Draw
    ) -> Image:
        """Render an exposure whose middle is the current time.

        Velocities are taken as constant during the exposure; ``data`` is not changed.
        """
        motion = self._open_s * self._speed_px(model, data, exposure)
        if motion < SHARP_PX:
            return draw(data, exposure)
        count = min(1 + math.ceil(motion), MAX_SUBIMAGES)
        total = np.array(count // 2, np.uint16)  # rounds the integer mean below
        for number in range(count):
            offset = (number + 0.5) / count - 0.5
            total = total + draw(self._state(model, data, offset * self._open_s), exposure)
        return (total // np.uint16(count)).astype(np.uint8)

    def _state(self, model: mujoco.MjModel, data: mujoco.MjData, later: float) -> mujoco.MjData:
        """State after ``later`` seconds at the current velocities; may be negative."""
        scratch = self._scratch
        scratch.qpos[:] = data.qpos
        scratch.mocap_pos[:] = data.mocap_pos
        scratch.mocap_quat[:] = data.mocap_quat
        mujoco.mj_integratePos(model, scratch.qpos, data.qvel, later)
        mujoco.mj_kinematics(model, scratch)
        mujoco.mj_camlight(model, scratch)
        return scratch

    def _speed_px(self, model: mujoco.MjModel, data: mujoco.MjData, exposure: Exposure) -> float:
        """Highest image speed of an object that may be visible, in pixels per second."""
        if self._model is not model:
            self._model = model
            self._scratch = mujoco.MjData(model)
            self._objects, self._radii = _objects(model)
            self._roots = model.body_rootid.copy()
        camera = exposure.camera_id
        kernels = _kernels()
        size = (exposure.width, exposure.height)
        focal_px = focal_length_px(exposure.height, math.radians(float(model.cam_fovy[camera])))
        speed: float = kernels.fastest(
            self._objects, self._radii, int(model.cam_bodyid[camera]),
            kernels.Bodies(data.xpos, data.cvel, data.subtree_com, self._roots),
            data.cam_xpos[camera], data.cam_xmat[camera].reshape(3, 3), focal_px,
            size, exposure.clipped,
        )  # fmt: skip
        return speed


def _objects(model: mujoco.MjModel) -> tuple[npt.NDArray[np.int64], Vector]:
    """Ids of all bodies that are not links of an arm, and their bounding radii in m."""
    ids = [body for body in range(1, model.nbody) if "/" not in model.body(body).name]
    extents = [
        max(
            (
                float(np.linalg.norm(model.geom_pos[geom]) + model.geom_rbound[geom])
                for geom in np.flatnonzero(model.geom_bodyid == body)
            ),
            default=0.0,
        )
        for body in ids
    ]
    return np.array(ids, dtype=np.int64), np.array(extents)


@cache
def _kernels() -> ModuleType:
    """The compiled kernels, imported once: an import statement costs as much as a kernel."""
    from bt_dualarm.sim import ray_trace_kernels

    return ray_trace_kernels


def warm_up_shutter() -> None:
    """Compile the kernel of motion blur."""
    spec = mujoco.MjSpec()
    spec.worldbody.add_camera()
    spec.worldbody.add_body(name="thing").add_geom(size=(0.1, 0.1, 0.1))
    model = spec.compile()
    data = mujoco.MjData(model)
    Shutter(1.0).render(model, data, Exposure(0, 2, 2), lambda *_: np.zeros((2, 2, 3), np.uint8))


# Calibration

CONSTANT_LIGHT: Final = Uncertainty()

_NOISE_BANK: Final = 2**18
"""Start positions of an image's noise in a precomputed sequence, at least half as many for large
images. Fresh noise for each image would cost as much as rendering it."""


@dataclass(eq=False)
class Calibration:
    """The nominal camera of an arm, and the errors of its images.

    Attributes:
        pose_at: Function that returns the camera's pose in the world (x right, y down, z forward)
            at a time in s, by the arm's encoders and the nominal mount.
        fov_rad: Vertical field of view by the tree file, rad.
        stamp_s: Seconds by which the camera's clock is ahead of the simulation's.
        noise: Standard deviation of a pixel's noise, of 255 levels.
        light: Uncertainty of the brightness, sampled for each image.
        exposure_s: Exposure time, s.
        distortion: Radial distortion that the calibration lacks, OpenCV's k1 and k2.
        rng: Random stream of noise and light.
    """

    pose_at: Callable[[float], Pose]
    fov_rad: float
    stamp_s: float = 0.0
    noise: float = 0.0
    light: Uncertainty = CONSTANT_LIGHT
    exposure_s: float = 0.0
    distortion: tuple[float, float] = (0.0, 0.0)
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))
    _bank: npt.NDArray[np.uint8] = field(
        init=False, default_factory=lambda: np.zeros((2, 0), np.uint8)
    )

    def degradation(self, region: Region, stride: int = 1) -> Callable[[Image], Image]:
        """Sample the noise and brightness of the next image.

        Args:
            region: Region that is exposed.
            stride: Edge in pixels of the blocks that share a color.

        Returns:
            Function that applies them to the blocks' colors, of shape (rows, columns, 3).
        """
        if not self.is_degraded:
            return lambda blocks: blocks
        left, top, right, bottom = region
        light = 1.0 + self.light.draw_one(self.rng)
        shape = -((top - bottom) // stride), -((left - right) // stride), 3
        positive, negative = self._sample_noise(math.prod(shape)).reshape(2, *shape)

        def degrade(blocks: Image) -> Image:
            # OpenCV saturates at 0 and 255, NumPy would wrap around.
            bright = cv2.add(cv2.convertScaleAbs(blocks, alpha=light), positive)
            return np.asarray(cv2.subtract(bright, negative), dtype=np.uint8)

        return degrade

    @property
    def is_degraded(self) -> bool:
        """Whether images have noise or varying brightness at all."""
        return bool(self.noise or self.light.most)

    def _sample_noise(self, count: int) -> npt.NDArray[np.uint8]:
        """Positive and negative part of the noise of ``count`` values, of shape (2, count).

        A random section of a precomputed sequence.
        """
        if self._bank.shape[1] < count + _NOISE_BANK // 2:
            values = self.rng.standard_normal(count + _NOISE_BANK, dtype=np.float32)
            self._bank = _noise_levels(values, self.noise)
        begin = int(self.rng.integers(self._bank.shape[1] - count))
        return self._bank[:, begin : begin + count]


def _noise_levels(values: npt.NDArray[np.float32], sigma: float) -> npt.NDArray[np.uint8]:
    """Positive and negative part of noise in whole levels, of shape (2, n).

    Args:
        values: Standard normal values, of shape (n,); they are changed.
        sigma: Standard deviation of the noise.
    """
    # In place: with temporary arrays it takes several times as long.
    levels = np.empty((2, len(values)), np.uint8)
    np.multiply(values, sigma, out=values)
    np.rint(values, out=values)
    np.clip(values, 0, 255, out=levels[0], casting="unsafe")
    np.negative(values, out=values)
    np.clip(values, 0, 255, out=levels[1], casting="unsafe")
    return levels


def calibration_of(world: World, name: str, seed: int) -> Calibration:
    """Nominal camera of an arm that is in the world and has a camera.

    Args:
        world: World that the arm is in.
        name: Name of the arm.
        seed: Seed of the noise of its images.
    """
    camera = world.declared_arms[name].camera
    if camera is None:
        raise WorldError(f"arm {name!r} has no camera")
    hardware = world.hardware[name]
    nominal = world.nominal[name]
    errors = world.devices.errors[name].camera
    sampled = world.devices.sampled[name]
    return Calibration(
        pose_at=lambda time: nominal.camera_pose_at(hardware.q_at(time)),
        fov_rad=camera.fov_rad,
        stamp_s=sampled.stamp_s,
        noise=errors.noise,
        light=errors.light,
        exposure_s=errors.exposure,
        distortion=sampled.distortion,
        rng=random_stream(seed, f"{name}:pixels"),
    )


# Image formation


class Optics:
    """Renders exposures of one camera with its shake, motion blur and distortion.

    Args:
        renderer: Renderer of its images.
        exposure_s: Exposure time in s.
        distortion: Radial distortion of its lens, OpenCV's k1 and k2.
    """

    def __init__(
        self,
        renderer: Renderer,
        exposure_s: float = 0.0,
        distortion: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        self._renderer = renderer
        self._shutter = Shutter(exposure_s) if exposure_s else None
        self._distortion = distortion
        self._lens: Lens | None = None

    def render(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        exposure: Exposure,
        shake: Vector,
        degrade: Callable[[Image], Image] | None = None,
    ) -> Image:
        """Render the blocks of an exposure, of shape (rows, columns, 3).

        Args:
            model: Compiled world.
            data: Its state, with up-to-date kinematics.
            exposure: Region to render, as blocks alone, its corner aligned with the grid of blocks.
            shake: Rotation of the camera about its x and y axes, of shape (2,), rad.
            degrade: Function that applies noise to the blocks, of shape (rows, columns, 3).
        """
        shakes = shake.any()

        def draw(state: mujoco.MjData, part: Exposure) -> Image:
            if not shakes:
                return self._renderer.render(model, state, part)
            with _turned(state, part.camera_id, shake):
                return self._renderer.render(model, state, part)

        if exposure.is_empty:
            return np.zeros((0, 0, 3), np.uint8)
        if not any(self._distortion):
            blocks = self._exposed(model, data, exposure, draw)
            return blocks if degrade is None else degrade(blocks)
        if self._lens is None:
            fov_rad = math.radians(float(model.cam_fovy[exposure.camera_id]))
            focal_px = focal_length_px(exposure.height, fov_rad)
            self._lens = Lens(*self._distortion, exposure.width, exposure.height, focal_px)
        wide = self._lens.widened(exposure)
        blocks = self._lens.distorted_blocks(self._exposed(model, data, wide, draw), exposure)
        return blocks if degrade is None else degrade(blocks)

    def _exposed(
        self, model: mujoco.MjModel, data: mujoco.MjData, exposure: Exposure, draw: Draw
    ) -> Image:
        if self._shutter is None:
            return draw(data, exposure)
        return self._shutter.render(model, data, exposure, draw)


@contextmanager
def _turned(data: mujoco.MjData, camera_id: int, angles: Vector) -> Iterator[None]:
    """Turn the camera about its x and y axes by ``angles`` of shape (2,), rad, temporarily."""
    straight = data.cam_xmat[camera_id].copy()
    vector = np.array([[*angles, 0.0]])
    turn = rotations.matrices(rotations.from_rotation_vectors(vector))[0]
    data.cam_xmat[camera_id] = (straight.reshape(3, 3) @ turn).ravel()
    try:
        yield
    finally:
        data.cam_xmat[camera_id] = straight


_CLOCK_TOLERANCE_S = 1e-9
_MAX_FINDINGS = 16  # far more than the frames delivered in one step
_NO_SHAKE = np.zeros(2)


class CameraTiming(Protocol):
    """The part of a camera's specification that `Camera` uses."""

    @property
    def resolution(self) -> tuple[int, int]:
        """Width and height in pixels."""

    @property
    def fps(self) -> float:
        """Frames a second."""

    @property
    def latency(self) -> float:
        """Time from the exposure to the delivery of a frame, s."""

    @property
    def drop(self) -> float:
        """Fraction of the frames that are never delivered."""

    @property
    def noise(self) -> float:
        """Standard deviation of the shake along x and y, in pixels."""


@dataclass(eq=False)
class CameraDisturbance:
    """What faults do to a camera at present; by default nothing.

    Attributes:
        is_frozen: Whether it repeats the scene that it saw last.
        brightness: Fraction of the brightness of its images.
        delay: Seconds by which images are delivered late.
        shake: Standard deviation of its rotation about x and y, rad.
        rng: Random stream of the shake.
    """

    is_frozen: bool = False
    brightness: float = 1.0
    delay: float = 0.0
    shake: float = 0.0
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))
    _scene: tuple[mujoco.MjModel, mujoco.MjData, int] | None = field(init=False, default=None)

    def scene(
        self, model: mujoco.MjModel, data: mujoco.MjData, camera_id: int
    ) -> tuple[mujoco.MjModel, mujoco.MjData, int]:
        """The scene that the camera sees: the current one, or a copy from when it froze."""
        if not self.is_frozen:
            self._scene = None
            return model, data, camera_id
        if self._scene is None:
            self._scene = model, Scenery.of(model, data).data(), camera_id
        return self._scene

    def turned(self, shake: Vector) -> Vector:
        """Rotation of the camera about its x and y axes, of shape (2,), rad."""
        if not self.shake:
            return shake
        turned: Vector = shake + self.rng.normal(0.0, self.shake, 2)
        return turned

    def dimmed(self, degrade: Callable[[Image], Image] | None) -> Callable[[Image], Image] | None:
        """Function that applies noise to the blocks of an image, of shape (rows, columns, 3)."""
        if self.brightness == 1.0:
            return degrade
        alpha = self.brightness

        def dim(blocks: Image) -> Image:
            dark: Image = np.asarray(cv2.convertScaleAbs(blocks, alpha=alpha), dtype=np.uint8)
            return dark if degrade is None else degrade(dark)

        return dim


FrameCallback: TypeAlias = Callable[[Frame], None]
WindowRequest: TypeAlias = Callable[[float, Pose, int, int], Window]
"""Called before each exposure with stamp, camera pose, width and height; returns what to expose."""


class Camera:
    """A camera of the model, which exposes at the times k / fps while it has subscribers.

    The runner tests `due` after each physics step, then calls `capture` and `deliver`.

    Args:
        name: Name of the camera in the model, for example ``arm2/camera``.
        spec: Resolution, frame rate, latency and faults; the field of view is the model's.
        renderer: Renderer of the images; it may serve several cameras.
        rng: Random stream of the faults; by default one with seed 0.
        calibration: Nominal pose and optics, and image errors; by default an ideal camera.
        memory: Memory of image processing; frames whose results it knows are not rendered.
        disturbance: Faults of the camera; none by default.

    Attributes:
        aim: Callback that selects the next exposure.
        latest: Frame that was delivered last.
        frames: Number of exposures so far.
        findings: Latest annotations by trackers, for the record; whoever reads them removes them.
    """

    def __init__(
        self,
        name: str,
        spec: CameraTiming,
        renderer: Renderer,
        rng: np.random.Generator | None = None,
        calibration: Calibration | None = None,
        memory: FrameMemory | None = None,
        disturbance: CameraDisturbance | None = None,
    ) -> None:
        self.name = name
        self._disturbance = disturbance or CameraDisturbance()
        self.latency = float(spec.latency)
        self.drop = float(spec.drop)
        self.noise = float(spec.noise)
        self.period = 1.0 / float(spec.fps)
        self.width, self.height = (int(n) for n in spec.resolution)
        self.aim: WindowRequest | None = None
        self.latest: Frame | None = None
        self.frames = 0
        self.findings: deque[FrameFinding] = deque(maxlen=_MAX_FINDINGS)
        self._calibration = calibration
        self._memory = memory
        self._optics = Optics(renderer)
        if calibration is not None:
            self._optics = Optics(renderer, calibration.exposure_s, calibration.distortion)
        self._rng = rng or np.random.default_rng(0)
        self._next_index = 0
        self._cached_id: tuple[mujoco.MjModel, int] | None = None
        self._pending: deque[tuple[float, Frame]] = deque()
        self._callbacks: list[FrameCallback] = []

    def subscribe(self, callback: FrameCallback) -> Callable[[], None]:
        """Call ``callback`` with every delivered frame; returns the function that unsubscribes."""
        self._callbacks.append(callback)
        return partial(self.unsubscribe, callback)

    def unsubscribe(self, callback: FrameCallback) -> None:
        """Stop calling ``callback``; harmless if it is not subscribed."""
        if callback in self._callbacks:
            self._callbacks.remove(callback)

    def due(self, time: float) -> bool:
        """Whether the next exposure time k / fps has come, and there is a subscriber."""
        if not self._callbacks:
            return False
        return time >= self._next_index * self.period - _CLOCK_TOLERANCE_S

    def capture(self, world: RenderableWorld) -> Frame:
        """Expose now, whether due or not; the frame waits for `deliver`, unless it is lost.

        Raises:
            WorldError: The model has no camera of this name.
        """
        model = world.model
        data = world.data
        camera_id = self._id_in(model)
        # mj_step leaves body positions at the state before the step: without an update the
        # camera would see everything one step, 2 ms, late.
        mujoco.mj_kinematics(model, data)
        mujoco.mj_camlight(model, data)
        fov_rad = math.radians(float(model.cam_fovy[camera_id]))
        time = float(data.time)
        nominal = self._calibration or Calibration(lambda _: camera_pose(data, camera_id), fov_rad)
        stamp = time + nominal.stamp_s
        pose = nominal.pose_at(stamp)
        window = self.aim(stamp, pose, self.width, self.height) if self.aim else Window()
        region = self._exposed(window)
        shake = _NO_SHAKE
        if self._is_faulty:
            shake = self._rng.normal(0.0, self.noise / focal_length_px(self.height, fov_rad), 2)
        disturbance = self._disturbance
        model, data, camera_id = disturbance.scene(model, data, camera_id)
        shake = disturbance.turned(shake)
        exposure = Exposure(camera_id, self.width, self.height, region, window.stride, alone=True)
        degrade = nominal.degradation(region, window.stride) if nominal.is_degraded else None
        degrade = disturbance.dimmed(degrade)

        def draw(state: mujoco.MjData) -> Image:
            return self._optics.render(model, state, exposure, shake, degrade)

        memory = self._memory if self._memory is not None and self._memory.keeps else None
        metadata = stamp, pose, nominal.fov_rad, region, window.stride, self.noise, memory
        size = self.width, self.height
        if memory is not None and memory.knows(stamp, region, window.stride):
            scenery = Scenery.of(model, data)
            frame = LazyFrame(size, lambda: draw(scenery.data()), *metadata)
        else:
            blocks = draw(data)
            frame = LazyFrame(size, lambda: blocks, *metadata)
        if not self._is_faulty or self._rng.random() >= self.drop:
            self._pending.append((self.latency + disturbance.delay, frame))
        self._next_index = math.floor((time + _CLOCK_TOLERANCE_S) / self.period) + 1
        self.frames += 1
        return frame

    @property
    def _is_faulty(self) -> bool:
        """Whether the random stream of the faults is used."""
        return bool(self.noise or self.drop)

    def _id_in(self, model: mujoco.MjModel) -> int:
        """Id of the camera in a model; looked up once for each model."""
        if self._cached_id is None or self._cached_id[0] is not model:
            camera_id = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, self.name)
            if camera_id < 0:
                raise WorldError(f"the world has no camera {self.name!r}")
            self._cached_id = model, camera_id
        return self._cached_id[1]

    def _exposed(self, window: Window) -> Region:
        """The window's region clipped to the image, its corner aligned with the grid of blocks."""
        left, top, right, bottom = clip_region(window.region, self.width, self.height)
        return left - left % window.stride, top - top % window.stride, right, bottom

    def has_arrived(self, time: float) -> bool:
        """Whether `deliver` has frames to pass at a simulated time in s."""
        if not self._pending:
            return False
        latency, frame = self._pending[0]
        return frame.stamp + latency <= time + _CLOCK_TOLERANCE_S

    def deliver(self, time: float) -> list[Frame]:
        """Pass frames whose latency has passed to the subscribers, oldest first; returns them."""
        ready = []
        while self.has_arrived(time):
            _, frame = self._pending.popleft()
            if self._calibration is not None and self._calibration.stamp_s > 0:
                # The stamp was ahead of the clock: the arm's pose at that time was not known yet.
                frame = frame.posed(self._calibration.pose_at(frame.stamp))
            self.latest = frame
            ready.append(frame)
            for callback in tuple(self._callbacks):
                callback(frame)
        return ready


class GuardedCamera:
    """The camera of an arm as its leaves use it; a callback that raises is not called again.

    Args:
        camera: Camera of the arm, shared by all its leaves.

    Attributes:
        fault: Error that a callback has raised, until the runner handles and clears it.
    """

    def __init__(self, camera: Camera) -> None:
        self.fault: BaseException | None = None
        self._camera = camera
        self._aim: WindowRequest | None = None

    @property
    def period(self) -> float:
        """Seconds between two exposures."""
        return self._camera.period

    @property
    def latency(self) -> float:
        """Seconds from the exposure to the delivery of a frame."""
        return self._camera.latency

    @property
    def noise(self) -> float:
        """Standard deviation of the camera's shake along x and y, in pixels."""
        return self._camera.noise

    @property
    def latest(self) -> Frame | None:
        """The frame that was delivered last, if any."""
        return self._camera.latest

    @property
    def aim(self) -> WindowRequest | None:
        """Callback that selects the next exposure, as `Camera.aim`."""
        return self._aim

    @aim.setter
    def aim(self, aim: WindowRequest | None) -> None:
        if aim is not None:
            self._camera.aim = self._guarded_aim
        elif self._camera.aim == self._guarded_aim:
            self._camera.aim = None
        self._aim = aim

    @property
    def findings(self) -> deque[FrameFinding]:
        """Latest annotations of frames, as `Camera.findings`."""
        return self._camera.findings

    def subscribe(self, callback: FrameCallback) -> Callable[[], None]:
        """Call ``callback`` with every frame; returns the function that unsubscribes."""
        return self._camera.subscribe(_GuardedCallback(self, self._camera, callback))

    def _guarded_aim(self, stamp: float, camera: Pose, width: int, height: int) -> Window:
        try:
            return self._aim(stamp, camera, width, height) if self._aim else Window()
        except RAISED_BY_SKILLS as error:
            self.fault = error
            self.aim = None
            return Window()


class _GuardedCallback:
    """A callback that is unsubscribed once it has raised.

    A class and not a closure: a closure that unsubscribes itself would be part of a reference
    cycle, and keep itself and its subscriber alive until the next garbage collection.

    Args:
        owner: Guarded camera that records the error.
        camera: Camera that calls it.
        callback: The callback.
    """

    def __init__(self, owner: GuardedCamera, camera: Camera, callback: FrameCallback) -> None:
        self._owner = owner
        self._camera = camera
        self._callback = callback

    def __call__(self, frame: Frame) -> None:
        try:
            self._callback(frame)
        except RAISED_BY_SKILLS as error:
            self._owner.fault = error
            self._camera.unsubscribe(self)
