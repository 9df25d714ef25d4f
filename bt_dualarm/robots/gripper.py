"""Grippers of the catalog: their data, the schema of their descriptions, and how they are built.

A gripper has two fingers that slide in a palm, or a suction cup. Its parts are either links of a
URDF, or simple shapes of uniform density.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Final, TypeAlias

import numpy as np
from pydantic import Field, model_validator

from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.robots.meshes import mesh_problems
from bt_dualarm.robots.robot import (
    DescriptionFile,
    PlaceEntry,
    ShapeEntry,
    description_path,
    file_below,
    is_description_path,
    shipped_names,
)
from bt_dualarm.robots.urdf import (
    Inertial,
    KinematicTree,
    Part,
    Selection,
    Shape,
    axis_of,
    read_urdf,
)
from bt_dualarm.robots.urdf_arm import Urdf, mesh_finder, robot_data_dir
from bt_dualarm.robots.urdf_xml import AttributeReader, DescriptionError
from bt_dualarm.spec.document import LONGEST_NAME
from bt_dualarm.spec.problems import Problem, suggestion
from bt_dualarm.spec.values import Value
from bt_dualarm.spec.yaml_reader import DataPath as Place

GRIPPER: Final = "gripper/"
"""Prefix of the names of all bodies of a gripper."""

PALM: Final = "gripper/palm"
"""Link that a gripper adds to its arm; names of links in URDFs contain no slash."""

CLOSED_M: Final = 0.001
"""Opening in m below which fingers count as closed, unless their encoder is coarser."""

FINGERS: Final = ("gripper/left", "gripper/right")
"""Bodies and joints of the two fingers, below the palm."""


@dataclass(frozen=True, eq=False)
class GripperShape:
    """One shape of a gripper.

    Attributes:
        kind: ``box``, ``cylinder``, ``sphere`` or ``mesh``.
        size: Full lengths of a box, radius and length of a cylinder, radius of a sphere (m); the
            scale of a mesh.
        pose: Pose in its part.
        mesh: File of a mesh.
    """

    kind: str
    size: tuple[float, ...]
    pose: Pose
    mesh: Path | None = None


@dataclass(frozen=True, eq=False)
class RigidPart:
    """A rigid part of a gripper, in its own frame.

    Attributes:
        mass: Mass in kg.
        center: Center of mass, of shape (3,), m.
        inertia: Inertia about the center of mass, of shape (3, 3), kg m².
        collision: Collision shapes.
        visual: Shapes for images; if empty, the collision shapes.
    """

    mass: float
    center: Vector
    inertia: Matrix
    collision: tuple[GripperShape, ...]
    visual: tuple[GripperShape, ...]


@dataclass(frozen=True, eq=False)
class Finger:
    """A finger that slides in the palm.

    Attributes:
        part: Shapes and inertia.
        pose: Pose of its frame in the palm when the gripper is closed.
        axis: Unit vector in the palm of its opening direction, of shape (3,).
        pad: Contact pad, a box in the finger.
    """

    part: RigidPart
    pose: Pose
    axis: Vector
    pad: GripperShape


@dataclass(frozen=True)
class Cup:
    """A suction cup; its rim lies in the tool frame's plane.

    Attributes:
        radius: Radius of its rim in m.
        depth: Depth of its lip in m.
        seal: Fraction of the rim that must be on an object for a seal.
    """

    radius: float
    depth: float
    seal: float


@dataclass(frozen=True)
class Tactile:
    """Force sensors under the pads.

    Attributes:
        rate: Sampling rate, Hz.
        noise: Standard deviation of a reading in each direction, N.
        gain: Half-width of the relative gain error of a pad's sensor.
    """

    rate: float
    noise: float
    gain: float


@dataclass(frozen=True)
class Interval:
    """Range of a gripper's commands."""

    least: float
    most: float

    def clipped(self, value: float) -> float:
        """The nearest value in the range."""
        return min(max(value, self.least), self.most)


