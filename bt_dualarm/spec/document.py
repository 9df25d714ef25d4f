"""The models of a tree file: its world, objects, arms and cameras.

They hold the numbers of the file: metres, seconds, degrees; properties give SI.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Final, Literal, Self, TypeAlias

from pydantic import (
    AfterValidator,
    Discriminator,
    Field,
    InstanceOf,
    Tag,
    WithJsonSchema,
    model_validator,
)

from bt_dualarm.spec.camera import CameraSpec
from bt_dualarm.spec.collision import CollisionSpec
from bt_dualarm.spec.marker import MarkerSpec
from bt_dualarm.spec.mounted import Mounted
from bt_dualarm.spec.name import Name, written_as
from bt_dualarm.spec.node import NodeSpec
from bt_dualarm.spec.ports import port
from bt_dualarm.spec.reality import Reality
from bt_dualarm.spec.shapes import SIZE_IN_WORDS, SIZES, ShapeName
from bt_dualarm.spec.values import Duration, PoseSpec, Speed, Value
from bt_dualarm.spec.wording import one_line

LONGEST_NAME: Final = 100
"""Characters that the name of a task may have."""

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
_Part: TypeAlias = Annotated[float, Field(ge=0.0, le=1.0)]
_Length: TypeAlias = Annotated[float, Field(ge=1e-4, le=10.0)]
_HalfWidth: TypeAlias = Annotated[float, Field(ge=0.0, le=10.0)]


class WorldSpec(Value):
    """The world and its clock."""

    scene: Name = port("table", "File in `assets/scenes`, without its ending")
    seed: int = port(0, "Seed of everything random", ge=0, lt=2**32)
    timestep: float = port(0.002, "Step of the physics", unit="s", ge=1e-4, le=0.004)
    renderer: Literal["auto", "gl", "ray"] = port(
        "ray",
        "Renderer of the cameras' pictures; by rays they are the same on every machine, `auto` "
        "takes OpenGL where it works",
    )
    time_limit: Duration = port(
        600.0, "Simulated time after which the run ends as failed", ge=0.001, le=86400.0
    )
    reality: Reality = port(
        "ideal", "How far the simulated arms are from what their controllers believe of them"
    )


class NoiseSpec(Value):
    """How far the seed may move an object's pose at the start."""

    xyz: tuple[_HalfWidth, _HalfWidth, _HalfWidth] = port(
        (0.0, 0.0, 0.0), "Half-widths of uniform offsets along the world's axes", unit="m"
    )
    yaw: float = port(
        0.0, "Half-width of a uniform turn about the vertical", unit="deg", ge=0.0, le=180.0
    )


