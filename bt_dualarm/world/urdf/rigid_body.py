"""Links without a joint between them are one rigid body: what it weighs, and fewer links of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from bt_dualarm.pose import Pose
from bt_dualarm.world.urdf.attributes import Complaints, Origin
from bt_dualarm.world.urdf.inertia import LEAST_MASS, combined, is_solid
from bt_dualarm.world.urdf.kinematic_tree import KinematicTree
from bt_dualarm.world.urdf.link import Inertial
from bt_dualarm.world.urdf.part import Part


def with_solid_bodies(
    parts: Mapping[str, Part], tree: KinematicTree, complaints: Complaints
) -> dict[str, Part]:
    """The same parts; what is no solid body by itself is counted to the link on the joint.

    A sensor of 100 g without any size is sound as a part of the hand that carries it, but nothing
    that could move alone. Of what moves, every rigid body must weigh something.
    """
    points: dict[str, list[tuple[Pose, Inertial]]] = {}
    weights: dict[str, list[tuple[Pose, Inertial]]] = {}
    poses: dict[str, Pose] = {}
    found = dict(parts)
    for link, part in parts.items():
        hung = part.top != link and part.parent is not None
        poses[link] = poses[str(part.parent)] @ part.pose if hung else Pose.identity()
        if part.inertial is not None:
            weights.setdefault(part.top, []).append((poses[link], part.inertial))
            if link != part.top and not is_solid(part.inertial):
                points.setdefault(part.top, []).append((poses[link], part.inertial))
                found[link] = replace(part, inertial=None)
    for top, some in points.items():
        found[top] = _loaded(found[top], some)
    for link, part in parts.items():
        if part.joint is not None:
            whole = combined(weights.get(link, []))
            if whole is None or not is_solid(whole):
                _complain(tree, part, whole, complaints)
            elif not any(is_solid(inertial) for _, inertial in weights[link]):
                found[link] = replace(part, inertial=whole)
    return found


def _complain(
    tree: KinematicTree, part: Part, whole: Inertial | None, complaints: Complaints
) -> None:
    joint = "" if part.joint is None else part.joint.name
    element = tree.links[part.link]
    inertial = element.find("inertial")
    if whole is None or whole.mass < LEAST_MASS:
        tag, what = "mass", f"what hangs on joint '{joint}' weighs nothing"
        hint = "give the link an <inertial> with the mass in kg and the inertia in kg m²"
    else:
        tag = "inertia"
        what = f"what hangs on joint '{joint}' weighs {whole.mass:g} kg, but has no inertia"
        hint = "give the link's <inertia> its principal moments in kg m²; none of them is 0"
    complaints.add((inertial and inertial.find(tag)) or inertial or element, what, hint)


def fused(parts: Mapping[str, Part], named: frozenset[str]) -> dict[str, Part]:
    """The same arm with fewer links: one of no shape and no name is a part of the one it hangs on.

    Args:
        parts: Links of the arm, each after the one that it hangs on.
        named: Links that somebody calls by name.
    """
    carriers: dict[str, tuple[str, Pose]] = {}
    loads: dict[str, list[tuple[Pose, Inertial]]] = {}
    kept: dict[str, Part] = {}
    for link, part in parts.items():
        carrier, pose = carriers.get(part.parent or "", (part.parent, None))
        if pose is not None:
            part = replace(part, parent=carrier, origin=Origin.of(pose @ part.pose))
        if part.top == link or part.collision or part.visual or link in named:
            kept[link] = part
            continue
        carriers[link] = (str(part.parent), part.pose)
        if part.inertial is not None:
            loads.setdefault(str(part.parent), []).append((part.pose, part.inertial))
    return kept | {link: _loaded(kept[link], some) for link, some in loads.items()}


def _loaded(part: Part, loads: list[tuple[Pose, Inertial]]) -> Part:
    """The part with what is counted to it, each at its pose in the part's frame."""
    own = [] if part.inertial is None else [(Pose.identity(), part.inertial)]
    return replace(part, inertial=combined([*own, *loads]))