@dataclass(frozen=True, eq=False)
class Gripper:
    """A gripper of the catalog, SI units.

    Attributes:
        name: Name in the catalog.
        title: Display name.
        mount: Pose of the palm in the robot's flange, whose z axis points away from the arm.
        tool: Pose of the tool frame in the palm: between the pads, or in the plane of the cup's
            rim. Its z axis points out of the gripper, its y axis along the motion of the fingers.
        stroke: Distance of the pads when open, m; 0 for a cup.
        force: Force of each pad on the object, N; for a cup, its holding force.
        speed: Speed of the opening, of both fingers together, m/s; zeros for a cup.
        payload: Largest mass of an object, kg.
        resolution: Resolution of the opening's encoder, m; 0 for none.
        friction: Minimum friction coefficient of pads or cup, whatever the object's.
        palm: Static part.
        fingers: Two fingers, or none.
        cup: Suction cup, if it has one.
        drive_mass: Reflected inertia of the drive per finger, kg.
        tactile: Force sensors under the pads, if any.
        color: RGBA of its shapes.
    """

    name: str
    title: str
    mount: Pose
    tool: Pose
    stroke: float
    force: Interval
    speed: Interval
    payload: float
    resolution: float
    friction: float
    palm: RigidPart
    fingers: tuple[Finger, ...]
    cup: Cup | None
    drive_mass: float
    tactile: Tactile | None
    color: tuple[float, float, float, float]

    @property
    def kind(self) -> str:
        """``"fingers"`` or ``"suction"``."""
        return "fingers" if self.fingers else "suction"

    @property
    def closed_width(self) -> float:
        """Opening in m below which the fingers hold no object: two encoder steps or `CLOSED_M`."""
        return max(CLOSED_M, 2.0 * self.resolution)

    @property
    def moved_mass(self) -> float:
        """Mass that the drive accelerates per finger, its own reflected inertia included, kg."""
        return self.drive_mass + sum(finger.part.mass for finger in self.fingers[:1])

    @property
    def mass(self) -> float:
        """Mass of palm and fingers, kg."""
        return self.palm.mass + sum(finger.part.mass for finger in self.fingers)


# Schema

_Metres: TypeAlias = Annotated[float, Field(ge=-2.0, le=2.0)]
_Length: TypeAlias = Annotated[float, Field(gt=0.0, le=2.0)]
_Share: TypeAlias = Annotated[float, Field(ge=0.0, le=1.0)]
_Mass: TypeAlias = Annotated[float, Field(gt=0.0, le=100.0)]
_Text: TypeAlias = Annotated[str, Field(min_length=8, max_length=300)]
_Force: TypeAlias = Annotated[float, Field(gt=0.0, le=5000.0)]
_Speed: TypeAlias = Annotated[float, Field(gt=0.0, le=2.0)]

_ROUNDING_M: Final = 1e-4
"""Rounding of lengths in a description, m."""


class PartEntry(Value):
    """A part of simple shapes; its mass is distributed evenly over their volumes."""

    mass: _Mass
    shapes: Annotated[tuple[ShapeEntry, ...], Field(min_length=1, max_length=50)]


class PadEntry(Value):
    """Contact pad of a finger: a box in the finger's frame; its inner face is at y = 0."""

    xyz: tuple[_Metres, _Metres, _Metres]
    size: tuple[_Length, _Length, _Length]

    @model_validator(mode="after")
    def _begins_in_the_middle(self) -> PadEntry:
        inner = self.xyz[1] - self.size[1] / 2
        if abs(inner) > _ROUNDING_M:  # the opening of the fingers would not be that of the pads
            raise ValueError(
                f"its inner face is at y = {inner:g} m, not at 0: y of xyz is half of that of size"
            )
        return self