class ObjectSpec(Value):
    """A thing in the world."""

    shape: ShapeName = port(..., "Form, which says what `size` means")
    size: tuple[_Length, ...] = port(..., SIZE_IN_WORDS, unit="m", min_length=1, max_length=3)
    mass: float = port(..., "Mass, spread evenly", unit="kg", ge=1e-4, le=1000.0)
    friction: float = port(0.8, "Coefficient of sliding friction", ge=0.0, le=10.0)
    color: Annotated[
        Annotated[ColorName, Tag("name")]
        | Annotated[tuple[_Part, ...], Field(min_length=3, max_length=4), Tag("value")],
        Discriminator(written_as),
    ] = port("grey", "Colour by name, or as red, green, blue (, opacity) from 0 to 1")
    pose: PoseSpec = port(PoseSpec(xyz=(0.0, 0.0, 0.0)), "Pose of its centre in the world")
    noise: NoiseSpec = port(NoiseSpec(), "Bounds within which the seed may move it")
    marker: MarkerSpec | None = port(None, "Marker on its top face, if it has one")
    spawned: bool = port(True, "Whether it is there from the start")
    fixed: bool = port(False, "Whether it is held in place, whatever pushes it")

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
            if self.marker.board > room + 1e-9:
                raise ValueError(
                    f"its marker takes {1e3 * self.marker.board:.1f} mm with the white around it; "
                    f"its top has {1e3 * room:.1f} mm"
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
    """How much of the robot's own limits an arm may use: a share of each."""

    velocity: Speed = port(1.0, "Share of the joints' velocities")
    acceleration: Speed = port(1.0, "Share of the joints' accelerations")
    jerk: Speed = port(
        1.0,
        "Share of the joints' jerks: less is smoother, and easier to follow for whoever watches",
    )


class ArmSpec(Value):
    """An arm with its tree."""

    robot: str = port(
        ...,
        "Name in the catalogue, or path of such a page relative to the tree file",
        min_length=1,
        max_length=200,
    )
    gripper: Mounted = port(
        None,
        "Gripper in place of the robot's own tool: name in the catalogue, path of such a page "
        "relative to the tree file, or `none`; or by a parameter: "
        '`{value: "{grasp}", cases: {fingers: robotiq_2f85, attach: none}}`',
    )
    base: PoseSpec = port(PoseSpec(xyz=(0.0, 0.0, 0.0)), "Pose of its base in the world")
    posture: Name = port("home", "Posture of the robot's catalogue page in which it starts")
    limits: LimitShares = port(
        LimitShares(), "Shares of the robot's limits that everything the arm does keeps to"
    )
    reality: Reality | None = port(
        None, "How far this arm is from what is believed of it; by default as the world says"
    )
    force_limit: float = port(
        280.0,
        "Force with which it may press on things, as far as it can feel that; a motion in which it "
        "presses harder fails",
        unit="N",
        ge=10.0,
        le=5000.0,
    )
    collision: CollisionSpec = port(CollisionSpec(), "What it does when it is hit")
    tick_hz: float = port(
        50.0, "Ticks of its tree per simulated second", unit="Hz", ge=0.1, le=1000.0
    )
    camera: CameraSpec | None = port(None, "Its camera, if it has one")
    spawned: bool = port(True, "Whether it is there from the start")
    removable: bool = port(
        False, "Whether a run succeeds although it was taken away before its tree had ended"
    )
    last_life_counts: bool = port(
        False, "Whether a run succeeds although it had failed before it was spawned anew"
    )
    tree: Annotated[InstanceOf[NodeSpec], WithJsonSchema({})] = port(
        ..., "One node, with others below it"
    )

    @property
    def carries_camera(self) -> bool:
        """Whether it has a camera that moves with it."""
        return self.camera is not None and isinstance(self.camera.mount, str)


class TreeContent(Value):
    """What a tree file says.

    Attributes:
        name: Name of the task; by default that of the file.
        description: One line for people.
        world: The world and its clock.
        objects: Things in the world by name.
        arms: Arms with their trees by name.
    """

    name: Annotated[str, Field(min_length=1, max_length=LONGEST_NAME), AfterValidator(one_line)]
    description: Annotated[str, Field(max_length=500)] = ""
    world: WorldSpec = WorldSpec()
    objects: Annotated[dict[Name, ObjectSpec], Field(default_factory=dict, max_length=200)]
    arms: Annotated[dict[Name, ArmSpec], Field(min_length=1, max_length=16)]

    @model_validator(mode="after")
    def _names_are_told_apart(self) -> Self:
        for name in self.objects.keys() & self.arms.keys():
            raise ValueError(f"'{name}' is the name of an object and of an arm: rename one")
        return self


class TreeFile(TreeContent):
    """A whole tree file.

    Attributes:
        path: Path of the file; relative paths in it start from its folder.
        texts: Text of the file, then those of the files that it includes, by their paths; Python
            data as JSON.
        given: Values of its parameters, by name.
    """

    path: InstanceOf[Path] = Path()
    texts: Mapping[str, str] = Field(default_factory=dict, repr=False)
    given: Mapping[str, object] = Field(default_factory=dict, repr=False)

    def in_reality(self, reality: Reality) -> TreeFile:
        """The same file, whose arms all are as far from what is believed of them as given."""
        arms = {name: arm.model_copy(update={"reality": None}) for name, arm in self.arms.items()}
        world = self.world.model_copy(update={"reality": reality})
        return self.model_copy(update={"world": world, "arms": arms})

    @property
    def root(self) -> Path:
        """The folder that relative paths in the file start from."""
        return self.path.parent
