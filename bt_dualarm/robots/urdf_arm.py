"""The arm inside a URDF: its links and rigid bodies, and the URDF that MuJoCo and PlaCo read.

A user's URDF is never passed on to a library. `Urdf.read` validates the part that is the arm, locks
all other joints and merges links without shapes; `Urdf.kinematic_text` writes the only URDF that
MuJoCo and PlaCo see. `arm_chains` guesses which chains of a URDF are arms.
"""

from __future__ import annotations

import functools
import importlib.metadata
import itertools
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Final

from bt_dualarm.core.errors import CatalogError
from bt_dualarm.core.pose import Pose
from bt_dualarm.robots.urdf import (
    MIN_MASS,
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
from bt_dualarm.robots.urdf_xml import AttributeReader, Origin

# Mesh files

PACKAGE: Final = "package://"
FILE: Final = "file://"
SUFFIXES: Final = (".stl", ".obj", ".dae")
MAX_BYTES: Final = 64 * 1024 * 1024


def mesh_finder(urdf: Path, folder: Path, packages: Path) -> MeshFinder:
    """Create a function that finds the mesh files that a URDF names.

    Only files below the description's folder or in a package are accepted: a URDF must not read
    other files of the user.

    Args:
        urdf: File of the URDF.
        folder: Folder of the robot's description, below which meshes may be.
        packages: Folder of installed packages.
    """

    def find(name: str) -> Path:
        base, rest = _base(name, urdf, packages)
        allowed = (base,) if name.startswith(PACKAGE) else (folder, packages)
        return _regular(name, _inside(name, base / rest, allowed))

    return find


def _base(name: str, urdf: Path, packages: Path) -> tuple[Path, str]:
    """The folder that a mesh name refers to, and the rest of the name."""
    if "\0" in name or not name.isprintable() or not name:
        raise ValueError(f"mesh {name[:80]!r} is not a file name")
    if name.startswith(PACKAGE):
        package, _, rest = name.removeprefix(PACKAGE).lstrip("/").partition("/")
        return _package(package, urdf, packages), rest
    rest = name.removeprefix(FILE)
    if "://" in rest:
        raise ValueError(f"mesh {name!r} is not on this machine; {PACKAGE}, or a relative path")
    return urdf.parent, rest


def _package(package: str, urdf: Path, packages: Path) -> Path:
    """The folder of a package: an ancestor of the URDF, otherwise an installed package."""
    for folder in itertools.chain((*urdf.parents, packages), (packages / "robots").iterdir()):
        if folder.name == package:
            return folder
    raise ValueError(
        f"there is no folder {package!r} above the URDF, nor in the installed "
        "example-robot-data; put the URDF below a folder of that name, or write paths relative "
        "to the URDF"
    )


def _inside(name: str, path: Path, allowed: tuple[Path, ...]) -> Path:
    """The resolved path, if it is in one of the allowed folders."""
    try:
        path = path.resolve()
    except (OSError, RuntimeError) as error:  # a name that is too long, a loop of symlinks
        raise ValueError(f"mesh {name[:80]!r} is not a file name") from error
    if not any(path.is_relative_to(folder.resolve()) for folder in allowed):
        raise ValueError(
            f"mesh {name!r} is outside {allowed[0]}; meshes must be below the folder of the "
            "robot's description, or in the package that they name"
        )
    return path


def _regular(name: str, path: Path) -> Path:
    """The path, if it is a mesh file of a supported type and size."""
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


# Chains that may be arms

MIN_JOINTS: Final = 2
"""Minimum number of joints of an arm; shorter chains are wheels, lids and fingers."""

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
    """A serial chain that could be an arm.

    Attributes:
        base: Parent link of the first joint.
        tool: Link at the end.
        joints: Names of the movable joints, base to tip.
    """

    base: str
    tool: str
    joints: tuple[str, ...]

    @property
    def rank(self) -> tuple[int, int, str]:
        """Sort key: likely arms before legs, many joints before few."""
        words = " ".join((*self.joints, self.tool))
        likely = len(_LEG.findall(words)) - len(_ARM.findall(words))
        return (likely > 0) - (likely < 0), -len(self.joints), self.base


def arm_chains(tree: KinematicTree) -> tuple[ArmChain, ...]:
    """Chains of at least two joints, the most likely arms first."""
    return tuple(sorted(_segments(tree), key=lambda chain: chain.rank))


def turning_joints(tree: KinematicTree, base: str, tool: str) -> tuple[str, ...]:
    """Names of the movable joints between two links, base to tip; empty without a chain."""
    return tuple(joint.name for joint in tree.chain(base, tool) or () if joint.turns)


def _segments(tree: KinematicTree) -> Iterator[ArmChain]:
    """Split the tree at its forks into chains."""
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
        if turned >= MIN_JOINTS:
            yield from _chain(tree, start, link)
        waiting += [(link, joint.child, int(joint.turns)) for joint in further]


def _chain(tree: KinematicTree, start: str, last: str) -> Iterator[ArmChain]:
    """The chain between two links, without a gripper at its end, if it is long enough."""
    joints = [joint for joint in tree.chain(start, last) or () if joint.turns]
    while joints and _moves_finger(joints[-1]):
        last = joints.pop().parent
    if len(joints) >= MIN_JOINTS:
        base = joints[0].parent
        tool = _tool(tree, last)
        yield ArmChain(base, tool, turning_joints(tree, base, tool))


def _moves_finger(joint: Joint) -> bool:
    """Whether a joint moves a finger, judging by its name."""
    name = f"{joint.name} {joint.child}"
    return _FINGER.search(name) is not None and _WRIST.search(name) is None


def _links_with_joints_below(tree: KinematicTree) -> set[str]:
    """Links with a movable joint among their descendants."""
    found: set[str] = set()
    for link in reversed(list(tree.subtree(tree.root))):
        if any(joint.turns or joint.child in found for joint in tree.below.get(link, ())):
            found.add(link)
    return found


def _tool(tree: KinematicTree, last: str) -> str:
    """The tool by its name, among the last link and those rigidly attached to it."""
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


# Rigid bodies


def with_solid_bodies(
    parts: Mapping[str, Part], tree: KinematicTree, reader: AttributeReader
) -> dict[str, Part]:
    """Move inertias that are invalid on their own to the topmost link of their rigid body.

    A sensor of 100 g without an extent is valid as a part of the hand that carries it, but not as a
    moving body of its own. A rigid body on a movable joint must have a mass and an inertia: the
    reader gets a problem for each one that has not.
    """
    degenerate: dict[str, list[tuple[Pose, Inertial]]] = {}
    inertials: dict[str, list[tuple[Pose, Inertial]]] = {}
    poses: dict[str, Pose] = {}
    found = dict(parts)
    for link, part in parts.items():
        is_child = part.top != link and part.parent is not None
        poses[link] = poses[str(part.parent)] @ part.pose if is_child else Pose.identity()
        if part.inertial is not None:
            inertials.setdefault(part.top, []).append((poses[link], part.inertial))
            if link != part.top and not is_solid(part.inertial):
                degenerate.setdefault(part.top, []).append((poses[link], part.inertial))
                found[link] = replace(part, inertial=None)
    for top, added in degenerate.items():
        found[top] = _with_added(found[top], added)
    for link, part in parts.items():
        if part.joint is not None:
            whole = combined(inertials.get(link, []))
            if whole is None or not is_solid(whole):
                _report_inertia(tree, part, whole, reader)
            elif not any(is_solid(inertial) for _, inertial in inertials[link]):
                found[link] = replace(part, inertial=whole)
    return found


def _report_inertia(
    tree: KinematicTree, part: Part, whole: Inertial | None, reader: AttributeReader
) -> None:
    joint = "" if part.joint is None else part.joint.name
    element = tree.links[part.link]
    inertial = element.find("inertial")
    if whole is None or whole.mass < MIN_MASS:
        tag = "mass"
        what = f"the body on joint '{joint}' has no mass"
        hint = "give the link an <inertial> with the mass in kg and the inertia in kg m²"
    else:
        tag = "inertia"
        what = f"the body on joint '{joint}' has a mass of {whole.mass:g} kg, but no inertia"
        hint = "give the link's <inertia> its principal moments in kg m²; none of them may be 0"
    reader.add((inertial and inertial.find(tag)) or inertial or element, what, hint)


def fused(parts: Mapping[str, Part], named: frozenset[str]) -> dict[str, Part]:
    """Merge links without shapes into their parents, which makes MuJoCo's models smaller.

    Args:
        parts: Links of the arm, parents first.
        named: Links that are referred to by name, and are kept.
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
    return kept | {link: _with_added(kept[link], added) for link, added in loads.items()}


def _with_added(part: Part, added: list[tuple[Pose, Inertial]]) -> Part:
    """The part with further inertias, each at a pose in the part's frame."""
    own = [] if part.inertial is None else [(Pose.identity(), part.inertial)]
    return replace(part, inertial=combined([*own, *added]))


# Generated URDF

ROOT = "world"
"""Link above the base: MuJoCo treats the first link of a URDF as its world."""

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
"""Escapes for attribute values. `xml.sax.saxutils` has them too, but imports `urllib.request`."""

_MASSLESS = Inertial(0.0, Origin(), (0.0, 0.0, 0.0, 0.0, 0.0, 0.0))


def kinematic_text(parts: Iterable[Part]) -> str:
    """A URDF without shapes: links, inertias, joints with their limits."""
    lines = [f"<link name={_quoted(ROOT)}/>"]
    for part in parts:
        lines += _link(part)
    for part in parts:
        lines += _joint(part)
    return "\n".join(['<robot name="arm">', *lines, "</robot>"])


def _link(part: Part) -> Iterator[str]:
    """A link; always with an inertia, without which MuJoCo would infer one."""
    yield f"<link name={_quoted(part.link)}>{_inertial(part.inertial or _MASSLESS)}</link>"


def _inertial(inertial: Inertial) -> str:
    names = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    pairs = zip(names, inertial.moments, strict=True)
    moments = " ".join(f'{name}="{moment!r}"' for name, moment in pairs)
    mass = f'<mass value="{inertial.mass!r}"/>'
    return f"<inertial>{_origin(inertial.origin)}{mass}<inertia {moments}/></inertial>"


def _joint(part: Part) -> Iterator[str]:
    """The joint of a link; fixed joints get a name that no valid URDF contains."""
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
    """One arm of a URDF: all joints but the arm's own are locked.

    Attributes:
        parts: Its links by name, parents first.
    """

    parts: Mapping[str, Part]

    @classmethod
    def read(
        cls,
        tree: KinematicTree,
        selection: Selection,
        mesh_file: MeshFinder,
        reader: AttributeReader,
    ) -> Urdf:
        """Read the arm; the result is valid only if the reader has no problems afterwards.

        Args:
            tree: Links and joints of the file.
            selection: The part of them that is the arm.
            mesh_file: Function that finds mesh files by name.
            reader: Reader of attributes, which collects problems.
        """
        parts = parts_of(tree, selection, mesh_file, reader)
        parts = with_solid_bodies(parts, tree, reader)
        return cls(fused(_with_collision_shapes(parts, tree, reader), selection.named))

    @property
    def links(self) -> tuple[str, ...]:
        """Names of the links, parents first."""
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


def _with_collision_shapes(
    parts: Mapping[str, Part], tree: KinematicTree, reader: AttributeReader
) -> Mapping[str, Part]:
    """The parts; if no moving link has a collision shape, visual shapes are used instead."""
    base = next(iter(parts))
    moving = [part for part in parts.values() if part.top != base]
    if any(part.collision for part in moving):
        return parts
    if any(part.visual for part in moving):
        return {link: replace(part, collision=part.visual) for link, part in parts.items()}
    if moving and not reader.problems:
        hint = "give the links a <collision>: without one, collisions of the arm are not detected"
        reader.add(tree.links[moving[0].link], "no moving link has a shape", hint)
    return parts


# Installed descriptions


@functools.cache
def robot_data_dir() -> Path:
    """Folder ``robots`` of the installed example-robot-data package.

    Raises:
        CatalogError: It is not installed.
    """
    package = importlib.metadata.distribution("example-robot-data")
    # `package.files` would make an object of each of its thousand files.
    for row in (package.read_text("RECORD") or "").splitlines():
        file = row.partition(",")[0]
        if file.endswith("example-robot-data/package.xml"):
            return Path(str(package.locate_file(file))).resolve().parent / "robots"
    raise CatalogError("the package example-robot-data is not installed")
