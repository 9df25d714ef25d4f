"""Values with their own notation in YAML: units, poses, planes, colors, names, goals.

YAML has meters, seconds and degrees; these types convert to SI, with angles in radians.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Final, Literal, TypeAlias

import numpy as np
import numpy.typing as npt
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PlainSerializer,
    model_validator,
)

from bt_dualarm.core.free_axes import AXES
from bt_dualarm.core.free_axes import FreeAxes as _FreeAxes
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.spec.node_types import (
    DEGREES,
    METERS,
    QUANTITY,
    SECONDS,
    STRICT,
    PortModel,
    Unit,
    port,
    scaled,
)
from bt_dualarm.spec.problems import suggestion
from bt_dualarm.spec.yaml_reader import Data, Json, flow_text, with_tuples

_Component: TypeAlias = Annotated[float, Field(ge=-1000.0, le=1000.0)]
Vector3: TypeAlias = tuple[_Component, _Component, _Component]
"""Three numbers; the field of this type states frame and unit."""


def _directed(vector: tuple[float, float, float]) -> tuple[float, float, float]:
    if math.hypot(*vector) < 1e-6:
        raise ValueError("a direction must not be a zero vector")
    return vector


Direction: TypeAlias = Annotated[Vector3, AfterValidator(_directed)]
"""Direction of any nonzero length; the field of this type states its frame."""

_Coordinate: TypeAlias = Annotated[float, Field(ge=-100.0, le=100.0)]
Turn: TypeAlias = Annotated[float, Field(ge=-720.0, le=720.0)]
"""Angle of an orientation, degrees."""
Point: TypeAlias = tuple[_Coordinate, _Coordinate, _Coordinate]
"""Coordinates in m; the field of this type states the frame."""


@dataclass(frozen=True)
class Refers:
    """Metadata of a port that has the name of something that the file declares, or several names.

    Attributes:
        to: Categories: ``"object"``, ``"arm"``, ``"signal"``, ``"zone"``, ``"rendezvous"``,
            ``"part"`` and ``"joint"`` (of the object that the port ``object`` names), ``"object
            part"`` (``OBJECT.PART``).
        words: Words that are allowed as well.
        to_others: Whether the name of the arm in whose tree the node is makes no sense.
        unlike: Port of the same node whose name this one cannot have; empty for none.
        where_it_is: Whether the arm has to come to the object where that is.
    """

    to: tuple[str, ...]
    words: tuple[str, ...] = ()
    to_others: bool = False
    unlike: str = ""
    where_it_is: bool = False


ObjectName: TypeAlias = Annotated[str, Refers(("object",))]
"""The name of an object of the tree file."""

PickedObjectName: TypeAlias = Annotated[str, Refers(("object",), where_it_is=True)]
"""The name of an object that the arm comes to; the check knows whether that is within its reach."""

OtherObjectName: TypeAlias = Annotated[str, Refers(("object",), unlike="object")]
"""The name of an object other than the one that the port ``object`` of the same node names."""

PartName: TypeAlias = Annotated[str, Refers(("part",))]
"""The name of a part of the object that the port ``object`` of the same node names."""

JointName: TypeAlias = Annotated[str, Refers(("joint",))]
"""The name of a joint of the object that the port ``object`` of the same node names."""

ArmName: TypeAlias = Annotated[str, Refers(("arm",))]
"""The name of an arm of the tree file."""

OtherArmName: TypeAlias = Annotated[str, Refers(("arm",), to_others=True)]
"""The name of an arm of the tree file other than the node's own."""

ObjectOrArmName: TypeAlias = Annotated[str, Refers(("object", "arm"))]
"""The name of an object or an arm of the tree file."""


_UNIT_NAMES: Final = {
    "sec": "s", "secs": "s", "second": "s", "seconds": "s", "msec": "ms", "milliseconds": "ms",
    "mins": "min", "minute": "min", "minutes": "min", "hr": "h", "hour": "h", "hours": "h",
    "degree": "deg", "degrees": "deg", "radian": "rad", "radians": "rad",
}  # fmt: skip
"""Other names of units, each with ours."""


