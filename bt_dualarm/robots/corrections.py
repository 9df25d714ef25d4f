"""Corrections that a robot's description makes to its URDF.

A URDF has the nominal values of one model. A description may replace the origins of joints (the
calibration of one arm, or another model of the same build), inertias of links and position limits
of joints, and add shapes. `corrected` writes them into the elements of the URDF before anything
else reads these, so that there is still one source of kinematics, inertia and shapes for all.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Set
from dataclasses import replace
from typing import Final, TypeVar

import numpy as np

from bt_dualarm.robots.robot import BodyEntry, OriginEntry, PositionEntry, RobotFile
from bt_dualarm.robots.urdf import Inertial, KinematicTree, inertial_of, stops_of
from bt_dualarm.robots.urdf_xml import ANGLE, AttributeReader, Element, Origin
from bt_dualarm.spec.node_types import counted
from bt_dualarm.spec.problems import Problem, suggestion

_ROUNDING: Final = 1e-4  # rad; data sheets round 2π to 6.2832

Correction = TypeVar("Correction")


def corrected(file: RobotFile, tree: KinematicTree, problems: list[Problem]) -> KinematicTree:
    """The URDF with the corrections of a description; unchanged if there are none.

    Args:
        file: Description of the robot.
        tree: Links and joints of its URDF; they have the description's ``base_link``.
        problems: List to which problems are appended.
    """
    base = file.entry.base_link
    links = dict(tree.links)
    joints = dict(tree.joints)
    below = set(tree.subtree(base))
    corrections = file.entry.corrections
    if corrections is not None:
        moving = {name for name, joint in joints.items() if joint.child in below - {base}}
        for name, origin in _of_arm(file, "joints", corrections.joints, joints, moving, problems):
            element = _with_origin(file, joints[name].element, name, origin)
            joints[name] = replace(joints[name], element=element)
        # Where a URDF has no shapes for contacts, those for images are used instead.
        has_contacts = any(links[link].find("collision") for link in below - {base})
        tags = ("collision", "visual") if has_contacts else ("visual",)
        for name, body in _of_arm(file, "links", corrections.links, links, below, problems):
            links[name] = _with_shapes(
                file, _with_inertia(file, links[name], name, body, problems), name, body, tags
            )
    position = file.entry.limits.position
    if position is not None:
        for number, name in _ranges(file, tree, position, problems):
            element = _with_range(file, joints[name].element, position, number)
            # A continuous joint has limits now.
            joints[name] = replace(joints[name], element=element, kind="revolute")
    return KinematicTree(
        links,
        joints,
        {link: joints[joint.name] for link, joint in tree.above.items()},
        {link: [joints[joint.name] for joint in some] for link, some in tree.below.items()},
    )


def _of_arm(
    file: RobotFile,
    what: str,
    given: Mapping[str, Correction],
    known: Iterable[str],
    arm: Set[str],
    problems: list[Problem],
) -> Iterator[tuple[str, Correction]]:
    """Corrections of ``joints`` or ``links`` of the arm by name; others are problems."""
    kind = what.removesuffix("s")
    for name, correction in given.items():
        place = ("corrections", what, name)
        if name in arm:
            yield name, correction
        elif name in known:
            message = f"{kind} '{name}' is not below base_link, '{file.entry.base_link}'"
            hint = "what is not below it is left out of the arm"
            problems.append(file.problem(place, message, hint, key=True))
        else:
            message = f"{file.entry.urdf} has no {kind} '{name}'"
            problems.append(file.problem(place, message, suggestion(name, known, kind), key=True))


def _with_origin(file: RobotFile, joint: Element, name: str, origin: OriginEntry) -> Element:
    """A joint with another origin; what the correction leaves out stays."""
    found = joint.find("origin")
    attributes = {} if found is None else dict(found.attributes)
    if origin.xyz is not None:
        attributes["xyz"] = _numbers(origin.xyz)
    if origin.rpy is not None:
        attributes["rpy"] = _numbers(np.radians(origin.rpy))
    return _with_child(joint, file.element(("corrections", "joints", name), "origin", attributes))


def _with_inertia(
    file: RobotFile, link: Element, name: str, body: BodyEntry, problems: list[Problem]
) -> Element:
    """A link with another mass, center of mass or inertia; what the correction leaves out stays."""
    if body.mass is None and body.center is None and body.inertia is None:
        return link
    place = ("corrections", "links", name)
    reader = AttributeReader()
    urdf = inertial_of(link, reader)
    if body.mass is None or body.inertia is None:
        if reader.problems:
            return link  # its own problems are reported where it is read
        if urdf is None:
            message = f"{file.entry.urdf} gives link '{name}' no mass"
            hint = "add mass in kg, and inertia: ixx, iyy, izz, ixy, ixz, iyz in kg m²"
            problems.append(file.problem(place, message, hint))
            return link
    if urdf is None or reader.problems:
        urdf = Inertial(1.0, Origin(), (0.0,) * 6)
    mass = urdf.mass if body.mass is None else body.mass
    center = urdf.origin.xyz if body.center is None else body.center
    turn = urdf.origin.rpy
    moments = tuple(mass / urdf.mass * moment for moment in urdf.moments)
    if body.inertia is not None:
        moments = body.inertia
        turn = (0.0, 0.0, 0.0)
    names = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    inertia = {name: repr(float(moment)) for name, moment in zip(names, moments, strict=True)}
    inertial = (
        file.element(place, "origin", {"xyz": _numbers(center), "rpy": _numbers(turn)}),
        file.element(place, "mass", {"value": repr(float(mass))}),
        file.element(place, "inertia", inertia),
    )
    return _with_child(link, file.element(place, "inertial", {}, inertial))


def _with_shapes(
    file: RobotFile, link: Element, name: str, body: BodyEntry, tags: tuple[str, ...]
) -> Element:
    """A link with further shapes, for contacts, images or both."""
    added = []
    for number, shape in enumerate(body.shapes):
        place = ("corrections", "links", name, "shapes", number)
        size = {
            "box": {"size": _numbers(shape.size)},
            "cylinder": {"radius": repr(shape.size[0]), "length": repr(shape.size[-1])},
            "sphere": {"radius": repr(shape.size[0])},
        }[shape.shape]
        geometry = file.element(place, "geometry", {}, [file.element(place, shape.shape, size)])
        turn = _numbers(np.radians(shape.rpy))
        origin = file.element(place, "origin", {"xyz": _numbers(shape.xyz), "rpy": turn})
        added += [file.element(place, tag, {}, [origin, geometry]) for tag in tags]
    return replace(link, children=[*link.children, *added])


def _ranges(
    file: RobotFile, tree: KinematicTree, position: PositionEntry, problems: list[Problem]
) -> Iterator[tuple[int, str]]:
    """Joints, by number and name, whose position limits the description gives soundly."""
    joints = file.entry.joints
    sound = True
    for side in ("lower", "upper"):
        values = getattr(position, side)
        if len(values) != len(joints):
            message = (
                f"has {counted(len(values), 'value')}, the arm {counted(len(joints), 'joint')}"
            )
            problems.append(file.problem(("limits", "position", side), message))
            sound = False
    for number, name in enumerate(joints if sound else ()):
        joint = tree.joints.get(name)
        if joint is None or not joint.turns:
            continue  # reported as a joint that the arm cannot have
        reader = AttributeReader()
        stops = stops_of(joint, reader)
        outside = position.lower[number] < stops.lower - _ROUNDING or (
            position.upper[number] > stops.upper + _ROUNDING
        )
        if outside and not position.widens and not reader.problems:
            message = (
                f"joint '{name}' turns from {stops.lower:g} to {stops.upper:g} rad in the URDF"
            )
            side = "lower" if position.lower[number] < stops.lower - _ROUNDING else "upper"
            hint = ANGLE.conversion(getattr(position, side)[number])
            hint = hint or "add widens: true to the limit if its source allows more"
            problems.append(file.problem(("limits", "position", side, number), message, hint))
        yield number, name


def _with_range(file: RobotFile, joint: Element, position: PositionEntry, number: int) -> Element:
    found = joint.find("limit")
    attributes = {} if found is None else dict(found.attributes)
    attributes["lower"] = repr(float(position.lower[number]))
    attributes["upper"] = repr(float(position.upper[number]))
    place = ("limits", "position", "upper", number)
    return _with_child(joint, file.element(place, "limit", attributes))


def _with_child(parent: Element, child: Element) -> Element:
    """The element with a child in place of those of the same tag."""
    others = [other for other in parent.children if other.tag != child.tag]
    return replace(parent, children=[*others, child])


def _numbers(values: Iterable[float]) -> str:
    return " ".join(repr(float(value)) for value in values)
