"""The arm inside a URDF: its chain, rigid bodies, and the URDF that MuJoCo and PlaCo read."""

from __future__ import annotations

import functools
import importlib.metadata
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Final

from bt_dualarm.core.errors import CatalogError
from bt_dualarm.core.pose import Pose
from bt_dualarm.robots.urdf import (
    LEAST_MASS,
    Inertial,
    Joint,
    KinematicTree,
    MeshFinder,
    Part,
    Selection,
    Shape,
    Stops,
    combined,
    is_solid,
    parts_of,
)
from bt_dualarm.robots.urdf_xml import Complaints, Origin

# Locations of meshes: the folder of the description, or a package


PACKAGE: Final = "package://"
FILE: Final = "file://"
SUFFIXES: Final = (".stl", ".obj", ".dae")
MAX_BYTES: Final = 64 * 1024 * 1024


def mesh_finder(urdf: Path, folder: Path, packages: Path) -> MeshFinder:
    """What finds the meshes that a URDF names.

    Args:
        urdf: File of the URDF.
        folder: Folder of the robot's description, below which meshes may lie.
        packages: Folder of installed packages, likewise.
    """

    def find(name: str) -> Path:
        base, rest = _base(name, urdf, packages)
        allowed = (base,) if name.startswith(PACKAGE) else (folder, packages)
        return _regular(name, _inside(name, base / rest, allowed))

    return find


def _base(name: str, urdf: Path, packages: Path) -> tuple[Path, str]:
    """The folder that a name begins at, and the rest of it."""
    if "\0" in name or not name.isprintable() or not name:
        raise ValueError(f"mesh {name[:80]!r} is no name of a file")
    if name.startswith(PACKAGE):
        package, _, rest = name.removeprefix(PACKAGE).lstrip("/").partition("/")
        return _package(package, urdf, packages), rest
    rest = name.removeprefix(FILE)
    if "://" in rest:
        raise ValueError(f"mesh {name!r} is not on this machine; {PACKAGE}, or a relative path")
    return urdf.parent, rest


def _package(package: str, urdf: Path, packages: Path) -> Path:
    """The folder of a package: one above the URDF, else an installed one."""
    for folder in (*urdf.parents, packages, *(packages / "robots").iterdir()):
        if folder.name == package:
            return folder
    raise ValueError(
        f"there is no folder {package!r} above the URDF, nor in the installed "
        "example-robot-data; put the URDF below a folder of that name, or write paths relative "
        "to the URDF"
    )


def _inside(name: str, path: Path, allowed: tuple[Path, ...]) -> Path:
    """The path without detours, if it stays in one of the folders."""
    try:
        path = path.resolve()
    except (OSError, RuntimeError) as error:  # a name too long, a loop of symlinks
        raise ValueError(f"mesh {name[:80]!r} is no name of a file") from error
    if not any(path.is_relative_to(folder.resolve()) for folder in allowed):
        raise ValueError(
            f"mesh {name!r} leads out of {allowed[0]}; meshes lie below the folder of the "
            "robot's page, or in the package that they name"
        )
    return path


def _regular(name: str, path: Path) -> Path:
    """The path, if a mesh of a kind and size that can be read is there."""
    try:
        size = path.stat().st_size if path.is_file() else -1
    except OSError:
        size = -1
    if size < 0:
        raise ValueError(f"mesh {name!r} does not exist; it would be {path}")
    if path.suffix.lower() not in SUFFIXES:
        raise ValueError(f"mesh {name!r} cannot be read; one of {', '.join(SUFFIXES)}")
    if size > MAX_BYTES:
        raise ValueError(f"mesh {name!r} is larger than {MAX_BYTES // 1024**2} MiB")
    if size == 0:
        raise ValueError(f"mesh {name!r} is empty")
    return path


# Serial chains of a URDF, which may be arms


LEAST_JOINTS: Final = 2
"""Joints of what is shown as an arm; fewer are wheels, lids and fingers."""

_ARM: Final = re.compile(r"arm|hand|wrist|elbow|gripper|tool|shoulder|ee_|tcp", re.IGNORECASE)
_LEG: Final = re.compile(
    r"leg|foot|ankle|knee|hip|wheel|head|neck|finger|thumb|little|index|middle|ring_|flex",
    re.IGNORECASE,
)
_FINGER: Final = re.compile(r"finger|jaw|gripper|mover|thumb|palm", re.IGNORECASE)
_JAW: Final = re.compile(r"finger|jaw|thumb", re.IGNORECASE)
_WRIST: Final = re.compile(r"yaw|roll|pitch|wrist", re.IGNORECASE)
_TOOLS: Final = (
    re.compile(r"tcp|tool|effector|eef|ee_|_ee$|grasp|gripper_frame", re.IGNORECASE),
    re.compile(r"tip|gripper|hand|flange", re.IGNORECASE),
)


