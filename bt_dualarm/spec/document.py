"""Models of a tree file: world, objects, arms, cameras.

Fields have the units of the file, meters, seconds and degrees; properties are in SI.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Final, Literal, Self, TypeAlias

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Discriminator,
    Field,
    InstanceOf,
    StringConstraints,
    Tag,
    ValidationInfo,
    WithJsonSchema,
    field_validator,
    model_validator,
)

from bt_dualarm.spec.cell import CellSpec
from bt_dualarm.spec.node_types import NodeSpec
from bt_dualarm.spec.ports import one_line, port
from bt_dualarm.spec.problems import Name, written_as
from bt_dualarm.spec.reality import Reality
from bt_dualarm.spec.values import (
    SIZE_IN_WORDS,
    SIZES,
    Duration,
    MarkerSpec,
    PoseSpec,
    ShapeName,
    Speed,
    Value,
)
from bt_dualarm.spec.yaml_reader import Data


class CollisionSpec(Value):
    """Reaction of an arm to a collision, which is detected by the torques of its joints."""

    stop: bool = port(False, "Whether its motion ends with `COLLISION` and a short retreat")
    threshold: float = port(
        1.0, "Factor on the torques that count as a collision", ge=0.2, le=1000.0
    )


MOST_UNDER_WAY_MB: Final = 100.0
"""Largest size in MB of a camera's images that are taken and not delivered yet."""

_MB_A_PIXEL: Final = 3e-6
_Pixels: TypeAlias = Annotated[int, Field(ge=16, le=1920)]


class CameraSpec(Value):
    """An arm's camera."""

    mount: Annotated[
        Annotated[Name, Tag("name")] | Annotated[PoseSpec, Tag("value")],
        Discriminator(written_as),
    ] = port(
        "wrist",
        "A mount of the robot's description, or a pose fixed in the world (OpenCV's frame: "
        "x right, y down, z forward)",
    )
    resolution: tuple[_Pixels, _Pixels] = port((320, 240), "Width and height", unit="px")
    fov: float = port(50.0, "Vertical field of view", unit="deg", ge=5.0, le=150.0)
    fps: float = port(30.0, "Frames per simulated second", unit="Hz", ge=0.1, le=1000.0)
    latency: Duration = port(0.0, "Time from a frame's capture to its delivery", le=10.0)
    drop: float = port(0.0, "Fraction of lost frames", ge=0.0, le=0.9)
    noise: float = port(
        0.0,
        "Standard deviation along x and y of an unmeasured camera shake, which shifts each image "
        "as a whole",
        unit="px",
        ge=0.0,
        le=20.0,
    )

    @field_validator("latency")
    @classmethod
    def _pictures_under_way_are_bounded(cls, latency: float, info: ValidationInfo) -> float:
        # Fields that are declared before this one, and valid, are in `info.data`.
        if "resolution" in info.data and "fps" in info.data:
            (width, height) = info.data["resolution"]
            fps = info.data["fps"]
            picture_mb = _MB_A_PIXEL * width * height
            if latency * fps * picture_mb > MOST_UNDER_WAY_MB:
                allowed = math.floor(1e3 * MOST_UNDER_WAY_MB / picture_mb / fps)
                raise ValueError(
                    f"{latency:g} s at {fps:g} Hz keep {latency * fps:.0f} images of "
                    f"{width} x {height} px in transit, {latency * fps * picture_mb:.0f} MB; at "
                    f"most {MOST_UNDER_WAY_MB:g} MB: here {allowed} ms"
                )
        return latency

    @property
    def fov_rad(self) -> float:
        """Vertical field of view in radians."""
        return math.radians(self.fov)


_NONE: Final = "none"
_FORM: Final = 'as in gripper: {value: "{grasp}", cases: {fingers: robotiq_2f85, attach: none}}'
_GRIPPER: Final = {"type": "string", "minLength": 1, "maxLength": 200}


def _chosen_case(given: Data) -> Data:
    """Returns the gripper of the case that equals the value; other data as they are."""
    if isinstance(given, dict):
        if given.keys() != {"value", "cases"} or not isinstance(given["cases"], dict):
            raise ValueError(f"expected a gripper, or a value and cases, {_FORM}")
        value = given["value"]
        cases = given["cases"]
        if not isinstance(value, str) or value not in cases:
            raise ValueError(f"no case for {value!r}; cases: {', '.join(cases)}")
        given = cases[value]
        if not isinstance(given, str):
            raise ValueError(f"case {value!r}: expected the name of a gripper or none, {_FORM}")
    return None if given == _NONE else given


