"""One picture to tune on: from a camera of a tree file, or from an image file."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Final

import cv2
import numpy as np

from bt_dualarm.errors import DualArmError
from bt_dualarm.pose import Pose
from bt_dualarm.registry import Registry
from bt_dualarm.run.parts import RunView
from bt_dualarm.run.session import Session, Wishes
from bt_dualarm.run.signals import StopRequest
from bt_dualarm.spec.document import ArmSpec, TreeFile
from bt_dualarm.spec.problems import suggestion
from bt_dualarm.tree.report import StatusChange
from bt_dualarm.world.camera import Camera, Frame
from bt_dualarm.world.rendering import Image, RendererKind

IMAGE_SUFFIXES: Final = (".png", ".jpg", ".jpeg", ".bmp", ".ppm", ".webp", ".tif", ".tiff")


class ShotError(DualArmError):
    """There is no picture; the message says why."""


@dataclass(frozen=True, eq=False)
class Shot:
    """A picture and where it comes from.

    Attributes:
        frame: Exposed as a whole.
        what: In words, for people.
    """

    frame: Frame
    what: str


@dataclass(frozen=True)
class Moment:
    """When a camera of a tree file takes its picture, and in what world.

    Attributes:
        seconds: Simulated, since the start of the run; 0 is before anything moves.
        posture: Where the joints of the camera's arm start; None for the file's posture.
        seed: Of everything random; None for the file's.
        renderer: None for the file's.
    """

    seconds: float = 0.0
    posture: str | None = None
    seed: int | None = None
    renderer: RendererKind | None = None


def image_shot(path: Path) -> Shot:
    """The picture of an image file.

    Raises:
        ShotError: It is no image that OpenCV reads.
    """
    try:
        raw = np.frombuffer(path.read_bytes(), np.uint8)
    except OSError as error:
        raise ShotError(f"{path}: cannot be read: {error.strerror or error}") from error
    image = cv2.imdecode(raw, cv2.IMREAD_COLOR) if raw.size else None
    if image is None:
        raise ShotError(f"{path}: is not an image that can be read")
    rgb = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)
    return Shot(still(rgb), str(path))


def still(image: Image, fov_rad: float = 1.0) -> Frame:
    """An image as a frame of a camera that stands in the world's origin."""
    height, width = image.shape[:2]
    return Frame(
        0.0,
        image,
        Pose.identity(),
        fov_rad,
        (0, 0, width, height),
    )


def camera_arm(file: TreeFile, name: str | None) -> str:
    """The arm whose camera is meant: the one of this name, or the only one with a camera.

    Raises:
        ShotError: There is none, or several and no name.
    """
    seeing = [arm for arm, spec in file.arms.items() if spec.camera is not None]
    if name is not None and name not in file.arms:
        raise ShotError(f"there is no arm '{name}': {suggestion(name, file.arms, 'arm')}")
    if name is not None and name not in seeing:
        raise ShotError(f"{name} has no camera (with one: {', '.join(seeing) or 'no arm'})")
    if name is None and len(seeing) != 1:
        found = f"several arms have one ({', '.join(seeing)})" if seeing else "no arm has one"
        raise ShotError(f"which camera? {found}" + "; say --arm NAME" * bool(seeing))
    return name or seeing[0]


def camera_shot(file: TreeFile, registry: Registry, arm: str, moment: Moment) -> Shot:
    """Compose the world of a file, run it until the moment, and expose.

    Latency, lost frames and shake of the camera are left out: they say nothing of colours.

    Args:
        file: Checked with the skills of ``registry``.
        registry: The installed skills.
        arm: Whose camera; see `camera_arm`.
        moment: When.

    Raises:
        ShotError: The arm is not in the world then, or the run broke before.
        DualArmError: The world cannot be composed, or the renderer cannot work here.
    """
    spec = file.arms[arm]
    if moment.posture is not None:
        spec = spec.model_copy(update={"posture": moment.posture})
        file = file.model_copy(update={"arms": {**file.arms, arm: spec}})
    stop = StopRequest()
    with Session(file, registry, Wishes(moment.seed, None, moment.renderer)) as session:
        shutter = _Shutter(moment.seconds, stop, lambda: _expose(session, arm, spec))
        if moment.seconds > 0.0:
            result = session.run([shutter], perf_counter, stop)
            if result.error:
                raise ShotError(f"the run broke before the picture: {result.error}")
        early = "" if stop.asked or moment.seconds <= 0.0 else ", where the run ended"
        frame = shutter.picture()
    what = f"camera of {arm} at {frame.stamp:.3f} s{early}, renderer {session.renderer_name}"
    return Shot(frame, f"{file.name}: {what}")


def _expose(session: Session, arm: str, spec: ArmSpec) -> Frame:
    world, renderer = session.assembly.world, session.assembly.renderer
    if arm not in world.arms:
        raise ShotError(f"{arm} is not in the world at {world.time:g} s; --at S looks later")
    if spec.camera is None or renderer is None:
        raise ShotError(f"{arm} has no camera")
    calm = spec.camera.model_copy(update={"noise": 0.0, "drop": 0.0})
    return Camera(f"{arm}/camera", calm, renderer).capture(world)


class _Shutter:
    """Exposes at a moment of a run, and then asks it to end.

    Args:
        seconds: Simulated.
        stop: Of the run.
        expose: Takes the picture of the world as it is.
    """

    def __init__(self, seconds: float, stop: StopRequest, expose: Callable[[], Frame]) -> None:
        self._seconds = seconds
        self._stop = stop
        self._expose = expose
        self._frame: Frame | None = None
        self._error: DualArmError | None = None

    def picture(self) -> Frame:
        """The one of the moment, or of now where the moment did not come.

        Raises:
            DualArmError: There was none.
        """
        if self._error is not None:
            raise self._error
        return self._frame or self._expose()

    def on_event(self, change: StatusChange) -> None:
        """Changes of a status do not matter here."""

    def after_ticks(self, run: RunView) -> None:
        """Neither do ticks."""

    def after_step(self, time: float) -> None:
        """Expose once, when the time has come."""
        if self._stop.asked or (time < self._seconds and not math.isclose(time, self._seconds)):
            return
        self._stop.count += 1
        try:
            self._frame = self._expose()
        except DualArmError as error:  # an observer that raises would be dropped
            self._error = error