@dataclass(frozen=True)
class ArmChain:
    """A chain that could be an arm.

    Attributes:
        base: Link that the first joint hangs on.
        tool: Link at the end.
        joints: Names of the joints that turn, base to tip.
    """

    base: str
    tool: str
    joints: tuple[str, ...]

    @property
    def rank(self) -> tuple[int, int, str]:
        """What sorts arms before legs, many joints before few."""
        words = " ".join((*self.joints, self.tool))
        likely = len(_LEG.findall(words)) - len(_ARM.findall(words))
        return (likely > 0) - (likely < 0), -len(self.joints), self.base


def arm_chains(tree: KinematicTree) -> tuple[ArmChain, ...]:
    """Chains of two joints and more, those first that are most likely arms."""
    return tuple(sorted(_segments(tree), key=lambda chain: chain.rank))


def turning_joints(tree: KinematicTree, base: str, tool: str) -> tuple[str, ...]:
    """Names of the joints between two links that could move, base to tip; none without a chain."""
    return tuple(joint.name for joint in tree.chain(base, tool) or () if joint.turns)


def _segments(tree: KinematicTree) -> Iterator[ArmChain]:
    """Chains from fork to fork, or to the end."""
    moves = _links_with_joints_below(tree)
    waiting = [(tree.root, tree.root, 0)]
    while waiting:
        start, link, turned = waiting.pop()
        further = [
            joint for joint in tree.below.get(link, ()) if joint.turns or joint.child in moves
        ]
        if len(further) == 1:
            joint = further[0]
            waiting.append((start, joint.child, turned + joint.turns))
            continue
        if turned >= LEAST_JOINTS:
            yield from _chain(tree, start, link)
        waiting += [(link, joint.child, int(joint.turns)) for joint in further]


def _chain(tree: KinematicTree, start: str, last: str) -> Iterator[ArmChain]:
    """The chain between two links, without the gripper at its end."""
    joints = [joint for joint in tree.chain(start, last) or () if joint.turns]
    while joints and _closes(joints[-1]):
        last = joints.pop().parent
    if len(joints) >= LEAST_JOINTS:
        base = joints[0].parent
        tool = _tool(tree, last)
        yield ArmChain(base, tool, turning_joints(tree, base, tool))


def _closes(joint: Joint) -> bool:
    """Whether a joint moves a finger, to go by its name."""
    name = f"{joint.name} {joint.child}"
    return _FINGER.search(name) is not None and _WRIST.search(name) is None


def _links_with_joints_below(tree: KinematicTree) -> set[str]:
    """Links below which something turns."""
    found: set[str] = set()
    for link in reversed(list(tree.subtree(tree.root))):
        if any(joint.turns or joint.child in found for joint in tree.below.get(link, ())):
            found.add(link)
    return found


def _tool(tree: KinematicTree, last: str) -> str:
    """The link that its name makes the tool, of those that hang on the last one without a joint."""
    waiting = [last]
    found = [last]
    while waiting:
        for joint in tree.below.get(waiting.pop(), ()):
            if joint.kind == "fixed":
                waiting.append(joint.child)
                found.append(joint.child)
    for tool in _TOOLS:
        named = [link for link in found if tool.search(link) and not _JAW.search(link)]
        if named:
            return named[-1]
    return last


# Merging of links without a joint between them into one rigid body


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
        tag = "mass"
        what = f"what hangs on joint '{joint}' weighs nothing"
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


# Generated URDF of an arm, the only one that MuJoCo and PlaCo read


ROOT = "world"
"""Link above the base: MuJoCo takes the first link of a URDF for its world."""

_ENTITIES: Final = str.maketrans(
    {
        "&": "&amp;",
        "<": "&lt;",
        ">": "&gt;",
        '"': "&quot;",
        "\n": "&#10;",
        "\r": "&#13;",
        "\t": "&#9;",
    }
)
"""What an attribute's value cannot hold as it is; the standard library's own way to write it brings
in what downloads web pages."""

_NOTHING = Inertial(0.0, Origin(), (0.0, 0.0, 0.0, 0.0, 0.0, 0.0))


def kinematic_text(parts: Iterable[Part]) -> str:
    """A URDF without shapes: links, inertias, joints with their limits."""
    lines = [f"<link name={_quoted(ROOT)}/>"]
    for part in parts:
        lines += _link(part)
    for part in parts:
        lines += _joint(part)
    return "\n".join(['<robot name="arm">', *lines, "</robot>"])


