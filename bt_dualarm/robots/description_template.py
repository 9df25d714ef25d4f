"""Templates of description files: a first description of an arm, derived from its URDF.

Limits that a URDF lacks are guessed, and a comment next to each guess asks the author to replace it
with the value from the data sheet. The home posture, and the pairs of links whose contacts are
ignored, come from a survey of random postures.
"""

from __future__ import annotations

import itertools
import json
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import mujoco
import numpy as np

from bt_dualarm.core.errors import CatalogError
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.robots.meshes import mesh_problems
from bt_dualarm.robots.mjspec import TOOL_SITE, robot_spec
from bt_dualarm.robots.robot import (
    Flange,
    JointFriction,
    JointLimits,
    LockedJoint,
    Robot,
    locked_joints,
)
from bt_dualarm.robots.robot_description import RANGES
from bt_dualarm.robots.urdf import Joint, KinematicTree, Selection, read_urdf
from bt_dualarm.robots.urdf_arm import Urdf, mesh_finder, robot_data_dir, turning_joints
from bt_dualarm.robots.urdf_xml import AttributeReader, DescriptionError
from bt_dualarm.spec.yaml_reader import ScalarError, plain_value

# Survey of random postures

_POSTURES: Final = 400
_ALWAYS: Final = 0.95  # above this fraction of postures, a contact is an artifact of the model
_STAND: Final = "stand/"
_STAND_SIZE: Final = (0.11, 0.11, 1.0)  # m, half lengths; as wide as a pedestal
_LIMIT_MARGIN: Final = 0.1  # rad, distance of home from the limits, if the range allows it


@dataclass(frozen=True, eq=False)
class PostureSurvey:
    """Result of a survey of random postures of an arm.

    Attributes:
        always: Pairs of links in contact in nearly all postures.
        home: Home posture, in whole degrees but given in rad, of shape (dof,).
        gravity: Gravity torques at home, N m, of shape (dof,).
        most_gravity: Largest gravity torques of all postures, of the same shape.
        inertia: Diagonal of the mass matrix at home, kg m², of shape (dof,).
    """

    always: tuple[tuple[str, str], ...]
    home: Vector
    gravity: Vector
    most_gravity: Vector
    inertia: Vector


def survey_of(robot: Robot) -> PostureSurvey:
    """Survey random postures of an arm, the same ones in each call.

    Raises:
        CatalogError: The arm collides with itself in every posture.
    """
    arm = _Arm(_on_a_stand(robot).compile(), robot)
    postures = _postures(robot)
    touching = [arm.touching(q) for q in postures]
    most = np.max([np.abs(arm.gravity(q)) for q in postures], axis=0)
    pairs = {pair for some in touching for pair in some if _STAND not in pair}
    always = {p for p in pairs if sum(p in some for some in touching) >= _ALWAYS * len(touching)}
    found = [(q, some - always) for q, some in zip(postures, touching, strict=True)]
    free = [q for q, some in found if not some]
    # An arm that is not meant for a pedestal may collide with it everywhere.
    free = free or [q for q, some in found if all(_STAND in pair for pair in some)]
    if not free:
        often = max(pairs - always, key=lambda p: sum(p in some for some in touching))
        raise CatalogError(
            f"none of {len(postures)} postures is free of self-collisions; most often "
            f"{' and '.join(sorted(often))} collide: list the pair in 'exclude' if that is harmless"
        )
    home = max(free, key=arm.quality)
    named = sorted((min(pair), max(pair)) for pair in always)
    return PostureSurvey(tuple(named), home, arm.gravity(home), most, arm.inertia(home))


def _on_a_stand(robot: Robot) -> mujoco.MjSpec:
    """The arm on a pedestal, whose contacts with the first link are ignored."""
    spec = robot_spec(robot, visuals=False)
    stand = spec.worldbody.add_body(name=_STAND, pos=(0.0, 0.0, -_STAND_SIZE[2]))
    stand.add_geom(name=_STAND, type=mujoco.mjtGeom.mjGEOM_BOX, size=_STAND_SIZE)
    first = spec.joint(robot.joints[0]).parent.name
    spec.add_exclude(bodyname1=_STAND, bodyname2=first)
    return spec


