"""What a robot's page and its URDF say together, or everything that is wrong with the two."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bt_dualarm.spec.problems import Problem
from bt_dualarm.world.robots import page_check
from bt_dualarm.world.robots.example_robot_data import robot_data_dir
from bt_dualarm.world.robots.friction import JointFriction
from bt_dualarm.world.robots.friction_check import friction_of
from bt_dualarm.world.robots.joint_limits import limits_of
from bt_dualarm.world.robots.mesh_check import mesh_problems
from bt_dualarm.world.robots.page import RobotFile
from bt_dualarm.world.robots.page_path import file_below
from bt_dualarm.world.robots.robot import JointLimits
from bt_dualarm.world.robots.urdf import Urdf
from bt_dualarm.world.urdf.attributes import Complaints
from bt_dualarm.world.urdf.description import disabled_pairs, read_urdf
from bt_dualarm.world.urdf.joint import TURNING
from bt_dualarm.world.urdf.kinematic_tree import KinematicTree
from bt_dualarm.world.urdf.mesh_path import mesh_finder
from bt_dualarm.world.urdf.part import Selection
from bt_dualarm.world.urdf.xml_source import DescriptionError


@dataclass(frozen=True, eq=False)
class ArmDescription:
    """An arm as its page and its URDF describe it.

    Attributes:
        exclusions: Pairs of links whose contacts do not count.
    """

    urdf: Urdf
    limits: JointLimits
    friction: JointFriction
    exclusions: frozenset[frozenset[str]]


def description_of(file: RobotFile) -> ArmDescription:
    """Read the URDF that a page names, and check the two against one another.

    Raises:
        DescriptionError: They do not describe an arm; it carries every reason.
    """
    urdf, srdf = _files(file)
    tree = read_urdf(urdf)
    problems = [
        *page_check.link_problems(file, tree),
        *page_check.joint_problems(file, tree),
        *page_check.locked_problems(file, tree),
    ]
    if file.entry.base_link not in tree.links:  # what hangs on it nobody knows
        raise DescriptionError(problems)
    pairs = _disabled(srdf, problems)
    selection = _selection(file, tree, pairs)
    finder = mesh_finder(urdf, file.path.parent, robot_data_dir().parent)
    complaints = Complaints()
    arm = Urdf.read(tree, selection, finder, complaints)
    problems += complaints.problems
    problems += mesh_problems(arm)
    problems += page_check.posture_problems(file, arm.stops)
    limits = limits_of(file, arm.stops, problems)
    friction = friction_of(file, limits.effort, problems)
    if problems:
        raise DescriptionError(problems)
    return ArmDescription(arm, limits, friction, _known(pairs | _given(file), arm))


def _disabled(srdf: Path | None, problems: list[Problem]) -> set[frozenset[str]]:
    """Pairs of links whose contacts the SRDF disables."""
    try:
        return disabled_pairs(srdf) if srdf is not None else set()
    except DescriptionError as error:
        problems += error.problems
        return set()


def _files(file: RobotFile) -> tuple[Path, Path | None]:
    """The URDF, and the SRDF if there is one: beside the page, or in example-robot-data."""
    paths: dict[str, Path] = {}
    problems = []
    for key, name in (("urdf", file.entry.urdf), ("srdf", file.entry.srdf)):
        path = None if name is None else _description_file(file, name)
        if path is not None:
            paths[key] = path
        elif name is not None:
            hint = f"neither beside this nor in {robot_data_dir()}"
            problems.append(file.problem((key,), f"there is no file {name!r}", hint))
    if problems:
        raise DescriptionError(problems)
    return paths["urdf"], paths.get("srdf")


def _description_file(file: RobotFile, name: str) -> Path | None:
    found = (file_below(folder, name) for folder in (file.path.parent, robot_data_dir()))
    return next((path for path in found if path is not None), None)


def _selection(file: RobotFile, tree: KinematicTree, pairs: set[frozenset[str]]) -> Selection:
    entry = file.entry
    named = {entry.base_link, entry.tool.link, *entry.colors}
    if entry.flange is not None:
        named |= {entry.flange.link, *entry.flange.stock}
    named |= {camera.link for camera in entry.cameras.values()}
    named |= {link for pair in pairs | _given(file) for link in pair}
    locked = {
        name: np.radians(value) if tree.joints[name].kind in TURNING else value
        for name, value in entry.locked.items()
        if name in tree.joints
    }
    return Selection(entry.base_link, entry.joints, locked, frozenset(named))


def _given(file: RobotFile) -> set[frozenset[str]]:
    return {frozenset(pair) for pair in file.entry.exclude}


def _known(pairs: set[frozenset[str]], arm: Urdf) -> frozenset[frozenset[str]]:
    """Those of the arm's own links; an SRDF may be of a whole robot."""
    return frozenset(pair for pair in pairs if pair <= set(arm.links))