def _quantity(value: Data, units: Mapping[str, float]) -> Data:
    """Converts text such as ``"500 ms"`` to the base unit; leaves a number as it is."""
    if not isinstance(value, str):
        return value
    match = QUANTITY.fullmatch(value)
    if match is None or match[2] not in units:
        choices = ", ".join(units)
        text = f"expected a number, or text with a unit ({choices}), not '{value}'"
        meant = QUANTITY.fullmatch(value.replace(",", "."))
        unit = "" if meant is None else _UNIT_NAMES.get(meant[2].lower(), meant[2])
        if meant is not None and unit in units:
            text += f" (did you mean '{meant[1]} {unit}'?)"
        raise ValueError(text)
    return scaled(float(match[1]), units[match[2]])


def _seconds(value: Data) -> Data:
    return _quantity(value, SECONDS)


def _degrees(value: Data) -> Data:
    return _quantity(value, DEGREES)


JOINT_UNIT: Final = "deg or m"
"""Unit of a bare `JointPosition`."""

_POSITIONS: Final = {**DEGREES, **METERS}


def _position(value: Data) -> Data:
    return _quantity(value, _POSITIONS)


Duration: TypeAlias = Annotated[
    float, BeforeValidator(_seconds), Field(ge=0.0, le=86400.0), Unit("s", SECONDS)
]
"""Seconds of simulated time, at most a day: ``0.5``, or text with a unit: ``"500 ms"``."""

Angle: TypeAlias = Annotated[
    float,
    BeforeValidator(_degrees),
    Field(ge=-3600.0, le=3600.0),
    AfterValidator(math.radians),
    PlainSerializer(math.degrees),
    Unit("deg", DEGREES),
]
"""Radians; in YAML degrees, at most ten turns: ``90``, or text with a unit: ``"1.57 rad"``."""

JointPosition: TypeAlias = Annotated[
    float, BeforeValidator(_position), Field(ge=-720.0, le=720.0), Unit(JOINT_UNIT, _POSITIONS)
]
"""Position of a joint, as in YAML: degrees of a joint that turns, or meters of one that slides; or
text with a unit: ``"1.57 rad"``, ``"20 cm"``. The check knows which of them the joint does."""


def wrong_unit(given: Data, *, turns: bool) -> str:
    """Returns why positions of a joint have the unit of the other kind of joint; empty if not.

    Args:
        given: A `JointPosition` in YAML, or a list of them.
        turns: Whether the joint turns rather than slides.
    """
    if isinstance(given, (list, tuple)):
        return next(filter(None, (wrong_unit(one, turns=turns) for one in given)), "")
    match = QUANTITY.fullmatch(given) if isinstance(given, str) else None
    if match is None or match[2] not in (METERS if turns else DEGREES):
        return ""
    kind = "turns: its positions are angles" if turns else "slides: its positions are lengths"
    return f"the joint {kind}, not '{given}'"


Tilt: TypeAlias = Annotated[
    float,
    BeforeValidator(_degrees),
    Field(ge=0.5, le=90.0),
    AfterValidator(math.radians),
    PlainSerializer(math.degrees),
    Unit("deg", DEGREES),
]
"""Half-width of a cone, radians; in YAML degrees. Below half a degree no arm can keep it."""


def _none_one_or_all(free: _FreeAxes) -> _FreeAxes:
    if len(set(free)) < len(free):
        raise ValueError(f"names {', '.join(free)}: each once")
    if len(free) == 2:
        raise ValueError(
            f"leave one of {' and '.join(free)} free, or all of {', '.join(AXES)}: what two turns "
            "allow depends on their order"
        )
    return free


