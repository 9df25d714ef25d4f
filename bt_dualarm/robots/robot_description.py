"""Robots from description files, with the gripper that an arm carries.

The URDF is the only source of kinematics, inertia, position limits and efforts. The description
adds what a URDF lacks: acceleration and jerk limits, postures, the tool frame, camera mounts; both
are checked against each other. `load_robot` is the catalog. `load_arm` mounts a gripper on a robot:
the result is one kinematic model.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np

from bt_dualarm.core.errors import CatalogError
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.robots.corrections import corrected
from bt_dualarm.robots.gripper import PALM, Gripper, load_gripper, placed, together
from bt_dualarm.robots.meshes import mesh_problems
from bt_dualarm.robots.robot import (
    CameraMount,
    Flange,
    JointFriction,
    JointLimits,
    LimitEntry,
    LockedJoint,
    Robot,
    RobotEntry,
    RobotFile,
    UrdfLimitEntry,
    degrees_within,
    description_path,
    file_below,
    is_description_path,
    locked_joints,
    problems_of,
    shipped_names,
    with_followers,
)
from bt_dualarm.robots.urdf import (
    TURNING,
    Inertial,
    KinematicTree,
    Part,
    Selection,
    Stops,
    disabled_pairs,
    read_urdf,
)
from bt_dualarm.robots.urdf_arm import Urdf, mesh_finder, robot_data_dir
from bt_dualarm.robots.urdf_xml import AttributeReader, DescriptionError, Origin, Range
from bt_dualarm.spec.document import ArmSpec
from bt_dualarm.spec.node_types import counted
from bt_dualarm.spec.problems import Problem, suggestion
from bt_dualarm.spec.yaml_reader import DataPath as Place

# Checks against the URDF

_MAX_LISTED = 16


def link_problems(file: RobotFile, tree: KinematicTree) -> Iterator[Problem]:
    """Report links that the URDF lacks, or that are not descendants of the base."""
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
            message = f"link '{link}' is not a descendant of base_link, '{base}'"
            hint = "links that are not below it are left out of the arm"
            yield file.problem(place, message, hint, key=at_key)


def _flange_links(file: RobotFile) -> Iterator[tuple[Place, str, bool]]:
    flange = file.entry.flange
    if flange is not None:
        yield ("flange", "link"), flange.link, False
        for number, link in enumerate(flange.stock):
            yield ("flange", "stock", number), link, False


def stock_problems(file: RobotFile, tree: KinematicTree) -> Iterator[Problem]:
    """Report links of the stock tool that carry the flange, or that joints of the arm move."""
    flange = file.entry.flange
    if flange is None:
        return
    for number, link in enumerate(flange.stock):
        removed = set(tree.subtree(link))
        moved = [
            name
            for name in file.entry.joints
            if name in tree.joints and tree.joints[name].child in removed
        ]
        message = f"a gripper replaces '{link}' and what is below it: "
        hint = "stock has the links of the robot's own tool; flange names the link before them"
        if moved:
            message += f"joint '{moved[0]}' is part of the arm"
            yield file.problem(("flange", "stock", number), message, hint)
        elif flange.link in removed:
            message += f"it would be mounted on '{flange.link}', which is then gone"
            yield file.problem(("flange", "stock", number), message, hint)


def joint_problems(file: RobotFile, tree: KinematicTree) -> Iterator[Problem]:
    """Report joints that the URDF lacks, that do not move the tool, or are not in order."""
    entry = file.entry
    turning = [name for name, joint in tree.joints.items() if joint.turns]
    kinds = "joints of an arm are revolute or continuous, and mimic no other joint"
    chain = tree.chain(entry.base_link, entry.tool.link) or ()
    moving = [joint.name for joint in chain if joint.turns]
    hint = f"from base to tool there are: {_listed(moving)}"
    for number, name in enumerate(entry.joints):
        place = ("joints", number)
        if name not in tree.joints:
            known = suggestion(name, turning, "joint")
            yield file.problem(place, f"{entry.urdf} has no joint '{name}'", known)
        elif name not in turning:
            joint = tree.joints[name]
            what = f"is {joint.kind}" if joint.kind not in TURNING else "mimics another joint"
            yield file.problem(place, f"joint '{name}' {what}", kinds)
        elif name in entry.joints[:number]:
            yield file.problem(place, f"joint '{name}' is listed twice")
        elif name not in moving:
            yield file.problem(place, f"joint '{name}' does not move the tool", hint)
    listed = [name for name in dict.fromkeys(entry.joints) if name in moving]
    if listed != sorted(listed, key=moving.index):
        yield file.problem(("joints",), "the joints are not in order, base to tip", hint)


def mount_problems(file: RobotFile, tree: KinematicTree) -> Iterator[Problem]:
    """Report a flange or a camera on a link that moves relative to the tool.

    Motions place the tool, and the camera or the gripper with it.
    """
    entry = file.entry

    def moving(link: str) -> list[str] | None:
        chain = tree.chain(entry.base_link, link) if link in tree.links else None
        return None if chain is None else [one.name for one in chain if one.name in entry.joints]

    mounts: list[tuple[Place, str, str]] = [
        (("cameras", name, "link"), f"camera '{name}'", camera.link)
        for name, camera in entry.cameras.items()
    ]
    if entry.flange is not None:
        mounts.append((("flange", "link"), "the flange", entry.flange.link))
    for place, what, link in mounts:
        # A link that is not there is reported elsewhere.
        if None not in (moving(link), moving(entry.tool.link)) and (
            moving(link) != moving(entry.tool.link)
        ):
            message = f"{what} is on '{link}', which moves relative to the tool"
            hint = f"a link is needed that moves with the tool's, '{entry.tool.link}'"
            yield file.problem(place, message, hint)


def locked_problems(file: RobotFile, tree: KinematicTree) -> Iterator[Problem]:
    """Report joints that cannot be locked, or not at the given position."""
    entry = file.entry
    for name in entry.locked:
        joint = tree.joints.get(name)
        place = ("locked", name)
        if joint is None:
            hint = suggestion(name, tree.joints, "joint")
            yield file.problem(place, f"{entry.urdf} has no joint '{name}'", hint, key=True)
        elif name in entry.joints:
            message = f"joint '{name}' is one of the arm's"
            yield file.problem(place, message, "it is in 'joints': it moves", key=True)
        elif joint.kind not in (*TURNING, "prismatic"):
            message = f"joint '{name}' is {joint.kind}; it has no other position"
            yield file.problem(place, message, "prismatic and revolute joints are locked", key=True)
    if entry.base_link not in tree.links:
        return
    for name, held in locked_joints(tree, entry.base_link, entry.joints, entry.locked).items():
        if held.lower <= held.at <= held.upper:
            continue
        message = f"joint '{name}' cannot be at {held.at:g} {held.unit}"
        if name in entry.locked:
            yield file.problem(("locked", name), message, f"its limits are {held.span}")
        else:
            hint = f"its limits are {held.span}: give its position in 'locked'"
            yield file.problem(("joints",), f"{message}, where it is locked", hint)


def posture_problems(file: RobotFile, stops: Mapping[str, Stops]) -> Iterator[Problem]:
    """Report postures with a wrong number of angles, or with angles outside the limits."""
    postures = file.entry.postures
    joints = file.entry.joints
    if "home" not in postures:
        yield file.problem(("postures",), "the posture 'home' is missing", "an arm starts there")
    for name, angles in postures.items():
        if len(angles) != len(joints):
            message = (
                f"has {counted(len(angles), 'angle')}, the arm {counted(len(joints), 'joint')}"
            )
            yield file.problem(("postures", name), message, _listed(joints))
            continue
        for number, angle in enumerate(np.deg2rad(angles)):
            limits = stops.get(joints[number])
            if limits is not None and not limits.lower <= angle <= limits.upper:
                low, high = degrees_within(limits.lower, limits.upper)
                hint = f"{joints[number]}: {low}° to {high}°"
                yield file.problem(("postures", name, number), "is outside the limits", hint)


def _listed(names: list[str] | tuple[str, ...]) -> str:
    more = ", …" if len(names) > _MAX_LISTED else ""
    return ", ".join(names[:_MAX_LISTED]) + more if names else "none"


# Joint limits

RANGES: Final[Mapping[str, Range]] = {
    "velocity": Range(1e-3, 50.0, "rad/s"),
    "acceleration": Range(1e-3, 1e5, "rad/s²"),
    "jerk": Range(1e-2, 1e7, "rad/s³"),
    "effort": Range(1e-4, 1e6, "N m"),
}
"""Plausible limits: no arm exceeds them, and motions within them have a computable length."""


def limits_of(file: RobotFile, stops: Mapping[str, Stops], problems: list[Problem]) -> JointLimits:
    """Combine the limits of URDF and description.

    The description's velocity and effort limits replace those of the URDF; larger ones are a
    problem unless the description says that it widens the limit.

    Args:
        file: Description of the robot.
        stops: Limits of its joints in the URDF.
        problems: List to which problems are appended.
    """
    unknown = Stops(0.0, 0.0, 1.0, 1.0)  # for a joint that has already been reported
    own = [stops.get(joint, unknown) for joint in file.entry.joints]
    given = file.entry.limits
    velocity = np.array([stop.velocity for stop in own])
    effort = np.array([stop.effort for stop in own])
    return JointLimits(
        lower=np.array([stop.lower for stop in own]),
        upper=np.array([stop.upper for stop in own]),
        velocity=_replaced(file, "velocity", given.velocity, velocity, problems),
        acceleration=_per_joint(file, "acceleration", given.acceleration, problems),
        jerk=_per_joint(file, "jerk", given.jerk, problems),
        effort=_replaced(file, "effort", given.effort, effort, problems),
    )


def _replaced(
    file: RobotFile, what: str, entry: UrdfLimitEntry | None, urdf: Vector, problems: list[Problem]
) -> Vector:
    """The limits of the description, otherwise of the URDF, of shape (dof,)."""
    if entry is not None:
        given = _per_joint(file, what, entry, problems)
        rows = zip(file.entry.joints, given, urdf, strict=True)
        for number, (joint, new, old) in enumerate(rows):
            if new > old and RANGES[what].holds(old) and not entry.widens:
                message = f"{what} of joint '{joint}' is {old:g} {RANGES[what].unit} in the URDF"
                hint = "add widens: true to the limit if its source allows more"
                value = ("limits", what, "value")
                place = (*value, number) if isinstance(entry.value, tuple) else value
                problems.append(file.problem(place, message, hint))
                break  # one value may stand for all joints
        return given
    for joint, limit in zip(file.entry.joints, urdf, strict=True):
        if not limit > 0:
            message = f"{file.entry.urdf} gives no {what} for joint '{joint}'"
            problems.append(file.problem(("limits",), message, f"add {what}"))
        elif not RANGES[what].holds(limit):
            message = f"{file.entry.urdf} gives {what} {limit:g} for joint '{joint}'"
            hint = f"add {what}: a limit is {RANGES[what]}"
            if conversion := RANGES[what].conversion(limit):
                hint = f"{hint}; {conversion}"
            problems.append(file.problem(("limits",), message, hint))
    return urdf


def _per_joint(file: RobotFile, what: str, limit: LimitEntry, problems: list[Problem]) -> Vector:
    """The description's limit of each joint, of shape (dof,)."""
    dof = len(file.entry.joints)
    place = ("limits", what, "value")
    values = limit.value if isinstance(limit.value, tuple) else (limit.value,) * dof
    if len(values) != dof:
        message = f"has {counted(len(values), 'value')}, the arm {counted(dof, 'joint')}"
        problems.append(file.problem(place, message))
        return np.ones(dof)
    for number, value in enumerate(values):
        if not RANGES[what].holds(value):
            message = f"{what}: must be {RANGES[what]}, not {value:g}"
            hint = RANGES[what].conversion(value)
            problems.append(file.problem((*place, number), message, hint))
    return np.array(values)


