"""Reading a URDF: the chain for PlaCo and MuJoCo, limits, and the shapes of its links."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from bt_dualarm.errors import CatalogueError
from bt_dualarm.pose import Pose
from bt_dualarm.world.robot_data import package_dir

_PACKAGE = "package://"
_TURNING = ("revolute", "continuous")
_CONTINUOUS = (-2 * np.pi, 2 * np.pi)  # a joint without stops: one turn either way


@dataclass(frozen=True, eq=False)
class Shape:
    """One shape of a link.

    Attributes:
        kind: ``box``, ``cylinder``, ``sphere`` or ``mesh``.
        size: Full lengths of a box, radius and length of a cylinder, radius of a sphere; the
            scale of a mesh.
        mesh: File of a mesh.
    """

    kind: str
    size: tuple[float, ...]
    pose: Pose
    mesh: Path | None = None


@dataclass(frozen=True, eq=False)
class Urdf:
    """A URDF whose joints are either the arm's own or locked.

    Attributes:
        limits: Lower, upper (rad), velocity (rad/s) and effort (N m) of each of the arm's joints.
        movable: All joints of the file that could be the arm's.
    """

    path: Path
    root: ET.Element
    limits: Mapping[str, tuple[float, float, float, float]]
    movable: tuple[str, ...]

    @classmethod
    def read(cls, path: Path, joints: Sequence[str], locked: Mapping[str, float]) -> Urdf:
        """Read a file; every joint not in ``joints`` is fixed, at ``locked`` or at zero.

        Raises:
            CatalogueError: The file is no URDF.
        """
        root = _parse(path)
        limits = {}
        movable = [str(j.get("name")) for j in root.findall("joint") if j.get("type") in _TURNING]
        for joint in root.findall("joint"):
            if joint.get("name") in joints:
                limits[str(joint.get("name"))] = _limits(joint)
                _bound(joint)
            else:
                _lock(joint, locked.get(str(joint.get("name")), 0.0))
        _root_at_world(root)
        return cls(path, root, limits, tuple(movable))

    @property
    def links(self) -> tuple[str, ...]:
        """Names of the links."""
        return tuple(str(link.get("name")) for link in self.root.findall("link"))

    @cached_property
    def kinematic_text(self) -> str:
        """The URDF without shapes and simulator extensions."""
        bare = ET.fromstring(ET.tostring(self.root))  # noqa: S314  # made from our own element
        for tag in ("gazebo", "transmission", "material"):
            for element in bare.findall(tag):
                bare.remove(element)
        for link in bare.findall("link"):
            for tag in ("visual", "collision"):
                for element in link.findall(tag):
                    link.remove(element)
        return ET.tostring(bare, encoding="unicode")

    def shapes(self, link: str, tag: str) -> Iterator[Shape]:
        """The shapes of a link; ``tag`` is ``"visual"`` or ``"collision"``."""
        for element in self.root.findall(f"link[@name='{link}']/{tag}"):
            geometry = element.find("geometry")
            if geometry is not None and len(geometry):
                yield self._shape(geometry[0], _origin(element))

    def disabled_pairs(self, srdf: Path) -> set[frozenset[str]]:
        """Pairs of links whose contacts an SRDF disables.

        Raises:
            CatalogueError: The file is no XML.
        """
        disabled = _parse(srdf).iter("disable_collisions")
        pairs = ((e.get("link1", ""), e.get("link2", "")) for e in disabled)
        return {frozenset(pair) for pair in pairs if set(pair) <= set(self.links)}

    def _shape(self, element: ET.Element, pose: Pose) -> Shape:
        kind = element.tag
        if kind == "box":
            return Shape(kind, _floats(element.get("size", "")), pose)
        if kind == "sphere":
            return Shape(kind, (float(element.get("radius", "0")),), pose)
        if kind == "cylinder":
            size = (float(element.get("radius", "0")), float(element.get("length", "0")))
            return Shape(kind, size, pose)
        if kind == "mesh":
            scale = _floats(element.get("scale", "1 1 1"))
            return Shape(kind, scale, pose, self._mesh(element.get("filename", "")))
        raise CatalogueError(f"{self.path}: shape <{kind}> is not understood")

    def _mesh(self, name: str) -> Path:
        if not name.startswith(_PACKAGE):
            return self.path.parent / name.removeprefix("file://")
        package, _, rest = name.removeprefix(_PACKAGE).partition("/")
        folder = package_dir(package, self.path)
        if folder is None:
            raise CatalogueError(
                f"{self.path}: mesh {name!r}: there is no folder {package!r} above the URDF, nor "
                "in the installed example-robot-data; put the URDF below a folder of that name, or "
                "write paths relative to the URDF"
            )
        return folder / rest


def _parse(path: Path) -> ET.Element:
    try:
        return ET.parse(path).getroot()  # noqa: S314  # a file of an installed package
    except ET.ParseError as error:
        raise CatalogueError(f"{path}: {error}") from error


def _limits(joint: ET.Element) -> tuple[float, float, float, float]:
    limit = joint.find("limit")
    if joint.get("type") == "continuous":
        lower, upper = _CONTINUOUS
        limit = ET.Element("limit") if limit is None else limit
    elif joint.get("type") == "revolute" and limit is not None:
        lower, upper = float(limit.get("lower", "0")), float(limit.get("upper", "0"))
    else:
        raise CatalogueError(f"joint {joint.get('name')!r} is not a revolute joint with limits")
    return lower, upper, float(limit.get("velocity", "0")), float(limit.get("effort", "0"))


def _bound(joint: ET.Element) -> None:
    """Give a joint without stops its limits: PlaCo would have an angle as a point of a circle."""
    if joint.get("type") != "continuous":
        return
    joint.set("type", "revolute")
    limit = joint.find("limit")
    if limit is None:
        limit = ET.SubElement(joint, "limit", velocity="0", effort="0")
    for side, angle in zip(("lower", "upper"), _CONTINUOUS, strict=True):
        limit.set(side, repr(float(angle)))


def _lock(joint: ET.Element, value: float) -> None:
    """Make a joint fixed; a sliding one stays where it is locked."""
    if joint.get("type") == "fixed":
        return
    axis = joint.find("axis")
    if value and axis is not None:
        _slide(joint, value, _floats(axis.get("xyz", "1 0 0")))
    joint.set("type", "fixed")
    for tag in ("limit", "mimic", "dynamics", "axis", "safety_controller", "calibration"):
        for element in joint.findall(tag):
            joint.remove(element)


def _slide(joint: ET.Element, value: float, axis: tuple[float, ...]) -> None:
    if joint.get("type") != "prismatic":
        raise CatalogueError(f"joint {joint.get('name')!r}: only sliding joints can be locked away")
    origin = joint.find("origin")
    if origin is None:
        origin = ET.SubElement(joint, "origin")
    at = _origin(joint).apply(np.asarray(axis) * value)
    origin.set("xyz", " ".join(repr(float(x)) for x in at))


def _root_at_world(root: ET.Element) -> None:
    """Hang the tree below a link ``world``: MuJoCo merges a URDF's root into its world body."""
    children = {str(child.get("link")) for child in root.findall("joint/child")}
    roots = [name for e in root.findall("link") if (name := str(e.get("name"))) not in children]
    if roots == ["world"]:
        return
    if len(roots) != 1:
        raise CatalogueError(f"the URDF must have one root link, it has {roots}")
    ET.SubElement(root, "link", name="world")
    joint = ET.SubElement(root, "joint", name="world_to_root", type="fixed")
    ET.SubElement(joint, "parent", link="world")
    ET.SubElement(joint, "child", link=roots[0])


def _origin(element: ET.Element) -> Pose:
    origin = element.find("origin")
    if origin is None:
        return Pose.identity()
    return Pose.from_rpy(_floats(origin.get("xyz", "0 0 0")), _floats(origin.get("rpy", "0 0 0")))


def _floats(text: str) -> tuple[float, ...]:
    return tuple(float(x) for x in text.split())