FreeAxes: TypeAlias = Annotated[
    _FreeAxes, Field(max_length=len(AXES)), AfterValidator(_none_one_or_all)
]
"""Rotations about the tool's own axes that a target leaves free: ``[rz]``, or all three."""

Speed: TypeAlias = Annotated[float, Field(ge=0.001, le=1.0)]
"""Fraction of the arm's limits of velocity, acceleration and jerk; 1.0 is the arm's maximum."""


class Value(BaseModel):
    """Base of value types: frozen, with strict types."""

    model_config = STRICT


class PoseSpec(Value):
    """Pose of a frame: a position, and at most one notation of its orientation."""

    xyz: Point = port(..., "Position", unit="m")
    rpy: tuple[Turn, Turn, Turn] | None = port(
        None, "Roll, pitch, yaw about the fixed axes x, y, z in that order", unit="deg"
    )
    quat: tuple[float, float, float, float] | None = port(
        None, "Quaternion w, x, y, z of unit length"
    )
    look_at: Point | None = port(
        None, "Point toward which the frame's z axis points; its y axis points downward", unit="m"
    )

    @model_validator(mode="after")
    def _one_orientation(self) -> PoseSpec:
        notations = (name for name in type(self).model_fields if name != "xyz")
        given = [name for name in notations if getattr(self, name) is not None]
        if len(given) > 1:
            raise ValueError(f"gives the orientation twice: {' and '.join(given)}")
        if self.quat is not None and abs(math.hypot(*self.quat) - 1.0) > 1e-3:
            length = math.hypot(*self.quat)
            raise ValueError(f"quat has length {length:.4g}; a rotation has length 1")
        if self.look_at is not None and math.dist(self.look_at, self.xyz) < 1e-6:
            raise ValueError("look_at equals the position, which gives no direction")
        return self

    @property
    def pose(self) -> Pose:
        """Pose in the frame in which it is given; by default with that frame's orientation."""
        if self.quat is not None:
            quaternion = np.array(self.quat) / math.hypot(*self.quat)
            return Pose(np.array(self.xyz), quaternion)
        if self.look_at is not None:
            return _look_at(np.array(self.xyz), np.array(self.look_at))
        roll, pitch, yaw = np.radians(self.rpy or (0.0, 0.0, 0.0))
        return Pose.from_rpy(self.xyz, (roll, pitch, yaw))

    @property
    def is_oriented(self) -> bool:
        """Whether an orientation is given."""
        return not (self.rpy is None and self.quat is None and self.look_at is None)

    def pose_from(self, current: Pose) -> Pose:
        """Returns the pose; without an orientation, that of ``current``."""
        if not self.is_oriented:
            return Pose(np.array(self.xyz), current.quaternion)
        return self.pose


def _look_at(eye: Vector, target: Vector) -> Pose:
    """Returns a pose with z to the target, x right, y down; right is world x along the vertical."""
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    if np.linalg.norm(right) < 1e-6:
        right = np.array([1.0, 0.0, 0.0])
    right /= np.linalg.norm(right)
    axes = np.column_stack((right, np.cross(forward, right), forward))
    return Pose.from_axes(eye, axes.tolist())


def _with_notations(others: Callable[[Json], list[Json]]) -> Callable[[Json], None]:
    """Returns a change of a model's schema that allows other notations besides the mapping.

    Args:
        others: Function from the schema of the mapping to those of the other notations.
    """

    def change(schema: Json) -> None:
        mapping = dict(schema)
        schema.clear()
        schema["description"] = mapping["description"]
        schema["anyOf"] = [*others(mapping), mapping]

    return change


_TAIL: Final = 3.0
"""Standard deviations at which a normal distribution is truncated: no mass may be negative."""