class FingersEntry(Value):
    """Two fingers that slide along y of the palm, the second one rotated by 180° about z.

    Attributes:
        links: Links of the URDF that are the fingers; the first one opens along +y.
        part: One finger, closed: y points outward from the middle.
        place: Pose in the palm of the middle between the closed fingers.
        pad: Box that grasps objects; its inner face is at y = 0.
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
    """A range with its source."""

    value: tuple[_Force, _Force]
    source: _Text

    @model_validator(mode="after")
    def _ascends(self) -> SourcedSpan:
        if self.value[0] > self.value[1]:
            raise ValueError("the smaller value comes first")
        return self


class SpeedSpan(SourcedSpan):
    """A range of speeds in m/s with its source."""

    value: tuple[_Speed, _Speed]


class SourcedValue(Value):
    """A number with its source."""

    value: Annotated[float, Field(gt=0.0, le=5000.0)]
    source: _Text


class LengthValue(SourcedValue):
    """A length in m with its source."""

    value: Annotated[float, Field(gt=0.0, le=2.0, json_schema_extra={"unit": "m"})]


class TactileEntry(Value):
    """Force sensors under the pads.

    Attributes:
        rate: Sampling rate, Hz.
        noise: Standard deviation of a reading in each direction, N.
        gain: Half-width of the relative gain error of a pad's sensor.
        source: Source of these values.
    """

    rate: Annotated[float, Field(ge=10.0, le=10000.0)]
    noise: Annotated[float, Field(ge=0.0, le=100.0)]
    gain: Annotated[float, Field(ge=0.0, le=0.5)] = 0.0
    source: _Text


class GripperEntry(Value):
    """Schema of a gripper's description.

    Attributes:
        title: Display name.
        urdf: File next to the description, or in the example-robot-data package, with the links
            that the description refers to.
        mount: Pose of the palm in the robot's flange, whose z axis points away from the arm.
        tool: Tool frame in the palm.
        palm: Static part: shapes, or a link of the URDF.
        fingers: Two fingers; otherwise there is a cup.
        cup: Suction cup; otherwise there are fingers.
        stroke: Distance of the pads when open, m.
        force: Force of each pad, or holding force of a cup, N.
        speed: Speed of the opening, m/s.
        payload: Largest mass of an object, kg.
        resolution: Resolution of the opening's encoder, m.
        tactile: Force sensors under the pads, if any.
        friction: Minimum friction coefficient of pads or cup.
        drive_mass: Reflected inertia of the drive per finger, kg.
        color: RGBA of its shapes.
    """

    title: Annotated[str, Field(min_length=1, max_length=LONGEST_NAME)]
    urdf: str | None = None
    mount: PlaceEntry = PlaceEntry()
    tool: PlaceEntry
    palm: PartEntry | str
    fingers: FingersEntry | None = None
    cup: CupEntry | None = None
    stroke: LengthValue | None = None
    force: SourcedSpan
    speed: SpeedSpan | None = None
    payload: SourcedValue
    resolution: LengthValue | None = None
    tactile: TactileEntry | None = None
    friction: Annotated[float, Field(ge=0.0, le=5.0)] = 0.0
    drive_mass: Annotated[float, Field(ge=0.0, le=100.0)] = 0.4
    color: tuple[_Share, _Share, _Share, _Share] = (0.2, 0.2, 0.22, 1.0)


class GripperFile(DescriptionFile[GripperEntry]):
    """A gripper's description file that was read and validated.

    Raises:
        DescriptionError: The file is not a valid description; lists all problems.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, GripperEntry)


# Parts


def part_of(entry: PartEntry) -> RigidPart:
    """Part of a gripper of simple shapes, of uniform density."""
    solids = tuple(GripperShape(shape.shape, shape.size, shape.pose) for shape in entry.shapes)
    volumes = np.array([_volume(shape) for shape in entry.shapes])
    masses = entry.mass * volumes / volumes.sum()
    bodies = [
        (mass, solid.pose.position, _inertia(solid, mass))
        for mass, solid in zip(masses.tolist(), solids, strict=True)
    ]
    return RigidPart(*together(bodies), solids, ())


def part_of_link(part: Part) -> RigidPart:
    """Part of a gripper that is a link of a URDF."""
    inertial = part.inertial or Inertial(1e-3, part.origin, (1e-6, 1e-6, 1e-6, 0.0, 0.0, 0.0))
    turn = inertial.origin.pose.rotation_matrix
    return RigidPart(
        inertial.mass,
        inertial.origin.pose.position,
        turn @ inertial.tensor @ turn.T,
        tuple(map(_solid, part.collision)),
        tuple(map(_solid, part.visual)),
    )


def together(bodies: Sequence[tuple[float, Vector, Matrix]]) -> tuple[float, Vector, Matrix]:
    """Mass, center of mass and inertia of rigidly connected bodies (parallel-axis theorem).

    Args:
        bodies: Mass in kg, center of mass of shape (3,) in m, and inertia about it of shape (3, 3)
            in kg m² of each body, all in one frame.

    Returns:
        The same for all of them.
    """
    mass = sum(body[0] for body in bodies)
    center = sum((body[0] * body[1] for body in bodies), np.zeros(3)) / mass
    inertia = np.zeros((3, 3))
    for own, place, about in bodies:
        away = place - center
        inertia += about + own * (away @ away * np.eye(3) - np.outer(away, away))
    return mass, center, inertia


def placed(pose: Pose, part: RigidPart) -> tuple[float, Vector, Matrix]:
    """Mass, center of mass and inertia of a part, in the frame in which its pose is given."""
    turn = pose.rotation_matrix
    return part.mass, pose.apply(part.center), turn @ part.inertia @ turn.T


def _solid(shape: Shape) -> GripperShape:
    return GripperShape(shape.kind, shape.size, shape.pose, shape.mesh)


