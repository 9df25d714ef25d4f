"""``bt-skills``: node types, skills, robots and grippers in the terminal, and the schema."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from bt_dualarm.cli.entry import (
    SUCCEEDED,
    add_skills,
    escape,
    given_path,
    imported_skills,
    print_json,
    print_parts,
    table,
)
from bt_dualarm.core.errors import DualArmError

if TYPE_CHECKING:
    from rich.table import Table

    from bt_dualarm.core.pose import Pose, Vector
    from bt_dualarm.kinematics.inverse_kinematics import Workspace
    from bt_dualarm.robots.gripper import Gripper, Interval
    from bt_dualarm.robots.robot import Robot
    from bt_dualarm.spec.node_types import NodeType
    from bt_dualarm.spec.reference import PortDescription


# Summary of a robot for display: its description and URDF, in degrees and millimeters.


Triple = tuple[float, float, float]


@dataclass(frozen=True)
class JointSummary:
    """A joint; degrees and degrees per second."""

    name: str
    lower_deg: float
    upper_deg: float
    velocity_deg_s: float


@dataclass(frozen=True)
class LockedJointSummary:
    """A locked joint, and the positions that a tree file may set.

    Attributes:
        unit: ``"m"`` for a prismatic joint, ``"degrees"`` for a revolute one.
        follows: Joint that it mimics; None if it is independent.
    """

    name: str
    at: float
    lower: float
    upper: float
    unit: str
    follows: str | None


@dataclass(frozen=True)
class PostureSummary:
    """A posture: an angle per joint, and the resulting pose of the tool in the base link frame.

    Attributes:
        points: Unit vector of the tool's z axis, which points out of the tool.
    """

    name: str
    angles_deg: tuple[float, ...]
    tool_m: Triple
    points: Triple


@dataclass(frozen=True)
class MountSummary:
    """A camera mount: position and viewing direction in its link."""

    name: str
    link: str
    xyz_m: Triple
    looks: Triple


@dataclass(frozen=True)
class RobotSummary:
    """Data of a robot that authors of tree files need.

    Attributes:
        tool_link: Link that the tool frame is fixed to.
        tool_m: Position of the tool frame in that link.
        center_m: Position of the first joint in the base link frame.
        reach_m: Largest distance of the tool from the first joint.
        payload_kg: Largest mass that the arm may hold, None if its description gives none.
    """

    name: str
    title: str
    base_link: str
    tool_link: str
    tool_m: Triple
    center_m: Triple
    reach_m: float
    payload_kg: float | None
    joints: tuple[JointSummary, ...]
    postures: tuple[PostureSummary, ...]
    cameras: tuple[MountSummary, ...]
    locked: tuple[LockedJointSummary, ...]


def robot_summary(robot: Robot) -> RobotSummary:
    """Summary of a robot from the catalog or from a description file."""
    # Imported here, because help and node types do not need the robot model.
    from bt_dualarm.core.pose import Pose
    from bt_dualarm.kinematics.inverse_kinematics import Workspace, reach

    arm = Workspace(robot, Pose.identity())
    limits = robot.limits
    rates = zip(limits.lower, limits.upper, limits.velocity, strict=True)
    joints = (map(_degrees, row) for row in rates)
    return RobotSummary(
        name=robot.name,
        title=robot.title,
        base_link=robot.base_link,
        tool_link=robot.tool_link,
        tool_m=_triple(robot.tool.position),
        center_m=_triple(arm.bounding_ball[0]),
        reach_m=round(reach(robot), 2),
        payload_kg=robot.payload,
        joints=tuple(
            JointSummary(name, *row) for name, row in zip(robot.joints, joints, strict=True)
        ),
        postures=tuple(_posture(arm, name, q) for name, q in robot.postures.items()),
        cameras=tuple(
            MountSummary(name, mount.link, _triple(mount.pose.position), _ahead(mount.pose))
            for name, mount in robot.cameras.items()
        ),
        locked=tuple(
            LockedJointSummary(name, joint.at, joint.lower, joint.upper, joint.unit, joint.follows)
            for name, joint in robot.locked.items()
        ),
    )


def direction(axis: Triple) -> str:
    """An axis of a frame as ``+x``, any other unit vector by its numbers."""
    for name, value in zip("xyz", axis, strict=True):
        if abs(value) == 1.0:
            return f"{'+' if value > 0 else '-'}{name}"
    return numbers(axis)


def numbers(values: Iterable[float]) -> str:
    """Numbers in their shortest notation."""
    return ", ".join(f"{value:g}" for value in values)


def _posture(arm: Workspace, name: str, q: Vector) -> PostureSummary:
    tool = arm.forward(q)
    return PostureSummary(name, tuple(map(_degrees, q)), _triple(tool.position), _ahead(tool))


def _ahead(pose: Pose) -> Triple:
    """A direction, rounded to hundredths."""
    return _triple(pose.rotation_matrix[:, 2], 2)


def _degrees(angle: float) -> float:
    """Rounded to hundredths, without a negative zero."""
    return round(float(math.degrees(angle)), 2) + 0.0


def _triple(values: Iterable[float], digits: int = 3) -> Triple:
    x, y, z = (round(float(value), digits) + 0.0 for value in values)
    return x, y, z


# Robots in the terminal: the catalog, and one robot in full.


def list_robots(*, as_json: bool) -> None:
    """The catalog: one line per robot with number of joints, reach, postures and mounts."""
    from bt_dualarm.robots.robot_description import robot_names

    summaries = [_summary(name) for name in robot_names()]
    if as_json:
        print_json({summary.name: asdict(summary) for summary in summaries})
        return
    rows = (
        (
            summary.name,
            summary.title,
            str(len(summary.joints)),
            f"{summary.reach_m:.2f} m",
            ", ".join(posture.name for posture in summary.postures),
            ", ".join(mount.name for mount in summary.cameras),
        )
        for summary in summaries
    )
    titles = ("robot", "", "joints", "reach", "postures", "cameras")
    print_parts("robots:", table(titles, rows), "\nbt-skills NAME shows one robot in full.")


def show_robot(name: str, *, as_json: bool) -> None:
    """One robot from the catalog or a file: joints, postures, camera mounts, tool, reach.

    Raises:
        CatalogError: It does not exist, or its description has errors.
    """
    summary = _summary(name)
    if as_json:
        print_json(asdict(summary))
        return
    joints = (
        (j.name, f"{j.lower_deg:g}°", f"{j.upper_deg:g}°", f"{j.velocity_deg_s:g} °/s")
        for j in summary.joints
    )
    postures = (
        (p.name, numbers(p.angles_deg), numbers(p.tool_m), direction(p.points))
        for p in summary.postures
    )
    mounts = ((c.name, c.link, numbers(c.xyz_m), direction(c.looks)) for c in summary.cameras)
    locked = (
        (j.name, f"{j.at:g}", f"{j.lower:g}", f"{j.upper:g}", j.unit, j.follows or "")
        for j in summary.locked
    )
    tool = f"({numbers(summary.tool_m)}) m in {escape(summary.tool_link)}, z pointing out of it"
    print_parts(
        f"[bold]{escape(summary.name)}[/bold]  {escape(summary.title)}",
        "\njoints, base to tip:",
        table(("joint", "from", "to", "velocity"), joints),
        "\npostures, with the tool pose in the base link frame:",
        table(("posture", "angles in degrees", "tool at, m", "points"), postures),
        *(
            ("\ncamera mounts:", table(("mount", "in the link", "at, m", "looks"), mounts))
            if summary.cameras
            else ()
        ),
        *(
            (
                "\nlocked joints, for `locked` of an arm:",
                table(("joint", "at", "from", "to", "unit", "goes with"), locked),
            )
            if summary.locked
            else ()
        ),
        f"\ntool: at {tool}",
        f"reach: {summary.reach_m:.2f} m from the first joint, at ({numbers(summary.center_m)}) m",
        *(() if summary.payload_kg is None else (f"payload: {summary.payload_kg:g} kg",)),
    )


def _summary(name: str) -> RobotSummary:
    from bt_dualarm.robots.robot import is_description_path
    from bt_dualarm.robots.robot_description import load_robot

    if is_description_path(name):
        path = Path(name)
        return robot_summary(load_robot(path.name, path.parent))
    return robot_summary(load_robot(name))


# Grippers in the terminal: the catalog, and one gripper in full.


def list_grippers(*, as_json: bool) -> None:
    """The catalog: one line per gripper with stroke, force, payload and mass."""
    from bt_dualarm.robots.gripper import gripper_names

    grippers = [_load(name) for name in gripper_names()]
    if as_json:
        print_json({gripper.name: _sheet(gripper) for gripper in grippers})
        return
    rows = map(_row, grippers)
    titles = ("gripper", "", "stroke", "force", "payload", "mass")
    print_parts("grippers:", table(titles, rows), "\nbt-skills NAME shows one gripper in full.")


def _row(gripper: Gripper) -> tuple[str, ...]:
    return (
        gripper.name,
        gripper.title,
        f"{1e3 * gripper.stroke:g} mm" if gripper.fingers else "vacuum",
        _span(gripper.force, 1.0, "N"),
        f"{gripper.payload:g} kg",
        f"{gripper.mass:.3g} kg",
    )


def show_gripper(name: str, *, as_json: bool) -> None:
    """One gripper from the catalog or a file: its ranges and its tool frame.

    Raises:
        CatalogError: It does not exist, or its description has errors.
    """
    gripper = _load(name)
    if as_json:
        print_json(_sheet(gripper))
        return
    print_parts(
        f"[bold]{escape(gripper.name)}[/bold]  {escape(gripper.title)}\n",
        *(_fingers(gripper) if gripper.fingers else _cup(gripper)),
        f"payload: {gripper.payload:g} kg, or the robot's remaining payload",
        f"mass: {gripper.mass:.3g} kg",
        f"tool: {_tool(gripper)}",
    )


def _fingers(gripper: Gripper) -> tuple[str, ...]:
    return (
        "grasps with: two fingers",
        f"stroke: {1e3 * gripper.stroke:g} mm",
        f"speed: {_span(gripper.speed, 1e3, 'mm/s')} of both fingers together",
        f"force: {_span(gripper.force, 1.0, 'N')} of each pad",
        f"encoder: a step of {1e3 * gripper.resolution:g} mm",
        f"pads: {_pads(gripper)}",
    )


def _pads(gripper: Gripper) -> str:
    felt = gripper.tactile
    if felt is None:
        return "do not feel"
    return f"measure the force on them {felt.rate:g} times per second, within {felt.noise:g} N"


def _cup(gripper: Gripper) -> tuple[str, ...]:
    return "grasps with: vacuum", f"force: {_span(gripper.force, 1.0, 'N')} of vacuum"


def _tool(gripper: Gripper) -> str:
    x, y, z = (gripper.mount @ gripper.tool).position
    return f"at ({x:.3f}, {y:.3f}, {z:.3f}) m from the flange, z pointing out of the gripper"


def is_gripper_description(name: str) -> bool:
    """Whether a file describes a gripper: only grippers have a palm."""
    import yaml

    try:
        content = yaml.safe_load(Path(name).read_text(encoding="utf-8"))
    except (OSError, ValueError, yaml.YAMLError):
        return False
    return isinstance(content, dict) and "palm" in content


def _load(name: str) -> Gripper:
    from bt_dualarm.robots.gripper import load_gripper
    from bt_dualarm.robots.robot import is_description_path

    if is_description_path(name):
        path = Path(name)
        return load_gripper(path.name, path.parent)
    return load_gripper(name)


def _sheet(gripper: Gripper) -> dict[str, object]:
    """Data for programs, in SI units."""
    return {
        "name": gripper.name,
        "title": gripper.title,
        "kind": gripper.kind,
        "stroke_m": gripper.stroke,
        "force_n": [gripper.force.least, gripper.force.most],
        "speed_m_s": [gripper.speed.least, gripper.speed.most],
        "payload_kg": gripper.payload,
        "mass_kg": gripper.mass,
        "resolution_m": gripper.resolution,
        "tactile_hz": None if gripper.tactile is None else gripper.tactile.rate,
        "friction": gripper.friction,
        "tool_m": (gripper.mount @ gripper.tool).position.tolist(),
    }


def _span(span: Interval, times: float, unit: str) -> str:
    return f"{times * span.least:g} to {times * span.most:g} {unit}"


# The command itself.


_EPILOG = """\
examples:
  bt-skills                    every skill and every node type of the language
  bt-skills circle             its ports, failures and an example
  bt-skills robots             every robot with its reach, postures and camera mounts
  bt-skills ur5                its joints, postures and camera mounts with their numbers
  bt-skills robots/z1.yaml     the same for your own robot description
  bt-skills grippers           every gripper with its stroke, force, payload and mass
  bt-skills suction_cup        one gripper, or your own gripper description
  bt-skills --schema tree.schema.json
                               for editors; begin a tree file with this line:
                               # yaml-language-server: $schema=tree.schema.json
