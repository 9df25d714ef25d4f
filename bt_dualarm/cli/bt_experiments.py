"""``bt-experiments``: run the tracking experiments and write their report."""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final, get_args

from bt_dualarm.cli.entry import FAILED, SUCCEEDED, early, positive
from bt_dualarm.core.errors import DualArmError
from bt_dualarm.experiments.trials import (
    CASES,
    JERK,
    UNTUNED,
    Cell,
    ControllerName,
    CurveName,
    RendererName,
)
from bt_dualarm.runtime.interruption import StopRequest, stop_on_signals
from bt_dualarm.spec.document import REALITY_NAMES

if TYPE_CHECKING:
    from bt_dualarm.experiments.report import Campaign, Result


# Arguments, and the experiments that they select.


_EXAMPLES: Final = """\
examples:
  bt-experiments                                    all of them, into out/experiments: 15 minutes
                                                    on two cores
  bt-experiments --seeds 10 --fps 30 --out out/slow
  bt-experiments --untuned --controller predictive  five curves not used for tuning
  bt-experiments --case circle --speed 1.0 --controller predictive --seeds 1 --json cell.json

exit code: 0 every run was measured and the report was written, 1 otherwise, 2 invalid command
line, 130 or 143 interrupted: completed experiments are written
"""


def command_line() -> argparse.ArgumentParser:
    """The parser of ``bt-experiments``."""
    parser = argparse.ArgumentParser(
        prog="bt-experiments",
        description="Run all or some of the five tracking experiments, and write a report.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("--untuned", action="store_true", help="five other curves, which were not used for tuning")
    add("--case", choices=get_args(CurveName), help="run only this curve")
    add(
        "--speed",
        type=float,
        metavar="S",
        help="speed of the leading arm, 0.05 to 1 (default: all)",
    )
    add("--controller", choices=("proportional", "predictive"), help="run only this one")
    add(
        "--renderer",
        choices=("ray", "gl", "both"),
        default="ray",
        help="camera renderer: ray casting, OpenGL, or each in turn (default: ray)",
    )
    add(
        "--jobs",
        type=_count,
        metavar="N",
        help="parallel runs; results do not depend on it (default: one per core)",
    )
    add("--seeds", type=_count, default=3, metavar="N", help="number of seeds (default: 3)")
    add("--fps", type=positive, default=60.0, help="frame rate of the camera (default: 60)")
    add("--latency", type=float, metavar="S", help="frame latency (default: one frame period)")
    add("--drop", type=float, default=0.0, help="fraction of lost frames, 0 to 0.9")
    add("--noise", type=float, default=0.0, metavar="PX", help="camera shake, standard deviation")
    meaning = "how far both arms deviate from their nominal models (default: lab)"
    add("--reality", choices=REALITY_NAMES, default="lab", help=meaning)
    add(
        "--jerk",
        type=float,
        default=JERK,
        metavar="S",
        help=f"fraction of the leading arm's jerk limit, 0.05 to 1 (default: {JERK:g})",
    )
    add(
        "--json",
        type=_path,
        metavar="FILE",
        help="write the numbers; no report unless --out is given",
    )
    add("--out", type=_path, metavar="DIR", help="folder of the report (default: out/experiments)")
    return parser


def _count(text: str) -> int:
    if not text.isdecimal() or not 1 <= int(text) <= 1000:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number from 1 to 1000")
    return int(text)


def _path(text: str) -> Path:
    if not text.strip():
        raise argparse.ArgumentTypeError("empty name; '.' is the current folder")
    return Path(text)


def cells_of(arguments: argparse.Namespace) -> Iterator[Cell]:
    """The selected experiments, in the order of the table.

    Raises:
        DualArmError: None is selected, or OpenGL was requested and does not work here.
    """
    both: tuple[ControllerName, ...] = ("proportional", "predictive")
    settings = {
        "fps": arguments.fps,
        "latency": arguments.latency,
        "drop": arguments.drop,
        "noise": arguments.noise,
        "jerk": arguments.jerk,
        "reality": arguments.reality,
    }
    curves = _curves(arguments)
    for renderer in _renderers(arguments.renderer):
        for cell in curves:
            for controller in (arguments.controller,) if arguments.controller else both:
                yield replace(cell, controller=controller, renderer=renderer, **settings)


def _curves(arguments: argparse.Namespace) -> list[Cell]:
    """Cells with curve and speed only.

    Raises:
        DualArmError: None is left.
    """
    cells = UNTUNED if arguments.untuned else tuple(Cell(case, speed) for case, speed in CASES)
    cells = tuple(cell for cell in cells if arguments.case in (None, cell.case))
    if not cells:
        raise DualArmError(f"{arguments.case} is not one of these curves; see --untuned")
    if arguments.speed is None:
        return list(cells)
    slower = (replace(cell, speed=arguments.speed) for cell in cells)
    return list({cell.name: cell for cell in slower}.values())


def _renderers(asked: str) -> tuple[RendererName, ...]:
    """The requested renderer, or both.

    Raises:
        RendererError: OpenGL was requested and does not work here; reported before the first run.
    """
    if asked == "ray":
        return ("ray",)
    from bt_dualarm.sim.renderers import choose_renderer

    choose_renderer("gl")
    return ("gl",) if asked == "gl" else ("ray", "gl")


# The command itself.


_REPORT: Final = Path("out/experiments")


def main(argv: Sequence[str] | None) -> int:
    """Run the selected experiments; returns the exit code."""
    arguments = command_line().parse_args(argv)
    with stop_on_signals(StopRequest()) as stop:
        for number in early.numbers:  # signals received during the imports
            stop.receive(number)
        code = _run(arguments, stop)
        return stop.exit_code or code


def _run(arguments: argparse.Namespace, stop: StopRequest) -> int:
    from rich.console import Console

    from bt_dualarm.experiments.report import run_all
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
    """Folder of the report; None if only the numbers are written."""
    wanted: Path | None = arguments.out
    return wanted or (_REPORT if arguments.json is None else None)


def _folders(arguments: argparse.Namespace) -> list[Path]:
    """Every folder to which the command writes.

    Raises:
        DualArmError: The path of the numbers is a folder.
    """
    report = _report_folder(arguments)
    if arguments.json is not None and arguments.json.is_dir():
        raise DualArmError(f"cannot write {arguments.json}: it is a folder")
    return [*([report] if report else []), *([arguments.json.parent] if arguments.json else [])]


def _refuse_unwritable(folder: Path) -> None:
    """Create a folder and test that it is writable, now rather than after all runs.

    Raises:
        DualArmError: The folder cannot be created or written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(b"0")
    except FileExistsError:
        raise DualArmError(f"cannot write to {folder}: it exists and is not a folder") from None
    except OSError as error:
        raise DualArmError(f"cannot write to {folder}: {error.strerror or error}") from error


def _write(arguments: argparse.Namespace, done: Campaign) -> bool:
    """Show and write the results; returns whether everything could be written."""
    from rich.console import Console

    from bt_dualarm.experiments.report import table_of

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
    """Write the numbers, then the report; returns one line on each."""
    from bt_dualarm.core.share import write_text
    from bt_dualarm.experiments.report import write_report

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