def _postures(robot: Robot) -> list[Vector]:
    """Zero, the middle, and random postures, in whole degrees within the limits."""
    rng = np.random.default_rng(0)
    lower = robot.limits.lower
    upper = robot.limits.upper
    margin = np.minimum(_LIMIT_MARGIN, (upper - lower) / 8)
    low = np.maximum(lower + margin, -np.pi)
    high = np.minimum(upper - margin, np.pi)
    low, high = np.minimum(low, high), np.maximum(low, high)
    drawn = rng.uniform(low, high, (_POSTURES, robot.dof))
    several = [np.clip(np.zeros(robot.dof), low, high), (low + high) / 2, *drawn]
    return [np.clip(np.radians(np.round(np.degrees(q))), lower, upper) for q in several]


class _Arm:
    """One arm alone in MuJoCo."""

    def __init__(self, model: mujoco.MjModel, robot: Robot) -> None:
        self.model = model
        self.robot = robot
        self.data = mujoco.MjData(model)
        self.ids = np.array([int(model.joint(name).qposadr[0]) for name in robot.joints])
        self.site = model.site(TOOL_SITE).id

    def _at(self, q: Vector) -> None:
        self.data.qpos[self.ids] = q
        mujoco.mj_fwdPosition(self.model, self.data)

    def touching(self, q: Vector) -> set[frozenset[str]]:
        """Pairs of links in contact at ``q``."""
        self._at(q)
        bodies = self.model.geom_bodyid
        return {
            frozenset(self.model.body(int(bodies[geom])).name for geom in contact.geom)
            for contact in itertools.islice(self.data.contact, self.data.ncon)
        }

    def gravity(self, q: Vector) -> Vector:
        """Gravity torques at ``q``, N m, of shape (dof,)."""
        self._at(q)
        self.data.qvel[:] = 0.0
        mujoco.mj_fwdVelocity(self.model, self.data)
        torques: Vector = self.data.qfrc_bias[self.ids].copy()
        return torques

    def inertia(self, q: Vector) -> Vector:
        """Diagonal of the mass matrix at ``q``, kg m², of shape (dof,)."""
        self._at(q)
        mass = np.empty((self.model.nv, self.model.nv))
        mujoco.mj_fullM(self.model, self.data, mass)
        diagonal: Vector = np.diag(mass)[self.ids].copy()
        return diagonal

    def quality(self, q: Vector) -> float:
        """Score of a posture: far from singularities and limits, with little gravity torque."""
        self._at(q)
        jacobian = np.empty((6, self.model.nv))
        mujoco.mj_jacSite(self.model, self.data, jacobian[:3], jacobian[3:], self.site)
        values = np.linalg.svd(jacobian[:, self.ids], compute_uv=False)
        limits = self.robot.limits
        margin = np.minimum(q - limits.lower, limits.upper - q) / (limits.upper - limits.lower)
        load = np.abs(self.gravity(q)) / limits.effort
        reserve = max(0.01, 1.0 - float(load.max()))
        # The ratio of the singular values is the inverse condition number of the Jacobian.
        return float(values[-1] / values[0] * min(margin.min(), 0.15) * reserve)


# Template

GUESSED_VELOCITY: Final = 1.0
"""Velocity limit in rad/s of joints without a usable one in the URDF: slow for any arm."""

_MAX_VELOCITY: Final = 10.0  # rad/s; URDFs with larger limits are wrong
_MAX_ACCELERATION: Final = 10.0  # rad/s²
_RISE_S: Final = 0.05  # time to full acceleration, which determines the jerk limit
_EFFORT_FACTOR: Final = 3.0  # guessed effort over what gravity and an acceleration need