def _volume(shape: ShapeEntry) -> float:
    size = shape.size
    if shape.shape == "box":
        return float(np.prod(size))
    if shape.shape == "cylinder":
        return float(np.pi * size[0] ** 2 * size[1])
    return float(4 / 3 * np.pi * size[0] ** 3)


def _inertia(solid: GripperShape, mass: float) -> Matrix:
    """Inertia of a uniform shape about its center, in the axes of its part, (3, 3), kg m²."""
    squares = np.square(solid.size)
    if solid.kind == "box":
        x, y, z = squares
        own = np.array([y + z, z + x, x + y]) / 12
    elif solid.kind == "cylinder":
        radius, length = squares
        own = np.array([3 * radius + length, 3 * radius + length, 6 * radius]) / 12
    else:
        own = np.full(3, 0.4 * squares[0])
    turn = solid.pose.rotation_matrix
    inertia: Matrix = turn @ np.diag(mass * own) @ turn.T
    return inertia


# Grippers

_NONE: Final = Interval(0.0, 0.0)
_OPPOSITE: Final = Pose.from_rpy((0.0, 0.0, 0.0), (0.0, 0.0, np.pi))
_MIN_COSINE: Final = 1.0 - 1e-6  # cosine of the angle between a finger's axis and y


@dataclass(frozen=True, eq=False)
class _Described:
    """Links of a URDF that are parts of a gripper, by name, and the fingers' opening axes."""

    parts: Mapping[str, RigidPart]
    poses: Mapping[str, Pose]
    axes: Mapping[str, Vector]


def gripper_of(file: GripperFile) -> Gripper:
    """Build the gripper of a description.

    Raises:
        DescriptionError: The description is wrong; carries all problems.
    """
    entry = file.entry
    problems = list(_problems(file))
    if problems:
        raise DescriptionError(problems)
    described = None if entry.urdf is None else _from_urdf(file, entry.urdf)
    if isinstance(entry.palm, str):
        assert described is not None  # noqa: S101 - a description with a link has a URDF
        palm = described.parts[entry.palm]
    else:
        palm = part_of(entry.palm)
    cup = entry.cup
    speed = entry.speed
    tactile = entry.tactile
    return Gripper(
        name=file.path.stem,
        title=entry.title,
        mount=entry.mount.pose,
        tool=entry.tool.pose,
        stroke=entry.stroke.value if entry.stroke else 0.0,
        force=Interval(*entry.force.value),
        speed=Interval(*speed.value) if speed else _NONE,
        payload=entry.payload.value,
        resolution=entry.resolution.value if entry.resolution else 0.0,
        friction=entry.friction,
        palm=palm,
        fingers=() if entry.fingers is None else tuple(_fingers(entry.fingers, described)),
        cup=None if cup is None else Cup(cup.radius, cup.depth, cup.seal),
        drive_mass=entry.drive_mass,
        tactile=None if tactile is None else Tactile(tactile.rate, tactile.noise, tactile.gain),
        color=entry.color,
    )


def _problems(file: GripperFile) -> Iterator[Problem]:
    """Report contradictions in the description."""
    entry = file.entry
    fingers = file.entry.fingers
    if (fingers is None) == (entry.cup is None):
        message = "a gripper has either fingers or a cup"
        yield file.problem(("cup",) if entry.cup else ("title",), message, "one of the two")
        return
    if fingers is not None:
        for key in ("stroke", "speed"):
            if getattr(entry, key) is None:
                yield file.problem(("fingers",), f"fingers need a {key}", "with its source")
        if (fingers.links is None) == (fingers.part is None):
            hint = "links of the URDF, or a part of shapes"
            yield file.problem(("fingers",), "the fingers have no shape, or two", hint, key=True)
    if fingers is None and entry.tactile is not None:
        yield file.problem(("tactile",), "tactile sensors are on pads: a cup has none", key=True)
    from_urdf = isinstance(entry.palm, str) or (fingers is not None and fingers.links is not None)
    if from_urdf and entry.urdf is None:
        place: Place = ("palm",) if isinstance(entry.palm, str) else ("fingers", "links")
        yield file.problem(place, "no URDF has these links", "name it: urdf: …")
    if fingers is not None and fingers.links is not None and not isinstance(entry.palm, str):
        yield file.problem(("palm",), "is not a link of the URDF that has the fingers")


