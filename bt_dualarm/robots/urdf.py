"""URDF files: links and joints as a checked tree, or every problem with its line."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.robots.urdf_xml import (
    Complaints,
    DescriptionError,
    Element,
    Origin,
    Range,
    read_xml,
)
from bt_dualarm.spec.problems import nearest, suggestion

MASS: Final = Range(0.0, 10_000.0, "kg")
_MOMENT: Final = Range(-1e6, 1e6, "kg m²")
_SIZE: Final = Range(0.0, 1000.0, "m", above=True)
_SCALE: Final = Range(-1e4, 1e4)
_ROUNDING: Final = 1e-6  # share of the largest moment by which a moment may be below zero
_MOMENTS: Final = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")

MeshFinder = Callable[[str], Path]
"""From the name of a mesh in a URDF to its file; raises ValueError with the reason if it cannot."""


@dataclass(frozen=True)
class Inertial:
    """Mass (kg), center of mass with the axes of the moments, and ixx, iyy, izz, ixy, ixz, iyz."""

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
        element: Element of the URDF that says so.
    """

    kind: str
    size: tuple[float, ...]
    pose: Pose
    mesh: Path | None
    element: Element


_ANYTHING: Final = Inertial(1.0, Origin(), (1.0, 1.0, 1.0, 0.0, 0.0, 0.0))
"""What a link weighs of which that was refused already."""


def inertial_of(link: Element, complaints: Complaints) -> Inertial | None:
    """What a link weighs; None if it weighs nothing, anything sound after a complaint."""
    element = link.find("inertial")
    if element is None:
        return None
    mass = element.find("mass")
    inertia = element.find("inertia")
    for tag, found in (("mass", mass), ("inertia", inertia)):
        if found is None:
            complaints.add(element, f"<inertial> lacks a <{tag}>")
    if mass is None or inertia is None:
        return _ANYTHING
    before = len(complaints.problems)
    kilograms = complaints.number(mass, "value", MASS)
    zero = dict.fromkeys(_MOMENTS[3:], 0.0)
    xx, yy, zz, xy, xz, yz = (
        complaints.number(inertia, name, _MOMENT, zero.get(name)) for name in _MOMENTS
    )
    inertial = Inertial(kilograms, complaints.origin(element), (xx, yy, zz, xy, xz, yz))
    principal = np.linalg.eigvalsh(inertial.tensor)
    if principal[0] < -_ROUNDING * abs(principal[2]):
        shown = ", ".join(f"{moment:.3g}" for moment in principal)
        hint = f"no body has negative moments; its principal ones are {shown} kg m²"
        complaints.add(inertia, "<inertia> is that of no body", hint)
    sound = inertial if kilograms > 0 else None
    return _ANYTHING if len(complaints.problems) > before else sound


def shapes_of(
    link: Element, tag: str, mesh_file: MeshFinder, complaints: Complaints
) -> tuple[Shape, ...]:
    """The shapes of a link; ``tag`` is ``"visual"`` or ``"collision"``."""
    found = (_shape(element, mesh_file, complaints) for element in link.all(tag))
    return tuple(shape for shape in found if shape is not None)


def _shape(element: Element, mesh_file: MeshFinder, complaints: Complaints) -> Shape | None:
    geometry = element.find("geometry")
    if geometry is None or len(geometry.children) != 1:
        what = "lacks a <geometry>" if geometry is None else "needs one shape in its <geometry>"
        complaints.add(element, f"<{element.tag}> {what}", f"one of {', '.join(_SIZES)} or mesh")
        return None
    shape = geometry.children[0]
    pose = complaints.origin(element).pose
    if shape.tag == "mesh":
        return _mesh(shape, pose, mesh_file, complaints)
    if shape.tag not in _SIZES:
        hint = f"one of {', '.join(_SIZES)} or mesh"
        complaints.add(shape, f"shape <{shape.tag}> is not understood", hint)
        return None
    return Shape(shape.tag, _SIZES[shape.tag](shape, complaints), pose, None, shape)


def _box(shape: Element, complaints: Complaints) -> tuple[float, ...]:
    return complaints.vector(shape, "size", _SIZE)


def _cylinder(shape: Element, complaints: Complaints) -> tuple[float, ...]:
    return complaints.number(shape, "radius", _SIZE), complaints.number(shape, "length", _SIZE)


