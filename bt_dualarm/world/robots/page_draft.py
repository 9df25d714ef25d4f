"""A first page for a robot, measured on its URDF: joints, limits, a home posture free of contacts.

What a URDF does not know is guessed, and the page says so beside each number: its author is to put
the data sheet's there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from bt_dualarm.errors import CatalogueError
from bt_dualarm.pose import Pose, Vector
from bt_dualarm.world.robots.example_robot_data import robot_data_dir
from bt_dualarm.world.robots.friction import JointFriction
from bt_dualarm.world.robots.joint_limits import RANGES
from bt_dualarm.world.robots.mesh_check import mesh_problems
from bt_dualarm.world.robots.posture_search import PostureSurvey, survey_of
from bt_dualarm.world.robots.robot import Flange, JointLimits, Robot
from bt_dualarm.world.robots.urdf import Urdf
from bt_dualarm.world.urdf.arm_chains import turning_joints
from bt_dualarm.world.urdf.attributes import Complaints
from bt_dualarm.world.urdf.description import read_urdf
from bt_dualarm.world.urdf.joint import TURNING, stops_of
from bt_dualarm.world.urdf.kinematic_tree import KinematicTree
from bt_dualarm.world.urdf.mesh_path import mesh_finder
from bt_dualarm.world.urdf.part import Selection
from bt_dualarm.world.urdf.xml_source import DescriptionError

GUESSED_VELOCITY: Final = 1.0
"""rad/s, of joints whose URDF says nothing of use: slow for any arm."""

_FASTEST: Final = 10.0  # rad/s; no joint of an arm turns faster, whatever a URDF says
_HIGHEST_ACCELERATION: Final = 10.0  # rad/s²
_RISE: Final = 0.05  # s from rest to full acceleration: the jerk
_EFFORT_ROOM: Final = 3.0  # times what gravity asks for


@dataclass(frozen=True, eq=False)
class PageDraft:
    """What a first page says.

    Attributes:
        locked: Where joints are locked that cannot be at zero: metres, or degrees.
        acceleration: Limits in rad/s², of shape (dof,); likewise ``jerk``, rad/s³.
        velocity: Limits in rad/s; None if those of the URDF do.
        effort: Limits in N m; likewise.
        home: Joint angles in degrees, of shape (dof,).
        exclude: Pairs of links that always touch.
        weak: Joints whose efforts do not hold the arm at home.
    """

    base_link: str
    tool_link: str
    joints: tuple[str, ...]
    locked: Mapping[str, float]
    acceleration: Vector
    jerk: Vector
    velocity: Vector | None
    effort: Vector | None
    home: Vector
    exclude: tuple[tuple[str, str], ...]
    weak: tuple[str, ...]


def draft_of(urdf: Path, folder: Path, base: str, tool: str) -> PageDraft:
    """Measure an arm on its URDF.

    Args:
        urdf: File of the URDF.
        folder: Folder of the page, below which meshes may lie.
        base: Link that is to stand still.
        tool: Link that carries the tool.

    Raises:
        DescriptionError: The URDF cannot be used; it carries every reason.
        CatalogueError: The two links have no joint between them, or no posture is free.
    """
    tree = read_urdf(urdf)
    joints = turning_joints(tree, base, tool)
    if not joints:
        raise CatalogueError(f"no joint that turns lies between {base!r} and {tool!r}")
    locked = _locked(tree, base, joints)
    arm = _read(tree, Selection(base, joints, locked, frozenset({base, tool})), urdf, folder)
    velocity, effort = (
        np.array([getattr(arm.stops[joint], what) for joint in joints])
        for what in ("velocity", "effort")
    )
    survey = survey_of(_robot(arm, base, tool, joints, effort))
    slow, strong = _velocity(velocity), _effort(effort, survey)
    torque = np.where(strong > 0, strong, 1.0)
    room = (torque - np.abs(survey.gravity)) / survey.inertia
    acceleration = _rounded(np.clip(room / 2, 0.1, _HIGHEST_ACCELERATION))
    return PageDraft(
        base_link=base,
        tool_link=tool,
        joints=joints,
        locked={name: _shown(tree, name, value) for name, value in locked.items()},
        acceleration=acceleration,
        jerk=_rounded(acceleration / _RISE),
        velocity=None if (slow == velocity).all() else slow,
        effort=None if (strong == effort).all() else strong,
        home=np.degrees(survey.home),
        exclude=survey.always,
        weak=tuple(name for name, some in zip(joints, room, strict=True) if some < 0.2),
    )


def _read(tree: KinematicTree, selection: Selection, urdf: Path, folder: Path) -> Urdf:
    complaints = Complaints()
    finder = mesh_finder(urdf, folder, robot_data_dir().parent)
    arm = Urdf.read(tree, selection, finder, complaints)
    problems = [*complaints.problems, *mesh_problems(arm)]
    if problems:
        raise DescriptionError(problems)
    return arm


def _locked(tree: KinematicTree, base: str, joints: tuple[str, ...]) -> dict[str, float]:
    """Joints that cannot stand at zero, where they stand instead: rad."""
    found = {}
    for link in tree.subtree(base):
        joint = tree.above.get(link)
        if link == base or joint is None or joint.kind != "revolute" or joint.name in joints:
            continue
        complaints = Complaints()
        stops = stops_of(joint, complaints)
        if not complaints.problems and not stops.lower <= 0 <= stops.upper:
            found[joint.name] = stops.lower if stops.lower > 0 else stops.upper
    return found


def _shown(tree: KinematicTree, name: str, value: float) -> float:
    return float(np.degrees(value)) if tree.joints[name].kind in TURNING else value


def _robot(arm: Urdf, base: str, tool: str, joints: tuple[str, ...], effort: Vector) -> Robot:
    """The arm with limits that say nothing but where its joints stop and what they bear."""
    effort = np.where(effort > RANGES["effort"].least, effort, RANGES["effort"].most)
    ones = np.ones(len(joints))
    stops = [arm.stops[joint] for joint in joints]
    lower, upper = (np.array([getattr(s, side) for s in stops]) for side in ("lower", "upper"))
    return Robot(
        name="draft", title="draft", model=arm, base_link=base, tool_link=tool,
        tool=Pose.identity(), tool_shape=None, joints=joints, postures={}, cameras={}, colors={},
        flange=Flange(tool, Pose.identity()),
        limits=JointLimits(lower, upper, ones, ones, ones, effort), payload=None,
        exclusions=frozenset(),
        friction=JointFriction.none(len(joints)),
        rotor_inertia=np.zeros(len(joints)),
    )  # fmt: skip


def _velocity(given: Vector) -> Vector:
    known = (given >= RANGES["velocity"].least) & (given <= _FASTEST)
    return np.where(known, given, np.where(given > _FASTEST, _FASTEST, GUESSED_VELOCITY))


def _effort(given: Vector, survey: PostureSurvey) -> Vector:
    """The URDF's, or some times what gravity asks for and an acceleration of 1 rad/s²."""
    guess = _rounded(_EFFORT_ROOM * (survey.most_gravity + survey.inertia))
    known = np.array([RANGES["effort"].holds(effort) for effort in given])
    return np.where(known, given, np.maximum(guess, 10 * RANGES["effort"].least))


def _rounded(values: Vector) -> Vector:
    """Two digits, downwards, of shape (dof,)."""
    unit = 10.0 ** (np.floor(np.log10(np.maximum(values, 1e-9))) - 1)
    rounded: Vector = np.round(np.floor(values / unit) * unit, 9)
    return rounded