Mounted: TypeAlias = Annotated[
    Annotated[str, StringConstraints(min_length=1, max_length=200)] | None,
    BeforeValidator(_chosen_case),
    WithJsonSchema(
        {
            "anyOf": [
                _GRIPPER,
                {
                    "type": "object",
                    "properties": {
                        "value": {"type": "string"},
                        "cases": {"type": "object", "additionalProperties": _GRIPPER},
                    },
                    "required": ["value", "cases"],
                    "additionalProperties": False,
                },
                {"type": "null"},
            ]
        }
    ),
]
"""Name or path of a gripper description, None for no gripper; a parameter may choose it."""


LONGEST_NAME: Final = 100
"""Largest number of characters in the name of a task."""

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
"""Red, green, blue from 0 to 1 of each color that an object can have by name."""

ColorName: TypeAlias = Literal["red", "orange", "yellow", "green", "blue", "white", "grey", "black"]
_Part: TypeAlias = Annotated[float, Field(ge=0.0, le=1.0)]
_Length: TypeAlias = Annotated[float, Field(ge=1e-4, le=10.0)]
_HalfWidth: TypeAlias = Annotated[float, Field(ge=0.0, le=10.0)]
_Locked: TypeAlias = Annotated[float, Field(ge=-720.0, le=720.0)]


class WorldSpec(Value):
    """The world and its clock."""

    scene: Name = port("table", "File in `assets/scenes`, without its ending")
    seed: int = port(0, "Random seed", ge=0, lt=2**32)
    timestep: float = port(0.002, "Physics time step", unit="s", ge=1e-4, le=0.004)
    renderer: Literal["auto", "gl", "ray"] = port(
        "ray",
        "Camera renderer; `ray` gives the same images on every machine, `auto` uses OpenGL if "
        "available",
    )
    time_limit: Duration = port(
        600.0, "Simulated time after which the run ends as failed", ge=0.001, le=86400.0
    )
    reality: Reality = port(
        "ideal", "Model mismatch: how far the simulated arms deviate from their nominal models"
    )


class NoiseSpec(Value):
    """Bounds of the random offset of an object's initial pose, sampled with the seed."""

    xyz: tuple[_HalfWidth, _HalfWidth, _HalfWidth] = port(
        (0.0, 0.0, 0.0), "Half-widths of uniform offsets along the world's axes", unit="m"
    )
    yaw: float = port(
        0.0, "Half-width of a uniform rotation about the vertical", unit="deg", ge=0.0, le=180.0
    )


class ObjectSpec(Value):
    """An object in the world."""

    shape: ShapeName = port(..., "Shape, which determines the meaning of `size`")
    size: tuple[_Length, ...] = port(..., SIZE_IN_WORDS, unit="m", min_length=1, max_length=3)
    mass: float = port(..., "Mass, evenly distributed", unit="kg", ge=1e-4, le=1000.0)
    friction: float = port(0.8, "Coefficient of sliding friction", ge=0.0, le=10.0)
    color: Annotated[
        Annotated[ColorName, Tag("name")]
        | Annotated[tuple[_Part, ...], Field(min_length=3, max_length=4), Tag("value")],
        Discriminator(written_as),
    ] = port("grey", "Color by name, or as red, green, blue (, opacity) from 0 to 1")
    pose: PoseSpec = port(PoseSpec(xyz=(0.0, 0.0, 0.0)), "Pose of its center in the world")
    noise: NoiseSpec = port(NoiseSpec(), "Bounds within which the seed may move it")
    marker: MarkerSpec | None = port(None, "Marker on its top face, if it has one")
    spawned: bool = port(True, "Whether it is in the world from the start")
    fixed: bool = port(False, "Whether it is fixed in the world")

    @model_validator(mode="after")
    def _size_fits_shape(self) -> ObjectSpec:
        meaning = SIZES[self.shape]
        if len(self.size) != len(meaning):
            wanted = ", ".join(meaning)
            raise ValueError(f"the size of a {self.shape} is [{wanted}], not {list(self.size)}")
        return self

    @model_validator(mode="after")
    def _marker_fits(self) -> ObjectSpec:
        if self.marker is not None:
            if self.shape in ("sphere", "capsule"):
                raise ValueError(f"a {self.shape} has no face for a marker")
            room = min(self.size[:2]) if self.shape == "box" else 2**0.5 * self.size[0]
            if self.marker.outer_size > room + 1e-9:
                raise ValueError(
                    f"its marker takes {1e3 * self.marker.outer_size:.1f} mm with the white around "
                    f"it; its top has {1e3 * room:.1f} mm"
                )
        return self

    @property
    def rgba(self) -> tuple[float, float, float, float]:
        """Red, green, blue, opacity from 0 to 1."""
        red, green, blue, *opacity = (
            NAMED_COLORS[self.color] if isinstance(self.color, str) else self.color
        )
        return red, green, blue, opacity[0] if opacity else 1.0


