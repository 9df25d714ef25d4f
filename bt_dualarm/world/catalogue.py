"""The robot catalogue: one YAML file an arm, on top of its URDF.

The URDF is the only source of kinematics, inertia, position limits and efforts. The catalogue adds
what a URDF lacks: acceleration and jerk limits, postures, the tool frame, camera mounts.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from bt_dualarm.errors import CatalogueError
from bt_dualarm.pose import Pose, Vector
from bt_dualarm.share import share_dir
from bt_dualarm.spec.document import LimitShares
from bt_dualarm.spec.problems import suggestion
from bt_dualarm.spec.source import Path as Place
from bt_dualarm.world.robot_data import robot_data_dir
from bt_dualarm.world.robot_file import LimitEntry, RobotFile, ToolShape
from bt_dualarm.world.urdf import Urdf


@dataclass(frozen=True, eq=False)
class JointLimits:
    """Limits of an arm's joints, base to tip, each of shape (dof,).

    Units: rad, rad/s, rad/s², rad/s³ and N m.
    """

    lower: Vector
    upper: Vector
    velocity: Vector
    acceleration: Vector
    jerk: Vector
    effort: Vector

    def scaled(self, speed: float) -> JointLimits:
        """Velocity, acceleration and jerk times ``speed``, the share in (0, 1]."""
        return self.derated(LimitShares(velocity=speed, acceleration=speed, jerk=speed))

    def derated(self, shares: LimitShares) -> JointLimits:
        """Velocity, acceleration and jerk times a share of each."""
        return replace(
            self,
            velocity=self.velocity * shares.velocity,
            acceleration=self.acceleration * shares.acceleration,
            jerk=self.jerk * shares.jerk,
        )


@dataclass(frozen=True, eq=False)
class CameraMount:
    """A place for a camera on an arm: its pose in a link (x right, y down, z forward)."""

    link: str
    pose: Pose


@dataclass(frozen=True, eq=False)
class Robot:
    """An arm of the catalogue; lengths in metres, angles in radians.

    Attributes:
        tool: The tool frame in ``tool_link``; its z axis points out of the tool.
        tool_shape: A cylinder that ends in the tool frame, if the URDF has no tool of its own.
        exclusions: Pairs of links whose contacts do not count.
        colors: RGBA of links by name; ``default`` is for all others.
    """

    name: str
    title: str
    model: Urdf
    base_link: str
    tool_link: str
    tool: Pose
    tool_shape: ToolShape | None
    joints: tuple[str, ...]
    limits: JointLimits
    postures: Mapping[str, Vector]
    cameras: Mapping[str, CameraMount]
    exclusions: frozenset[frozenset[str]]
    colors: Mapping[str, tuple[float, float, float, float]]

    @property
    def dof(self) -> int:
        """Number of joints of the arm."""
        return len(self.joints)

    def derated(self, shares: LimitShares) -> Robot:
        """The same arm that keeps to a share of its limits."""
        return replace(self, limits=self.limits.derated(shares))

    @cached_property
    def urdf_text(self) -> str:
        """The kinematic chain with inertias, without any shape."""
        return self.model.kinematic_text


def is_page(name: str) -> bool:
    """Whether a robot is named by the path of its page, and not as the catalogue does."""
    return name.endswith((".yaml", ".yml"))


def robot_names() -> tuple[str, ...]:
    """Names of the arms in the shipped catalogue, sorted."""
    return tuple(sorted(path.stem for path in (share_dir("assets") / "robots").glob("*.yaml")))


def load_robot(name: str, root: Path | None = None) -> Robot:
    """An arm by its name in the catalogue, or by the path of a YAML file below ``root``.

    Raises:
        CatalogueError: No such arm, or its file is wrong; the message names file and entry.
    """
    file = RobotFile(_robot_file(name, root))
    entry = file.entry
    urdf = Urdf.read(_description(file, "urdf", entry.urdf), entry.joints, entry.locked)
    _check_names(file, urdf)
    limits = _limits(file, urdf)
    _check_postures(file, limits)
    exclusions = {frozenset(pair) for pair in entry.exclude}
    if entry.srdf is not None:
        exclusions |= urdf.disabled_pairs(_description(file, "srdf", entry.srdf))
    return Robot(
        name=file.path.stem,
        title=entry.title,
        model=urdf,
        base_link=entry.base_link,
        tool_link=entry.tool.link,
        tool=entry.tool.pose,
        tool_shape=entry.tool.shape,
        joints=entry.joints,
        limits=limits,
        postures={name: np.deg2rad(angles) for name, angles in entry.postures.items()},
        cameras={name: CameraMount(c.link, c.pose) for name, c in entry.cameras.items()},
        exclusions=frozenset(exclusions),
        colors=entry.colors,
    )


def _robot_file(name: str, root: Path | None) -> Path:
    if is_page(name):
        folder = (root or Path.cwd()).resolve()
        path = _file_below(folder, name)
        if path is not None:
            return path
        raise CatalogueError(
            f"there is no robot file {name!r} below {folder}; {_elsewhere(folder, name)}"
        )
    if name in robot_names():
        return share_dir("assets") / "robots" / f"{name}.yaml"
    near = suggestion(name, robot_names(), "robot")
    raise CatalogueError(f"there is no robot {name!r} in the catalogue; {near}")


def _elsewhere(folder: Path, name: str) -> str:
    """A hint for the path of a robot's page that is not there, or not below the folder."""
    path = Path(os.path.normpath(folder / name.replace("\0", "")))
    if not path.is_relative_to(folder):
        return "a robot's page lies beside the tree file or in a folder below it"
    pages = [page.name for page in path.parent.glob("*.yaml") if page != path]
    return suggestion(path.name, pages, "robot file")