def _sphere(shape: Element, complaints: Complaints) -> tuple[float, ...]:
    return (complaints.number(shape, "radius", _SIZE),)


_SIZES: Final = {"box": _box, "cylinder": _cylinder, "sphere": _sphere}


def _mesh(
    shape: Element, pose: Pose, mesh_file: MeshFinder, complaints: Complaints
) -> Shape | None:
    scale = complaints.vector(shape, "scale", _SCALE, (1.0, 1.0, 1.0))
    if 0.0 in scale and "scale" in shape.attributes:
        complaints.add(shape, "<mesh> scale: a mesh that is scaled by 0 is flat", "", "scale")
    if "filename" not in shape.attributes:
        complaints.add(shape, "<mesh> lacks the attribute 'filename'")
        return None
    try:
        mesh = mesh_file(shape.attributes["filename"])
    except ValueError as error:
        message, _, hint = str(error).partition("; ")
        complaints.add(shape, message, hint, "filename")
        return None
    return Shape("mesh", scale, pose, mesh, shape)


# Inertia of links that form one rigid body


LEAST_MASS: Final = 1e-6
"""kg; what a joint moves weighs more, or its acceleration has no meaning."""

LEAST_MOMENT: Final = 1e-12
"""kg m²; likewise: a ball of 1 mg that is 3 mm wide."""

_RELATIVE: Final = 1e-9  # of the largest moment: less is rounding


def is_solid(inertial: Inertial) -> bool:
    """Whether it resists a turn about every axis: MuJoCo wants no less of a body."""
    moments = np.linalg.eigvalsh(inertial.tensor)
    return bool(
        inertial.mass >= LEAST_MASS and moments[0] > max(LEAST_MOMENT, _RELATIVE * moments[2])
    )


def combined(parts: Sequence[tuple[Pose, Inertial]]) -> Inertial | None:
    """The inertia of several bodies that hold together.

    Args:
        parts: Pose of each body's link in the frame of the result, and its inertia.

    Returns:
        Inertia about the common center of mass, along the axes of that frame (parallel-axis
        theorem); None for bodies that weigh nothing.
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
    """Inertia of a point of 1 kg at a position of shape (3,), of shape (3, 3)."""
    return float(away @ away) * np.eye(3) - np.outer(away, away)


TURNING: Final = ("revolute", "continuous")
KINDS: Final = (*TURNING, "prismatic", "fixed", "floating", "planar")
ONE_TURN: Final = 2 * math.pi
"""How far a joint without stops turns either way, rad."""

LEAST_SPAN: Final = 0.05
"""What a joint of an arm turns at least, rad: planners keep a little away from both ends."""

_STOP: Final = Range(-math.inf, math.inf, "rad")
_NO_STOP: Final = 1000.0  # rad; what a URDF writes for a joint that turns on and on
_VELOCITY: Final = Range(0.0, 1e5, "rad/s")
_EFFORT: Final = Range(0.0, 1e7, "N m")
_AXIS: Final = Range(-1e6, 1e6)


@dataclass(frozen=True, eq=False)
class Joint:
    """What hangs on what, as far as every joint of a file says.

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
    """Limits of a joint: rad, rad/s, N m; zero where the URDF gives no velocity or effort."""

    lower: float
    upper: float
    velocity: float
    effort: float


def joint_of(element: Element, complaints: Complaints) -> Joint:
    """What hangs on what; empty names where that is not said."""
    name = complaints.name(element)
    kind = element.attributes.get("type", "")
    if kind not in KINDS:
        near = nearest(kind, KINDS)
        hint = f"did you mean '{near}'?" if near else f"one of {', '.join(KINDS)}"
        what = f"there is no joint type {kind!r}" if kind else "<joint> lacks the attribute 'type'"
        complaints.add(element, what, hint, "type")
    ends = {}
    for tag in ("parent", "child"):
        found = element.find(tag)
        if found is None:
            complaints.add(element, f"joint '{name}' lacks a <{tag}>", f'<{tag} link="…"/>')
        ends[tag] = complaints.name(found, "link") if found is not None else ""
    return Joint(name, kind, ends["parent"], ends["child"], element)


def origin_of(joint: Joint, complaints: Complaints) -> Origin:
    """The frame of the joint's child, at zero, in its parent's."""
    return complaints.origin(joint.element)