"""

_STDOUT = Path("-")
_ROBOTS = "robots"
_GRIPPERS = "grippers"

_WIDE = 110
"""Fewest columns for a table of ports with their descriptions."""


def main(argv: Sequence[str] | None) -> int:
    """Show the installed skills; returns the exit code."""
    return _skills(_command_line().parse_args(argv))


def _command_line() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="bt-skills",
        description="Show what a tree file may contain.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "name",
        metavar="NAME",
        nargs="?",
        help="a skill, a node type, a robot, a gripper, robots, or grippers",
    )
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument(
        "--schema",
        metavar="FILE",
        type=given_path,
        nargs="?",
        const=_STDOUT,
        help="write the JSON Schema of tree files, including the installed skills",
    )
    add_skills(parser)
    return parser


def _skills(arguments: argparse.Namespace) -> int:
    from bt_dualarm.behaviors.language import LANGUAGE

    kinds = imported_skills("bt-skills", arguments.skills).kinds
    if arguments.schema is not None:
        return _write_schema({**LANGUAGE, **kinds}, arguments.schema)
    everything = {**kinds, **LANGUAGE}
    if arguments.name is None:
        return _list(kinds, LANGUAGE, as_json=arguments.json)
    if arguments.name in everything:
        return _show(everything[arguments.name], as_json=arguments.json)
    return _show_of_catalog(arguments.name, everything, as_json=arguments.json)


def _show_of_catalog(name: str, others: Mapping[str, NodeType], *, as_json: bool) -> int:
    from bt_dualarm.robots.gripper import gripper_names
    from bt_dualarm.robots.robot import is_description_path
    from bt_dualarm.robots.robot_description import robot_names

    if name == _ROBOTS:
        list_robots(as_json=as_json)
    elif name == _GRIPPERS:
        list_grippers(as_json=as_json)
    elif name in gripper_names() or (is_description_path(name) and is_gripper_description(name)):
        show_gripper(name, as_json=as_json)
    elif is_description_path(name) or name in robot_names():
        show_robot(name, as_json=as_json)
    else:
        raise _unknown(name, (*others, _ROBOTS, _GRIPPERS, *robot_names(), *gripper_names()))
    return SUCCEEDED


def _unknown(name: str, known: Sequence[str]) -> DualArmError:
    from bt_dualarm.spec.problems import suggestion

    hint = suggestion(name, known, "name")
    return DualArmError(f"there is no skill, node type, robot or gripper '{name}'; {hint}")


def _write_schema(kinds: Mapping[str, NodeType], target: Path) -> int:
    from bt_dualarm.core.share import write_text
    from bt_dualarm.spec.reference import schema_text

    text = schema_text(kinds)
    if target == _STDOUT:
        sys.stdout.write(text)
        return SUCCEEDED
    try:
        write_text(target, text)
    except OSError as error:
        raise DualArmError(f"cannot write {target}: {error.strerror or error}") from error
    return SUCCEEDED


def _list(kinds: Mapping[str, NodeType], words: Mapping[str, NodeType], *, as_json: bool) -> int:
    if as_json:
        found = {name: kind.summary for name, kind in {**kinds, **words}.items()}
        print(json.dumps(found, indent=2))
        return SUCCEEDED
    width = max(map(len, {**kinds, **words}))
    for title, some in (("skills", kinds), ("node types of the language", words)):
        print(f"{title}:")
        for name, kind in sorted(some.items()):
            print(f"  {name:<{width}}  {kind.summary}")
    print("robots: listed by bt-skills robots")
    print("grippers: listed by bt-skills grippers")
    return SUCCEEDED


def _show(kind: NodeType, *, as_json: bool) -> int:
    """One node type: ports, outputs, failure codes, an example."""
    from bt_dualarm.spec.reference import describe

    description = describe(kind)
    if as_json:
        print(json.dumps(asdict(description), indent=2, ensure_ascii=False))
        return SUCCEEDED

    from rich.console import Console

    console = Console(highlight=False)
    console.print(f"[bold]{description.name}[/bold]  {_escape(description.summary)}")
    for title, ports in (("ports", description.ports), ("outputs", description.outputs)):
        if ports:
            console.print(f"\n{title}:")
            console.print((_table if console.width >= _WIDE else _entries)(ports))
    for rule, choice in (
        ("exactly", description.exactly_one_of),
        ("at most", description.at_most_one_of),
    ):
        if choice:
            console.print(f"\n{rule} one of {', '.join(choice)} is given")
    if description.needs_camera:
        console.print("\nthe arm needs a camera that moves with it")
    if description.needs_gripper:
        console.print("\nthe arm needs a gripper")
    for title, words in (("children", description.children), ("failures", description.failures)):
        if words:
            console.print(f"\n{title}:")
            console.print(_pairs(words))
    console.print("\nexample:")
    console.print(f"  {_escape(description.example)}", soft_wrap=True)
    console.print(f"\nfrom {_escape(description.origin)}", style="dim", soft_wrap=True)
    return SUCCEEDED


def _escape(text: str) -> str:
    """Text with rich's markup escaped."""
    from rich.markup import escape as escaped

    return escaped(text)


def _table(ports: Sequence[PortDescription]) -> Table:
    from rich.table import Table

    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="dim")
    table.add_column("  port", no_wrap=True)
    for title in ("type", "unit", "range", "default", ""):
        table.add_column(title)
    for port in ports:
        default = "required" if port.required else port.default
        words = (port.type, port.unit, port.range, default, port.description)
        table.add_row(f"  {port.name}", *map(_escape, words))
    return table


def _entries(ports: Sequence[PortDescription]) -> Table:
    """The same in two columns: a port, and below it its description."""
    from rich.table import Table

    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), show_header=False)
    table.add_column(no_wrap=True)
    table.add_column()
    for port in ports:
        default = "required" if port.required else port.default and f"{port.default} by default"
        facts = (" ".join(filter(None, (port.type, port.unit))), port.range, default)
        table.add_row(f"  {port.name}", f"[dim]{_escape(', '.join(filter(None, facts)))}[/dim]")
        table.add_row("", _escape(port.description))
    return table


def _pairs(words: Mapping[str, str]) -> Table:
    from rich.table import Table

    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), show_header=False)
    table.add_column(no_wrap=True)
    table.add_column()
    for name, meaning in words.items():
        table.add_row(f"  {name}", _escape(meaning))
    return table
