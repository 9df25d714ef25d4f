"""A whole URDF: its links and joints as a tree, or everything that is wrong with that."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

from bt_dualarm.world.urdf.attributes import Complaints
from bt_dualarm.world.urdf.joint import joint_of
from bt_dualarm.world.urdf.kinematic_tree import KinematicTree, tree_of
from bt_dualarm.world.urdf.xml_source import DescriptionError, Element, read_xml

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
            hint = f"the first is in line {seen[name].line}; call one differently"
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