def axis_of(joint: Joint, complaints: Complaints) -> Vector:
    """Direction that it turns about or slides along in its own frame, of shape (3,), length 1."""
    element = joint.element.find("axis")
    if element is None:
        return np.array([1.0, 0.0, 0.0])  # the default of the URDF's specification
    axis = np.array(complaints.vector(element, "xyz", _AXIS, (1.0, 0.0, 0.0)))
    length = float(np.linalg.norm(axis))
    if length < 1e-3:
        complaints.add(element, "<axis> xyz has no direction", "three numbers, not all 0", "xyz")
        return np.array([1.0, 0.0, 0.0])
    return axis / length


def stops_of(joint: Joint, complaints: Complaints) -> Stops:
    """How far and fast a turning joint goes."""
    element = joint.element.find("limit")
    if element is None:
        if joint.kind == "revolute":
            hint = "or type='continuous' if it has no stops"
            complaints.add(joint.element, f"joint '{joint.name}' lacks a <limit>", hint)
        return Stops(-ONE_TURN, ONE_TURN, 0.0, 0.0)
    velocity = complaints.number(element, "velocity", _VELOCITY, 0.0)
    effort = complaints.number(element, "effort", _EFFORT, 0.0)
    if joint.kind == "continuous":
        return Stops(-ONE_TURN, ONE_TURN, velocity, effort)
    before = len(complaints.problems)
    lower = complaints.number(element, "lower", _STOP, 0.0)
    upper = complaints.number(element, "upper", _STOP, 0.0)
    if max(-lower, upper) >= _NO_STOP:
        lower = max(lower, -ONE_TURN)
        upper = min(upper, ONE_TURN)
    if len(complaints.problems) == before and not upper - lower >= LEAST_SPAN:
        message = f"joint '{joint.name}' turns from {lower:g} to {upper:g} rad"
        complaints.add(element, message, f"'upper' is at least {LEAST_SPAN} above 'lower'")
    return Stops(lower, upper, velocity, effort)


# Kinematic tree


@dataclass(frozen=True, eq=False)
class KinematicTree:
    """Links by name, each but the root on one joint.

    Attributes:
        links: Elements of the links, by name, in the file's order.
        joints: Joints by name, in the file's order.
        above: Joint that a link hangs on, by the link's name; none for the root.
        below: Joints that hang on a link, by the link's name, in the file's order.
    """

    links: Mapping[str, Element]
    joints: Mapping[str, Joint]
    above: Mapping[str, Joint]
    below: Mapping[str, Sequence[Joint]]

    @property
    def root(self) -> str:
        """The link that hangs on none."""
        return next(link for link in self.links if link not in self.above)

    def subtree(self, link: str) -> Iterator[str]:
        """A link and all that hang on it, each after the one that it hangs on."""
        waiting = [link]
        while waiting:
            link = waiting.pop()
            yield link
            waiting += [joint.child for joint in reversed(self.below.get(link, ()))]

    def chain(self, base: str, tip: str) -> tuple[Joint, ...] | None:
        """The joints from a link down to another; None if the other does not hang on it."""
        joints: list[Joint] = []
        while tip != base:
            joint = self.above.get(tip)
            if joint is None:
                return None
            joints.append(joint)
            tip = joint.parent
        return tuple(reversed(joints))


def tree_of(
    links: Mapping[str, Element], joints: Sequence[Joint], complaints: Complaints
) -> KinematicTree:
    """The tree that joints make of links, with a complaint wherever they make none."""
    above: dict[str, Joint] = {}
    below: dict[str, list[Joint]] = {}
    for joint in joints:
        if not _is_known(joint, links, complaints):
            continue
        if joint.child in above:
            first = above[joint.child]
            message = f"link '{joint.child}' hangs on '{joint.name}' and on '{first.name}'"
            hint = f"a link hangs on one joint; the other is in line {first.element.line}"
            complaints.add(joint.element, message, hint)
            continue
        above[joint.child] = joint
        below.setdefault(joint.parent, []).append(joint)
    tree = KinematicTree(links, {joint.name: joint for joint in joints}, above, below)
    if not complaints.problems:
        _refuse_more_than_one_tree(tree, complaints)
    return tree


