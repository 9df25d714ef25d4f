"""Cameras on the simulated clock: exposure, latency, lost frames, subscribers.

A `Camera` exposes at a fixed rate while it has subscribers, and delivers each frame after its
latency. An *aim* callback may restrict the next exposure to the region where a target is expected.
`GuardedCamera` is the view of a camera that skills get.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Protocol, TypeAlias

import mujoco
import numpy as np

from bt_dualarm.core.errors import RAISED_BY_SKILLS, WorldError
from bt_dualarm.core.pose import Pose, camera_pose
from bt_dualarm.sim.camera_optics import Calibration, Optics
from bt_dualarm.sim.frame import (
    Frame,
    FrameFinding,
    FrameMemory,
    LazyFrame,
    Scenery,
    Window,
    focal_length_px,
)
from bt_dualarm.sim.renderer import Exposure, Image, Region, RenderableWorld, Renderer, clip_region

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
        """Share of the frames that are never delivered."""

    @property
    def noise(self) -> float:
        """Standard deviation of the shake along x and y, in pixels."""


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
    ) -> None:
        self.name = name
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
        self._pending: deque[Frame] = deque()
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
        exposure = Exposure(camera_id, self.width, self.height, region, window.stride, alone=True)
        degrade = nominal.degradation(region, window.stride) if nominal.is_degraded else None

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
            self._pending.append(frame)
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

    @property
    def has_seen(self) -> bool:
        """Whether there are frames that have not been delivered."""
        return bool(self._pending)

    def deliver(self, time: float) -> list[Frame]:
        """Pass frames whose latency has passed to the subscribers, oldest first; returns them."""
        ready = []
        while self._pending and self._pending[0].stamp + self.latency <= time + _CLOCK_TOLERANCE_S:
            frame = self._pending.popleft()
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