@dataclass(frozen=True, eq=False)
class DescriptionTemplate:
    """Content of the template of a description.

    Attributes:
        locked: Positions of locked joints that cannot be at zero: meters, or degrees.
        acceleration: Limits in rad/s², of shape (dof,); likewise ``jerk``, rad/s³.
        velocity: Limits in rad/s; None if those of the URDF are usable.
        effort: Limits in N m, of the same shape.
        home: Joint angles in degrees, of shape (dof,).
        exclude: Pairs of links that are in contact in nearly every posture.
        weak: Joints whose effort limits hardly hold the arm at home.
        stock: Links of the robot's own gripper; empty if it has none.
        flange_link: Link on which it is mounted.
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
    stock: tuple[str, ...]
    flange_link: str


def template_of(urdf: Path, folder: Path, base: str, tool: str) -> DescriptionTemplate:
    """Create the template of an arm from its URDF.

    Args:
        urdf: File of the URDF.
        folder: Folder of the description, below which meshes may be.
        base: Base link.
        tool: Link that carries the tool.

    Raises:
        DescriptionError: The URDF cannot be used; it carries all problems.
        CatalogError: There is no joint between the links, or no collision-free posture.
    """
    tree = read_urdf(urdf)
    joints = turning_joints(tree, base, tool)
    if not joints:
        raise CatalogError(f"there is no revolute joint between {base!r} and {tool!r}")
    locked = _locked(tree, base, joints)
    at = {name: np.radians(one.at) if one.turns else one.at for name, one in locked.items()}
    arm = _read(tree, Selection(base, joints, at, frozenset({base, tool})), urdf, folder)
    velocity, effort = (
        np.array([getattr(arm.stops[joint], what) for joint in joints])
        for what in ("velocity", "effort")
    )
    survey = survey_of(_robot(arm, base, tool, joints, effort))
    flange_link, stock = _stock_gripper(tree, tool)
    velocity_limit = _velocity(velocity)
    effort_limit = _effort(effort, survey)
    torque = np.where(effort_limit > 0, effort_limit, 1.0)
    possible = (torque - np.abs(survey.gravity)) / survey.inertia
    acceleration = _rounded(np.clip(possible / 2, 0.1, _MAX_ACCELERATION))
    return DescriptionTemplate(
        base_link=base,
        tool_link=tool,
        joints=joints,
        locked={name: joint.at for name, joint in locked.items()},
        acceleration=acceleration,
        jerk=_rounded(acceleration / _RISE_S),
        velocity=None if (velocity_limit == velocity).all() else velocity_limit,
        effort=None if (effort_limit == effort).all() else effort_limit,
        home=np.degrees(survey.home),
        exclude=survey.always,
        weak=tuple(name for name, most in zip(joints, possible, strict=True) if most < 0.2),
        stock=stock,
        flange_link=flange_link,
    )


def _stock_gripper(tree: KinematicTree, tool: str) -> tuple[str, tuple[str, ...]]:
    """The link that carries the robot's own gripper, and the gripper's links; none without fingers.

    Fingers are what moves below the tool's link. If they are mounted on that itself, it is their
    palm, provided that it is fixed to the arm; otherwise the palms are further down.
    """

    def moves(joint: Joint) -> bool:
        return any(tree.above[link].kind != "fixed" for link in tree.subtree(joint.child))

    moving = [joint for joint in tree.below.get(tool, ()) if moves(joint)]
    above = tree.above[tool]
    if above.kind == "fixed" and any(joint.kind != "fixed" for joint in moving):
        return above.parent, (tool,)
    return tool, tuple(joint.child for joint in moving)


def _read(tree: KinematicTree, selection: Selection, urdf: Path, folder: Path) -> Urdf:
    reader = AttributeReader()
    finder = mesh_finder(urdf, folder, robot_data_dir().parent)
    arm = Urdf.read(tree, selection, finder, reader)
    problems = [*reader.problems, *mesh_problems(arm)]
    if problems:
        raise DescriptionError(problems)
    return arm


def _locked(tree: KinematicTree, base: str, joints: tuple[str, ...]) -> dict[str, LockedJoint]:
    """Locked joints that cannot be at zero, at the limit next to it."""
    return {
        name: replace(joint, at=joint.lower if joint.lower > 0 else joint.upper)
        for name, joint in locked_joints(tree, base, joints, {}).items()
        if not joint.lower <= 0 <= joint.upper
    }


def _robot(arm: Urdf, base: str, tool: str, joints: tuple[str, ...], effort: Vector) -> Robot:
    """The arm with the URDF's position and effort limits, and placeholders for the others."""
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
    known = (given >= RANGES["velocity"].least) & (given <= _MAX_VELOCITY)
    return np.where(known, given, np.where(given > _MAX_VELOCITY, _MAX_VELOCITY, GUESSED_VELOCITY))


