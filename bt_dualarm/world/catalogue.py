"""The robot catalogue: one YAML file an arm, on top of its URDF.

The URDF is the only source of kinematics, inertia, position limits and efforts. The catalogue adds
what a URDF lacks: acceleration and jerk limits, postures, the tool frame, camera mounts.
"""

from __future__ import annotations

import difflib
import importlib.metadata
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from bt_dualarm.errors import CatalogueError
from bt_dualarm.pose import Pose, Vector
from bt_dualarm.share import share_dir
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
        return replace(
            self,
            velocity=self.velocity * speed,
            acceleration=self.acceleration * speed,
            jerk=self.jerk * speed,
        )


@dataclass(frozen=True, eq=False)
class CameraMount:
    """A place for a camera on an arm: its pose in a link (x right, y down, z forward)."""

    link: str
    pose: Pose


@dataclass(frozen=True)
class ToolShape:
    """A cylinder along the tool's z axis: what the arm touches objects with. Metres."""

    radius: float
    length: float


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

    @cached_property
    def urdf_text(self) -> str:
        """The kinematic chain with inertias, without any shape."""
        return self.model.kinematic_text


class _Entry(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class _Frame(_Entry):
    link: str
    xyz: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def pose(self) -> Pose:
        return Pose.from_rpy(self.xyz, tuple(np.deg2rad(self.rpy)))


class _CameraEntry(_Entry):
    link: str
    xyz: tuple[float, float, float]
    forward: tuple[float, float, float]
    up: tuple[float, float, float]

    @property
    def pose(self) -> Pose:
        forward = np.asarray(self.forward) / np.linalg.norm(self.forward)
        right = np.cross(forward, self.up)
        right /= np.linalg.norm(right)
        matrix = np.eye(4)
        matrix[:3, :3] = np.column_stack((right, np.cross(forward, right), forward))
        matrix[:3, 3] = self.xyz
        return Pose.from_matrix(matrix)


class _ToolEntry(_Frame):
    radius: float | None = Field(default=None, gt=0, le=0.5)
    length: float | None = Field(default=None, gt=0, le=1.0)

    @property
    def shape(self) -> ToolShape | None:
        if self.radius is None or self.length is None:
            return None
        return ToolShape(self.radius, self.length)


class _LimitEntry(_Entry):
    value: float | tuple[float, ...]
    source: str = Field(min_length=8)


class _Limits(_Entry):
    acceleration: _LimitEntry
    jerk: _LimitEntry
    velocity: _LimitEntry | None = None
    effort: _LimitEntry | None = None


class _RobotEntry(_Entry):
    title: str
    urdf: str
    srdf: str | None = None
    base_link: str
    tool: _ToolEntry
    joints: tuple[str, ...] = Field(min_length=1)
    locked: dict[str, float] = {}
    limits: _Limits
    postures: dict[str, tuple[float, ...]]
    cameras: dict[str, _CameraEntry] = {}
    exclude: tuple[tuple[str, str], ...] = ()
    colors: dict[str, tuple[float, float, float, float]] = {}

    @model_validator(mode="after")
    def _postures_fit(self) -> _RobotEntry:
        if "home" not in self.postures:
            raise ValueError("postures: 'home' is missing")
        for name, angles in self.postures.items():
            if len(angles) != len(self.joints):
                raise ValueError(
                    f"postures: {name!r} has {len(angles)} angles, "
                    f"the arm has {len(self.joints)} joints"
                )
        return self


def robot_names() -> tuple[str, ...]:
    """Names of the arms in the shipped catalogue, sorted."""
    return tuple(sorted(path.stem for path in (share_dir("assets") / "robots").glob("*.yaml")))


def load_robot(name: str, root: Path | None = None) -> Robot:
    """An arm by its name in the catalogue, or by the path of a YAML file below ``root``.

    Raises:
        CatalogueError: No such arm, or its file is wrong; the message names file and entry.
    """
    path = _robot_file(name, root)
    try:
        entry = _RobotEntry.model_validate(yaml.safe_load(path.read_text(encoding="utf-8")))
    except (ValidationError, yaml.YAMLError, OSError) as error:
        raise CatalogueError(f"{path}: {error}") from error
    return _assemble(path, entry)


def _robot_file(name: str, root: Path | None) -> Path:
    if name.endswith((".yaml", ".yml")):
        path = ((root or Path.cwd()) / name).resolve()
        if path.is_file():
            return path
        raise CatalogueError(f"no robot file {path}")
    if name in robot_names():
        return share_dir("assets") / "robots" / f"{name}.yaml"
    near = difflib.get_close_matches(name, robot_names(), n=1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    raise CatalogueError(
        f"no robot {name!r} in the catalogue{hint} (there are: {', '.join(robot_names())})"
    )


def _assemble(path: Path, entry: _RobotEntry) -> Robot:
    urdf = Urdf.read(_description(entry.urdf, path), entry.joints, entry.locked)
    missing = [joint for joint in entry.joints if joint not in urdf.limits]
    if missing:
        raise CatalogueError(f"{path}: joints {missing} are not movable joints of {entry.urdf}")
    for link in (entry.base_link, entry.tool.link, *(c.link for c in entry.cameras.values())):
        if link not in urdf.links:
            near = difflib.get_close_matches(link, urdf.links, n=1)
            raise CatalogueError(f"{path}: {entry.urdf} has no link {link!r}; nearest: {near}")
    exclusions = {frozenset(pair) for pair in entry.exclude}
    if entry.srdf is not None:
        exclusions |= urdf.disabled_pairs(_description(entry.srdf, path))
    return Robot(
        name=path.stem,
        title=entry.title,
        model=urdf,
        base_link=entry.base_link,
        tool_link=entry.tool.link,
        tool=entry.tool.pose,
        tool_shape=entry.tool.shape,
        joints=entry.joints,
        limits=_limits(path, entry, urdf),
        postures={name: np.deg2rad(angles) for name, angles in entry.postures.items()},
        cameras={name: CameraMount(c.link, c.pose) for name, c in entry.cameras.items()},
        exclusions=frozenset(exclusions),
        colors=entry.colors,
    )


def _limits(path: Path, entry: _RobotEntry, urdf: Urdf) -> JointLimits:
    """The URDF's limits; the catalogue may tighten velocity and effort, never widen them."""
    rows = np.array([urdf.limits[joint] for joint in entry.joints])
    lower, upper, velocity, effort = rows.T
    count = len(entry.joints)

    def of(limit: _LimitEntry | None, ceiling: Vector | None = None) -> Any:
        if limit is None:
            return ceiling
        try:
            value = np.broadcast_to(np.asarray(limit.value, dtype=float), (count,)).copy()
        except ValueError as error:
            raise CatalogueError(f"{path}: limits: {error}") from error
        return value if ceiling is None else np.minimum(value, ceiling)

    limits = JointLimits(
        lower=lower,
        upper=upper,
        velocity=of(entry.limits.velocity, velocity),
        acceleration=of(entry.limits.acceleration),
        jerk=of(entry.limits.jerk),
        effort=of(entry.limits.effort, effort),
    )
    for name, angles in entry.postures.items():
        q = np.deg2rad(angles)
        if np.any(q < lower) or np.any(q > upper):
            raise CatalogueError(f"{path}: posture {name!r} is outside the joint limits")
    if not all(np.all(x > 0) for x in (limits.velocity, limits.acceleration, limits.jerk)):
        raise CatalogueError(f"{path}: limits must be greater than zero")
    return limits


def _description(name: str, beside: Path) -> Path:
    """A file of the example-robot-data package, or one beside the catalogue file."""
    own = beside.parent / name
    path = own if own.is_file() else robot_data_dir() / name
    if not path.is_file():
        raise CatalogueError(f"{beside}: neither {own} nor {path} exists")
    return path


def robot_data_dir() -> Path:
    """Folder ``robots`` of the installed example-robot-data package."""
    files = importlib.metadata.files("example-robot-data") or []
    for file in files:
        if file.name == "package.xml" and "example-robot-data" in file.parts:
            return Path(str(file.locate())).resolve().parent / "robots"
    raise CatalogueError("the package example-robot-data is not installed")
