"""A robot of the catalog as data, and the description file that declares it.

A description is a YAML file that adds to a URDF what it lacks: limits of acceleration and jerk,
postures, the tool frame, camera mounts. `DescriptionFile` finds, reads and validates one, of a
robot or a gripper; joints of the URDF may be locked. `Robot` is the result: joints, limits,
friction, tool, postures, camera mounts. `robot_description` builds it.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Final, Generic, Literal, TypeAlias, TypeVar

import numpy as np
import numpy.typing as npt
from pydantic import AfterValidator, Field, ValidationError, model_validator

from bt_dualarm.core.errors import CatalogError
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.core.share import share_dir
from bt_dualarm.robots.urdf import MASS, ONE_TURN, TURNING, Joint, KinematicTree
from bt_dualarm.robots.urdf_arm import Urdf, robot_data_dir
from bt_dualarm.robots.urdf_xml import (
    AttributeReader,
    DescriptionError,
    Document,
    Element,
    Range,
)
from bt_dualarm.spec.document import LONGEST_NAME, LimitShares
from bt_dualarm.spec.explain import explain
from bt_dualarm.spec.problems import Name, Problem, SpecError, suggestion
from bt_dualarm.spec.values import Value
from bt_dualarm.spec.yaml_reader import DataPath as Place
from bt_dualarm.spec.yaml_reader import Source, read_file, with_tuples

# Locations

Kind = Literal["robot", "gripper"]
"""Kinds of descriptions; the catalog has a folder for each."""


def is_description_path(name: str) -> bool:
    """Whether a name is the path of a description file, and not a name in the catalog."""
    return name.endswith((".yaml", ".yml"))


def shipped_names(kind: Kind) -> tuple[str, ...]:
    """Names in the shipped catalog, sorted."""
    return tuple(sorted(path.stem for path in (share_dir("assets") / f"{kind}s").glob("*.yaml")))


def description_path(kind: Kind, name: str, root: Path | None) -> Path:
    """Location of the description of a robot or gripper.

    Args:
        kind: Which of the two.
        name: Name in the catalog, or path of a YAML file below ``root``.
        root: Folder that the path is relative to; by default the current one.

    Raises:
        CatalogError: There is none; the message suggests similar names.
    """
    if is_description_path(name):
        folder = (root or Path.cwd()).resolve()
        path = file_below(folder, name)
        if path is not None:
            return path
        raise CatalogError(
            f"there is no {kind} file {name!r} below {folder}; {_elsewhere(kind, folder, name)}"
        )
    if name in shipped_names(kind):
        return share_dir("assets") / f"{kind}s" / f"{name}.yaml"
    near = suggestion(name, shipped_names(kind), kind)
    raise CatalogError(f"there is no {kind} {name!r} in the catalog; {near}")


def file_below(folder: Path, name: str) -> Path | None:
    """The file of a name relative to a folder, if it exists and is inside the folder."""
    try:
        path = (folder / name).resolve()
        return path if path.is_file() and path.is_relative_to(folder) else None
    except (
        OSError,
        RuntimeError,
        ValueError,
    ):  # a name that is too long, a loop of symlinks, a NUL
        return None


def _elsewhere(kind: Kind, folder: Path, name: str) -> str:
    """A hint for the path of a description that is not there, or not below the folder."""
    path = Path(os.path.normpath(folder / name.replace("\0", "")))
    if not path.is_relative_to(folder):
        return f"a {kind}'s description must be in the folder of the tree file or below it"
    others = [other.name for other in path.parent.glob("*.yaml") if other != path]
    return suggestion(path.name, others, f"{kind} file")


Entry = TypeVar("Entry", bound=Value)
"""Schema of that kind of description."""


class DescriptionFile(Generic[Entry]):
    """A description file that was read and validated, with its text for error messages.

    Args:
        path: YAML file.
        kind: Schema of the file.

    Attributes:
        path: YAML file.
        entry: Validated content.

    Raises:
        DescriptionError: The file is not a valid description; lists all problems.
    """

    def __init__(self, path: Path, kind: type[Entry]) -> None:
        self.path = path
        try:
            self._source: Source = read_file(path)
            self.entry: Entry = kind.model_validate(with_tuples(self._source.data))
        except SpecError as error:
            raise DescriptionError(error.problems) from error
        except ValidationError as error:
            data = self._source.data
            found = [
                self._source.problem(f.path, f.message, f.hint, key=f.at_key)
                for f in explain(error, kind, data, "field")
            ]
            raise DescriptionError(found) from error

    def problem(self, place: Place, message: str, hint: str = "", *, key: bool = False) -> Problem:
        """Create a problem at the value of an entry of the file, or at its key."""
        return self._source.problem(place, message, hint, key=key)

    def element(
        self,
        place: Place,
        tag: str,
        attributes: Mapping[str, str],
        children: Iterable[Element] = (),
    ) -> Element:
        """Create an XML element whose problems are reported at an entry of the file."""
        at = self._source.location(place)
        document = Document(self._source.file, self._source.lines)
        return Element(tag, attributes, document, at.line, at.column, [*children])


# URDF of a new description


@dataclass(frozen=True)
class UrdfSource:
    """A URDF, and an SRDF of the same name.

    Attributes:
        path: File of the URDF.
        name: Path of the URDF as the description refers to it.
        srdf: Path of the SRDF as the description refers to it; None if there is none.
    """

    path: Path
    name: str
    srdf: str | None


def find_urdf(given: str, folder: Path) -> UrdfSource:
    """Find a URDF by its path, absolute, relative, or below example-robot-data's ``robots``.

    Args:
        given: Path that the user gave.
        folder: Resolved folder of the new description.

    Raises:
        CatalogError: There is none, or a description in that folder could not refer to it.
    """
    data = robot_data_dir()
    try:
        found = [path.resolve() for path in (Path(given), data / given) if path.is_file()]
    except (OSError, ValueError) as error:  # a name that is too long, a NUL
        raise CatalogError(f"there is no URDF {given[:80]!r}") from error
    if not found:
        raise CatalogError(f"there is no URDF {given!r}, neither here nor in {data}")
    for root in (folder, data):
        if found[0].is_relative_to(root):
            return UrdfSource(found[0], str(found[0].relative_to(root)), _srdf(found[0], root))
    raise CatalogError(
        f"{found[0]} is neither below {folder}, the folder of the new description, nor in "
        "example-robot-data; write the description to a folder above the URDF (--out), or copy the "
        "URDF and its meshes there"
    )


def _srdf(urdf: Path, root: Path) -> str | None:
    """The SRDF of the same name, next to the URDF or in the folder ``srdf`` of its package."""
    for folder in (urdf.parent, urdf.parent.parent / "srdf"):
        path = folder / f"{urdf.stem}.srdf"
        if path.is_file() and path.is_relative_to(root):
            return str(path.relative_to(root))
    return None


# Schema of robot descriptions


_Positive: TypeAlias = Annotated[float, Field(gt=0.0)]
_NotNegative: TypeAlias = Annotated[float, Field(ge=0.0, le=1e4)]
_Metres: TypeAlias = Annotated[float, Field(ge=-10.0, le=10.0)]
_Near: TypeAlias = tuple[_Metres, _Metres, _Metres]
_Hand: TypeAlias = Annotated[float, Field(ge=-2.0, le=2.0)]
_Close: TypeAlias = tuple[_Hand, _Hand, _Hand]
_Length: TypeAlias = Annotated[float, Field(gt=0.0, le=2.0)]
_Turn: TypeAlias = Annotated[float, Field(ge=-720.0, le=720.0)]
_Held: TypeAlias = Annotated[float, Field(ge=-720.0, le=720.0)]
_Share: TypeAlias = Annotated[float, Field(ge=0.0, le=1.0)]
_MOST: Final = 200

TYPICAL_ROTOR: Final = 0.1
"""Rotor inertia in kg m² of the joints of UR5e, Panda and xArm7 in MuJoCo Menagerie."""

MAX_JOINTS: Final = 24
"""Largest number of joints of an arm; torso and arm of a humanoid have ten."""


def _printable(text: str | None) -> str | None:
    if text is not None and not text.isprintable():
        raise ValueError("contains a character that cannot be printed")
    return text


_Printable: Final = AfterValidator(_printable)

_LENGTHS: Final = {"box": 3, "cylinder": 2, "sphere": 1}

Color: TypeAlias = tuple[_Share, _Share, _Share, _Share]
"""Red, green, blue, opacity."""


class PlaceEntry(Value):
    """Pose of a frame; meters, degrees."""

    xyz: _Close = (0.0, 0.0, 0.0)
    rpy: tuple[_Turn, _Turn, _Turn] = (0.0, 0.0, 0.0)

    @property
    def pose(self) -> Pose:
        """The frame's pose in its parent."""
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


