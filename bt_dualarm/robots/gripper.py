"""Grippers: what they can do and consist of, and what their description files may say."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Final, Literal, TypeAlias

import numpy as np
from pydantic import Field, model_validator

from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.robots.description_file import (
    DescriptionFile,
    description_path,
    file_below,
    is_description_path,
    shipped_names,
)
from bt_dualarm.robots.meshes import mesh_problems
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
from bt_dualarm.robots.urdf_xml import Complaints, DescriptionError
from bt_dualarm.spec.document import LONGEST_NAME
from bt_dualarm.spec.problems import Problem, suggestion
from bt_dualarm.spec.values import Value
from bt_dualarm.spec.yaml_reader import DataPath as Place

PALM: Final = "gripper/palm"
"""Link that a gripper adds to its arm; no link of a URDF has a slash in its name."""

CLOSED_M: Final = 0.001
"""Opening in meters at which fingers are closed, or more where their encoder is coarser."""

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
        visual: Shapes that people see; those that touch where there are none.
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
        part: What it consists of.
        pose: Pose of its frame in the palm when the gripper is closed.
        axis: Direction in the palm in which it opens, of unit length, of shape (3,).
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
        seal: Share of the rim that has to lie on an object so that it seals.
    """

    radius: float
    depth: float
    seal: float


@dataclass(frozen=True)
class Tactile:
    """What feels the force on each pad.

    Attributes:
        rate: Readings a second, Hz.
        noise: Deviation of a reading in each direction, N.
        gain: Half-width of the share by which a pad's sensor reads too much or too little.
    """

    rate: float
    noise: float
    gain: float


@dataclass(frozen=True)
class Interval:
    """What a gripper can be asked for: from the least to the most."""

    least: float
    most: float

    def clipped(self, value: float) -> float:
        """The nearest value that it can do."""
        return min(max(value, self.least), self.most)


@dataclass(frozen=True, eq=False)
class Gripper:
    """A gripper of the catalog, SI units.

    Attributes:
        name: Name in the catalog.
        title: Name for people.
        mount: Pose of the palm in the robot's flange, whose z axis points away from the arm.
        tool: Tool frame in the palm: between the pads, or in the cup's rim. Its z axis points out
            of the gripper, its y axis along the way of the fingers.
        stroke: Distance of the pads when it is open, m; 0 for a cup.
        force: Force of each pad on what is between them, N; of a cup, that which pulls it off.
        speed: Speed of the opening, of both fingers together, m/s; zeros for a cup.
        payload: Most that it may hold, kg.
        resolution: Step of its opening's encoder, m; 0 for none.
        friction: Least coefficient of friction of its pads or cup, whatever the object has.
        palm: All of it that does not move in it.
        fingers: Two fingers, or none.
        cup: Suction cup, if it has one.
        drive_mass: What a finger's drive adds to its inertia, kg.
        tactile: What feels the force on each pad, if anything does.
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
        """Opening in m below which nothing is between the fingers: two steps of the encoder."""
        return max(CLOSED_M, 2.0 * self.resolution)

    @property
    def moved_mass(self) -> float:
        """What the drive moves with a finger, and of itself, kg."""
        return self.drive_mass + sum(finger.part.mass for finger in self.fingers[:1])

    @property
    def mass(self) -> float:
        """Mass of all of it, kg."""
        return self.palm.mass + sum(finger.part.mass for finger in self.fingers)


# Schema of gripper descriptions


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
    """A frame in another; meters, degrees."""

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
    """Contact pad of a finger: a box in the finger's frame."""

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
    """A description of the catalog.

    Attributes:
        title: Name for people.
        urdf: File in the example-robot-data package, or beside the description, that has the links
            that the description names.
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


class GripperFile(DescriptionFile[GripperEntry]):
    """A description that was read, and the text that messages point into.

    Raises:
        DescriptionError: The file is no description; it carries every reason.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, GripperEntry)


# Parts of a gripper: shapes of uniform density, or links of a URDF


def part_of(entry: PartEntry) -> RigidPart:
    """Part of a gripper whose mass is distributed evenly over the volumes of its shapes."""
    solids = tuple(GripperShape(shape.shape, shape.size, shape.pose) for shape in entry.shapes)
    volumes = np.array([_volume(shape) for shape in entry.shapes])
    masses = entry.mass * volumes / volumes.sum()
    bodies = [
        (mass, solid.pose.position, _inertia(solid, mass))
        for mass, solid in zip(masses.tolist(), solids, strict=True)
    ]
    return RigidPart(*together(bodies), solids, ())


def part_of_link(part: Part) -> RigidPart:
    """A part that is a link of a URDF, its shapes and inertia as they stand there."""
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
    """Mass, center and inertia about it of bodies that hold together (parallel-axis theorem).

    Args:
        bodies: Mass in kg, center of mass of shape (3,) in m, and inertia about it of shape (3, 3)
            in kg m² of each, all in one frame.
    """
    mass = sum(body[0] for body in bodies)
    center = sum((body[0] * body[1] for body in bodies), np.zeros(3)) / mass
    inertia = np.zeros((3, 3))
    for own, place, about in bodies:
        away = place - center
        inertia += about + own * (away @ away * np.eye(3) - np.outer(away, away))
    return mass, center, inertia


def placed(pose: Pose, part: RigidPart) -> tuple[float, Vector, Matrix]:
    """Mass, center and inertia of a part in the frame in which it stands at a pose."""
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
    """Of an even body about its center, along the axes of its part, of shape (3, 3), kg m²."""
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


# Building a gripper from its description, with or without a URDF


