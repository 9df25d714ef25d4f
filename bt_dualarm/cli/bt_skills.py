"""``bt-skills``: what may be written in a tree file, robots and grippers too, and the schema."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from bt_dualarm.cli.entry import SUCCEEDED
from bt_dualarm.cli.skill_import import imported_skills
from bt_dualarm.cli.words import add_skills
from bt_dualarm.errors import DualArmError

if TYPE_CHECKING:
    from rich.table import Table

    from bt_dualarm.spec.describe import PortDescription
    from bt_dualarm.spec.kind import Kind

_EPILOG = """\
examples:
  bt-skills                    every skill and every word of the language
  bt-skills circle             its ports, failures and an example
  bt-skills robots             every robot with its reach, postures and camera mounts
  bt-skills ur5                its joints, postures and camera mounts with their numbers
  bt-skills robots/z1.yaml     those of a robot's page of your own
  bt-skills grippers           every gripper with its stroke, force, payload and mass
  bt-skills suction_cup        what it can do; or a gripper's page of your own
  bt-skills --schema tree.schema.json
                               for editors: begin a tree file with the line
                               # yaml-language-server: $schema=tree.schema.json
"""

_STDOUT = Path("-")
_ROBOTS = "robots"
_GRIPPERS = "grippers"

_WIDE = 110
"""Columns from which on a table of ports has room for what they mean."""


def main(argv: Sequence[str] | None) -> int:
    """Show the installed skills; returns the exit code."""
    return _skills(_command_line().parse_args(argv))


def _command_line() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="bt-skills",
        description="Show what may be written in a tree file.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "name",
        metavar="NAME",
        nargs="?",
        help="a skill, a word, a robot, a gripper, robots, or grippers",
    )
    parser.add_argument("--json", action="store_true", help="for programs")
    parser.add_argument(
        "--schema",
        metavar="FILE",
        type=Path,
        nargs="?",
        const=_STDOUT,
        help="write the JSON Schema of the whole format with the installed skills",
    )
    add_skills(parser)
    return parser


def _skills(arguments: argparse.Namespace) -> int:
    from bt_dualarm.spec.language import LANGUAGE

    kinds = imported_skills("bt-skills", arguments.skills).kinds
    if arguments.schema is not None:
        return _write_schema(kinds, arguments.schema)
    everything = {**kinds, **LANGUAGE}
    if arguments.name is None:
        return _list(kinds, LANGUAGE, as_json=arguments.json)
    if arguments.name in everything:
        return _show(everything[arguments.name], as_json=arguments.json)
    return _show_of_catalogue(arguments.name, everything, as_json=arguments.json)


def _show_of_catalogue(name: str, others: Mapping[str, Kind], *, as_json: bool) -> int:
    from bt_dualarm.cli.gripper_summaries import is_gripper_page, list_grippers, show_gripper
    from bt_dualarm.cli.robot_summaries import list_robots, show_robot
    from bt_dualarm.world.grippers.named import gripper_names
    from bt_dualarm.world.robots.catalogue import robot_names
    from bt_dualarm.world.robots.page_path import is_page

    if name == _ROBOTS:
        list_robots(as_json=as_json)
    elif name == _GRIPPERS:
        list_grippers(as_json=as_json)
    elif name in gripper_names() or (is_page(name) and is_gripper_page(name)):
        show_gripper(name, as_json=as_json)
    elif is_page(name) or name in robot_names():
        show_robot(name, as_json=as_json)
    else:
        raise _unknown(name, (*others, _ROBOTS, _GRIPPERS, *robot_names(), *gripper_names()))
    return SUCCEEDED


def _unknown(name: str, known: Sequence[str]) -> DualArmError:
    from bt_dualarm.spec.problems import suggestion

    hint = suggestion(name, known, "name")
    return DualArmError(f"there is no skill, word, robot or gripper '{name}'; {hint}")


def _write_schema(kinds: Mapping[str, Kind], target: Path) -> int:
    from bt_dualarm.runtime.atomic_write import write_text
    from bt_dualarm.spec.schema import schema_text

    text = schema_text(kinds)
    if target == _STDOUT:
        sys.stdout.write(text)
        return SUCCEEDED
    try:
        write_text(target, text)
    except OSError as error:
        raise DualArmError(f"cannot write {target}: {error.strerror or error}") from error
    return SUCCEEDED


def _list(kinds: Mapping[str, Kind], words: Mapping[str, Kind], *, as_json: bool) -> int:
    if as_json:
        found = {name: kind.summary for name, kind in {**kinds, **words}.items()}
        print(json.dumps(found, indent=2))
        return SUCCEEDED
    width = max(map(len, {**kinds, **words}))
    for title, some in (("skills", kinds), ("words of the language", words)):
        print(f"{title}:")
        for name, kind in sorted(some.items()):
            print(f"  {name:<{width}}  {kind.summary}")
    print("robots: listed by bt-skills robots")
    print("grippers: listed by bt-skills grippers")
    return SUCCEEDED


def _show(kind: Kind, *, as_json: bool) -> int:
    """One kind: what it takes, what it gives, how it fails, an example."""
    from bt_dualarm.spec.describe import describe

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
    if description.exactly_one_of:
        console.print(f"\nexactly one of {', '.join(description.exactly_one_of)} is given")
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
    """Text in which rich is to see no markup."""
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
    """The same in two columns: what a port takes, and below it what it means."""
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
