"""Shared parts of the commands: arguments, tables in the terminal, import of skills."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable, Sequence
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Final

from bt_dualarm.cli.entry import early

if TYPE_CHECKING:
    from rich.table import Table

    from bt_dualarm.skill.registry import Registry


def add_skills(parser: argparse.ArgumentParser) -> None:
    """Add ``--skills DIR``."""
    parser.add_argument(
        "--skills",
        metavar="DIR",
        type=Path,
        action="append",
        default=[],
        help="folder with your own skills, in addition to the shipped ones (may be repeated)",
    )


def add_params(parser: argparse.ArgumentParser) -> None:
    """Add ``--param NAME=VALUE``."""
    parser.add_argument(
        "--param",
        metavar="NAME=VALUE",
        type=_assignment,
        action="append",
        default=[],
        help="set a parameter that the file declares (may be repeated)",
    )


def _assignment(text: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not name or not equals:
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form NAME=VALUE")
    return name, value


def add_view(parser: argparse.ArgumentParser) -> None:
    """Add ``--view-port N`` and ``--view-host ADDRESS``."""
    add = parser.add_argument
    add(
        "--view-port",
        metavar="N",
        type=_port,
        default=0,
        help="port of the page (default: any free port)",
    )
    add(
        "--view-host",
        metavar="ADDRESS",
        default="127.0.0.1",
        help="IPv4 address of another interface of this machine on which to serve the page; anyone "
        "who knows the page's address can then press its buttons (default: 127.0.0.1)",
    )


def seed(text: str) -> int:
    """The value of ``--seed``."""
    if not text.isascii() or not text.isdecimal() or int(text) >= 2**32:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 0 to 4294967295")
    return int(text)


def _port(text: str) -> int:
    if not text.isascii() or not text.isdecimal() or int(text) > 65535:
        raise argparse.ArgumentTypeError(f"{text!r} is not a port from 0 to 65535")
    return int(text)


def print_parts(*parts: str | Table) -> None:
    """Print lines and tables one below the other."""
    from rich.console import Console

    console = Console(highlight=False)
    for part in parts:
        console.print(part)


def print_json(content: object) -> None:
    """Print JSON for programs."""
    print(json.dumps(content, indent=2, ensure_ascii=False))


def table(titles: Sequence[str], rows: Iterable[Sequence[str]]) -> Table:
    """Table with titles and without a frame; the first column is never wrapped."""
    from rich.table import Table

    rows_of = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="dim")
    first, *others = titles
    rows_of.add_column(f"  {first}", no_wrap=True)
    for title in others:
        rows_of.add_column(title)
    for name, *cells in rows:
        rows_of.add_row(f"  {escape(name)}", *map(escape, cells))
    return rows_of


def escape(text: str) -> str:
    """The text with rich's markup escaped."""
    from rich.markup import escape as escaped

    return escaped(text)


IMPORT_S: Final = 30.0
"""Default wall-clock budget in s for the import of all skills."""


def imported_skills(
    program: str, folders: Sequence[Path], seconds: float | None = None
) -> Registry:
    """Registry of the installed skills and those in folders, each file imported once per process.

    Module-level code of skills is user code, so it runs under a watchdog.

    Args:
        program: Name of the program, for the error message of the last resort.
        folders: Folders of the user.
        seconds: Wall-clock budget in s; infinity for no limit, by default `IMPORT_S`.

    Raises:
        Overrun: A file was not imported in time; the message names the line.
        RegistryError: A skill is invalid.
        DualArmError: A file raises KeyboardInterrupt.
    """
    from bt_dualarm.cli.entry import ProcessEnd, exit_refused
    from bt_dualarm.core.errors import DualArmError, Interruption
    from bt_dualarm.runtime.signals import StopRequest
    from bt_dualarm.runtime.watchdog import Watchdog
    from bt_dualarm.skill.registry import Registry

    stop = StopRequest()
    watchdog = Watchdog(
        IMPORT_S if seconds is None else seconds, stop, owner="the import of skills"
    )
    last_resort = ProcessEnd(program, stop)
    with last_resort as watchdog.last_resort, closing(watchdog), watchdog.awake(), exit_refused():
        try:
            with watchdog:
                return Registry.load(folders)
        except (KeyboardInterrupt, Interruption) as error:
            if early:  # a signal was received
                raise
            raise DualArmError(" ".join(error.__notes__)) from error