# Joint friction

_OPTIONAL = ("viscous", "static", "rise", "offset")


def friction_of(file: RobotFile, effort: Vector, problems: list[Problem]) -> JointFriction:
    """Joint friction of the description, otherwise typical values by the effort limits.

    Args:
        file: Description of the robot.
        effort: Effort limits of its joints, of shape (dof,), N m.
        problems: List to which problems are appended.
    """
    entry = file.entry.friction
    if entry is None:
        return JointFriction.typical(effort)
    given = {name: getattr(entry, name) for name in ("coulomb", *_OPTIONAL)}
    found: dict[str, Vector] = {}
    for name, values in given.items():
        found[name] = np.zeros_like(effort)
        if values is None:
            continue
        if len(values) != len(effort):
            message = (
                f"has {counted(len(values), 'value')}, the arm {counted(len(effort), 'joint')}"
            )
            problems.append(file.problem(("friction", name), message))
            return JointFriction.typical(effort)
        found[name] = np.array(values)
    if entry.static is None:
        found["static"] = found["coulomb"]
    if (found["static"] < found["coulomb"]).any():
        message = "static friction is less than Coulomb friction"
        problems.append(file.problem(("friction", "static"), message, "it is at least coulomb"))
    speed = np.full_like(effort, entry.stribeck_velocity)
    return JointFriction(stribeck_velocity=speed, **found)  # type: ignore[arg-type]  # no uncertainty among them


