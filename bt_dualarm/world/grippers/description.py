"""What a gripper's page says, alone or on top of a URDF, or everything that is wrong with it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from bt_dualarm.pose import Pose, Vector
from bt_dualarm.spec.problems import Problem, suggestion
from bt_dualarm.spec.source import Path as Place
from bt_dualarm.world.grippers.gripper import (
    Cup,
    Finger,
    Gripper,
    RigidPart,
    Solid,
    Span,
    Tactile,
)
from bt_dualarm.world.grippers.gripper_entry import FingersEntry, GripperFile
from bt_dualarm.world.grippers.parts import part_of, part_of_link
from bt_dualarm.world.robots.example_robot_data import robot_data_dir
from bt_dualarm.world.robots.mesh_check import mesh_problems
from bt_dualarm.world.robots.page_path import file_below
from bt_dualarm.world.robots.urdf import Urdf
from bt_dualarm.world.urdf.attributes import Complaints
from bt_dualarm.world.urdf.description import read_urdf
from bt_dualarm.world.urdf.joint import axis_of
from bt_dualarm.world.urdf.kinematic_tree import KinematicTree
from bt_dualarm.world.urdf.mesh_path import mesh_finder
from bt_dualarm.world.urdf.part import Selection
from bt_dualarm.world.urdf.xml_source import DescriptionError

_NONE: Final = Span(0.0, 0.0)
_OPPOSITE: Final = Pose.from_rpy((0.0, 0.0, 0.0), (0.0, 0.0, np.pi))
_ALONG: Final = 1.0 - 1e-6


@dataclass(frozen=True, eq=False)
class _Described:
    """The links of a URDF that a gripper consists of, by name, and how its fingers open."""

    parts: Mapping[str, RigidPart]
    poses: Mapping[str, Pose]
    axes: Mapping[str, Vector]


def gripper_of(file: GripperFile) -> Gripper:
    """The gripper of a page.

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
    cup, speed, felt = entry.cup, entry.speed, entry.tactile
    return Gripper(
        name=file.path.stem,
        title=entry.title,
        mount=entry.mount.pose,
        tool=entry.tool.pose,
        stroke=entry.stroke.value if entry.stroke else 0.0,
        force=Span(*entry.force.value),
        speed=Span(*speed.value) if speed else _NONE,
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
    """What does not go together on the page."""
    entry, fingers = file.entry, file.entry.fingers
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
    pad = Solid("box", entry.pad.size, Pose.from_rpy(entry.pad.xyz, (0.0, 0.0, 0.0)))
    if entry.part is not None:
        part, place = part_of(entry.part), entry.place.pose
        for pose in (place, place @ _OPPOSITE):
            yield Finger(part, pose, pose.rotation_matrix[:, 1].copy(), pad)
    if entry.links is not None and described is not None:
        for link in entry.links:
            pose, axis = described.poses[link], described.axes[link]
            turned = pose.rotation_matrix.T @ axis  # the way in which it opens, in the finger
            facing = Pose.identity() if turned[1] > 0 else _OPPOSITE
            own = Solid("box", pad.size, facing @ pad.pose)
            yield Finger(_without(described.parts[link], own), pose, axis, own)


def _without(part: RigidPart, pad: Solid) -> RigidPart:
    """The part without the shapes in which the pad's middle lies: the pad stands for them."""
    kept = tuple(solid for solid in part.collision if not _holds(solid, pad.pose.position))
    return RigidPart(part.mass, part.center, part.inertia, kept, part.visual)


def _holds(solid: Solid, point: Vector) -> bool:
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