@dataclass(frozen=True)
class ToolShape:
    """A cylinder along the tool's z axis that ends in the tool frame; meters."""

    radius: float
    length: float


class ToolEntry(Value):
    """The tool frame in its link, and an optional shape that ends in it; meters, degrees."""

    link: str
    xyz: _Near = (0.0, 0.0, 0.0)
    rpy: tuple[_Turn, _Turn, _Turn] = (0.0, 0.0, 0.0)
    radius: Annotated[float | None, Field(gt=0.0, le=0.5)] = None
    length: Annotated[float | None, Field(gt=0.0, le=1.0)] = None

    @property
    def pose(self) -> Pose:
        """Pose of the tool frame in its link."""
        roll, pitch, yaw = np.deg2rad(self.rpy)
        return Pose.from_rpy(self.xyz, (roll, pitch, yaw))

    @property
    def shape(self) -> ToolShape | None:
        """The shape, if there is one."""
        if self.radius is None or self.length is None:
            return None
        return ToolShape(self.radius, self.length)


class FlangeEntry(Value):
    """The flange for grippers, its z axis pointing away from the arm; meters, degrees.

    Attributes:
        stock: Links of the stock tool, which a gripper replaces with all their descendants.
    """

    link: str
    xyz: _Near = (0.0, 0.0, 0.0)
    rpy: tuple[_Turn, _Turn, _Turn] = (0.0, 0.0, 0.0)
    stock: Annotated[tuple[str, ...], Field(max_length=_MOST)] = ()

    @property
    def pose(self) -> Pose:
        """Pose of the flange in its link."""
        roll, pitch, yaw = np.deg2rad(self.rpy)
        return Pose.from_rpy(self.xyz, (roll, pitch, yaw))