# Robots


@dataclass(frozen=True, eq=False)
class ArmDescription:
    """The checked parts of a robot.

    Attributes:
        exclusions: Pairs of links whose contacts are ignored.
        locked: Joints that could move but are locked, by name.
        other_arms: Links of the other arms of the same robot, by the names of their descriptions.
    """

    urdf: Urdf
    limits: JointLimits
    friction: JointFriction
    exclusions: frozenset[frozenset[str]]
    locked: Mapping[str, LockedJoint]
    other_arms: Mapping[str, frozenset[str]]


def description_of(file: RobotFile) -> ArmDescription:
    """Read the URDF of a description, and check the two against each other.

    Raises:
        DescriptionError: They do not describe an arm; it carries all problems.
    """
    urdf, srdf = _files(file)
    tree = read_urdf(urdf)
    problems = [
        *link_problems(file, tree),
        *stock_problems(file, tree),
        *joint_problems(file, tree),
    ]
    if file.entry.base_link not in tree.links:  # nothing else can be checked
        problems += locked_problems(file, tree)
        raise DescriptionError(problems)
    problems += mount_problems(file, tree)
    tree = corrected(file, tree, problems)
    problems += locked_problems(file, tree)
    pairs = _disabled(srdf, problems)
    selection = _selection(file, tree, pairs)
    finder = mesh_finder(urdf, file.path.parent, robot_data_dir().parent)
    reader = AttributeReader()
    arm = Urdf.read(tree, selection, finder, reader)
    problems += reader.problems
    problems += mesh_problems(arm)
    problems += posture_problems(file, arm.stops)
    limits = limits_of(file, arm.stops, problems)
    friction = friction_of(file, limits.effort, problems)
    others = _other_arms(file, tree, arm, problems)
    if problems:
        raise DescriptionError(problems)
    entry = file.entry
    locked = locked_joints(tree, entry.base_link, entry.joints, entry.locked)
    exclusions = _of_arm(pairs | _excluded(file), arm)
    return ArmDescription(arm, limits, friction, exclusions, locked, others)


