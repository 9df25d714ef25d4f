"""``bt-experiments``: run the tracking experiments and write their report."""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from bt_dualarm.cli.early_signals import early
from bt_dualarm.cli.entry import FAILED, SUCCEEDED
from bt_dualarm.cli.experiment_arguments import cells_of, command_line
from bt_dualarm.errors import DualArmError
from bt_dualarm.runtime.signals import StopRequest, stop_on_signals

if TYPE_CHECKING:
    from bt_dualarm.experiments.campaign import Campaign
    from bt_dualarm.experiments.results import Result

_REPORT: Final = Path("out/experiments")


def main(argv: Sequence[str] | None) -> int:
    """Run what was asked for; returns the exit code."""
    arguments = command_line().parse_args(argv)
    with stop_on_signals(StopRequest()) as stop:
        for number in early.numbers:  # one that was lost on its way through the imports
            stop.receive(number)
        code = _run(arguments, stop)
        return stop.exit_code or code


def _run(arguments: argparse.Namespace, stop: StopRequest) -> int:
    from rich.console import Console

    from bt_dualarm.experiments.campaign import run_all
    from bt_dualarm.experiments.trials import usable_cores

    cells = list(cells_of(arguments))
    for folder in _folders(arguments):
        _refuse_unwritable(folder)
    jobs = arguments.jobs or usable_cores()
    done = run_all(cells, arguments.seeds, jobs, stop, Console(stderr=True, highlight=False))
    for failure in done.failures:
        _say(failure)
    if stop.asked:
        _say(f"interrupted: {len(done.results)} of {len(cells)} experiments are complete")
    written = not done.results or stop.urgent or _write(arguments, done)
    return SUCCEEDED if written and not done.failures else FAILED


def _say(words: str) -> None:
    print(f"bt-experiments: {words}", file=sys.stderr)


def _report_folder(arguments: argparse.Namespace) -> Path | None:
    """Where the report goes; None where only the numbers are wanted."""
    wanted: Path | None = arguments.out
    return wanted or (_REPORT if arguments.json is None else None)


def _folders(arguments: argparse.Namespace) -> list[Path]:
    """Every folder that is to be written to.

    Raises:
        DualArmError: A folder has the name of the file.
    """
    report = _report_folder(arguments)
    if arguments.json is not None and arguments.json.is_dir():
        raise DualArmError(f"cannot write {arguments.json}: it is a folder")
    return [*([report] if report else []), *([arguments.json.parent] if arguments.json else [])]


def _refuse_unwritable(folder: Path) -> None:
    """Make a folder and write to it, now rather than after all runs.

    Raises:
        DualArmError: That cannot be done.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(b"0")
    except FileExistsError:
        raise DualArmError(f"cannot write to {folder}: it is there and is not a folder") from None
    except OSError as error:
        raise DualArmError(f"cannot write to {folder}: {error.strerror or error}") from error


def _write(arguments: argparse.Namespace, done: Campaign) -> bool:
    """Show and write the results; whether all of it could be written."""
    from rich.console import Console

    from bt_dualarm.experiments.table import table_of

    console = Console(highlight=False)
    console.print(table_of(done.results))
    try:
        for line in _written(arguments, done.results):
            console.print(line, markup=False, soft_wrap=True)
    except OSError as error:
        _say(f"error: cannot write {error.filename}: {error.strerror or error}")
        return False
    return True


def _written(arguments: argparse.Namespace, results: Sequence[Result]) -> list[str]:
    """Write the numbers, then the report; returns a line on each."""
    from bt_dualarm.experiments.report import write_report
    from bt_dualarm.runtime.atomic_write import write_text

    lines = []
    if arguments.json is not None:
        contents = [result.as_json() for result in results]
        content = contents[0] if len(contents) == 1 else {"cells": contents}
        write_text(arguments.json, json.dumps(content, indent=2) + "\n")
        lines.append(f"written: {arguments.json}")
    folder = _report_folder(arguments)
    if folder is not None:
        write_report(folder, results)
        lines.append(f"report: {folder / 'report.html'}")
    return lines