def _fingers(entry: FingersEntry, described: _Described | None) -> Iterator[Finger]:
    pad = GripperShape("box", entry.pad.size, Pose.from_rpy(entry.pad.xyz, (0.0, 0.0, 0.0)))
    if entry.part is not None:
        part = part_of(entry.part)
        place = entry.place.pose
        for pose in (place, place @ _OPPOSITE):
            yield Finger(part, pose, pose.rotation_matrix[:, 1].copy(), pad)
    if entry.links is not None and described is not None:
        for link in entry.links:
            pose = described.poses[link]
            axis = described.axes[link]
            opening = pose.rotation_matrix.T @ axis  # in the finger
            facing = Pose.identity() if opening[1] > 0 else _OPPOSITE
            own = GripperShape("box", pad.size, facing @ pad.pose)
            yield Finger(_without(described.parts[link], own), pose, axis, own)


def _without(part: RigidPart, pad: GripperShape) -> RigidPart:
    """The part without the collision shapes that contain the pad's center, which it replaces."""
    kept = tuple(solid for solid in part.collision if not _holds(solid, pad.pose.position))
    return RigidPart(part.mass, part.center, part.inertia, kept, part.visual)


def _holds(solid: GripperShape, point: Vector) -> bool:
    inside = np.abs(solid.pose.inverse.apply(point))
    return solid.kind == "box" and bool((inside <= 0.5 * np.asarray(solid.size)).all())


def _from_urdf(file: GripperFile, name: str) -> _Described:
    """Read palm and fingers from the URDF.

    Raises:
        DescriptionError: It lacks the links, or they are invalid.
    """
    entry = file.entry
    path = next(
        (f for folder in (file.path.parent, robot_data_dir()) if (f := file_below(folder, name))),
        None,
    )
    if path is None:
        hint = f"neither next to this file nor in {robot_data_dir()}"
        raise DescriptionError([file.problem(("urdf",), f"there is no file {name!r}", hint)])
    tree = read_urdf(path)
    problems = list(_unknown_links(file, tree))
    if problems:
        raise DescriptionError(problems)
    links = () if entry.fingers is None or entry.fingers.links is None else entry.fingers.links
    return _read(path, file, tree, links)


def _unknown_links(file: GripperFile, tree: KinematicTree) -> Iterator[Problem]:
    entry = file.entry
    fingers = () if entry.fingers is None else entry.fingers.links or ()
    named: list[tuple[Place, str]] = [
        (("fingers", "links", number), link) for number, link in enumerate(fingers)
    ]
    if isinstance(entry.palm, str):
        named.append((("palm",), entry.palm))
    for place, link in named:
        if link not in tree.links:
            hint = suggestion(link, tree.links, "link")
            yield file.problem(place, f"{entry.urdf} has no link '{link}'", hint)
        elif link in fingers:
            joint = tree.above.get(link)
            if joint is None or joint.kind != "prismatic" or joint.parent != entry.palm:
                message = f"link '{link}' does not slide in '{entry.palm}'"
                yield file.problem(place, message, "a finger needs a prismatic joint to it")


def _read(path: Path, file: GripperFile, tree: KinematicTree, links: tuple[str, ...]) -> _Described:
    reader = AttributeReader()
    palm = str(file.entry.palm)
    finder = mesh_finder(path, file.path.parent, robot_data_dir().parent)
    selection = Selection(palm, (), {}, frozenset({palm, *links}))
    urdf = Urdf.read(tree, selection, finder, reader)
    poses = {link: urdf.parts[link].pose for link in links}
    axes = {link: poses[link].rotation_matrix @ axis_of(tree.above[link], reader) for link in links}
    problems = [*reader.problems, *mesh_problems(urdf)]
    for number, (link, axis) in enumerate(axes.items()):
        if abs(axis[1]) < _MIN_COSINE:
            message = f"link '{link}' does not slide along y of '{palm}'"
            problems.append(file.problem(("fingers", "links", number), message))
    if problems:
        raise DescriptionError(problems)
    parts = {link: part_of_link(urdf.parts[link]) for link in (palm, *links)}
    return _Described(parts, poses, axes)


# Catalog


def gripper_names() -> tuple[str, ...]:
    """Names of the grippers in the shipped catalog, sorted."""
    return shipped_names("gripper")


def load_gripper(name: str, root: Path | None = None) -> Gripper:
    """Load a gripper by its name in the catalog, or by the path of a YAML file below ``root``.

    Raises:
        CatalogError: There is no such gripper, or its file is wrong; the message names file and
            entry.
    """
    path = description_path("gripper", name, root)
    if is_description_path(name):
        return gripper_of(GripperFile(path))
    state = path.stat()
    return _load_shipped(path, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=64)
def _load_shipped(path: Path, _changed: int, _size: int) -> Gripper:
    """A shipped gripper, cached until its description changes."""
    return gripper_of(GripperFile(path))
