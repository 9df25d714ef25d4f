"""Whether grippers can hold what the file has them grasp, whatever the pose of the object."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from bt_dualarm.arm.payload import UNKNOWN_KG, cup_measures, jaw_measures
from bt_dualarm.grasping.candidates import CLEAR, cup_grasps, least_width
from bt_dualarm.grasping.grasp import CupMeasures, Load, Solid
from bt_dualarm.robots.gripper import Gripper, load_gripper
from bt_dualarm.sim.object_body import body_of
from bt_dualarm.skill.grasp_search import GRAVITY, LIGHT_KG, TakingPorts
from bt_dualarm.spec.document import REALITY_SETS, ObjectSpec, TreeFile, resolved
from bt_dualarm.spec.node_types import NodeSpec, NodeType, is_dynamic
from bt_dualarm.spec.problems import Problem
from bt_dualarm.spec.shapes import PartSpec


def unfit_grasps(file: TreeFile, kinds: Mapping[str, NodeType]) -> Iterator[Problem]:
    """Yields a warning for every object that an arm is to grasp and whose gripper cannot hold it.

    It is fixed, wider than the fingers open, heavier than the gripper's payload, or has no face on
    which the cup seals. Forces of fingers are not checked: that takes a search for grasps.

    Args:
        file: File without errors.
        kinds: All node types, by name.
    """
    for arm in file.arms.values():
        if arm.gripper is None:
            continue
        gripper = load_gripper(arm.gripper, file.root)
        knows_masses = resolved(file.world.reality, arm.reality, REALITY_SETS).payload.known
        known: dict[tuple[str, object, object, bool], tuple[str, str] | None] = {}
        for node in arm.tree.walk():
            kind = kinds.get(node.kind)
            wanted, part, mass = (node.ports.get(port) for port in ("object", "part", "mass"))
            if kind is None or not grasps(node, kind):
                continue
            if not isinstance(wanted, str) or is_dynamic(part) or is_dynamic(mass):
                continue
            obj = object_of_part(file.objects, wanted, part)
            if obj is None:
                continue
            # What another arm hands over has been weighed.
            weighed = knows_masses or takes_over(node, kind)
            key = (wanted, part, mass, weighed)
            if key not in known:
                known[key] = _complaint(node, gripper, obj, part, knows_masses=weighed)
            complaint = known[key]
            if complaint is not None:
                message = f"{node.kind}: object: {complaint[0]}"
                problem = node.port_problem(("object",), message, complaint[1])
                yield replace(problem, severity="warning")


def grasps(node: NodeSpec, kind: NodeType) -> bool:
    """Whether a node takes one object with the gripper of its arm, if that has one."""
    return issubclass(kind.ports, TakingPorts) or takes_over(node, kind)


def takes_over(node: NodeSpec, kind: NodeType) -> bool:
    """Whether a node takes an object out of another arm's hand; what both carry is shared."""
    action = kind.counterpart
    return kind.takes_hold and action is not None and action.kind != node.kind


def object_of_part(
    objects: Mapping[str, ObjectSpec], wanted: str, part: object
) -> ObjectSpec | None:
    """The named object, or what a joint of it moves with the part; None if it is not declared."""
    obj = objects.get(wanted)
    if obj is None or part is None or part in obj.parts:
        return obj
    hung = (one for one in objects.values() if one.joint is not None and one.joint.owner == wanted)
    return next((one for one in hung if part in one.parts), obj)


def _complaint(
    node: NodeSpec, gripper: Gripper, obj: ObjectSpec, part: object, *, knows_masses: bool
) -> tuple[str, str] | None:
    """Message and hint if a gripper cannot hold an object; None if it may."""
    name = str(node.ports["object"])
    label = name if part is None else f"{part} of {name}"
    if obj.fixed:
        return f"{label} is fixed: no arm can carry it", "leave out `fixed`, or name another object"
    shapes = [(one.shape, one.size) for one in _shapes(obj, part)]
    # What surely fits needs no compiled code, which takes 0.15 s and 70 MB to load.
    if gripper.fingers:
        opening = jaw_measures(gripper, obj.friction).widest_opening
        room = opening - 2.0 * CLEAR
        if not any(_extent(*one) <= room for one in shapes):
            solid = _solid(obj, part)
            width = room if solid is None else least_width(solid)
            if width > room:
                message = f"{label} is {1e3 * width:.0f} mm wide"
                return message, f"the fingers of {gripper.name} open to {1e3 * opening:.0f} mm"
    else:
        cup = cup_measures(gripper, obj.friction)
        wide = 2.0 * cup.radius
        if not any(_flat(*one) > _AMPLE * wide for one in shapes):
            solid = _solid(obj, part)
            if solid is not None and not _seals(cup, solid):
                message = f"{label} has no face on which {gripper.name} seals"
                return message, f"it needs a flat one {1e3 * wide:.0f} mm wide"
    if obj.joint is not None:  # which bears the weight
        return None
    given = node.ports.get("mass")
    mass = float(given) if isinstance(given, (int, float)) else obj.total_mass
    most = f"{gripper.name} may hold {gripper.payload:g} kg"
    if (given is not None or knows_masses) and mass > gripper.payload:
        return f"{label} weighs {mass:g} kg", most
    if given is None and not knows_masses and gripper.payload < UNKNOWN_KG:
        message = f"the mass of {label} is not known in this reality: {UNKNOWN_KG:g} kg is assumed"
        return message, f"{most}: give the leaf `mass`"
    return None


def _shapes(obj: ObjectSpec, part: object) -> Sequence[ObjectSpec | PartSpec]:
    """The named part, or all parts of a compound; of others the object itself."""
    if isinstance(part, str) and part in obj.parts:
        return [obj.parts[part]]
    return list(obj.parts.values()) if obj.parts else [obj]


def _solid(obj: ObjectSpec, part: object) -> Solid | None:
    """Solid of an object, or of a part of it if that is named; None if there is none."""
    body = body_of(obj)
    return body.part(part) if isinstance(part, str) else body.solid


def _extent(shape: str, size: Sequence[float]) -> float:
    """Distance of two opposite sides between which fingers close, m: an upper bound."""
    if shape == "box":
        return min(size)
    if shape in ("cylinder", "prism"):
        return min(2.0 * size[0], size[1])
    if shape in ("sphere", "capsule"):
        return 2.0 * size[0]
    return 0.0 if shape in ("bin", "tray", "tube", "cup", "bowl") else math.inf  # their walls


def _flat(shape: str, size: Sequence[float]) -> float:
    """Width of the widest flat face of a box or cylinder, m; 0 of other shapes."""
    if shape == "box":
        return sorted(size)[1]
    return 2.0 * size[0] if shape == "cylinder" else 0.0


_AMPLE: Final = 1.2
"""Width of a face over that of a cup from which it surely seals."""


def _seals(cup: CupMeasures, solid: Solid) -> bool:
    """Whether a cup seals on some face of a solid."""
    light = Load(LIGHT_KG, np.array((0.0, 0.0, -GRAVITY)), 0.0, np.zeros(3))
    return bool(cup_grasps(solid, cup, light))
