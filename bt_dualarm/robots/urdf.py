"""URDF files: links and joints as a validated tree, or every problem with its line.

`read_urdf` reads only names and topology. Masses, shapes and limits are read by `parts_of` for the
links that an arm uses: problems of the others do not matter.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.robots.urdf_xml import (
    ANGLE,
    LENGTH,
    AttributeReader,
    DescriptionError,
    Element,
    Origin,
    Range,
    read_xml,
)
from bt_dualarm.spec.problems import nearest, suggestion

MASS: Final = Range(0.0, 10_000.0, "kg")
_MOMENT: Final = Range(-1e6, 1e6, "kg m²")
_SIZE: Final = Range(0.0, LENGTH.most, "m", above=True)
_SCALE: Final = Range(-1e4, 1e4)
_ROUNDING: Final = 1e-6  # allowed negative moment, as a fraction of the largest principal moment
_MOMENTS: Final = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")

MeshFinder = Callable[[str], Path]
"""Maps the name of a mesh in a URDF to its file; raises ValueError with the reason if it fails."""


@dataclass(frozen=True)
class Inertial:
    """Inertia of a link.

    Attributes:
        mass: Mass in kg.
        origin: Center of mass in the link, with the axes of the moments.
        moments: ixx, iyy, izz, ixy, ixz, iyz, kg m².
    """

    mass: float
    origin: Origin
    moments: tuple[float, float, float, float, float, float]

    @property
    def tensor(self) -> Matrix:
        """Inertia about the center of mass along the axes of the origin, of shape (3, 3), kg m²."""
        xx, yy, zz, xy, xz, yz = self.moments
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


@dataclass(frozen=True, eq=False)
class Shape:
    """One shape of a link.

    Attributes:
        kind: ``box``, ``cylinder``, ``sphere`` or ``mesh``.
        size: Full lengths of a box, radius and length of a cylinder, radius of a sphere (m); the
            scale of a mesh.
        pose: Pose in the link.
        mesh: File of a mesh.
        element: Element of the URDF.
    """

    kind: str
    size: tuple[float, ...]
    pose: Pose
    mesh: Path | None
    element: Element


_PLACEHOLDER: Final = Inertial(1.0, Origin(), (1.0, 1.0, 1.0, 0.0, 0.0, 0.0))
"""Inertia of a link whose own was refused: it causes no further problems."""


def inertial_of(link: Element, reader: AttributeReader) -> Inertial | None:
    """Inertia of a link; None if it has no mass, a valid placeholder after a problem."""
    element = link.find("inertial")
    if element is None:
        return None
    mass = element.find("mass")
    inertia = element.find("inertia")
    for tag, found in (("mass", mass), ("inertia", inertia)):
        if found is None:
            reader.add(element, f"<inertial> lacks a <{tag}>")
    if mass is None or inertia is None:
        return _PLACEHOLDER
    before = len(reader.problems)
    kilograms = reader.number(mass, "value", MASS)
    zero = dict.fromkeys(_MOMENTS[3:], 0.0)
    xx, yy, zz, xy, xz, yz = (
        reader.number(inertia, name, _MOMENT, zero.get(name)) for name in _MOMENTS
    )
    inertial = Inertial(kilograms, reader.origin(element), (xx, yy, zz, xy, xz, yz))
    principal = np.linalg.eigvalsh(inertial.tensor)
    if principal[0] < -_ROUNDING * abs(principal[2]):
        shown = ", ".join(f"{moment:.3g}" for moment in principal)
        hint = f"principal moments must not be negative; they are {shown} kg m²"
        reader.add(inertia, "<inertia> is physically impossible", hint)
    if len(reader.problems) > before:
        return _PLACEHOLDER
    return inertial if kilograms > 0 else None


def shapes_of(
    link: Element, tag: str, mesh_file: MeshFinder, reader: AttributeReader
) -> tuple[Shape, ...]:
    """The shapes of a link; ``tag`` is ``"visual"`` or ``"collision"``."""
    found = (_shape(element, mesh_file, reader) for element in link.all(tag))
    return tuple(shape for shape in found if shape is not None)


def _shape(element: Element, mesh_file: MeshFinder, reader: AttributeReader) -> Shape | None:
    geometry = element.find("geometry")
    if geometry is None or len(geometry.children) != 1:
        what = "lacks a <geometry>" if geometry is None else "needs one shape in its <geometry>"
        reader.add(element, f"<{element.tag}> {what}", f"one of {', '.join(_SIZES)} or mesh")
        return None
    shape = geometry.children[0]
    pose = reader.origin(element).pose
    if shape.tag == "mesh":
        return _mesh(shape, pose, mesh_file, reader)
    if shape.tag not in _SIZES:
        hint = f"one of {', '.join(_SIZES)} or mesh"
        reader.add(shape, f"shape <{shape.tag}> is not supported", hint)
        return None
    return Shape(shape.tag, _SIZES[shape.tag](shape, reader), pose, None, shape)


def _box(shape: Element, reader: AttributeReader) -> tuple[float, ...]:
    return reader.vector(shape, "size", _SIZE)


def _cylinder(shape: Element, reader: AttributeReader) -> tuple[float, ...]:
    return reader.number(shape, "radius", _SIZE), reader.number(shape, "length", _SIZE)


def _sphere(shape: Element, reader: AttributeReader) -> tuple[float, ...]:
    return (reader.number(shape, "radius", _SIZE),)


_SIZES: Final = {"box": _box, "cylinder": _cylinder, "sphere": _sphere}


def _mesh(
    shape: Element, pose: Pose, mesh_file: MeshFinder, reader: AttributeReader
) -> Shape | None:
    scale = reader.vector(shape, "scale", _SCALE, (1.0, 1.0, 1.0))
    if 0.0 in scale and "scale" in shape.attributes:
        reader.add(shape, "<mesh> scale: a scale of 0 makes the mesh flat", "", "scale")
    if "filename" not in shape.attributes:
        reader.add(shape, "<mesh> lacks the attribute 'filename'")
        return None
    try:
        mesh = mesh_file(shape.attributes["filename"])
    except ValueError as error:
        message, _, hint = str(error).partition("; ")
        reader.add(shape, message, hint, "filename")
        return None
    return Shape("mesh", scale, pose, mesh, shape)


# Inertia of rigid bodies

MIN_MASS: Final = 1e-6
"""Minimum mass in kg of a body on a joint: below it, its acceleration is meaningless."""

MIN_MOMENT: Final = 1e-12
"""Minimum principal moment in kg m² of such a body: that of a ball of 1 mg and 3 mm diameter."""

_RELATIVE: Final = 1e-9  # fraction of the largest moment; less is rounding


def is_solid(inertial: Inertial) -> bool:
    """Whether a body resists rotation about every axis, as MuJoCo requires."""
    moments = np.linalg.eigvalsh(inertial.tensor)
    return bool(inertial.mass >= MIN_MASS and moments[0] > max(MIN_MOMENT, _RELATIVE * moments[2]))


def combined(parts: Sequence[tuple[Pose, Inertial]]) -> Inertial | None:
    """Inertia of several bodies that form one rigid body.

    Args:
        parts: Pose of each body's link in the frame of the result, and its inertia.

    Returns:
        Inertia about the common center of mass, along the axes of that frame (parallel-axis
        theorem); None for bodies without mass.
    """
    mass = sum(inertial.mass for _, inertial in parts)
    if not mass > 0:
        return None
    frames = [pose @ inertial.origin.pose for pose, inertial in parts]
    weights = np.array([inertial.mass for _, inertial in parts]) / mass
    center = weights @ np.array([frame.position for frame in frames])
    tensor = np.zeros((3, 3))
    for frame, (_, inertial) in zip(frames, parts, strict=True):
        turn = frame.rotation_matrix
        tensor += turn @ inertial.tensor @ turn.T
        tensor += inertial.mass * _point(frame.position - center)
    diagonal = np.diag(tensor)
    rest = tensor[[0, 0, 1], [1, 2, 2]]
    xx, yy, zz, xy, xz, yz = (float(moment) for moment in (*diagonal, *rest))
    x, y, z = (float(part) for part in center)
    return Inertial(mass, Origin((x, y, z)), (xx, yy, zz, xy, xz, yz))


def _point(away: Matrix) -> Matrix:
    """Inertia of a point mass of 1 kg at a position of shape (3,), of shape (3, 3), m²."""
    return float(away @ away) * np.eye(3) - np.outer(away, away)


TURNING: Final = ("revolute", "continuous")
KINDS: Final = (*TURNING, "prismatic", "fixed", "floating", "planar")
ONE_TURN: Final = 2 * math.pi
"""Limit in rad, either way, of a joint without stops."""

MIN_SPAN: Final = 0.05
"""Minimum range of a joint of an arm, rad: planners keep a margin from both ends."""

_STOP: Final = Range(-math.inf, math.inf, "rad")
_NO_STOP: Final = 1000.0  # rad; URDFs write such limits for joints that turn without end
_VELOCITY: Final = Range(0.0, 1e5, "rad/s")
_EFFORT: Final = Range(0.0, 1e7, "N m")
_AXIS: Final = Range(-1e6, 1e6)


@dataclass(frozen=True, eq=False)
class Joint:
    """Topology of one joint; everything else is read from its element on demand.

    Attributes:
        kind: One of `KINDS`.
        element: Element of the URDF.
    """

    name: str
    kind: str
    parent: str
    child: str
    element: Element

    @property
    def turns(self) -> bool:
        """Whether it could be a joint of an arm."""
        return self.kind in TURNING and self.element.find("mimic") is None


@dataclass(frozen=True)
class Stops:
    """Limits of a joint: rad, rad/s, N m; zero if the URDF gives no velocity or effort."""

    lower: float
    upper: float
    velocity: float
    effort: float


def joint_of(element: Element, reader: AttributeReader) -> Joint:
    """Read a joint's topology; missing names are empty."""
    name = reader.name(element)
    kind = element.attributes.get("type", "")
    if kind not in KINDS:
        near = nearest(kind, KINDS)
        hint = f"did you mean '{near}'?" if near else f"one of {', '.join(KINDS)}"
        what = f"there is no joint type {kind!r}" if kind else "<joint> lacks the attribute 'type'"
        reader.add(element, what, hint, "type")
    ends = {}
    for tag in ("parent", "child"):
        found = element.find(tag)
        if found is None:
            reader.add(element, f"joint '{name}' lacks a <{tag}>", f'<{tag} link="…"/>')
        ends[tag] = reader.name(found, "link") if found is not None else ""
    return Joint(name, kind, ends["parent"], ends["child"], element)