def _other_arms(
    file: RobotFile, tree: KinematicTree, arm: Urdf, problems: list[Problem]
) -> dict[str, frozenset[str]]:
    """Links of the other arms of the same robot, by the names of their descriptions."""
    entry = file.entry
    found = {}
    for number, name in enumerate(entry.other_arms):
        place = ("other_arms", number)
        try:
            path = description_path("robot", name, file.path.parent)
            other = RobotFile(path).entry
        except CatalogError as error:
            problems.append(file.problem(place, f"'{name}' cannot be used", str(error)))
            continue
        first = tree.joints.get(other.joints[0])
        common = [joint for joint in entry.joints if joint in other.joints]
        if (other.urdf, other.base_link) != (entry.urdf, entry.base_link) or first is None:
            message = f"'{name}' is no arm of this robot"
            hint = f"its URDF and base_link are {other.urdf} and '{other.base_link}'"
            problems.append(file.problem(place, message, hint))
        elif common:
            message = f"'{name}' moves joint '{common[0]}', too"
            problems.append(file.problem(place, message, "arms of a robot have no common joints"))
        else:
            found[path.stem] = frozenset(tree.subtree(first.child)) & frozenset(arm.links)
    return found


def _disabled(srdf: Path | None, problems: list[Problem]) -> set[frozenset[str]]:
    """Pairs of links whose contacts the SRDF disables."""
    try:
        return disabled_pairs(srdf) if srdf is not None else set()
    except DescriptionError as error:
        problems += error.problems
        return set()


