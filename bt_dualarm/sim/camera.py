"""Cameras on the simulated clock: frames, latency, lost frames, and who listens."""

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
_MOST_LOOKS = 16  # far more than frames that are delivered in one step
_STEADY = np.zeros(2)


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
        """Time from the exposure to the delivery of a frame, s."""

    @property
    def drop(self) -> float:
        """Share of the frames that are never delivered."""

    @property
    def noise(self) -> float:
        """Standard deviation of the shake along x and y, in pixels."""


FrameCallback: TypeAlias = Callable[[Frame], None]
WindowRequest: TypeAlias = Callable[[float, Pose, int, int], Window]
"""Asked before each exposure, with stamp, camera pose, width and height: what to expose."""


class Camera:
    """A camera of the model, exposing at k / fps as long as somebody listens.

    The runner asks ``due`` after each physics step, then calls ``capture`` and ``deliver``.

    Args:
        name: Name of the camera in the model, for example ``arm2/camera``.
        spec: Resolution, frame rate, latency and faults; the field of view is the model's.
        renderer: Renderer of the images; may serve several cameras.
        rng: Source of its faults; seed 0 by default.
        calibration: What is believed of it; by default what is true.
        memory: Memory of what is found in its images; those that it knows are not drawn.

    Attributes:
        looks: Latest finds of those who listen, for the record; taken away by who reads them.
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
        self.findings: deque[FrameFinding] = deque(maxlen=_MOST_LOOKS)
        self._calibration = calibration
        self._memory = memory
        self._optics = Optics(renderer)
        if calibration is not None:
            self._optics = Optics(renderer, calibration.exposure_s, calibration.distortion)
        self._rng = rng or np.random.default_rng(0)
        self._next_index = 0
        self._known: tuple[mujoco.MjModel, int] | None = None
        self._pending: deque[Frame] = deque()
        self._callbacks: list[FrameCallback] = []

    def subscribe(self, callback: FrameCallback) -> Callable[[], None]:
        """Have every delivered frame handed to ``callback``, in order; returns how to stop it."""
        self._callbacks.append(callback)
        return partial(self.unsubscribe, callback)

    def unsubscribe(self, callback: FrameCallback) -> None:
        """Hand no more frames to ``callback``; harmless when that has ended."""
        if callback in self._callbacks:
            self._callbacks.remove(callback)

    def due(self, time: float) -> bool:
        """Whether the next exposure on the grid k / fps has come."""
        if not self._callbacks:
            return False
        return time >= self._next_index * self.period - _CLOCK_TOLERANCE_S

    def capture(self, world: RenderableWorld) -> Frame:
        """Expose now, whether due or not; the frame waits for ``deliver``, unless it gets lost.

        Raises:
            WorldError: The model has no camera of this name (any more).
        """
        model = world.model
        data = world.data
        camera_id = self._number_in(model)
        # After mj_step positions of bodies are those before the step: bring them up to date,
        # else a camera at 2 ms a step would see everything 2 ms late.
        mujoco.mj_kinematics(model, data)
        mujoco.mj_camlight(model, data)
        fov_rad = math.radians(float(model.cam_fovy[camera_id]))
        time = float(data.time)
        known = self._calibration or Calibration(lambda _: camera_pose(data, camera_id), fov_rad)
        stamp = time + known.stamp_s
        pose = known.pose_at(stamp)
        window = self.aim(stamp, pose, self.width, self.height) if self.aim else Window()
        region = self._exposed(window)
        shake = _STEADY
        if self._is_faulty:
            shake = self._rng.normal(0.0, self.noise / focal_length_px(self.height, fov_rad), 2)
        exposure = Exposure(camera_id, self.width, self.height, region, window.stride, alone=True)
        degrade = known.degradation(region, window.stride) if known.is_degraded else None

        def draw(state: mujoco.MjData) -> Image:
            return self._optics.render(model, state, exposure, shake, degrade)

        memory = self._memory if self._memory is not None and self._memory.keeps else None
        facts = stamp, pose, known.fov_rad, region, window.stride, self.noise, memory
        size = self.width, self.height
        if memory is not None and memory.knows(stamp, region, window.stride):
            then = Scenery.of(model, data)
            frame = LazyFrame(size, lambda: draw(then.data()), *facts)
        else:
            blocks = draw(data)
            frame = LazyFrame(size, lambda: blocks, *facts)
        if not self._is_faulty or self._rng.random() >= self.drop:
            self._pending.append(frame)
        self._next_index = math.floor((time + _CLOCK_TOLERANCE_S) / self.period) + 1
        self.frames += 1
        return frame

    @property
    def _is_faulty(self) -> bool:
        """Whether anything is drawn of its faults."""
        return bool(self.noise or self.drop)

    def _number_in(self, model: mujoco.MjModel) -> int:
        """Number of the camera in a model; looked up once."""
        if self._known is None or self._known[0] is not model:
            number = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, self.name)
            if number < 0:
                raise WorldError(f"the world has no camera {self.name!r}")
            self._known = model, number
        return self._known[1]

    def _exposed(self, window: Window) -> Region:
        """The window's region inside the image, its corner on the grid of blocks."""
        left, top, right, bottom = clip_region(window.region, self.width, self.height)
        return left - left % window.stride, top - top % window.stride, right, bottom

    @property
    def has_seen(self) -> bool:
        """Whether there are frames that have not been handed out."""
        return bool(self._pending)

    def deliver(self, time: float) -> list[Frame]:
        """Hand out, oldest first, the frames whose latency has passed."""
        ready = []
        while self._pending and self._pending[0].stamp + self.latency <= time + _CLOCK_TOLERANCE_S:
            frame = self._pending.popleft()
            if self._calibration is not None and self._calibration.stamp_s > 0:
                # Where the arm is at the time of the stamp was not known at the exposure.
                frame = frame.posed(self._calibration.pose_at(frame.stamp))
            self.latest = frame
            ready.append(frame)
            for callback in tuple(self._callbacks):
                callback(frame)
        return ready


class GuardedCamera:
    """Like `Camera` for those who look through it; a callback that raises is not called again.

    Args:
        camera: Camera of the arm, shared by all its leaves.

    Attributes:
        fault: Error that a callback has raised, until somebody takes it up.
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
        """The frame that was delivered last."""
        return self._camera.latest

    @property
    def aim(self) -> WindowRequest | None:
        """What is asked before each exposure what to expose, as `Camera.aim`."""
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
        """What was found in frames of late, as `Camera.findings`."""
        return self._camera.findings

    def subscribe(self, callback: FrameCallback) -> Callable[[], None]:
        """Have every frame handed to ``callback``; returns how to stop it."""
        return self._camera.subscribe(_Guarded(self, self._camera, callback))

    def _guarded_aim(self, stamp: float, camera: Pose, width: int, height: int) -> Window:
        try:
            return self._aim(stamp, camera, width, height) if self._aim else Window()
        except RAISED_BY_SKILLS as error:
            self.fault = error
            self.aim = None
            return Window()


class _Guarded:
    """A callback that is not called again once it has raised.

    A function would have to know itself for that, and so stay in memory, with whom it calls, until
    Python looks for circles.

    Args:
        owner: Who learns what it has raised.
        camera: Camera that calls it.
        callback: Callback itself.
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