def _link(part: Part) -> Iterator[str]:
    """A link; without an inertia MuJoCo would put the center of mass somewhere else."""
    yield f"<link name={_quoted(part.link)}>{_inertial(part.inertial or _NOTHING)}</link>"


def _inertial(inertial: Inertial) -> str:
    names = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    pairs = zip(names, inertial.moments, strict=True)
    moments = " ".join(f'{name}="{moment!r}"' for name, moment in pairs)
    mass = f'<mass value="{inertial.mass!r}"/>'
    return f"<inertial>{_origin(inertial.origin)}{mass}<inertia {moments}/></inertial>"


def _joint(part: Part) -> Iterator[str]:
    """The joint of a link; that of a fixed one has a name that no URDF can have."""
    kind = "fixed" if part.joint is None else "revolute"
    name = f"{part.link}/fixed" if part.joint is None else part.joint.name
    yield f'<joint name={_quoted(name)} type="{kind}">{_origin(part.origin)}'
    yield f"<parent link={_quoted(part.parent or ROOT)}/><child link={_quoted(part.link)}/>"
    if part.axis is not None and part.stops is not None:
        stops = part.stops
        axis = part.axis.tolist()
        yield f'<axis xyz="{_numbers(axis)}"/><limit lower="{stops.lower!r}" '
        yield f'upper="{stops.upper!r}" velocity="{stops.velocity!r}" effort="{stops.effort!r}"/>'
    yield "</joint>"


def _quoted(value: str) -> str:
    """The value of an attribute (XML 1.0, 2.3 and 3.3.3)."""
    return f'"{value.translate(_ENTITIES)}"'


def _origin(origin: Origin) -> str:
    return f'<origin xyz="{_numbers(origin.xyz)}" rpy="{_numbers(origin.rpy)}"/>'


def _numbers(numbers: Iterable[float]) -> str:
    return " ".join(repr(float(number)) for number in numbers)


@dataclass(frozen=True, eq=False)
class Urdf:
    """What a URDF says of one arm, whose joints are either its own or locked.

    Attributes:
        parts: Its links by name, each after the one that it hangs on.
    """

    parts: Mapping[str, Part]

    @classmethod
    def read(
        cls,
        tree: KinematicTree,
        selection: Selection,
        mesh_file: MeshFinder,
        complaints: Complaints,
    ) -> Urdf:
        """What hangs on the base, as far as it is needed; of no use after a complaint.

        Args:
            tree: Links and joints of the file.
            selection: What of them makes the arm.
            mesh_file: Finder of the meshes that shapes name.
            complaints: List that takes what is wrong.
        """
        parts = parts_of(tree, selection, mesh_file, complaints)
        parts = with_solid_bodies(parts, tree, complaints)
        return cls(fused(_that_touch(parts, tree, complaints), selection.named))

    @property
    def links(self) -> tuple[str, ...]:
        """Names of the links, each after the one that it hangs on."""
        return tuple(self.parts)

    @property
    def stops(self) -> Mapping[str, Stops]:
        """Limits of the arm's joints by name."""
        return {
            part.joint.name: part.stops
            for part in self.parts.values()
            if part.joint is not None and part.stops is not None
        }

    @cached_property
    def kinematic_text(self) -> str:
        """A URDF of the arm without shapes."""
        return kinematic_text(tuple(self.parts.values()))

    def shapes(self, link: str, tag: str) -> tuple[Shape, ...]:
        """The shapes of a link; ``tag`` is ``"visual"`` or ``"collision"``."""
        part = self.parts[link]
        return part.visual if tag == "visual" else part.collision


def _that_touch(
    parts: Mapping[str, Part], tree: KinematicTree, complaints: Complaints
) -> Mapping[str, Part]:
    """The parts; where a URDF has no shapes to touch with, those that are seen stand for them."""
    base = next(iter(parts))
    moving = [part for part in parts.values() if part.top != base]
    if any(part.collision for part in moving):
        return parts
    if any(part.visual for part in moving):
        return {link: replace(part, collision=part.visual) for link, part in parts.items()}
    if moving and not complaints.problems:
        hint = "give the links a <collision>: without, nothing keeps the arm from hitting things"
        complaints.add(tree.links[moving[0].link], "no link that moves has a shape", hint)
    return parts


# Location of the installed example-robot-data, with the catalog's URDFs and meshes


@functools.cache
def robot_data_dir() -> Path:
    """Folder ``robots`` of the installed example-robot-data package.

    Raises:
        CatalogError: It is not installed.
    """
    for file in importlib.metadata.files("example-robot-data") or []:
        if file.name == "package.xml" and "example-robot-data" in file.parts:
            return Path(str(file.locate())).resolve().parent / "robots"
    raise CatalogError("the package example-robot-data is not installed")