def origin_of(joint: Joint, reader: AttributeReader) -> Origin:
    """Frame of the joint's child, at zero, in its parent."""
    return reader.origin(joint.element)


def axis_of(joint: Joint, reader: AttributeReader) -> Vector:
    """Unit vector of the joint's axis in its own frame, of shape (3,)."""
    element = joint.element.find("axis")
    if element is None:
        return np.array([1.0, 0.0, 0.0])  # the default of the URDF's specification
    axis = np.array(reader.vector(element, "xyz", _AXIS, (1.0, 0.0, 0.0)))
    length = float(np.linalg.norm(axis))
    if length < 1e-3:
        reader.add(element, "<axis> xyz has no direction", "three numbers, not all 0", "xyz")
        return np.array([1.0, 0.0, 0.0])
    return axis / length


def stops_of(joint: Joint, reader: AttributeReader) -> Stops:
    """Limits of a revolute or continuous joint."""
    element = joint.element.find("limit")
    if element is None:
        if joint.kind == "revolute":
            hint = "or type='continuous' if it has no stops"
            reader.add(joint.element, f"joint '{joint.name}' lacks a <limit>", hint)
        return Stops(-ONE_TURN, ONE_TURN, 0.0, 0.0)
    velocity = reader.number(element, "velocity", _VELOCITY, 0.0)
    effort = reader.number(element, "effort", _EFFORT, 0.0)
    if joint.kind == "continuous":
        return Stops(-ONE_TURN, ONE_TURN, velocity, effort)
    before = len(reader.problems)
    lower = reader.number(element, "lower", _STOP, 0.0)
    upper = reader.number(element, "upper", _STOP, 0.0)
    if max(-lower, upper) >= _NO_STOP:
        lower = max(lower, -ONE_TURN)
        upper = min(upper, ONE_TURN)
    if len(reader.problems) == before:
        message = f"joint '{joint.name}' turns from {lower:g} to {upper:g} rad"
        if not upper - lower >= MIN_SPAN:
            reader.add(element, message, f"'upper' is at least {MIN_SPAN} above 'lower'")
        elif not (ANGLE.holds(lower) and ANGLE.holds(upper)):
            span = f"{math.radians(lower):.4g} to {math.radians(upper):.4g}"
            hint = f"in rad: {span}, if degrees are meant; type='continuous' if it has no stops"
            reader.add(element, message, hint)
    return Stops(lower, upper, velocity, effort)