def _is_known(joint: Joint, links: Mapping[str, Element], complaints: Complaints) -> bool:
    """Whether both links of a joint are there."""
    known = True
    for tag, name in (("parent", joint.parent), ("child", joint.child)):
        if name not in links:
            known = False
            if name:  # without a name there was a complaint already
                end = joint.element.find(tag) or joint.element
                hint = suggestion(name, links, "link")
                complaints.add(end, f"there is no link '{name}'", hint, "link")
    return known


def _refuse_more_than_one_tree(tree: KinematicTree, complaints: Complaints) -> None:
    """One root, and every link below it: what is not hangs on itself."""
    roots = [link for link in tree.links if link not in tree.above]
    for root in roots[1:]:
        message = f"links '{roots[0]}' and '{root}' both hang on nothing"
        complaints.add(tree.links[root], message, "a joint is missing: all links are one tree")
    reached = {link for root in roots for link in tree.subtree(root)}
    circling = [link for link in tree.links if link not in reached]
    if circling:
        names = ", ".join(f"'{link}'" for link in circling[:8])
        more = ", …" if len(circling) > 8 else ""
        joint = tree.above[circling[0]]
        message = f"joint '{joint.name}' closes a circle: {names}{more} hang on one another"
        complaints.add(joint.element, message, "links and joints are a tree")


# Links of an arm: the subtree of its base, as far as the arm needs it


TAKEN: Final = frozenset({"world", "universe", "root_joint"})
"""What MuJoCo and Pinocchio call objects of their own."""


@dataclass(frozen=True, eq=False)
class Part:
    """One link of an arm, and how it hangs on the one before it.

    Attributes:
        link: Name of the link.
        parent: Name of the link that it hangs on; None for the base.
        origin: Frame of the link in its parent's, at zero or where its joint is locked.
        joint: Joint of the arm that moves it; None if it is fixed or locked.
        axis: Direction that the joint turns about, of shape (3,), in the link.
        stops: Limits of the joint.
        top: Link of the rigid body that it belongs to which hangs on a joint of the arm, or base.
        inertial: What it weighs.
        collision: Shapes that touch; likewise ``visual``, those that are seen.
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
        """The frame of the link in its parent's, where its joint is at zero."""
        return self.origin.pose


@dataclass(frozen=True, eq=False)
class Selection:
    """What of a URDF makes an arm.

    Attributes:
        base: Link that stands still; what does not hang on it is left out.
        joints: Names of the joints that move; all others are locked.
        locked: Where joints are locked if not at zero, by name: meters of a sliding joint, radians
            of a turning one.
        named: Links that somebody calls by name.
    """

    base: str
    joints: Sequence[str]
    locked: Mapping[str, float]
    named: frozenset[str]


def parts_of(
    tree: KinematicTree, selection: Selection, mesh_file: MeshFinder, complaints: Complaints
) -> dict[str, Part]:
    """The links of an arm by name, each after the one that it hangs on, with every complaint."""
    parts: dict[str, Part] = {}
    for link in tree.subtree(selection.base):
        element = tree.links[link]
        joint = tree.above.get(link)
        shapes = [shapes_of(element, tag, mesh_file, complaints) for tag in ("collision", "visual")]
        part = Part(link, None, Origin(), None, None, None, link, None, *shapes)
        if joint is not None and link != selection.base:
            part = _hung(part, joint, parts[joint.parent].top, selection, complaints)
        if part.top == selection.base:
            inertial = _inertial_of_what_stands(element)
        else:
            inertial = inertial_of(element, complaints)
        parts[link] = replace(part, inertial=inertial)
    _refuse_taken_names(parts, tree, complaints)
    return parts


def _refuse_taken_names(
    parts: Mapping[str, Part], tree: KinematicTree, complaints: Complaints
) -> None:
    """Names that MuJoCo's world and PlaCo's frames have already."""
    for link in TAKEN & parts.keys():
        below = [joint.child for joint in tree.below.get(link, ())]
        hint = f"choose a base_link below it: {', '.join(below[:8])}" if below else ""
        complaints.add(tree.links[link], f"link '{link}' cannot be a part of an arm", hint)
    base = next(iter(parts))
    for part in parts.values():
        if part.joint is not None and part.joint.name in {*TAKEN, base}:
            message = f"a joint of an arm cannot be called '{part.joint.name}'"
            hint = "the base link is" if part.joint.name == base else ""
            complaints.add(part.joint.element, message, hint, "name")