class Uncertainty(Value):
    """Distribution about zero; a bare number is the half-width of a uniform one."""

    model_config = ConfigDict(
        json_schema_extra=_with_notations(lambda _: [{"type": "number", "minimum": 0.0}])
    )

    uniform: Annotated[float, Field(ge=0.0, le=1e3)] = port(
        0.0, "Half-width of a uniform distribution about zero"
    )
    normal: Annotated[float, Field(ge=0.0, le=1e3)] = port(
        0.0,
        "Standard deviation of a normal distribution about zero, truncated at three times it",
    )

    @model_validator(mode="before")
    @classmethod
    def _of_a_number(cls, data: Data) -> Data:
        """Converts ``0.05`` to ``{uniform: 0.05}``."""
        is_number = isinstance(data, int | float) and not isinstance(data, bool)
        return {"uniform": float(data)} if is_number else data

    @model_validator(mode="after")
    def _is_one(self) -> Uncertainty:
        if self.uniform and self.normal:
            raise ValueError("give uniform or normal, not both")
        return self

    @property
    def most(self) -> float:
        """Largest magnitude of a sample."""
        return max(self.uniform, _TAIL * self.normal)

    def draw(self, rng: np.random.Generator, size: int) -> Vector:
        """Returns samples of shape (size,); draws as many numbers for every distribution."""
        share = rng.uniform(-1.0, 1.0, size)
        bell = rng.normal(0.0, 1.0, size)
        drawn: Vector = self.uniform * share + self.normal * np.clip(bell, -_TAIL, _TAIL)
        return drawn

    def draw_one(self, rng: np.random.Generator) -> float:
        """Returns one sample; faster than `draw`, for values that change with each image."""
        share = rng.uniform(-1.0, 1.0)
        bell = rng.normal(0.0, 1.0)
        return self.uniform * share + self.normal * min(max(bell, -_TAIL), _TAIL)


def _below(limit: float, unit: str = "") -> Callable[[Uncertainty], Uncertainty]:
    def check(uncertainty: Uncertainty) -> Uncertainty:
        if uncertainty.most > limit:
            allowed = f"{limit:g} {unit}".rstrip()
            raise ValueError(f"may come to {uncertainty.most:g}; at most {allowed} is allowed")
        return uncertainty

    return check


Share: TypeAlias = Annotated[Uncertainty, AfterValidator(_below(0.9))]
"""Relative uncertainty: 0.05 is 5 %. Below 1, so that the value keeps its sign."""

Bend: TypeAlias = Annotated[Uncertainty, AfterValidator(_below(0.3))]
"""Uncertainty of a coefficient of radial distortion."""

Meters: TypeAlias = Annotated[Uncertainty, AfterValidator(_below(0.1, "m"))]
Degrees: TypeAlias = Annotated[Uncertainty, AfterValidator(_below(20.0, "deg"))]
Seconds: TypeAlias = Annotated[Uncertainty, AfterValidator(_below(0.1, "s"))]


RelativePath: TypeAlias = Annotated[str, Field(min_length=5, max_length=200)]
"""Path of a file relative to the tree file."""


def below_tree(kind: str, *suffixes: str) -> Callable[[str], str]:
    """Returns a validator of paths of one kind of file below the folder of the tree file.

    Args:
        kind: What the file is, for messages: ``"an STL or OBJ file"``.
        suffixes: Endings in lower case, with the dot.
    """

    def checked(path: str) -> str:
        if not path.lower().endswith(suffixes):
            raise ValueError(f"expected {kind}, not {path!r}")
        steps = path.replace("\\", "/").split("/")
        if steps[0] == "" or ".." in steps or ":" in steps[0]:
            raise ValueError(f"{path!r} is not below the folder of the tree or scene file")
        return path

    return checked