# Kinematic tree


@dataclass(frozen=True, eq=False)
class KinematicTree:
    """Links by name; each one but the root is the child of one joint.

    Attributes:
        links: Elements of the links, by name, in the file's order.
        joints: Joints by name, in the file's order.
        above: Joint whose child a link is, by the link's name; the root has none.
        below: Joints whose parent a link is, by the link's name, in the file's order.
    """

    links: Mapping[str, Element]
    joints: Mapping[str, Joint]
    above: Mapping[str, Joint]
    below: Mapping[str, Sequence[Joint]]

    @property
    def root(self) -> str:
        """The link without a parent."""
        return next(link for link in self.links if link not in self.above)

    def subtree(self, link: str) -> Iterator[str]:
        """A link and all its descendants, parents first."""
        pending = [link]
        while pending:
            link = pending.pop()
            yield link
            pending += [joint.child for joint in reversed(self.below.get(link, ()))]

    def chain(self, base: str, tip: str) -> tuple[Joint, ...] | None:
        """The joints from ``base`` down to ``tip``; None if ``tip`` is not a descendant."""
        joints: list[Joint] = []
        while tip != base:
            joint = self.above.get(tip)
            if joint is None:
                return None
            joints.append(joint)
            tip = joint.parent
        return tuple(reversed(joints))