def _check_names(file: RobotFile, urdf: Urdf) -> None:
    """Every name of a link or joint must be one of the URDF's."""
    entry = file.entry
    for number, joint in enumerate(entry.joints):
        if joint not in urdf.limits:
            known = suggestion(joint, urdf.movable, "movable joint")
            file.refuse(("joints", number), f"{entry.urdf} has no movable joint {joint!r}", known)
    links: list[tuple[Place, str]] = [
        (("base_link",), entry.base_link),
        (("tool", "link"), entry.tool.link),
        *((("cameras", name, "link"), camera.link) for name, camera in entry.cameras.items()),
        *(
            (("exclude", i, j), link)
            for i, pair in enumerate(entry.exclude)
            for j, link in enumerate(pair)
        ),
        *((("colors", link), link) for link in entry.colors if link != "default"),
    ]
    for place, link in links:
        if link not in urdf.links:
            known = suggestion(link, urdf.links, "link")
            file.refuse(place, f"{entry.urdf} has no link {link!r}", known)


def _limits(file: RobotFile, urdf: Urdf) -> JointLimits:
    """The URDF's limits; the catalogue may tighten velocity and effort, never widen them.

    Where the URDF gives none, or zero, the catalogue's are taken.
    """
    entry = file.entry
    rows = np.array([urdf.limits[joint] for joint in entry.joints])
    lower, upper, velocity, effort = rows.T.copy()
    given = entry.limits
    if given.velocity is not None:
        velocity = _tightened(velocity, _per_joint(file, "velocity", given.velocity))
    if given.effort is not None:
        effort = _tightened(effort, _per_joint(file, "effort", given.effort))
    for what, limit in (("velocity", velocity), ("effort", effort)):
        if not (limit > 0).all():
            file.refuse(("limits",), f"{entry.urdf} gives no {what} for a joint", f"add {what}")
    return JointLimits(
        lower=lower,
        upper=upper,
        velocity=velocity,
        acceleration=_per_joint(file, "acceleration", given.acceleration),
        jerk=_per_joint(file, "jerk", given.jerk),
        effort=effort,
    )


def _tightened(limit: Vector, given: Vector) -> Vector:
    """The smaller of the two where there are two, of shape (dof,)."""
    return np.where(limit > 0, np.minimum(limit, given), given)


def _per_joint(file: RobotFile, what: str, limit: LimitEntry) -> Vector:
    """Of shape (dof,)."""
    dof = len(file.entry.joints)
    if isinstance(limit.value, tuple) and len(limit.value) != dof:
        file.refuse(
            ("limits", what, "value"), f"has {len(limit.value)} values, the arm {dof} joints"
        )
    return np.full(dof, limit.value, dtype=float)


def _check_postures(file: RobotFile, limits: JointLimits) -> None:
    """Every posture has an angle for every joint, within its limits; one is ``home``."""
    postures = file.entry.postures
    if "home" not in postures:
        file.refuse(("postures",), "the posture 'home' is missing", "an arm starts there")
    for name, angles in postures.items():
        dof = len(file.entry.joints)
        if len(angles) != dof:
            file.refuse(("postures", name), f"has {len(angles)} angles, the arm {dof} joints")
        for number, angle in enumerate(np.deg2rad(angles)):
            lower, upper = limits.lower[number], limits.upper[number]
            if not lower <= angle <= upper:
                span = f"{np.degrees(lower):.1f}° to {np.degrees(upper):.1f}°"
                joint = file.entry.joints[number]
                file.refuse(("postures", name, number), "is outside the limits", f"{joint}: {span}")


def _description(file: RobotFile, key: str, name: str) -> Path:
    """A file beside the catalogue file, or one of the example-robot-data package."""
    shipped = robot_data_dir()
    for folder in (file.path.parent, shipped):
        path = _file_below(folder, name)
        if path is not None:
            return path
    return file.refuse(
        (key,), f"there is no file {name!r}", f"neither beside this nor in {shipped}"
    )


def _file_below(folder: Path, name: str) -> Path | None:
    """The file of that name if there is one in the folder, or in one of its own."""
    try:
        path = (folder / name).resolve()
        return path if path.is_file() and path.is_relative_to(folder) else None
    except (OSError, RuntimeError, ValueError):  # a name too long, a loop of symlinks, a NUL
        return None