_NONE: Final = Interval(0.0, 0.0)
_OPPOSITE: Final = Pose.from_rpy((0.0, 0.0, 0.0), (0.0, 0.0, np.pi))
_ALONG: Final = 1.0 - 1e-6


@dataclass(frozen=True, eq=False)
class _Described:
    """The links of a URDF that a gripper consists of, by name, and how its fingers open."""

    parts: Mapping[str, RigidPart]
    poses: Mapping[str, Pose]
    axes: Mapping[str, Vector]


def gripper_of(file: GripperFile) -> Gripper:
    """Build the gripper of a description.

    Raises:
        DescriptionError: It describes none; it carries every reason.
    """
    entry = file.entry
    problems = list(_problems(file))
    if problems:
        raise DescriptionError(problems)
    described = None if entry.urdf is None else _from_urdf(file, entry.urdf)
    if isinstance(entry.palm, str):
        assert described is not None  # noqa: S101 - a page that names a link names its URDF
        palm = described.parts[entry.palm]
    else:
        palm = part_of(entry.palm)
    cup = entry.cup
    speed = entry.speed
    felt = entry.tactile
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
        tactile=None if felt is None else Tactile(felt.rate, felt.noise, felt.gain),
        color=entry.color,
    )


def _problems(file: GripperFile) -> Iterator[Problem]:
    """Contradictions in the description."""
    entry = file.entry
    fingers = file.entry.fingers
    if (fingers is None) == (entry.cup is None):
        message = "a gripper has fingers, or a cup"
        yield file.problem(("cup",) if entry.cup else ("title",), message, "one of the two")
        return
    if fingers is not None:
        for key in ("stroke", "speed"):
            if getattr(entry, key) is None:
                yield file.problem(("fingers",), f"fingers need a {key}", "with its source")
        if (fingers.links is None) == (fingers.part is None):
            hint = "links of the URDF, or a part of shapes"
            yield file.problem(("fingers",), "what do the fingers consist of?", hint, key=True)
    if fingers is None and entry.tactile is not None:
        yield file.problem(("tactile",), "feels the force on pads: a cup has none", key=True)
    from_urdf = isinstance(entry.palm, str) or (fingers is not None and fingers.links is not None)
    if from_urdf and entry.urdf is None:
        place: Place = ("palm",) if isinstance(entry.palm, str) else ("fingers", "links")
        yield file.problem(place, "no URDF has these links", "name it: urdf: …")
    if fingers is not None and fingers.links is not None and not isinstance(entry.palm, str):
        yield file.problem(("palm",), "is no link of the URDF that the fingers are of")


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
            turned = pose.rotation_matrix.T @ axis  # the way in which it opens, in the finger
            facing = Pose.identity() if turned[1] > 0 else _OPPOSITE
            own = GripperShape("box", pad.size, facing @ pad.pose)
            yield Finger(_without(described.parts[link], own), pose, axis, own)


def _without(part: RigidPart, pad: GripperShape) -> RigidPart:
    """The part without the shapes in which the pad's middle lies: the pad stands for them."""
    kept = tuple(solid for solid in part.collision if not _holds(solid, pad.pose.position))
    return RigidPart(part.mass, part.center, part.inertia, kept, part.visual)


def _holds(solid: GripperShape, point: Vector) -> bool:
    inside = np.abs(solid.pose.inverse.apply(point))
    return solid.kind == "box" and bool((inside <= 0.5 * np.asarray(solid.size)).all())


def _from_urdf(file: GripperFile, name: str) -> _Described:
    """Palm and fingers of the URDF.

    Raises:
        DescriptionError: It has no such links, or they are not sound.
    """
    entry = file.entry
    path = next(
        (f for folder in (file.path.parent, robot_data_dir()) if (f := file_below(folder, name))),
        None,
    )
    if path is None:
        hint = f"neither beside this nor in {robot_data_dir()}"
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
                yield file.problem(place, message, "a finger hangs on a prismatic joint of it")


def _read(path: Path, file: GripperFile, tree: KinematicTree, links: tuple[str, ...]) -> _Described:
    complaints = Complaints()
    palm = str(file.entry.palm)
    finder = mesh_finder(path, file.path.parent, robot_data_dir().parent)
    selection = Selection(palm, (), {}, frozenset({palm, *links}))
    urdf = Urdf.read(tree, selection, finder, complaints)
    poses = {link: urdf.parts[link].pose for link in links}
    axes = {
        link: poses[link].rotation_matrix @ axis_of(tree.above[link], complaints) for link in links
    }
    problems = [*complaints.problems, *mesh_problems(urdf)]
    for number, (link, axis) in enumerate(axes.items()):
        if abs(axis[1]) < _ALONG:
            message = f"link '{link}' does not slide along y of '{palm}'"
            problems.append(file.problem(("fingers", "links", number), message))
    if problems:
        raise DescriptionError(problems)
    parts = {link: part_of_link(urdf.parts[link]) for link in (palm, *links)}
    return _Described(parts, poses, axes)


# Gripper catalog


def gripper_names() -> tuple[str, ...]:
    """Names of the grippers in the shipped catalog, sorted."""
    return shipped_names("gripper")


def load_gripper(name: str, root: Path | None = None) -> Gripper:
    """A gripper by its name in the catalog, or by the path of a YAML file below ``root``.

    Raises:
        CatalogError: No such gripper, or its file is wrong; the message names file and entry.
    """
    path = description_path("gripper", name, root)
    if is_description_path(name):
        return gripper_of(GripperFile(path))
    state = path.stat()
    return _catalogd(path, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=64)
def _catalogd(path: Path, _changed: int, _size: int) -> Gripper:
    """A shipped gripper, read again only when its description has changed."""
    return gripper_of(GripperFile(path))