class Offset(PortModel):
    """Offset from the current pose of the tool."""

    xyz: Vector3 = port((0.0, 0.0, 0.0), "Distance along x, y, z", unit="m")
    rpy: Vector3 = port((0.0, 0.0, 0.0), "Roll, pitch, yaw", unit="deg")
    frame: Literal["world", "tool"] = port("world", "Frame of the axes")

    def applied_to(self, tool: Pose) -> Pose:
        """Returns the tool's pose in the world after the step."""
        step = Pose.from_rpy(self.xyz, tuple(np.deg2rad(self.rpy)))
        if self.frame == "tool":
            return tool @ step
        turned = Pose(np.zeros(3), step.quaternion) @ Pose(np.zeros(3), tool.quaternion)
        return Pose(tool.position + step.position, turned.quaternion)


_NAMED_NORMALS: Final[Mapping[str, Vector3]] = {
    "xy": (0.0, 0.0, 1.0),
    "yz": (1.0, 0.0, 0.0),
    "xz": (0.0, -1.0, 0.0),
}


def _plane_notation(value: Data, names: Sequence[str]) -> Data:
    """The mapping for a plane's name, or another value as it is; names are those allowed."""
    if not isinstance(value, str):
        return with_tuples(value)
    if value not in names:
        hint = suggestion(value, names, "plane")
        raise ValueError(f"there is no plane '{value}' ({hint}); or give {{normal: [x, y, z]}}")
    return {"normal": _NAMED_NORMALS[value]} if value in _NAMED_NORMALS else {}


def _refuse_zero(normal: Vector3) -> None:
    if math.hypot(*normal) < 1e-6:
        raise ValueError("the normal has no direction: its length is 0")


class Plane(Value):
    """``xy``, ``yz``, ``xz`` of the world, or ``{normal: [x, y, z]}``."""

    model_config = ConfigDict(
        json_schema_extra=_with_notations(lambda _: [{"enum": list(_NAMED_NORMALS)}])
    )

    normal: Vector3 = port(..., "Normal in the world frame, of any nonzero length")

    @model_validator(mode="before")
    @classmethod
    def _from_notation(cls, value: Data) -> Data:
        return _plane_notation(value, list(_NAMED_NORMALS))

    @model_validator(mode="after")
    def _has_direction(self) -> Plane:
        _refuse_zero(self.normal)
        return self

    @property
    def axes(self) -> tuple[Vector, Vector]:
        """Unit vectors u, v in the plane with u cross v along the normal, each of shape (3,).

        v is the projection of the world's z axis; in a horizontal plane it is the world's y axis.
        Hence yz has (y, z), xz has (x, z), xy has (x, y).
        """
        normal = np.array(self.normal) / math.hypot(*self.normal)
        up = np.array([0.0, 0.0, 1.0])
        if np.linalg.norm(np.cross(up, normal)) < 1e-6:
            up = np.array([0.0, 1.0, 0.0])
        v = up - (up @ normal) * normal
        v /= np.linalg.norm(v)
        return np.asarray(np.cross(v, normal), float), v


_FREE: Final = "free"


class PlaneOrFree(Value):
    """A plane, written in the same way, or ``free``: all directions of space."""

    model_config = ConfigDict(
        json_schema_extra=_with_notations(lambda _: [{"enum": [*_NAMED_NORMALS, _FREE]}])
    )

    normal: Vector3 | None = port(
        None, "Normal of the plane in the world frame, of any nonzero length"
    )

    @model_validator(mode="before")
    @classmethod
    def _from_notation(cls, value: Data) -> Data:
        if isinstance(value, dict) and value.get("normal") is None:
            raise ValueError(f"its normal is missing: give {{normal: [x, y, z]}}, or {_FREE}")
        return _plane_notation(value, [*_NAMED_NORMALS, _FREE])

    @model_validator(mode="after")
    def _has_direction(self) -> PlaneOrFree:
        if self.normal is not None:
            _refuse_zero(self.normal)
        return self

    @property
    def plane(self) -> Plane | None:
        """The plane; None in all directions of space."""
        return None if self.normal is None else Plane(normal=self.normal)


ShapeName: TypeAlias = Literal["box", "cylinder", "capsule", "sphere"]

