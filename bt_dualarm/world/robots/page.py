"""A robot's page in the catalogue: what its YAML file may say, and where it is wrong."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final, TypeAlias

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from bt_dualarm.pose import Pose
from bt_dualarm.spec.document import LONGEST_NAME
from bt_dualarm.spec.name import Name
from bt_dualarm.spec.values import Value
from bt_dualarm.world.robots.page_file import PageFile

_Positive: TypeAlias = Annotated[float, Field(gt=0.0)]
_NotNegative: TypeAlias = Annotated[float, Field(ge=0.0, le=1e4)]
_Metres: TypeAlias = Annotated[float, Field(ge=-10.0, le=10.0)]
_Near: TypeAlias = tuple[_Metres, _Metres, _Metres]
_Turn: TypeAlias = Annotated[float, Field(ge=-720.0, le=720.0)]
_Held: TypeAlias = Annotated[float, Field(ge=-720.0, le=720.0)]
_Share: TypeAlias = Annotated[float, Field(ge=0.0, le=1.0)]
_MOST: Final = 200

TYPICAL_ROTOR: Final = 0.1
"""Rotor inertia in kg m² that MuJoCo Menagerie gives the joints of UR5e, Panda and xArm7 alike."""

MAX_JOINTS: Final = 24
"""Joints of one arm; a torso and an arm of a humanoid have ten."""


def _printable(text: str | None) -> str | None:
    if text is not None and not text.isprintable():
        raise ValueError("holds a character that cannot be printed")
    return text


_Printable: Final = AfterValidator(_printable)

Color: TypeAlias = tuple[_Share, _Share, _Share, _Share]
"""Red, green, blue, opacity."""


@dataclass(frozen=True)
class ToolShape:
    """A cylinder along the tool's z axis: what the arm touches objects with. Metres."""

    radius: float
    length: float


class ToolEntry(Value):
    """The tool frame in its link, and a shape that ends in it; metres, degrees."""

    link: str
    xyz: _Near = (0.0, 0.0, 0.0)
    rpy: tuple[_Turn, _Turn, _Turn] = (0.0, 0.0, 0.0)
    radius: Annotated[float | None, Field(gt=0.0, le=0.5)] = None
    length: Annotated[float | None, Field(gt=0.0, le=1.0)] = None

    @property
    def pose(self) -> Pose:
        """The tool frame in its link."""
        roll, pitch, yaw = np.deg2rad(self.rpy)
        return Pose.from_rpy(self.xyz, (roll, pitch, yaw))

    @property
    def shape(self) -> ToolShape | None:
        """The shape, if there is one."""
        if self.radius is None or self.length is None:
            return None
        return ToolShape(self.radius, self.length)


class FlangeEntry(Value):
    """Where grippers are mounted; metres, degrees. Its z axis points away from the arm.

    Attributes:
        stock: Links of the stock tool, which comes off with all that hangs on them.
    """

    link: str
    xyz: _Near = (0.0, 0.0, 0.0)
    rpy: tuple[_Turn, _Turn, _Turn] = (0.0, 0.0, 0.0)
    stock: Annotated[tuple[str, ...], Field(max_length=_MOST)] = ()

    @property
    def pose(self) -> Pose:
        """The flange in its link."""
        roll, pitch, yaw = np.deg2rad(self.rpy)
        return Pose.from_rpy(self.xyz, (roll, pitch, yaw))


class CameraEntry(Value):
    """A place for a camera on a link: where it is, where it looks, what is up in its image."""

    link: str
    xyz: _Near
    forward: _Near
    up: _Near

    @model_validator(mode="after")
    def _spans_an_image(self) -> CameraEntry:
        lengths = np.linalg.norm(self.forward) * np.linalg.norm(self.up)
        if np.linalg.norm(np.cross(self.forward, self.up)) <= 1e-6 * lengths:
            raise ValueError("forward and up must be two different directions")
        return self

    @property
    def pose(self) -> Pose:
        """The camera in its link: x right, y down, z forward."""
        forward = np.asarray(self.forward) / np.linalg.norm(self.forward)
        right = np.cross(forward, self.up)
        right /= np.linalg.norm(right)
        matrix = np.eye(4)
        matrix[:3, :3] = np.column_stack((right, np.cross(forward, right), forward))
        matrix[:3, 3] = self.xyz
        return Pose.from_matrix(matrix)


class LimitEntry(Value):
    """One value for all joints or one for each, and who says so."""

    value: _Positive | tuple[_Positive, ...]
    source: Annotated[str, Field(min_length=8)]


class LimitsEntry(Value):
    """Limits in rad/s, rad/s², rad/s³ and N m; velocity and effort only where the URDF errs."""

    acceleration: LimitEntry
    jerk: LimitEntry
    velocity: LimitEntry | None = None
    effort: LimitEntry | None = None


class PayloadEntry(Value):
    """What the maker lets the arm carry, in kg, and who says so."""

    value: Annotated[float, Field(gt=0.0, le=1e4)]
    source: Annotated[str, Field(min_length=8)]


class FrictionEntry(Value):
    """Friction of the joints, base to tip, as `JointFriction` has it, and who says so."""

    coulomb: tuple[_NotNegative, ...]
    viscous: tuple[_NotNegative, ...] | None = None
    static: tuple[_NotNegative, ...] | None = None
    stribeck_velocity: _Positive = 0.1
    rise: tuple[_Positive, ...] | None = None
    offset: tuple[float, ...] | None = None
    source: Annotated[str, Field(min_length=8)]


class RobotEntry(Value):
    """A page of the catalogue.

    Attributes:
        title: Name for people.
        urdf: File in the example-robot-data package, or beside the page; likewise ``srdf``.
        base_link: Link that stands still; what does not hang on it is left out.
        flange: Where grippers are mounted; by default where the tool's shape begins.
        joints: Joints of the arm, base to tip; all others are locked.
        locked: Where joints are locked if not at zero: metres of a sliding one, degrees of one that
            turns.
        payload: Largest mass that the arm may hold; without it, what its joints bear.
        friction: What is published of the joints' friction; without it, what is typical is taken.
        rotor_inertia: Inertia of a motor's rotor behind its gear in kg m².
        postures: Joint angles in degrees; ``home`` is required.
        exclude: Pairs of links whose contacts do not count, beside those of the SRDF.
    """

    title: Annotated[str, Field(min_length=1, max_length=LONGEST_NAME), _Printable]
    urdf: Annotated[str, _Printable]
    srdf: Annotated[str | None, _Printable] = None
    base_link: str
    tool: ToolEntry
    flange: FlangeEntry | None = None
    joints: Annotated[tuple[str, ...], Field(min_length=1, max_length=MAX_JOINTS)]
    locked: dict[str, _Held] = Field(default_factory=dict)
    limits: LimitsEntry
    payload: PayloadEntry | None = None
    friction: FrictionEntry | None = None
    rotor_inertia: Annotated[float, Field(ge=0.0, le=100.0)] = TYPICAL_ROTOR
    postures: Annotated[dict[Name, tuple[float, ...]], Field(max_length=_MOST)]
    cameras: Annotated[dict[Name, CameraEntry], Field(default_factory=dict, max_length=_MOST)]
    exclude: Annotated[tuple[tuple[str, str], ...], Field(max_length=10_000)] = ()
    colors: dict[str, Color] = Field(default_factory=dict)


class RobotFile(PageFile[RobotEntry]):
    """A page that was read, and the text that messages point into.

    Raises:
        DescriptionError: The file is no page; it carries every reason.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, RobotEntry)