def _files(file: RobotFile) -> tuple[Path, Path | None]:
    """Find the URDF, and the SRDF if there is one, next to the description or installed."""
    paths: dict[str, Path] = {}
    problems = []
    for key, name in (("urdf", file.entry.urdf), ("srdf", file.entry.srdf)):
        path = None if name is None else _description_file(file, name)
        if path is not None:
            paths[key] = path
        elif name is not None:
            hint = f"neither next to this file nor in {robot_data_dir()}"
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
    named |= {link for pair in pairs | _excluded(file) for link in pair}
    locked = {
        name: np.radians(value) if tree.joints[name].kind in TURNING else value
        for name, value in entry.locked.items()
        if name in tree.joints
    }
    return Selection(entry.base_link, entry.joints, locked, frozenset(named))


def _excluded(file: RobotFile) -> set[frozenset[str]]:
    return {frozenset(pair) for pair in file.entry.exclude}


def _of_arm(pairs: set[frozenset[str]], arm: Urdf) -> frozenset[frozenset[str]]:
    """Pairs of the arm's own links: an SRDF may describe a whole robot."""
    return frozenset(pair for pair in pairs if pair <= set(arm.links))


# Catalog


def robot_names() -> tuple[str, ...]:
    """Names of the arms in the shipped catalog, sorted."""
    return shipped_names("robot")


def load_robot(
    name: str, root: Path | None = None, locked: Mapping[str, float] | None = None
) -> Robot:
    """Load an arm by its name in the catalog, or by the path of a YAML file below ``root``.

    Args:
        name: Name or path.
        root: Folder that the path is relative to; by default the current one.
        locked: Positions of locked joints that replace those of the description: meters of
            prismatic joints, degrees of revolute ones. Joints that mimic one of them follow it.

    Raises:
        CatalogError: There is no such arm, its file is wrong, or a joint cannot be locked there;
            the message names file and entry.
    """
    path = description_path("robot", name, root)
    robot = _loaded(path, {}, shipped=not is_description_path(name))
    if not locked:
        return robot
    for joint, _, message, hint in problems_of(robot.name, robot.joints, robot.locked, locked):
        raise CatalogError(f"locked: {joint}: {message}; {hint}")
    return _loaded(
        path, with_followers(robot.locked, locked), shipped=not is_description_path(name)
    )


def _loaded(path: Path, locked: Mapping[str, float], *, shipped: bool) -> Robot:
    if not shipped:
        return _read(path, locked)
    state = path.stat()
    return _load_shipped(path, state.st_mtime_ns, state.st_size, tuple(sorted(locked.items())))


@lru_cache(maxsize=64)
def _load_shipped(
    path: Path, _changed: int, _size: int, locked: tuple[tuple[str, float], ...]
) -> Robot:
    """A shipped arm, cached until its description changes; its URDF is part of a package."""
    robot = _read(path, dict(locked))
    for shared in (robot.rotor_inertia, *robot.postures.values(), *vars(robot.limits).values()):
        if isinstance(shared, np.ndarray):
            shared.setflags(write=False)  # all callers share the cached robot
    return robot


def _read(path: Path, locked: Mapping[str, float]) -> Robot:
    file = RobotFile(path)
    file.entry = file.entry.model_copy(update={"locked": {**file.entry.locked, **locked}})
    entry = file.entry
    found = description_of(file)
    return Robot(
        name=file.path.stem,
        title=entry.title,
        model=found.urdf,
        base_link=entry.base_link,
        tool_link=entry.tool.link,
        tool=entry.tool.pose,
        tool_shape=entry.tool.shape,
        flange=flange_of(entry),
        joints=entry.joints,
        limits=found.limits,
        payload=None if entry.payload is None else entry.payload.value,
        friction=found.friction,
        rotor_inertia=np.full(len(entry.joints), entry.rotor_inertia),
        postures={name: np.deg2rad(angles) for name, angles in entry.postures.items()},
        cameras={name: CameraMount(c.link, c.pose) for name, c in entry.cameras.items()},
        exclusions=found.exclusions,
        colors=entry.colors,
        locked=found.locked,
        other_arms=found.other_arms,
    )


def flange_of(entry: RobotEntry) -> Flange:
    """Flange for grippers: as described, otherwise where the tool's shape begins."""
    if entry.flange is not None:
        return Flange(entry.flange.link, entry.flange.pose, entry.flange.stock)
    shape = entry.tool.shape
    tool = entry.tool.pose
    length = 0.0 if shape is None else shape.length
    return Flange(entry.tool.link, tool @ Pose.from_rpy((0, 0, -length), (0, 0, 0)))