class LimitShares(Value):
    """Fractions of the robot's limits that an arm may use."""

    velocity: Speed = port(1.0, "Fraction of the joint velocity limits")
    acceleration: Speed = port(1.0, "Fraction of the joint acceleration limits")
    jerk: Speed = port(
        1.0,
        "Fraction of the joint jerk limits: less is smoother, and easier for a camera to track",
    )


class ArmSpec(Value):
    """An arm with its tree."""

    robot: str = port(
        ...,
        "Name in the catalog, or path of a robot description relative to the tree file",
        min_length=1,
        max_length=200,
    )
    gripper: Mounted = port(
        None,
        "Gripper in place of the robot's stock tool: name in the catalog, path of a gripper "
        "description relative to the tree file, or `none`; or by a parameter: "
        '`{value: "{grasp}", cases: {fingers: robotiq_2f85, attach: none}}`',
    )
    locked: Annotated[dict[str, _Locked], Field(max_length=200)] = port(
        {},
        "Positions of the description's locked joints by name, in meters (prismatic) or degrees "
        "(revolute); by default as in the description. "
        "`{panda_finger_joint1: 0.04}` opens a Panda's stock fingers; the other finger follows",
    )
    base: PoseSpec = port(PoseSpec(xyz=(0.0, 0.0, 0.0)), "Pose of its base in the world")
    posture: Name = port("home", "Posture of the robot's description in which it starts")
    limits: LimitShares = port(
        LimitShares(), "Fractions of the robot's limits, for all motions of the arm"
    )
    reality: Reality | None = port(None, "Model mismatch of this arm; by default the world's")
    force_limit: float = port(
        280.0,
        "Largest sensed contact force; a motion that exceeds it fails",
        unit="N",
        ge=10.0,
        le=5000.0,
    )
    collision: CollisionSpec = port(CollisionSpec(), "Reaction to a collision")
    tick_hz: float = port(
        50.0, "Ticks of its tree per simulated second", unit="Hz", ge=0.1, le=1000.0
    )
    camera: CameraSpec | None = port(None, "Its camera, if it has one")
    spawned: bool = port(True, "Whether it is in the world from the start")
    removable: bool = port(
        False, "Whether a run may succeed if the arm was removed before its tree had ended"
    )
    last_life_counts: bool = port(
        False, "Whether a run may succeed if the arm had failed before it was spawned again"
    )
    tree: Annotated[InstanceOf[NodeSpec], WithJsonSchema({})] = port(..., "Root node of the tree")

    @property
    def carries_camera(self) -> bool:
        """Whether it has a camera that moves with it."""
        return self.camera is not None and isinstance(self.camera.mount, str)


class TreeContent(Value):
    """Content of a tree file.

    Attributes:
        name: Name of the task; by default that of the file.
        description: One-line description.
        world: World and its clock.
        objects: Objects in the world by name.
        cell: What the trees share.
        arms: Arms with their trees by name.
    """

    name: Annotated[str, Field(min_length=1, max_length=LONGEST_NAME), AfterValidator(one_line)]
    description: Annotated[str, Field(max_length=500)] = ""
    world: WorldSpec = WorldSpec()
    objects: Annotated[dict[Name, ObjectSpec], Field(default_factory=dict, max_length=200)]
    cell: CellSpec = CellSpec()
    arms: Annotated[dict[Name, ArmSpec], Field(min_length=1, max_length=16)]

    @model_validator(mode="after")
    def _names_are_unique(self) -> Self:
        for name in self.objects.keys() & self.arms.keys():
            raise ValueError(f"'{name}' is the name of an object and of an arm: rename one")
        return self


class TreeFile(TreeContent):
    """A tree file.

    Attributes:
        path: Path of the file; relative paths in it start from its folder.
        texts: Texts of the file and of the files that it includes by path; Python data as JSON.
        given: Values of its parameters by name.
    """

    path: InstanceOf[Path] = Path()
    texts: Mapping[str, str] = Field(default_factory=dict, repr=False)
    given: Mapping[str, object] = Field(default_factory=dict, repr=False)

    def in_reality(self, reality: Reality) -> TreeFile:
        """Returns the file with this model mismatch for all arms."""
        arms = {name: arm.model_copy(update={"reality": None}) for name, arm in self.arms.items()}
        world = self.world.model_copy(update={"reality": reality})
        return self.model_copy(update={"world": world, "arms": arms})

    @property
    def root(self) -> Path:
        """Folder from which relative paths in the file start."""
        return self.path.parent