def _effort(given: Vector, survey: PostureSurvey) -> Vector:
    """The URDF's efforts, or multiples of the torques for gravity and 1 rad/s²."""
    guess = _rounded(_EFFORT_FACTOR * (survey.most_gravity + survey.inertia))
    known = np.array([RANGES["effort"].holds(effort) for effort in given])
    return np.where(known, given, np.maximum(guess, 10 * RANGES["effort"].least))


def _rounded(values: Vector) -> Vector:
    """Values rounded down to two significant digits, of shape (dof,)."""
    unit = 10.0 ** (np.floor(np.log10(np.maximum(values, 1e-9))) - 1)
    rounded: Vector = np.round(np.floor(values / unit) * unit, 9)
    return rounded


# Text

_PLAIN: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_./-]*", re.ASCII)

_SOURCES: Final = {
    "velocity": "Guessed by bt-robot where the URDF gives no usable value; see the data sheet",
    "effort": "Guessed by bt-robot, three times the torque of gravity; see the data sheet",
    "acceleration": "Guessed by bt-robot, half of what efforts allow at home; see the data sheet",
    "jerk": "Guessed by bt-robot for full acceleration within 50 ms; see the data sheet",
}


def template_text(draft: DescriptionTemplate, title: str, urdf: str, srdf: str | None) -> str:
    """YAML text of the template, a valid description that the author has to edit.

    Args:
        draft: Content.
        title: Display name.
        urdf: Path of the URDF as the description refers to it; likewise ``srdf``.
        srdf: SRDF, if there is one.
    """
    return "\n".join(_lines(draft, title, urdf, srdf)) + "\n"


def _lines(draft: DescriptionTemplate, title: str, urdf: str, srdf: str | None) -> Iterator[str]:
    yield "# Template by bt-robot. Replace the guessed values by those of the data sheet."
    yield f"title: {_text(title)}"
    yield f"urdf: {_text(urdf)}"
    if srdf is not None:
        yield f"srdf: {_text(srdf)}"
    yield f"base_link: {_text(draft.base_link)}"
    yield f"tool: {{link: {_text(draft.tool_link)}}}   # its z axis must point out of the tool"
    if draft.stock:
        yield f"flange: {{link: {_text(draft.flange_link)}, stock: [{_list(draft.stock)}]}}"
        yield "# A gripper replaces what `stock` names. The flange's z axis must point out, too."
    yield f"joints: [{_list(draft.joints)}]"
    if draft.locked:
        pairs = (f"{_text(name)}: {_number(value)}" for name, value in draft.locked.items())
        yield f"locked: {{{', '.join(pairs)}}}   # these cannot be at zero"
    yield "limits:   # rad/s, rad/s², rad/s³, N m"
    for what in ("velocity", "effort", "acceleration", "jerk"):
        yield from _limit(what, getattr(draft, what))
    if draft.weak:
        yield f"# The effort limits hardly hold the arm at home: {', '.join(draft.weak)}."
    yield "postures:   # degrees"
    yield f"  home: [{', '.join(map(_number, draft.home))}]"
    if draft.exclude:
        yield "exclude:   # in contact in nearly every posture, because of how they are modeled"
        yield from (f"  - [{_list(pair)}]" for pair in draft.exclude)


def _limit(what: str, values: Vector | None) -> Iterator[str]:
    if values is None:
        return
    same = bool((values == values[0]).all())
    shown = _number(values[0]) if same else f"[{', '.join(map(_number, values))}]"
    yield f"  {what}:"
    yield f"    value: {shown}"
    yield f"    source: {_SOURCES[what]}"


def _list(names: Iterable[str]) -> str:
    return ", ".join(map(_text, names))


def _number(value: float) -> str:
    return np.format_float_positional(round(float(value), 6), trim="-")


def _text(text: str) -> str:
    """A YAML string, in quotes if it needs them."""
    try:
        plain = _PLAIN.fullmatch(text) is not None and isinstance(plain_value(text), str)
    except ScalarError:
        plain = False
    return text if plain else json.dumps(text, ensure_ascii=False)
