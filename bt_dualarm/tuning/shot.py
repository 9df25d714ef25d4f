"""One picture to tune on: from a camera of a tree file, or from an image file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from bt_dualarm.errors import DualArmError
from bt_dualarm.pose import Pose
from bt_dualarm.runtime.options import RunOptions
from bt_dualarm.runtime.run import Run
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.document import ArmSpec, TreeFile
from bt_dualarm.spec.problems import suggestion
from bt_dualarm.tuning.image_file import read_image
from bt_dualarm.world.cameras.camera import Camera
from bt_dualarm.world.cameras.frame import Frame
from bt_dualarm.world.rendering.renderer import Image, RendererKind


class ShotError(DualArmError):
    """There is no picture; the message says why."""


@dataclass(frozen=True, eq=False)
class Shot:
    """A picture and where it comes from.

    Attributes:
        frame: Frame that was exposed as a whole.
        what: Words for people on where it comes from.
    """

    frame: Frame
    what: str


@dataclass(frozen=True)
class Moment:
    """When a camera of a tree file takes its picture, and in what world.

    Attributes:
        seconds: Simulated time since the start of the run in s; 0 is before anything moves.
        posture: Named posture in which the camera's arm starts; None for the file's.
        seed: Seed of everything random; None for the file's.
        renderer: Kind of renderer; None for the file's.
    """

    seconds: float = 0.0
    posture: str | None = None
    seed: int | None = None
    renderer: RendererKind | None = None


def image_shot(path: Path) -> Shot:
    """The picture of an image file.

    Raises:
        ImageFileError: It is no image that can be read.
    """
    return Shot(still(read_image(path)), str(path))


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
        file: Tree file, checked with the skills of ``registry``.
        registry: Installed skills.
        arm: Name of the arm whose camera it is; see `camera_arm`.
        moment: Moment of the exposure.

    Raises:
        ShotError: The arm is not in the world then, or the run broke before.
        DualArmError: The world cannot be composed, or the renderer cannot work here.
    """
    spec = file.arms[arm]
    if moment.posture is not None:
        spec = spec.model_copy(update={"posture": moment.posture})
        file = file.model_copy(update={"arms": {**file.arms, arm: spec}})
    with Run(file, registry, RunOptions(moment.seed, None, moment.renderer)) as run:
        if moment.seconds > 0.0:
            run.step(moment.seconds)
        if run.done and run.result.error:
            raise ShotError(f"the run broke before the picture: {run.result.error}")
        early = ", where the run ended" if run.done else ""
        frame = _expose(run, arm, spec)
    what = f"camera of {arm} at {frame.stamp:.3f} s{early}, renderer {run.renderer}"
    return Shot(frame, f"{file.name}: {what}")


def _expose(run: Run, arm: str, spec: ArmSpec) -> Frame:
    world, renderer = run.world, run.assembly.renderer
    if arm not in world.arms:
        raise ShotError(f"{arm} is not in the world at {world.time:g} s; --at S looks later")
    if spec.camera is None or renderer is None:
        raise ShotError(f"{arm} has no camera")
    calm = spec.camera.model_copy(update={"noise": 0.0, "drop": 0.0})
    return Camera(f"{arm}/camera", calm, renderer).capture(world)
