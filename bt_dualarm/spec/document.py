"""The models of a tree file: its world, objects, arms and cameras.

They hold the numbers of the file: metres, seconds, degrees; properties give SI.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Final, Literal, TypeAlias

from pydantic import (
    Discriminator,
    Field,
    InstanceOf,
    StringConstraints,
    Tag,
    WithJsonSchema,
    model_validator,
)

from bt_dualarm.spec.node import NodeSpec
from bt_dualarm.spec.values import Duration, PoseSpec, Speed, Value

NAME_PATTERN: Final = r"^[A-Za-z][A-Za-z0-9_-]{0,47}$"
"""Names end up in MuJoCo's names (``arm1/wrist``), in file names and in paths of nodes."""

LONGEST_NAME: Final = 100
"""Characters that the name of a task may have."""

Name: TypeAlias = Annotated[str, StringConstraints(pattern=NAME_PATTERN)]

NAMED_COLORS: Final[Mapping[str, tuple[float, float, float]]] = {
    "red": (0.80, 0.05, 0.05),
    "orange": (0.95, 0.45, 0.05),
    "yellow": (0.95, 0.85, 0.05),
    "green": (0.05, 0.65, 0.10),
    "blue": (0.05, 0.15, 0.80),
    "white": (0.95, 0.95, 0.95),
    "grey": (0.50, 0.50, 0.50),
    "black": (0.05, 0.05, 0.05),
}
"""Red, green, blue from 0 to 1 of each colour that an object can be given by name."""

ColorName: TypeAlias = Literal["red", "orange", "yellow", "green", "blue", "white", "grey", "black"]
_Share: TypeAlias = Annotated[float, Field(ge=0.0, le=1.0)]
_Length: TypeAlias = Annotated[float, Field(ge=1e-4, le=10.0)]
_Pixels: TypeAlias = Annotated[int, Field(ge=16, le=1920)]
_HalfWidth: TypeAlias = Annotated[float, Field(ge=0.0, le=10.0)]
_SIZES: Final = {"box": ("x", "y", "z"), "cylinder": ("radius", "length"), "sphere": ("radius",)}


def _written_as(value: Any) -> str:
    return "name" if isinstance(value, str) else "value"


class WorldSpec(Value):
    """The world and its clock.

    Attributes:
        scene: File name in ``assets/scenes`` without its ending.
        seed: Of everything random.
        timestep: Of the physics in seconds.
        renderer: Of the cameras; ``auto`` takes OpenGL where it works.
        time_limit: Simulated seconds after which the run ends as failed.
    """

    scene: Name = "table"
    seed: Annotated[int, Field(ge=0, lt=2**32)] = 0
    timestep: Annotated[float, Field(ge=1e-4, le=0.004)] = 0.002
    renderer: Literal["auto", "gl", "ray"] = "auto"
    time_limit: Annotated[Duration, Field(gt=0.0, le=86400.0)] = 600.0


class NoiseSpec(Value):
    """How far the seed may move an object's pose at the start.

    Attributes:
        xyz: Half-widths in metres of uniform offsets along the world's axes.
        yaw: Half-width in degrees of a uniform turn about the vertical.
    """

    xyz: tuple[_HalfWidth, _HalfWidth, _HalfWidth] = (0.0, 0.0, 0.0)
    yaw: Annotated[float, Field(ge=0.0, le=180.0)] = 0.0


class ObjectSpec(Value):
    """A thing in the world.

    Attributes:
        shape: Which fixes the meaning of ``size``.
        size: Metres: edges of a box; radius and length of a cylinder; radius of a sphere.
        mass: Kilograms.
        friction: Sliding friction coefficient.
        color: By name, or red, green, blue (, opacity) from 0 to 1.
        pose: Of its centre in the world.
        noise: How far the seed may move it.
        spawned: Whether it is there from the start.
        fixed: Whether it is held in place, whatever pushes it.
    """

    shape: Literal["box", "cylinder", "sphere"]
    size: Annotated[
        tuple[_Length, ...],
        Field(min_length=1, max_length=3, json_schema_extra={"unit": "m"}),
    ]
    mass: Annotated[float, Field(gt=0.0, le=1000.0)]
    friction: Annotated[float, Field(ge=0.0, le=10.0)] = 0.8
    color: Annotated[
        Annotated[ColorName, Tag("name")]
        | Annotated[tuple[_Share, ...], Field(min_length=3, max_length=4), Tag("value")],
        Discriminator(_written_as),
    ] = "grey"
    pose: PoseSpec = PoseSpec(xyz=(0.0, 0.0, 0.0))
    noise: NoiseSpec = NoiseSpec()
    spawned: bool = True
    fixed: bool = False

    @model_validator(mode="after")
    def _size_fits_shape(self) -> ObjectSpec:
        meaning = _SIZES[self.shape]
        if len(self.size) != len(meaning):
            wanted = ", ".join(meaning)
            raise ValueError(f"the size of a {self.shape} is [{wanted}], not {list(self.size)}")
        return self

    @property
    def rgba(self) -> tuple[float, float, float, float]:
        """Red, green, blue, opacity from 0 to 1."""
        red, green, blue, *opacity = (
            NAMED_COLORS[self.color] if isinstance(self.color, str) else self.color
        )
        return red, green, blue, opacity[0] if opacity else 1.0


