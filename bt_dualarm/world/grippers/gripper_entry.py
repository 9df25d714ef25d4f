"""What the YAML file of a gripper may say, and where it is wrong."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, TypeAlias

import numpy as np
from pydantic import Field, model_validator

from bt_dualarm.pose import Pose
from bt_dualarm.spec.document import LONGEST_NAME
from bt_dualarm.spec.values import Value
from bt_dualarm.world.robots.page_file import PageFile

_Metres: TypeAlias = Annotated[float, Field(ge=-2.0, le=2.0)]
_Length: TypeAlias = Annotated[float, Field(gt=0.0, le=2.0)]
_Turn: TypeAlias = Annotated[float, Field(ge=-720.0, le=720.0)]
_Share: TypeAlias = Annotated[float, Field(ge=0.0, le=1.0)]
_Mass: TypeAlias = Annotated[float, Field(gt=0.0, le=100.0)]
_Text: TypeAlias = Annotated[str, Field(min_length=8, max_length=300)]
_Force: TypeAlias = Annotated[float, Field(gt=0.0, le=5000.0)]
_Speed: TypeAlias = Annotated[float, Field(gt=0.0, le=2.0)]

_LENGTHS = {"box": 3, "cylinder": 2, "sphere": 1}


class PlaceEntry(Value):
    """A frame in another; metres, degrees."""

    xyz: tuple[_Metres, _Metres, _Metres] = (0.0, 0.0, 0.0)
    rpy: tuple[_Turn, _Turn, _Turn] = (0.0, 0.0, 0.0)

    @property
    def pose(self) -> Pose:
        """The frame in the other."""
        roll, pitch, yaw = np.deg2rad(self.rpy)
        return Pose.from_rpy(self.xyz, (roll, pitch, yaw))


class ShapeEntry(PlaceEntry):
    """A box by its lengths, a cylinder by radius and length, a sphere by its radius."""

    shape: Literal["box", "cylinder", "sphere"]
    size: Annotated[tuple[_Length, ...], Field(min_length=1, max_length=3)]

    @model_validator(mode="after")
    def _has_its_sizes(self) -> ShapeEntry:
        if len(self.size) != _LENGTHS[self.shape]:
            raise ValueError(f"a {self.shape} has {_LENGTHS[self.shape]} sizes")
        return self


class PartEntry(Value):
    """What a part consists of; its mass is spread evenly over its shapes."""

    mass: _Mass
    shapes: Annotated[tuple[ShapeEntry, ...], Field(min_length=1, max_length=50)]


class PadEntry(Value):
    """The box of a finger that takes hold of things, in the finger's frame."""

    xyz: tuple[_Metres, _Metres, _Metres]
    size: tuple[_Length, _Length, _Length]


class FingersEntry(Value):
    """Two fingers that slide along y of the palm, the second one the first turned by 180° about z.

    Attributes:
        urdf: URDF that describes palm and fingers, in place of shapes.
        links: Links of the URDF that are the fingers, the first one opens along +y.
        part: One finger, closed: y points from the middle outwards.
        place: Where the middle of the closed fingers is in the palm.
        pad: Box that takes hold; its inner face lies at y = 0.
    """

    links: tuple[str, str] | None = None
    part: PartEntry | None = None
    place: PlaceEntry = PlaceEntry()
    pad: PadEntry


class CupEntry(Value):
    """A suction cup along z, its rim in the tool frame."""

    radius: Annotated[float, Field(gt=0.001, le=0.2)]
    depth: Annotated[float, Field(gt=0.0005, le=0.1)]
    seal: _Share = 0.9


class SourcedSpan(Value):
    """From the least to the most, and who says so."""

    value: tuple[_Force, _Force]
    source: _Text

    @model_validator(mode="after")
    def _ascends(self) -> SourcedSpan:
        if self.value[0] > self.value[1]:
            raise ValueError("the least comes first")
        return self


class SourcedValue(Value):
    """A number, and who says so."""

    value: Annotated[float, Field(gt=0.0, le=5000.0)]
    source: _Text


class TactileEntry(Value):
    """Sensors under the pads that feel the force on each of them, and who says so.

    Attributes:
        rate: Readings a second, Hz.
        noise: Deviation of a reading in each direction, N.
        gain: Half-width of the share by which a pad's sensor reads too much or too little.
        source: Where that is from.
    """

    rate: Annotated[float, Field(ge=10.0, le=10000.0)]
    noise: Annotated[float, Field(ge=0.0, le=100.0)]
    gain: Annotated[float, Field(ge=0.0, le=0.5)] = 0.0
    source: _Text


class GripperEntry(Value):
    """A page of the catalogue.

    Attributes:
        title: Name for people.
        urdf: File in the example-robot-data package, or beside the page, that has the links that
            the page names.
        mount: Palm in the flange of the robot; z points away from the arm.
        tool: Tool frame in the palm.
        palm: All that does not move in it: a part of its own, or a link of the URDF.
        fingers: Two fingers; else there is a cup.
        cup: Suction cup; else there are fingers.
        stroke: Distance of the pads when it is open, m.
        force: Force of each pad, or that which pulls a cup off, N.
        speed: Speed of the opening, m/s.
        payload: Most that it may hold, kg.
        resolution: Step of its opening's encoder, m.
        tactile: What feels the force on each pad; none where it is left out.
        friction: Least coefficient of friction of pads or cup.
        drive_mass: What the drive adds to a finger's inertia, kg.
        color: RGBA of its shapes.
    """

    title: Annotated[str, Field(min_length=1, max_length=LONGEST_NAME)]
    urdf: str | None = None
    mount: PlaceEntry = PlaceEntry()
    tool: PlaceEntry
    palm: PartEntry | str
    fingers: FingersEntry | None = None
    cup: CupEntry | None = None
    stroke: SourcedValue | None = None
    force: SourcedSpan
    speed: SourcedSpan | None = None
    payload: SourcedValue
    resolution: SourcedValue | None = None
    tactile: TactileEntry | None = None
    friction: Annotated[float, Field(ge=0.0, le=5.0)] = 0.0
    drive_mass: Annotated[float, Field(ge=0.0, le=100.0)] = 0.4
    color: tuple[_Share, _Share, _Share, _Share] = (0.2, 0.2, 0.22, 1.0)


class GripperFile(PageFile[GripperEntry]):
    """A page that was read, and the text that messages point into.

    Raises:
        DescriptionError: The file is no page; it carries every reason.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, GripperEntry)
