"""A robot's page against its URDF: names that lead nowhere, numbers that do not fit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from bt_dualarm.spec.problems import Problem, suggestion
from bt_dualarm.spec.source import Path as Place
from bt_dualarm.world.robots.page import RobotFile
from bt_dualarm.world.urdf.joint import TURNING, Stops
from bt_dualarm.world.urdf.kinematic_tree import KinematicTree

_MOST_SHOWN = 16


def link_problems(file: RobotFile, tree: KinematicTree) -> Iterator[Problem]:
    """Links that the URDF does not have, or that do not hang on the base."""
    entry = file.entry
    links: list[tuple[Place, str, bool]] = [
        (("base_link",), entry.base_link, False),
        (("tool", "link"), entry.tool.link, False),
        *_flange_links(file),
        *(
            (("cameras", name, "link"), camera.link, False)
            for name, camera in entry.cameras.items()
        ),
        *(
            (("exclude", i, j), link, False)
            for i, pair in enumerate(entry.exclude)
            for j, link in enumerate(pair)
        ),
        *((("colors", link), link, True) for link in entry.colors if link != "default"),
    ]
    base = entry.base_link if entry.base_link in tree.links else tree.root
    arm = set(tree.subtree(base))
    for place, link, at_key in links:
        if link not in tree.links:
            hint = suggestion(link, tree.links, "link")
            yield file.problem(place, f"{entry.urdf} has no link '{link}'", hint, key=at_key)
        elif link not in arm:
            message = f"link '{link}' does not hang on base_link, '{base}'"
            hint = "what does not hang on it is left out of the arm"
            yield file.problem(place, message, hint, key=at_key)


def _flange_links(file: RobotFile) -> Iterator[tuple[Place, str, bool]]:
    flange = file.entry.flange
    if flange is not None:
        yield ("flange", "link"), flange.link, False
        for number, link in enumerate(flange.stock):
            yield ("flange", "stock", number), link, False


def joint_problems(file: RobotFile, tree: KinematicTree) -> Iterator[Problem]:
    """Joints that the URDF does not have, that do not move the tool, or are not in order."""
    entry = file.entry
    turning = [name for name, joint in tree.joints.items() if joint.turns]
    chain = tree.chain(entry.base_link, entry.tool.link) or ()
    moving = [joint.name for joint in chain if joint.turns]
    hint = f"from base to tool there are: {_listed(moving)}"
    for number, name in enumerate(entry.joints):
        place = ("joints", number)
        if name not in turning:
            known = suggestion(name, turning, "movable joint")
            yield file.problem(place, f"{entry.urdf} has no movable joint '{name}'", known)
        elif name in entry.joints[:number]:
            yield file.problem(place, f"joint '{name}' is listed twice")
        elif name not in moving:
            yield file.problem(place, f"joint '{name}' does not move the tool", hint)
    listed = [name for name in dict.fromkeys(entry.joints) if name in moving]
    if listed != sorted(listed, key=moving.index):
        yield file.problem(("joints",), "the joints are not in order, base to tip", hint)


def locked_problems(file: RobotFile, tree: KinematicTree) -> Iterator[Problem]:
    """Joints that are to be held somewhere and cannot be."""
    entry = file.entry
    for name in entry.locked:
        joint, place = tree.joints.get(name), ("locked", name)
        if joint is None:
            hint = suggestion(name, tree.joints, "joint")
            yield file.problem(place, f"{entry.urdf} has no joint '{name}'", hint, key=True)
        elif name in entry.joints:
            message = f"joint '{name}' is one of the arm's"
            yield file.problem(place, message, "it is in 'joints': it moves", key=True)
        elif joint.kind not in (*TURNING, "prismatic"):
            message = f"joint '{name}' is {joint.kind}; it cannot be held anywhere else"
            yield file.problem(place, message, "locked are sliding and turning joints", key=True)


def posture_problems(file: RobotFile, stops: Mapping[str, Stops]) -> Iterator[Problem]:
    """Postures without an angle for every joint, or with one outside of its limits."""
    postures, joints = file.entry.postures, file.entry.joints
    if "home" not in postures:
        yield file.problem(("postures",), "the posture 'home' is missing", "an arm starts there")
    for name, angles in postures.items():
        if len(angles) != len(joints):
            message = f"has {len(angles)} angles, the arm {len(joints)} joints"
            yield file.problem(("postures", name), message, _listed(joints))
            continue
        for number, angle in enumerate(np.deg2rad(angles)):
            limits = stops.get(joints[number])
            if limits is not None and not limits.lower <= angle <= limits.upper:
                span = f"{np.degrees(limits.lower):.1f}° to {np.degrees(limits.upper):.1f}°"
                hint = f"{joints[number]}: {span}"
                yield file.problem(("postures", name, number), "is outside the limits", hint)


def _listed(names: list[str] | tuple[str, ...]) -> str:
    more = ", …" if len(names) > _MOST_SHOWN else ""
    return ", ".join(names[:_MOST_SHOWN]) + more if names else "none"