class CameraSpec(Value):
    """An arm's camera.

    Attributes:
        mount: A mount of the robot's catalogue page, or a pose fixed in the world
            (OpenCV's frame: x right, y down, z forward).
        resolution: Width and height in pixels.
        fov: Vertical field of view in degrees.
        fps: Frames per simulated second.
        latency: Seconds from a frame's capture to its delivery.
        drop: Share of the frames that get lost on their way.
        noise: Pixels, standard deviation along x and y of a shake that nobody measures: each
            exposure looks past where it believes to look, so all that it sees is shifted.
    """

    mount: Annotated[
        Annotated[Name, Tag("name")] | Annotated[PoseSpec, Tag("value")],
        Discriminator(_written_as),
    ] = "wrist"
    resolution: tuple[_Pixels, _Pixels] = (320, 240)
    fov: Annotated[float, Field(ge=5.0, le=150.0)] = 50.0
    fps: Annotated[float, Field(gt=0.0, le=1000.0)] = 30.0
    latency: Annotated[Duration, Field(le=10.0)] = 0.0
    drop: Annotated[float, Field(ge=0.0, le=0.9)] = 0.0
    noise: Annotated[float, Field(ge=0.0, le=20.0)] = 0.0

    @property
    def fov_rad(self) -> float:
        """Vertical field of view in radians."""
        return math.radians(self.fov)


class LimitShares(Value):
    """How much of the robot's own limits an arm may use: a share above 0, at most 1, of each.

    Attributes:
        velocity: Of the joints' velocities.
        acceleration: Of the joints' accelerations.
        jerk: Of the joints' jerks: less is smoother, and easier to follow for whoever watches.
    """

    velocity: Speed = 1.0
    acceleration: Speed = 1.0
    jerk: Speed = 1.0


class ArmSpec(Value):
    """An arm with its tree.

    Attributes:
        robot: Name in the catalogue, or path of such a page relative to the tree file.
        base: Of the arm in the world.
        posture: Where its joints start: a posture of the robot's catalogue page.
        limits: Shares of the robot's limits that everything the arm does keeps to.
        tick_hz: Ticks of its tree per simulated second.
        camera: Its camera, if it has one.
        spawned: Whether it is there from the start.
        tree: What it does.
    """

    robot: Annotated[str, Field(min_length=1, max_length=200)]
    base: PoseSpec = PoseSpec(xyz=(0.0, 0.0, 0.0))
    posture: Name = "home"
    limits: LimitShares = LimitShares()
    tick_hz: Annotated[float, Field(gt=0.0, le=1000.0)] = 50.0
    camera: CameraSpec | None = None
    spawned: bool = True
    tree: Annotated[InstanceOf[NodeSpec], WithJsonSchema({})]

    @property
    def carries_camera(self) -> bool:
        """Whether it has a camera that moves with it."""
        return self.camera is not None and isinstance(self.camera.mount, str)


class TreeFile(Value):
    """A whole tree file.

    Attributes:
        name: Of the task; by default the file's name.
        description: One line for people.
        world: The world and its clock.
        objects: By name.
        arms: By name.
        path: Where the file lies; relative paths in it start from its folder.
    """

    name: Annotated[str, Field(min_length=1, max_length=LONGEST_NAME)]
    description: Annotated[str, Field(max_length=500)] = ""
    world: WorldSpec = WorldSpec()
    objects: Annotated[dict[Name, ObjectSpec], Field(default_factory=dict, max_length=200)]
    arms: Annotated[dict[Name, ArmSpec], Field(min_length=1, max_length=16)]
    path: InstanceOf[Path] = Path()

    @model_validator(mode="after")
    def _names_are_told_apart(self) -> TreeFile:
        for name in self.objects.keys() & self.arms.keys():
            raise ValueError(f"'{name}' is the name of an object and of an arm: rename one")
        return self

    @property
    def root(self) -> Path:
        """The folder that relative paths in the file start from."""
        return self.path.parent