def _inertial_of_what_stands(link: Element) -> Inertial | None:
    """What a link weighs if that is sound: what does not move may weigh what it likes."""
    complaints = Complaints()
    inertial = inertial_of(link, complaints)
    return None if complaints.problems or inertial is None or not is_solid(inertial) else inertial


def _hung(part: Part, joint: Joint, top: str, selection: Selection, complaints: Complaints) -> Part:
    """The part on its joint, which is the arm's or locked."""
    origin = origin_of(joint, complaints)
    if joint.name not in selection.joints:
        value = selection.locked.get(joint.name, 0.0)
        if value:
            origin = _moved(origin, joint, value, axis_of(joint, complaints))
        return replace(part, parent=joint.parent, origin=origin, top=top)
    axis = axis_of(joint, complaints)
    stops = stops_of(joint, complaints)
    return replace(part, parent=joint.parent, origin=origin, joint=joint, axis=axis, stops=stops)


def _moved(origin: Origin, joint: Joint, value: float, axis: Vector) -> Origin:
    """The frame of a joint's child where the joint stands at a value."""
    if joint.kind in TURNING:
        turn = np.array((np.cos(value / 2), *(np.sin(value / 2) * axis)))
        return Origin.of(origin.pose @ Pose(np.zeros(3), turn))
    x, y, z = (float(part) for part in origin.pose.apply(axis * value))
    return Origin((x, y, z), origin.rpy)


# Reading a complete URDF


MAX_LINKS: Final = 10_000


def read_urdf(path: Path) -> KinematicTree:
    """Read a URDF as far as everybody needs it: names, and who hangs on whom.

    Masses, shapes and limits are read where they are needed: what an arm has no use for is none of
    its problems.

    Raises:
        DescriptionError: The file is no URDF; it carries every reason.
    """
    complaints = Complaints()
    robot = read_xml(path)
    if robot.tag != "robot":
        complaints.add(robot, f"is no URDF: its top element is <{robot.tag}>, not <robot>")
        raise DescriptionError(complaints.problems)
    _refuse_templates(robot, complaints)
    links = dict(_named(robot, "link", complaints))
    elements = dict(_named(robot, "joint", complaints))
    joints = [joint_of(element, complaints) for element in elements.values()]
    if not links and not complaints.problems:
        complaints.add(robot, "a robot without links")
    if len(links) > MAX_LINKS:
        complaints.add(robot, f"has {len(links)} links; {MAX_LINKS} are the most")
        raise DescriptionError(complaints.problems)
    tree = tree_of(links, joints, complaints)
    if complaints.problems:
        raise DescriptionError(complaints.problems)
    return tree


def disabled_pairs(path: Path) -> set[frozenset[str]]:
    """Pairs of links whose contacts an SRDF disables.

    Raises:
        DescriptionError: The file is no SRDF.
    """
    complaints = Complaints()
    robot = read_xml(path)
    if robot.tag != "robot":
        complaints.add(robot, f"is no SRDF: its top element is <{robot.tag}>, not <robot>")
    found = robot.all("disable_collisions")
    pairs = {frozenset(complaints.name(e, end) for end in ("link1", "link2")) for e in found}
    if complaints.problems:
        raise DescriptionError(complaints.problems)
    return pairs


def _named(robot: Element, tag: str, complaints: Complaints) -> Iterator[tuple[str, Element]]:
    """Elements by name, with a complaint where a name is given twice."""
    seen: dict[str, Element] = {}
    for element in robot.all(tag):
        name = complaints.name(element)
        if name in seen:
            message = f"there are two {tag}s '{name}'"
            hint = f"the first is in line {seen[name].line}; rename one"
            complaints.add(element, message, hint, "name")
        elif name:
            seen[name] = element
            yield name, element


def _refuse_templates(robot: Element, complaints: Complaints) -> None:
    for element in robot.children:
        if element.tag.startswith("xacro:"):
            message = f"<{element.tag}>: this is a template for a URDF"
            complaints.add(element, message, "write the URDF with: xacro ROBOT.xacro > ROBOT.urdf")
            raise DescriptionError(complaints.problems)