def tree_of(
    links: Mapping[str, Element], joints: Sequence[Joint], reader: AttributeReader
) -> KinematicTree:
    """Build the tree of links and joints; adds a problem wherever they do not form one."""
    above: dict[str, Joint] = {}
    below: dict[str, list[Joint]] = {}
    for joint in joints:
        if not _is_known(joint, links, reader):
            continue
        if joint.child in above:
            first = above[joint.child]
            message = f"link '{joint.child}' is the child of both '{joint.name}' and '{first.name}'"
            hint = f"a link has one parent joint; the other one is on line {first.element.line}"
            reader.add(joint.element, message, hint)
            continue
        above[joint.child] = joint
        below.setdefault(joint.parent, []).append(joint)
    tree = KinematicTree(links, {joint.name: joint for joint in joints}, above, below)
    if not reader.problems:
        _refuse_more_than_one_tree(tree, reader)
    return tree


def _is_known(joint: Joint, links: Mapping[str, Element], reader: AttributeReader) -> bool:
    """Whether both links of a joint exist."""
    known = True
    for tag, name in (("parent", joint.parent), ("child", joint.child)):
        if name not in links:
            known = False
            if name:  # a missing name was reported already
                end = joint.element.find(tag) or joint.element
                hint = suggestion(name, links, "link")
                reader.add(end, f"there is no link '{name}'", hint, "link")
    return known


