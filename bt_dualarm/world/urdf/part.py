"""The links that an arm consists of: what hangs on its base, read as far as the arm needs it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from bt_dualarm.pose import Pose, Vector
from bt_dualarm.world.urdf.attributes import Complaints, Origin
from bt_dualarm.world.urdf.inertia import is_solid
from bt_dualarm.world.urdf.joint import TURNING, Joint, Stops, axis_of, origin_of, stops_of
from bt_dualarm.world.urdf.kinematic_tree import KinematicTree
from bt_dualarm.world.urdf.link import Inertial, MeshFinder, Shape, inertial_of, shapes_of
from bt_dualarm.world.urdf.xml_source import Element

TAKEN: Final = frozenset({"world", "universe", "root_joint"})
"""What MuJoCo and Pinocchio call things of their own."""


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
        locked: Where joints are locked if not at zero, by name: metres of a sliding joint, radians
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
        element, joint = tree.links[link], tree.above.get(link)
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
    axis, stops = axis_of(joint, complaints), stops_of(joint, complaints)
    return replace(part, parent=joint.parent, origin=origin, joint=joint, axis=axis, stops=stops)


def _moved(origin: Origin, joint: Joint, value: float, axis: Vector) -> Origin:
    """The frame of a joint's child where the joint stands at a value."""
    if joint.kind in TURNING:
        turn = np.array((np.cos(value / 2), *(np.sin(value / 2) * axis)))
        return Origin.of(origin.pose @ Pose(np.zeros(3), turn))
    x, y, z = (float(part) for part in origin.pose.apply(axis * value))
    return Origin((x, y, z), origin.rpy)
