"""The command ``bt-experiments``: run the tracking experiments and write their report."""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, get_args

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from bt_dualarm.errors import DualArmError
from bt_dualarm.experiments.cases import (
    CASES,
    JERK,
    UNTUNED,
    Cell,
    ControllerName,
    CurveName,
    RendererName,
)

if TYPE_CHECKING:
    from bt_dualarm.experiments.results import Result

_EXAMPLES = """\
examples:
  bt-experiments                                    all five, both controllers, into out/experiments
  bt-experiments --seeds 10 --fps 30 --out out/slow
  bt-experiments --untuned --controller predictive  five curves that nothing was tuned on
  bt-experiments --case circle --speed 1.0 --controller predictive --seeds 1 --json cell.json

exit code: 0 every run was measured, 1 one was not, 2 the command is wrong
"""

_WIDTH = 110
"""Characters of a line where no terminal says how many there are."""


def command_line() -> argparse.ArgumentParser:
    """The parser of ``bt-experiments``."""
    parser = argparse.ArgumentParser(
        prog="bt-experiments",
        description="Run the five tracking experiments, or some of them, and write a report.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("--untuned", action="store_true", help="five other curves, which nothing was tuned on")
    add("--case", choices=get_args(CurveName), help="only this curve")
    add("--speed", type=float, metavar="S", help="of the leading arm, 0.05 to 1 (default: all)")
    add("--controller", choices=("proportional", "predictive"), help="only this one")
    add(
        "--renderer",
        choices=("gl", "ray"),
        help="only this one (default: those that work here; ray where case, speed and controller "
        "leave one experiment)",
    )
    add(
        "--jobs",
        type=_count,
        metavar="N",
        help="runs side by side, for the same numbers (default: one for each core)",
    )
    add("--seeds", type=_count, default=3, metavar="N", help="repetitions (default: 3)")
    add("--fps", type=float, default=60.0, help="of the camera (default: 60)")
    add("--latency", type=float, metavar="S", help="of a frame (default: the time of one frame)")
    add("--drop", type=float, default=0.0, help="share of the frames that get lost, 0 to 0.9")
    add("--noise", type=float, default=0.0, metavar="PX", help="shake of the camera")
    add(
        "--jerk",
        type=float,
        default=JERK,
        metavar="S",
        help=f"share of the leading arm's limit of jerk, 0.05 to 1 (default: {JERK:g})",
    )
    add("--json", type=Path, metavar="FILE", help="write the numbers there; no report unless --out")
    add("--out", type=Path, metavar="DIR", help="of the report (default: out/experiments)")
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run what was asked for; returns the exit code.

    Args:
        argv: Arguments without the program's name; those of the process by default.
    """
    arguments = command_line().parse_args(argv)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as in `bt_dualarm.cli`
    errors = Console(stderr=True, highlight=False)
    try:
        cells = list(_cells(arguments))
        results, failures = _run(cells, arguments.seeds, arguments.jobs)
    except DualArmError as error:
        errors.print(f"bt-experiments: error: {error}", markup=False, soft_wrap=True)
        return 2
    for failure in failures:
        errors.print(f"bt-experiments: {failure}", markup=False, soft_wrap=True)
    if results:
        _write(arguments, results)
    return 1 if failures else 0


def _count(text: str) -> int:
    if not text.isdecimal() or not 1 <= int(text) <= 1000:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number from 1 to 1000")
    return int(text)


def _cells(arguments: argparse.Namespace) -> Iterator[Cell]:
    """The experiments that were asked for, in the order of the table."""
    both: tuple[ControllerName, ...] = ("proportional", "predictive")
    settings = {
        "fps": arguments.fps,
        "latency": arguments.latency,
        "drop": arguments.drop,
        "noise": arguments.noise,
        "jerk": arguments.jerk,
    }
    curves = _curves(arguments)
    single = len(curves) == 1 and arguments.controller
    for renderer in (arguments.renderer,) if arguments.renderer else _renderers(single=single):
        for cell in curves:
            for controller in (arguments.controller,) if arguments.controller else both:
                yield replace(cell, controller=controller, renderer=renderer, **settings)


def _curves(arguments: argparse.Namespace) -> list[Cell]:
    """Curves and speeds alone.

    Raises:
        DualArmError: None is left.
    """
    cells = UNTUNED if arguments.untuned else tuple(Cell(case, speed) for case, speed in CASES)
    cells = tuple(cell for cell in cells if arguments.case in (None, cell.case))
    if not cells:
        raise DualArmError(f"{arguments.case} is not among these curves: see --untuned")
    if arguments.speed is None:
        return list(cells)
    slower = (replace(cell, speed=arguments.speed) for cell in cells)
    return list({cell.name: cell for cell in slower}.values())


def _renderers(*, single: bool) -> tuple[RendererName, ...]:
    """One where one experiment was asked for, the same on every machine; else all there are."""
    if single:
        return ("ray",)
    from bt_dualarm.errors import RendererError
    from bt_dualarm.world.rendering import choose_renderer

    try:
        choose_renderer("gl")
    except RendererError:
        return ("ray",)
    return ("ray", "gl")


def _run(cells: Sequence[Cell], seeds: int, jobs: int | None) -> tuple[list[Result], list[str]]:
    """Every cell with every seed; what could not be measured is a sentence."""
    from bt_dualarm.experiments.results import Result
    from bt_dualarm.experiments.trial import TrialError, tree_file
    from bt_dualarm.experiments.trials import run_trials, usable_cores
    from bt_dualarm.registry import Registry

    registry, results, failures = Registry.load(), [], []
    for cell in cells:
        tree_file(cell, registry)  # what it refuses is said before anything runs
    runs = [(cell, seed) for cell in cells for seed in range(seeds)]
    coming = zip(runs, run_trials(runs, registry, jobs or usable_cores()), strict=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, TimeElapsedColumn(), console=Console(stderr=True)) as progress:
        task = progress.add_task("", total=len(runs))
        for cell in cells:
            progress.update(task, description=f"{cell.name} {cell.controller} {cell.renderer}")
            trials = []
            for (_, seed), trial in islice(coming, seeds):
                if isinstance(trial, TrialError):
                    failures.append(f"{cell.name} {cell.controller}, seed {seed}: {trial}")
                else:
                    trials.append(trial)
                progress.advance(task)
            if trials:
                results.append(Result(cell, trials))
    return results, failures


def _write(arguments: argparse.Namespace, results: Sequence[Result]) -> None:
    from bt_dualarm.experiments.report import HEADER, row, write_report
    from bt_dualarm.run.whole_files import write_text

    table = Table(*map(escape, HEADER[:9]))
    for result in results:
        table.add_row(*row(result)[:9])
    console = Console(highlight=False)
    if not console.is_terminal:
        console = Console(highlight=False, width=_WIDTH)
    console.print(table)
    if arguments.json is not None:
        contents = [result.as_json() for result in results]
        content = contents[0] if len(contents) == 1 else {"cells": contents}
        write_text(arguments.json, json.dumps(content, indent=2) + "\n")
        console.print(f"written: {arguments.json}", markup=False, soft_wrap=True)
    if arguments.out is not None or arguments.json is None:
        folder = arguments.out or Path("out/experiments")
        write_report(folder, results)
        console.print(f"report: {folder / 'report.html'}", markup=False, soft_wrap=True)