def _refuse_more_than_one_tree(tree: KinematicTree, reader: AttributeReader) -> None:
    """Report several roots, and links that are not below a root, which form a cycle."""
    roots = [link for link in tree.links if link not in tree.above]
    for root in roots[1:]:
        message = f"links '{roots[0]}' and '{root}' both have no parent"
        reader.add(tree.links[root], message, "a joint is missing: all links must form one tree")
    reached = {link for root in roots for link in tree.subtree(root)}
    in_cycle = [link for link in tree.links if link not in reached]
    if in_cycle:
        names = ", ".join(f"'{link}'" for link in in_cycle[:8])
        more = ", …" if len(in_cycle) > 8 else ""
        joint = tree.above[in_cycle[0]]
        message = f"joint '{joint.name}' closes a cycle of the links {names}{more}"
        reader.add(joint.element, message, "links and joints must form a tree")


# Links of an arm

RESERVED: Final = frozenset({"world", "universe", "root_joint"})
"""Names that MuJoCo and Pinocchio use for objects of their own."""


@dataclass(frozen=True, eq=False)
class Part:
    """One link of an arm, with its joint to the parent.

    Attributes:
        link: Name of the link.
        parent: Name of the parent link; None for the base.
        origin: Frame of the link in its parent, at zero or where its joint is locked.
        joint: Joint of the arm that moves the link; None if it is fixed or locked.
        axis: Unit vector of the joint's axis in the link, of shape (3,).
        stops: Limits of the joint.
        top: Topmost link of the rigid body that the link belongs to: the child of a joint of the
            arm, or the base.
        inertial: Inertia of the link.
        collision: Collision shapes; likewise ``visual``.
    """

    link: str
    parent: str | None
    origin: Origin
    joint: Joint | None
    axis: Vector | None
    stops: Stops | None
    top: str
    inertial: Inertial | None
    collision: tuple[Shape, ...]
    visual: tuple[Shape, ...]

    @property
    def pose(self) -> Pose:
        """Pose of the link in its parent, with its joint at zero."""
        return self.origin.pose


@dataclass(frozen=True, eq=False)
class Selection:
    """The part of a URDF that is an arm.

    Attributes:
        base: Base link; everything that is not its descendant is left out.
        joints: Names of the joints that move; all others are locked.
        locked: Positions of locked joints if not zero, by name: meters of prismatic joints, radians
            of others.
        named: Links that the description refers to, and which therefore cannot be merged.
    """

    base: str
    joints: Sequence[str]
    locked: Mapping[str, float]
    named: frozenset[str]


def parts_of(
    tree: KinematicTree, selection: Selection, mesh_file: MeshFinder, reader: AttributeReader
) -> dict[str, Part]:
    """Read the links of an arm, parents first; the reader collects all problems."""
    parts: dict[str, Part] = {}
    for link in tree.subtree(selection.base):
        element = tree.links[link]
        joint = tree.above.get(link)
        shapes = [shapes_of(element, tag, mesh_file, reader) for tag in ("collision", "visual")]
        part = Part(link, None, Origin(), None, None, None, link, None, *shapes)
        if joint is not None and link != selection.base:
            part = _with_joint(part, joint, parts[joint.parent].top, selection, reader)
        if part.top == selection.base:
            inertial = _inertial_of_static_link(element)
        else:
            inertial = inertial_of(element, reader)
        parts[link] = replace(part, inertial=inertial)
    _refuse_reserved_names(parts, tree, reader)
    return parts


def _refuse_reserved_names(
    parts: Mapping[str, Part], tree: KinematicTree, reader: AttributeReader
) -> None:
    """Report names that MuJoCo's world or PlaCo's frames use already."""
    for link in RESERVED & parts.keys():
        below = [joint.child for joint in tree.below.get(link, ())]
        hint = f"choose a base_link below it: {', '.join(below[:8])}" if below else ""
        reader.add(tree.links[link], f"link '{link}' cannot be a part of an arm", hint)
    base = next(iter(parts))
    for part in parts.values():
        if part.joint is not None and part.joint.name in {*RESERVED, base}:
            message = f"a joint of an arm cannot be called '{part.joint.name}'"
            hint = "the base link is" if part.joint.name == base else ""
            reader.add(part.joint.element, message, hint, "name")