COMES_OFF: Final = "joint '{joint}' is one of the robot's own tool, which comes off for {gripper}"
"""Error text for a locked joint of a stock tool that a gripper replaces."""


def load_arm(arm: ArmSpec, root: Path | None = None) -> tuple[Robot, Gripper | None]:
    """Load the robot of an arm of a tree file, with its gripper mounted if it has one.

    Args:
        arm: Part of the tree file about the arm.
        root: Folder in which paths of descriptions begin; by default the current one.

    Returns:
        The robot with its gripper mounted, and the gripper or None.

    Raises:
        CatalogError: There is no such robot or gripper, or its description is wrong.
    """
    robot = load_robot(arm.robot, root, arm.locked)
    if arm.gripper is None:
        return robot, None
    gripper = load_gripper(arm.gripper, root)
    for joint in arm.locked:
        if joint in stock_joints(robot):
            raise CatalogError(f"locked: {COMES_OFF.format(joint=joint, gripper=gripper.name)}")
    return with_gripper(robot, gripper), gripper


def stock_joints(robot: Robot) -> frozenset[str]:
    """Locked joints of the robot's stock tool, which a gripper replaces."""
    removed = _subtrees(robot.model, robot.flange.stock)
    return frozenset(name for name, joint in robot.locked.items() if joint.link in removed)


def with_gripper(robot: Robot, gripper: Gripper) -> Robot:
    """Replace the stock tool of a robot by a gripper.

    In the kinematic and the nominal model the gripper is one rigid link, half open. The remaining
    payload is the robot's payload minus the gripper's mass, or the gripper's own if that is
    smaller.
    """
    flange = robot.flange
    removed = _subtrees(robot.model, flange.stock)
    parts = {link: part for link, part in robot.model.parts.items() if link not in removed}
    parts[PALM] = _palm(parts[flange.link], flange.pose @ gripper.mount, gripper)
    payload = gripper.payload
    if robot.payload is not None:
        payload = min(payload, max(robot.payload - gripper.mass, 0.0))
    return replace(
        robot,
        model=Urdf(parts),
        tool_link=PALM,
        tool=gripper.tool,
        tool_shape=None,
        payload=payload,
        gripper=gripper.name,
        cameras={
            name: _on_remaining_link(robot, mount, removed) for name, mount in robot.cameras.items()
        },
        exclusions=frozenset(pair for pair in robot.exclusions if not pair & removed),
        locked={name: joint for name, joint in robot.locked.items() if joint.link not in removed},
    )


def _subtrees(model: Urdf, links: tuple[str, ...]) -> frozenset[str]:
    """The given links and all their descendants."""
    found = set(links)
    for link, part in model.parts.items():  # parents come before their children
        if part.parent in found:
            found.add(link)
    return frozenset(found)


def _palm(carrier: Part, pose: Pose, gripper: Gripper) -> Part:
    """The gripper as one rigid link, its fingers half open."""
    half = 0.25 * gripper.stroke
    bodies = [placed(Pose.identity(), gripper.palm)]
    for finger in gripper.fingers:
        shifted = finger.pose.shifted(half * finger.axis)
        bodies.append(placed(shifted, finger.part))
    mass, center, tensor = together(bodies)
    x, y, z = (float(part) for part in center)
    xx, yy, zz, xy, xz, yz = (
        float(tensor[pair]) for pair in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    )
    inertial = Inertial(mass, Origin((x, y, z)), (xx, yy, zz, xy, xz, yz))
    return Part(
        link=PALM,
        parent=carrier.link,
        origin=Origin.of(pose),
        joint=None,
        axis=None,
        stops=None,
        top=carrier.top,
        inertial=inertial,
        collision=(),
        visual=(),
    )


def _on_remaining_link(robot: Robot, mount: CameraMount, removed: frozenset[str]) -> CameraMount:
    """The same camera pose, expressed in the nearest ancestor link that is not removed."""
    link = mount.link
    pose = mount.pose
    while link in removed:
        part = robot.model.parts[link]
        link = str(part.parent)
        pose = part.pose @ pose
    return CameraMount(link, pose)