class CameraEntry(Value):
    """A camera mount: position in a link, viewing direction, and the image's up direction."""

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
        """Pose of the camera in its link (x right, y down, z forward)."""
        forward = np.asarray(self.forward) / np.linalg.norm(self.forward)
        right = np.cross(forward, self.up)
        right /= np.linalg.norm(right)
        axes = np.column_stack((right, np.cross(forward, right), forward))
        return Pose.from_axes(np.array(self.xyz, dtype=float), axes.tolist())


class LimitEntry(Value):
    """One value for all joints or one for each, with its source."""

    value: _Positive | tuple[_Positive, ...]
    source: Annotated[str, Field(min_length=8)]


class UrdfLimitEntry(LimitEntry):
    """A limit that the URDF gives as well.

    Attributes:
        widens: Whether values above those of the URDF are meant; without it they are an error.
    """

    widens: bool = False


class PositionEntry(Value):
    """Position limits of all joints in rad, base to tip, with their source.

    Attributes:
        widens: Whether positions outside of the URDF's limits are meant; without it they are an
            error.
    """

    lower: tuple[float, ...]
    upper: tuple[float, ...]
    source: Annotated[str, Field(min_length=8)]
    widens: bool = False


class LimitsEntry(Value):
    """Limits in rad, rad/s, rad/s², rad/s³ and N m.

    The URDF has those of position, velocity and effort, too; here they are corrected.
    """

    acceleration: LimitEntry
    jerk: LimitEntry
    velocity: UrdfLimitEntry | None = None
    effort: UrdfLimitEntry | None = None
    position: PositionEntry | None = None