def _inertial_of_static_link(link: Element) -> Inertial | None:
    """Inertia of a link that does not move, None if it is invalid, which does not matter then."""
    reader = AttributeReader()
    inertial = inertial_of(link, reader)
    return None if reader.problems or inertial is None or not is_solid(inertial) else inertial


def _with_joint(
    part: Part, joint: Joint, top: str, selection: Selection, reader: AttributeReader
) -> Part:
    """Attach the part to its parent by a joint, which moves or is locked."""
    origin = origin_of(joint, reader)
    if joint.name not in selection.joints:
        value = selection.locked.get(joint.name, 0.0)
        if value:
            origin = _origin_at(origin, joint, value, axis_of(joint, reader))
        return replace(part, parent=joint.parent, origin=origin, top=top)
    axis = axis_of(joint, reader)
    stops = stops_of(joint, reader)
    return replace(part, parent=joint.parent, origin=origin, joint=joint, axis=axis, stops=stops)


def _origin_at(origin: Origin, joint: Joint, value: float, axis: Vector) -> Origin:
    """Frame of a joint's child in its parent, with the joint at a value."""
    if joint.kind in TURNING:
        turn = np.array((np.cos(value / 2), *(np.sin(value / 2) * axis)))
        return Origin.of(origin.pose @ Pose(np.zeros(3), turn))
    x, y, z = (float(part) for part in origin.pose.apply(axis * value))
    return Origin((x, y, z), origin.rpy)


# Files


MAX_LINKS: Final = 10_000


def read_urdf(path: Path) -> KinematicTree:
    """Read the names and the topology of a URDF.

    Raises:
        DescriptionError: The file is not a URDF; the error has every reason.
    """
    reader = AttributeReader()
    robot = read_xml(path)
    if robot.tag != "robot":
        reader.add(robot, f"is not a URDF: its top element is <{robot.tag}>, not <robot>")
        raise DescriptionError(reader.problems)
    _refuse_templates(robot, reader)
    links = dict(_named(robot, "link", reader))
    elements = dict(_named(robot, "joint", reader))
    joints = [joint_of(element, reader) for element in elements.values()]
    if not links and not reader.problems:
        reader.add(robot, "a robot without links")
    if len(links) > MAX_LINKS:
        reader.add(robot, f"has {len(links)} links; at most {MAX_LINKS} are allowed")
        raise DescriptionError(reader.problems)
    tree = tree_of(links, joints, reader)
    if reader.problems:
        raise DescriptionError(reader.problems)
    return tree


def disabled_pairs(path: Path) -> set[frozenset[str]]:
    """Pairs of links whose contacts an SRDF disables.

    Raises:
        DescriptionError: The file is not an SRDF.
    """
    reader = AttributeReader()
    robot = read_xml(path)
    if robot.tag != "robot":
        reader.add(robot, f"is not an SRDF: its top element is <{robot.tag}>, not <robot>")
    found = robot.all("disable_collisions")
    pairs = {frozenset(reader.name(e, end) for end in ("link1", "link2")) for e in found}
    if reader.problems:
        raise DescriptionError(reader.problems)
    return pairs


def _named(robot: Element, tag: str, reader: AttributeReader) -> Iterator[tuple[str, Element]]:
    """Elements of a tag by name; reports names that are given twice."""
    seen: dict[str, Element] = {}
    for element in robot.all(tag):
        name = reader.name(element)
        if name in seen:
            message = f"there are two {tag}s '{name}'"
            hint = f"the first is on line {seen[name].line}; rename one"
            reader.add(element, message, hint, "name")
        elif name:
            seen[name] = element
            yield name, element


def _refuse_templates(robot: Element, reader: AttributeReader) -> None:
    for element in robot.children:
        if element.tag.startswith("xacro:"):
            message = f"<{element.tag}>: this is a template for a URDF"
            reader.add(element, message, "write the URDF with: xacro ROBOT.xacro > ROBOT.urdf")
            raise DescriptionError(reader.problems)
