"""A camera in the hands of one leaf: what that leaf's callbacks raise stays its own fault."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from bt_dualarm.errors import RAISED_BY_SKILLS
from bt_dualarm.pose import Pose
from bt_dualarm.world.cameras.camera import Camera, FrameCallback, WindowRequest
from bt_dualarm.world.cameras.frame import Frame, Window
from bt_dualarm.world.cameras.look import Look


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
    def looks(self) -> deque[Look]:
        """What was found in frames of late, as `Camera.looks`."""
        return self._camera.looks

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
        self._owner, self._camera, self._callback = owner, camera, callback

    def __call__(self, frame: Frame) -> None:
        try:
            self._callback(frame)
        except RAISED_BY_SKILLS as error:
            self._owner.fault = error
            self._camera.unsubscribe(self)