class OriginEntry(Value):
    """Origin of a joint as in the URDF, in m and degrees; None for what the URDF gives."""

    xyz: _Near | None = None
    rpy: tuple[_Turn, _Turn, _Turn] | None = None


class BodyEntry(Value):
    """Inertia of a link in its frame, and shapes that the URDF lacks.

    Attributes:
        mass: Mass in kg; by default the URDF's.
        center: Center of mass in m; by default the URDF's.
        inertia: ixx, iyy, izz, ixy, ixz, iyz about the center of mass, along the axes of the link,
            kg m²; by default the URDF's, scaled with the mass.
        shapes: Shapes in addition to those of the URDF, for contacts and cameras.
    """

    mass: Annotated[float | None, Field(gt=0.0, le=MASS.most)] = None
    center: _Near | None = None
    inertia: tuple[float, float, float, float, float, float] | None = None
    shapes: Annotated[tuple[ShapeEntry, ...], Field(max_length=_MOST)] = ()

    @model_validator(mode="after")
    def _is_a_body(self) -> BodyEntry:
        if self.inertia is not None:
            xx, yy, zz, xy, xz, yz = self.inertia
            a, b, c = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            # The figures of data sheets are rounded: a thin rod has a + b = c exactly.
            if not 0.0 < a <= b <= c <= 1.01 * (a + b):
                raise ValueError(
                    f"no body has the principal moments {a:.3g}, {b:.3g}, {c:.3g} kg m²: they are "
                    "positive, and none is larger than the sum of the others"
                )
        return self


class CorrectionsEntry(Value):
    """Values that replace those of the URDF, with their source.

    Attributes:
        joints: Origins of joints by name: a calibration, or an arm of other lengths.
        links: Inertias of links by name, and further shapes.
    """

    joints: Annotated[dict[str, OriginEntry], Field(default_factory=dict, max_length=_MOST)]
    links: Annotated[dict[str, BodyEntry], Field(default_factory=dict, max_length=_MOST)]
    source: Annotated[str, Field(min_length=8)]


class PayloadEntry(Value):
    """Payload by the manufacturer, kg, with its source."""

    value: Annotated[float, Field(gt=0.0, le=1e4)]
    source: Annotated[str, Field(min_length=8)]


class FrictionEntry(Value):
    """Friction of the joints, base to tip, as in `JointFriction`, with its source."""

    coulomb: tuple[_NotNegative, ...]
    viscous: tuple[_NotNegative, ...] | None = None
    static: tuple[_NotNegative, ...] | None = None
    stribeck_velocity: _Positive = 0.1
    rise: tuple[_Positive, ...] | None = None
    offset: tuple[float, ...] | None = None
    source: Annotated[str, Field(min_length=8)]


class RobotEntry(Value):
    """Schema of a robot's description.

    Attributes:
        title: Display name.
        urdf: File next to the description, or in the example-robot-data package; likewise ``srdf``.
        base_link: Base of the arm; links that are not its descendants are left out.
        flange: Flange for grippers; by default where the tool's shape begins.
        joints: Joints of the arm, base to tip; all others are locked.
        locked: Positions of locked joints if not zero: meters of prismatic joints, degrees of
            revolute ones.
        corrections: What replaces values of the URDF.
        payload: Largest mass that the arm may hold; by default limited by its joints only.
        friction: Published friction of the joints; by default typical values.
        rotor_inertia: Inertia of a motor's rotor reflected through its gear, kg m².
        postures: Joint angles in degrees; ``home`` is required.
        exclude: Pairs of links whose contacts are ignored, in addition to those of the SRDF.
        other_arms: Descriptions of the other arms of the same robot: names in the catalog, or paths
            next to this file. Arms of a tree file that are such a pair and have the same base are
            one robot.
    """

    title: Annotated[str, Field(min_length=1, max_length=LONGEST_NAME), _Printable]
    urdf: Annotated[str, _Printable]
    srdf: Annotated[str | None, _Printable] = None
    base_link: str
    tool: ToolEntry
    flange: FlangeEntry | None = None
    joints: Annotated[tuple[str, ...], Field(min_length=1, max_length=MAX_JOINTS)]
    locked: dict[str, _Held] = Field(default_factory=dict)
    corrections: CorrectionsEntry | None = None
    limits: LimitsEntry
    payload: PayloadEntry | None = None
    friction: FrictionEntry | None = None
    rotor_inertia: Annotated[float, Field(ge=0.0, le=100.0)] = TYPICAL_ROTOR
    postures: Annotated[dict[Name, tuple[float, ...]], Field(max_length=_MOST)]
    cameras: Annotated[dict[Name, CameraEntry], Field(default_factory=dict, max_length=_MOST)]
    exclude: Annotated[tuple[tuple[str, str], ...], Field(max_length=10_000)] = ()
    other_arms: Annotated[tuple[str, ...], Field(max_length=_MOST)] = ()
    colors: dict[str, Color] = Field(default_factory=dict)