SIZES: Final[Mapping[ShapeName, tuple[str, ...]]] = {
    "box": ("x", "y", "z"),
    "cylinder": ("radius", "length"),
    "capsule": ("radius", "length"),
    "sphere": ("radius",),
}
"""Names of the numbers in the size of each shape."""

SIZE_IN_WORDS: Final = (
    "Edge lengths of a box; radius and length of a cylinder, or of a capsule without its end caps; "
    "radius of a sphere"
)
"""Description of these numbers, which are in meters."""


_Hue: TypeAlias = Annotated[float, Field(ge=0.0, le=360.0)]
_Part: TypeAlias = Annotated[float, Field(ge=0.0, le=1.0)]
Bounds: TypeAlias = tuple[npt.NDArray[np.uint8], npt.NDArray[np.uint8]]
"""Lower and upper inclusive bound for ``cv2.inRange`` on an HSV image, each of shape (3,)."""

_NAMED_HUES: Final[Mapping[str, tuple[float, float]]] = {
    "red": (340.0, 12.0),
    "orange": (14.0, 40.0),
    "yellow": (42.0, 70.0),
    "green": (80.0, 165.0),
    "blue": (216.0, 260.0),  # excludes the blue of a UR's joints
}


def _short(number: float) -> int | float:
    """Returns a whole number as an integer, so that YAML has 1 and not 1.0."""
    return int(number) if float(number).is_integer() else number


class HsvRange(Value):
    """A box in hue, saturation and value (brightness), bounds inclusive."""

    hue: tuple[_Hue, _Hue] = port(
        ...,
        "Angles on the color wheel; a lower bound above the upper one wraps through red",
        unit="deg",
    )
    saturation: tuple[_Part, _Part] = port((0.4, 1.0), "Saturation from 0 (gray) to 1")
    value: tuple[_Part, _Part] = port((0.2, 1.0), "Brightness from 0 (black) to 1")

    @model_validator(mode="after")
    def _ascending(self) -> HsvRange:
        for name in ("saturation", "value"):
            low, high = getattr(self, name)
            if low > high:
                raise ValueError(f"{name} goes from {low} down to {high}: swap the two")
        return self

    @property
    def data(self) -> Data:
        """Range in YAML notation, with every field."""
        return {
            name: [_short(end) for end in getattr(self, name)] for name in HsvRange.model_fields
        }

    @property
    def bounds(self) -> tuple[Bounds, ...]:
        """Boxes in OpenCV's HSV (hue 0 to 179, others 0 to 255): one, or two where hue wraps."""
        low, high = (min(round(hue / 2), 179) for hue in self.hue)
        hues = [(low, high)] if self.hue[0] <= self.hue[1] else [(low, 179), (0, high)]
        return tuple((self._corner(a, 0), self._corner(b, 1)) for a, b in hues)

    def _corner(self, hue: int, end: int) -> npt.NDArray[np.uint8]:
        shares = (self.saturation[end], self.value[end])
        return np.array([hue, *(round(255 * share) for share in shares)], np.uint8)


class Color(Value):
    """``yellow``, or a list of ranges any of which a pixel may lie in."""

    model_config = ConfigDict(
        json_schema_extra=_with_notations(
            lambda mapping: [{"enum": list(_NAMED_HUES)}, mapping["properties"]["ranges"]]
        )
    )

    name: str = port("", "Name of a color; omitted if ranges are given")
    ranges: tuple[HsvRange, ...] = port(
        ..., "Ranges; a pixel must lie in at least one", min_length=1, max_length=8
    )

    @model_validator(mode="before")
    @classmethod
    def _from_notation(cls, value: Data) -> Data:
        if isinstance(value, str):
            if value not in _NAMED_HUES:
                hint = suggestion(value, _NAMED_HUES, "color")
                raise ValueError(f"there is no color '{value}' ({hint})")
            return {"name": value, "ranges": ({"hue": _NAMED_HUES[value]},)}
        if isinstance(value, (list, tuple)):
            return {"ranges": with_tuples(value)}
        return with_tuples(value)

    @classmethod
    def named(cls, name: str) -> Color:
        """Returns the color red, orange, yellow, green or blue.

        Raises:
            pydantic.ValidationError: There is no such name.
        """
        return cls.model_validate(name)

    @property
    def data(self) -> Data:
        """Color in YAML notation: the name, or the list of ranges."""
        return self.name or [item.data for item in self.ranges]

    @property
    def notation(self) -> str:
        """Color in YAML notation on one line."""
        return self.name or flow_text(self.data)

    @property
    def bounds(self) -> tuple[Bounds, ...]:
        """Boxes for ``cv2.inRange``; a pixel in any of them has the color."""
        return tuple(box for item in self.ranges for box in item.bounds)