class RobotFile(DescriptionFile[RobotEntry]):
    """A robot's description file that was read and validated.

    Raises:
        DescriptionError: The file is not a valid description; lists all problems.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, RobotEntry)


# Locked joints: those of the URDF that are not joints of the arm

_ANY: Final = Range(-1e6, 1e6)
_MOST_LISTED: Final = 16

_SAME: Final = 1e-6
"""Tolerance in meters or degrees between a given position and that of the followed joint."""


@dataclass(frozen=True)
class LockedJoint:
    """A joint that could move but is locked; meters if prismatic, degrees if revolute.

    Attributes:
        link: Child link.
        turns: Whether it is revolute.
        at: Position at which it is locked.
        lower: Lower limit; likewise ``upper``.
        follows: Joint that it mimics, by the URDF's ``<mimic>``.
        times: Multiplier of the mimicked position.
        plus: Offset added to it.
    """

    link: str
    turns: bool
    at: float
    lower: float
    upper: float
    follows: str | None = None
    times: float = 1.0
    plus: float = 0.0

    @property
    def span(self) -> str:
        """Text of the limits with their unit."""
        return f"{self.lower:g} to {self.upper:g} {self.unit}"

    @property
    def unit(self) -> str:
        """Unit of its values."""
        return "degrees" if self.turns else "m"


def locked_joints(
    tree: KinematicTree, base: str, moving: tuple[str, ...], held: Mapping[str, float]
) -> dict[str, LockedJoint]:
    """Find the joints below the base that could move but are locked, by name.

    Args:
        tree: Links and joints of the URDF.
        base: The arm's base link.
        moving: Joints of the arm.
        held: Positions of locked joints if not zero: meters, degrees.
    """
    found = {}
    for link in tree.subtree(base):
        joint = tree.above.get(link)
        if link == base or joint is None or joint.name in moving:
            continue
        if joint.kind in (*TURNING, "prismatic"):
            found[joint.name] = _locked(joint, held.get(joint.name, 0.0))
    return found


def with_followers(
    joints: Mapping[str, LockedJoint], given: Mapping[str, float]
) -> dict[str, float]:
    """Add the positions of joints that mimic a given one, directly or through others."""
    values = dict(given)
    left = {name: joint for name, joint in joints.items() if name not in values}
    while ready := [name for name, joint in left.items() if joint.follows in values]:
        for name in ready:
            values[name] = _mimicked(joints, left.pop(name), values)
    return values


def problems_of(
    robot: str,
    moving: tuple[str, ...],
    joints: Mapping[str, LockedJoint],
    given: Mapping[str, float],
) -> Iterator[tuple[str, bool, str, str]]:
    """Check the positions of locked joints.

    Args:
        robot: Name of the robot.
        moving: Joints of its arm.
        joints: Its locked joints by name.
        given: Requested positions: meters of prismatic joints, degrees of revolute ones.

    Yields:
        Joint, whether its name is the problem, message, hint.
    """
    known = ", ".join(list(joints)[:_MOST_LISTED]) + (", …" if len(joints) > _MOST_LISTED else "")
    for name, value in given.items():
        if name in moving:
            hint = f"locked joints of {robot}: {known or 'none'}"
            yield name, True, f"joint '{name}' is one of the arm's: it moves", hint
        elif name not in joints:
            hint = suggestion(name, joints, "locked joint") if joints else f"{robot} has none"
            yield name, True, f"there is no locked joint of {robot} '{name}'", hint
        elif not joints[name].lower <= value <= joints[name].upper:
            joint = joints[name]
            message = f"joint '{name}' cannot be at {value:g} {joint.unit}"
            yield name, False, message, f"its limits are {joint.span}"
    valid = {
        name: value
        for name, value in given.items()
        if name in joints and joints[name].lower <= value <= joints[name].upper
    }
    yield from _mimic_problems(joints, valid)


def _mimic_problems(
    joints: Mapping[str, LockedJoint], given: Mapping[str, float]
) -> Iterator[tuple[str, bool, str, str]]:
    """Check joints that mimic one another, as the two fingers of a hand; as `problems_of`."""
    values = with_followers(joints, given)
    everywhere = {name: values.get(name, joint.at) for name, joint in joints.items()}
    for name, value in values.items():
        joint = joints[name]
        if name not in given:
            if not joint.lower <= value <= joint.upper:
                message = f"'{name}', which follows it, cannot be at {value:g} {joint.unit}"
                yield _leader(joints, name, given), False, message, f"its limits are {joint.span}"
        elif joint.follows in joints:
            expected = _mimicked(joints, joint, everywhere)
            if abs(expected - value) > _SAME:
                message = f"joint '{name}' follows '{joint.follows}', to {expected:g} {joint.unit}"
                hint = f"{joint.follows} is at {everywhere[str(joint.follows)]:g}: set that one"
                yield name, False, message, hint


def _mimicked(
    joints: Mapping[str, LockedJoint], joint: LockedJoint, values: Mapping[str, float]
) -> float:
    """Position of a joint that mimics another one."""
    leader = str(joint.follows)
    at = float(np.radians(values[leader])) if joints[leader].turns else values[leader]
    value = joint.times * at + joint.plus
    return float(np.degrees(value)) if joint.turns else value


def _leader(joints: Mapping[str, LockedJoint], name: str, given: Mapping[str, float]) -> str:
    """The given joint that a joint mimics, directly or through others."""
    while name not in given:
        name = str(joints[name].follows)
    return name


def _locked(joint: Joint, at: float) -> LockedJoint:
    turns = joint.kind in TURNING
    mimic = joint.element.find("mimic")
    lower, upper = _span(joint)
    scale = 180.0 / np.pi if turns else 1.0
    follows = None
    times = 1.0
    plus = 0.0
    if mimic is not None:
        follows = mimic.attributes.get("joint")
        times = _number(mimic, "multiplier", 1.0)
        plus = _number(mimic, "offset", 0.0)
    lower, upper = (round(float(scale * end), 6) for end in (lower, upper))
    return LockedJoint(joint.child, turns, at, lower, upper, follows, times, plus)


def _span(joint: Joint) -> tuple[float, float]:
    """Limits of a joint in rad or m; a locked joint needs none and then may be anywhere."""
    element = joint.element.find("limit")
    free = ONE_TURN if joint.kind in TURNING else 10.0
    if element is None or joint.kind == "continuous":
        return -free, free
    lower = max(_number(element, "lower", 0.0), -free)
    upper = min(_number(element, "upper", 0.0), free)
    return (lower, upper) if lower <= upper else (-free, free)


def _number(element: Element, name: str, default: float) -> float:
    return AttributeReader().number(element, name, _ANY, default)


TYPICAL_COULOMB: Final = 0.04
"""Default Coulomb friction as a fraction of the effort limit: strain-wave gears of this size have 3
to 7 %."""

TYPICAL_VISCOUS: Final = 0.01
"""Default viscous friction as a fraction of the effort limit per rad/s."""


@dataclass(frozen=True, eq=False)
class JointFriction:
    """Friction of the joints, base to tip, each array of shape (dof,).

    ``τ(v) = (c + (s - c) exp(-(v/v_s)²)) T(v) + b v``: Coulomb friction with the Stribeck effect,
    and viscous friction (Armstrong-Hélouvry, Dupont, Canudas de Wit, Automatica 1994). ``T`` is the
    sign of ``v``, or, if dry friction builds up over a speed ``r``, the sigmoid
    ``tanh((v + o)/r) - tanh(o/r)`` (the form of Gaz et al., RA-L 2019).

    Attributes:
        coulomb: Coulomb friction c, N m.
        viscous: Viscous friction b, N m s/rad.
        static: Static friction s, N m: dry friction at rest.
        stribeck_velocity: Stribeck velocity v_s, rad/s.
        rise: Speed r over which dry friction builds up, rad/s; 0 for a step.
        offset: Offset o of the speed in the sigmoid, rad/s.
        uncertainty: Relative uncertainty of the dry friction.
    """

    coulomb: Vector
    viscous: Vector
    static: Vector
    stribeck_velocity: Vector
    rise: Vector
    offset: Vector
    uncertainty: float = 0.0

    @classmethod
    def typical(cls, effort: Vector) -> JointFriction:
        """Default friction of an arm without published values, from its effort limits in N m."""
        coulomb = TYPICAL_COULOMB * effort
        zero = np.zeros_like(effort)
        return cls(
            coulomb, TYPICAL_VISCOUS * effort, coulomb, np.full_like(effort, 0.1), zero, zero
        )

    @classmethod
    def none(cls, dof: int) -> JointFriction:
        """Frictionless joints."""
        zero = np.zeros(dof)
        return cls(zero, zero, zero, np.ones(dof), zero, zero)

    def torque(self, v: Vector) -> Vector:
        """Torque in N m, of shape (dof,), that keeps the joints at velocities ``v`` in rad/s.

        The friction torque itself is its negative.
        """
        torque: Vector = self.level(v) * self.build_up(v) + self.viscous * v
        return torque

    def level(self, v: Vector) -> Vector:
        """Magnitude of dry friction at velocities ``v`` in rad/s, of shape (dof,), N m."""
        if self._stribeck is None:
            return self.coulomb
        drop, factor = self._stribeck
        level: Vector = v * v  # in place from here on, because this runs in every control step
        np.multiply(level, factor, level)
        np.exp(level, level)
        np.multiply(level, drop, level)
        return np.add(level, self.coulomb, level)

    @cached_property
    def _stribeck(self) -> tuple[Vector, Vector] | None:
        """Drop of dry friction from rest to motion, N m, and -1/v_s²; None if there is none."""
        drop = self.static - self.coulomb
        return (drop, -1.0 / np.square(self.stribeck_velocity)) if drop.any() else None

    def build_up(self, v: Vector) -> Vector:
        """Signed share T of the dry friction at velocities ``v``, of shape (dof,), from -1 to 1."""
        is_smooth, rise, start = self._sigmoid
        smooth = np.tanh((v + self.offset) / rise) - start
        share: Vector = smooth if is_smooth.all() else np.where(is_smooth, smooth, np.sign(v))
        return share

    @cached_property
    def _sigmoid(self) -> tuple[npt.NDArray[np.bool_], Vector, Vector]:
        """Which joints have a sigmoid, its speed r (1 for the others), and tanh(o/r)."""
        is_smooth = self.rise > 0
        rise = np.where(is_smooth, self.rise, 1.0)
        return is_smooth, rise, np.tanh(self.offset / rise)

    def scaled(self, dry: Vector, viscous: Vector, most: Vector) -> JointFriction:
        """Friction of another specimen of the robot.

        Args:
            dry: Factors of the Coulomb and static friction, of shape (dof,).
            viscous: Factors of the viscous friction, of the same shape.
            most: Upper limit of the Coulomb and static friction, of shape (dof,), N m.
        """
        peak = np.maximum(self.static, self.coulomb) * dry
        dry = dry * np.minimum(1.0, most / np.maximum(peak, 1e-12))
        return replace(
            self,
            coulomb=self.coulomb * dry,
            static=self.static * dry,
            viscous=self.viscous * viscous,
        )


@dataclass(frozen=True, eq=False)
class JointLimits:
    """Limits of an arm's joints, base to tip, each of shape (dof,).

    Units: rad, rad/s, rad/s², rad/s³ and N m.
    """

    lower: Vector
    upper: Vector
    velocity: Vector
    acceleration: Vector
    jerk: Vector
    effort: Vector

    def scaled(self, speed: float) -> JointLimits:
        """Scale velocity, acceleration and jerk by ``speed``, a share in (0, 1].

        Unlike the shares of a tree file it may be below 0.001: guarded motions far from the base
        need that.
        """
        return replace(
            self,
            velocity=self.velocity * speed,
            acceleration=self.acceleration * speed,
            jerk=self.jerk * speed,
        )

    def derated(self, shares: LimitShares) -> JointLimits:
        """Scale velocity, acceleration and jerk by a share of each."""
        return replace(
            self,
            velocity=self.velocity * shares.velocity,
            acceleration=self.acceleration * shares.acceleration,
            jerk=self.jerk * shares.jerk,
        )


def degrees_within(lower: float, upper: float) -> tuple[float, float]:
    """Position limits in rad as degrees with three decimals, rounded to the inside.

    As they are printed, a joint can be at them: rounded to the nearest, every second one could not.
    """
    low, high = 1e3 * np.degrees((lower, upper))
    # What is a whole number but for rounding errors stays one; -0.0 becomes 0.0.
    return float(np.ceil(low - 1e-6)) / 1e3 + 0.0, float(np.floor(high + 1e-6)) / 1e3 + 0.0


@dataclass(frozen=True, eq=False)
class CameraMount:
    """Mount of a camera on an arm: a link, and the camera's pose in it (OpenCV's axes)."""

    link: str
    pose: Pose


@dataclass(frozen=True, eq=False)
class Flange:
    """Flange of an arm, on which grippers are mounted.

    Attributes:
        link: Link of the flange.
        pose: Pose in the link; the z axis points away from the arm.
        stock: Links of the stock tool; a gripper replaces them and their subtrees.
    """

    link: str
    pose: Pose
    stock: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Robot:
    """An arm of the catalog; lengths in meters, angles in radians.

    Attributes:
        tool: The tool frame in ``tool_link``; its z axis points out of the tool.
        friction: Friction of the joints.
        rotor_inertia: Rotor inertias reflected through the gears, of shape (dof,), kg m².
        flange: Flange on which grippers are mounted.
        tool_shape: Cylinder that ends in the tool frame, if the URDF has no tool of its own.
        payload: Largest mass that it may carry, kg; None if the description gives none.
        gripper: Name of the gripper that is mounted, for which the payload is; empty without one.
        exclusions: Pairs of links whose contacts are ignored.
        colors: RGBA of links by name; ``default`` is for all others.
        locked: Joints that could move but are locked, by name.
        other_arms: Links of the other arms of the same robot, by the names of their descriptions.
    """

    name: str
    title: str
    model: Urdf
    base_link: str
    tool_link: str
    tool: Pose
    tool_shape: ToolShape | None
    flange: Flange
    joints: tuple[str, ...]
    limits: JointLimits
    payload: float | None
    friction: JointFriction
    rotor_inertia: Vector
    postures: Mapping[str, Vector]
    cameras: Mapping[str, CameraMount]
    exclusions: frozenset[frozenset[str]]
    colors: Mapping[str, tuple[float, float, float, float]]
    locked: Mapping[str, LockedJoint] = field(default_factory=dict)
    other_arms: Mapping[str, frozenset[str]] = field(default_factory=dict)
    gripper: str = ""

    @property
    def full_name(self) -> str:
        """Its name, with that of its gripper if one is mounted."""
        return f"{self.name} with {self.gripper}" if self.gripper else self.name

    @property
    def dof(self) -> int:
        """Number of joints of the arm."""
        return len(self.joints)

    def derated(self, shares: LimitShares) -> Robot:
        """The same robot with a fraction of its velocity, acceleration and jerk limits."""
        return replace(self, limits=self.limits.derated(shares))

    @cached_property
    def urdf_text(self) -> str:
        """URDF of links, joints and inertias, without shapes."""
        return self.model.kinematic_text