MarkerDictionary: TypeAlias = Literal[
    "aruco_4x4_50", "aruco_5x5_50", "aruco_6x6_50", "apriltag_16h5", "apriltag_36h11"
]

BITS: Final[dict[str, int]] = {
    "aruco_4x4_50": 4,
    "aruco_5x5_50": 5,
    "aruco_6x6_50": 6,
    "apriltag_16h5": 4,
    "apriltag_36h11": 6,
}
"""Number of cells along an edge within the black border, by dictionary."""


class MarkerSpec(Value):
    """A square marker, white around it, on the top face of an object."""

    dictionary: MarkerDictionary = port("aruco_4x4_50", "Marker dictionary")
    id: int = port(..., "Number in the dictionary", ge=0, le=29)
    size: float = port(..., "Edge of its black square", unit="m", ge=0.005, le=1.0)

    @property
    def cells(self) -> int:
        """Number of cells along an edge with the black border."""
        return BITS[self.dictionary] + 2

    @property
    def outer_size(self) -> float:
        """Edge of the white square around it in m: one cell wider on each side."""
        return self.size * (self.cells + 2) / self.cells


# Types of ports with targets of an arm: the check knows whether the arm can reach them.


@dataclass(frozen=True)
class Goal:
    """Metadata of a target pose in the world.

    Attributes:
        carried: Whether it is the pose of the held object rather than that of the tool.
    """

    carried: bool = False


@dataclass(frozen=True)
class OfPosture:
    """Metadata of a text port that has the name of a posture of the robot."""


@dataclass(frozen=True)
class OfJoints:
    """Metadata of a port with a value for each of the arm's joints, or for some by name.

    Attributes:
        are_offsets: Whether the values are added to the current ones; others are within the limits
            of the joints.
    """

    are_offsets: bool = False


@dataclass(frozen=True)
class OfGripper:
    """Metadata of a set-point of the gripper, whose description has the limits.

    Attributes:
        what: ``"width"``, ``"speed"`` or ``"force"``.
    """

    what: Literal["width", "speed", "force"]


GripWidth: TypeAlias = Annotated[float, OfGripper("width")]
"""Opening between the pads in m; the check knows the gripper's stroke."""

GripSpeed: TypeAlias = Annotated[float, OfGripper("speed")]
"""Speed of the opening in m/s; the check knows the gripper's limits."""

GripForce: TypeAlias = Annotated[float, OfGripper("force")]
"""Force of each pad, or of a suction cup, in N; the check knows the gripper's limits."""

PostureName: TypeAlias = Annotated[str, OfPosture()]
"""Name of a posture in the robot's description, which the check knows."""

JointAngles: TypeAlias = Annotated[tuple[Angle, ...] | dict[str, Angle], OfJoints()]
"""Angles of all joints from base to tip, or of some by name; the check knows joints and limits."""

JointOffsets: TypeAlias = Annotated[
    tuple[Angle, ...] | dict[str, Angle], OfJoints(are_offsets=True)
]
"""Changes of the angles of all joints from base to tip, or of some by name."""
