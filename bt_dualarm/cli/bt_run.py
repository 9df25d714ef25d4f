"""``bt-run``: from a tree file to an exit code."""

from __future__ import annotations

import argparse
import logging
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from bt_dualarm.cli.early_signals import early
from bt_dualarm.cli.entry import FAILED, OVERRUN, SUCCEEDED, UNUSABLE, complain
from bt_dualarm.cli.run_arguments import command_line
from bt_dualarm.cli.viewing import drop_record, linger, record_folder, viewed, watched
from bt_dualarm.errors import DualArmError
from bt_dualarm.runtime.signals import StopRequest, stop_on_signals

if TYPE_CHECKING:
    from bt_dualarm.runtime.result import RunResult
    from bt_dualarm.runtime.run import Run

_ENDLESS = 10**4
"""Lines of a terminal that is not to fold any tree."""


def main(argv: Sequence[str] | None) -> int:
    """Run a tree file; returns the exit code.

    Args:
        argv: Arguments without the program's name; those of the process by default.
    """
    stop = StopRequest()
    try:
        code = _command(argv, stop)
    except DualArmError as error:
        complain("bt-run", error)
        code = UNUSABLE
    return stop.exit_code or code


def _command(argv: Sequence[str] | None, stop: StopRequest) -> int:
    parser = command_line()
    arguments = parser.parse_args(argv)
    if arguments.version:
        return _version()
    if arguments.list:
        return _list()
    if arguments.resume is not None and arguments.real_time:
        parser.error("--real-time and --resume exclude each other")
    if arguments.frames and arguments.record is None:
        parser.error("--frames keeps pictures in a record: --record DIR says where")
    if arguments.file is None and arguments.resume is None:
        parser.error("which tree file? (bt-run --list names the shipped ones)")
    if arguments.watch and arguments.file is None:
        parser.error("--watch: which tree file?")
    return _run(arguments, stop)


def _version() -> int:
    from importlib.metadata import version

    print(f"bt-run {version('bt_dualarm')}")
    return SUCCEEDED


def _list() -> int:
    from bt_dualarm.runtime.shipped import shipped_trees

    trees = shipped_trees()
    width = max((len(tree.name) for tree in trees), default=0)
    lines = [f"{tree.name:<{width}}  {tree.description}".rstrip() for tree in trees]
    print("\n".join(lines), flush=True)
    return SUCCEEDED


def _run(arguments: argparse.Namespace, stop: StopRequest) -> int:
    """Open the file, run it, and say how it went."""
    with (
        _logging(),
        record_folder(arguments) as folder,
        _opened(arguments, folder, stop) as opened,
    ):
        if arguments.display != "quiet":
            for warning in opened.warnings:
                print(warning, file=sys.stderr)
        if arguments.dry_run:
            return _show_trees(arguments, opened)
        from bt_dualarm.cli.last_resort import ProcessEnd, exit_refused

        with stop_on_signals(stop), exit_refused(), ProcessEnd("bt-run", stop) as last_resort:
            opened.watchdog.last_resort = last_resort
            for number in early.numbers:  # one that was lost on its way through the imports
                stop.receive(number)
            with (
                viewed(arguments, opened, stop) as view,
                watched(arguments, opened, view),
            ):
                if view is not None:
                    view.gate.hold()
                code = _show(arguments, opened)
                if view is not None:
                    linger(view)
            opened.close()
            return code


def _opened(arguments: argparse.Namespace, folder: Path | None, stop: StopRequest) -> Run:
    from bt_dualarm.runtime.shipped import find_tree

    if arguments.resume is not None:
        from bt_dualarm.cli.resuming import opened_again

        return opened_again(arguments, folder, stop)
    tree = find_tree(arguments.file)  # a slip is told before all that is heavy is imported

    from bt_dualarm.cli.skill_import import imported_skills
    from bt_dualarm.runtime import api

    imported_skills("bt-run", arguments.skills, arguments.watchdog)
    return api.open(
        tree,
        params=dict(arguments.param),
        seed=arguments.seed,
        duration=arguments.duration,
        renderer=arguments.renderer,
        reality=arguments.reality,
        record=folder,
        frames=arguments.frames and not arguments.dry_run,
        real_time=arguments.real_time,
        watchdog=arguments.watchdog,
        skills=arguments.skills,
        stop=stop,
    )


def _show_trees(arguments: argparse.Namespace, opened: Run) -> int:
    """Bring in everything that the file declares, and draw the trees of all arms."""
    from rich.console import Console

    from bt_dualarm.runtime.display import suited_symbols
    from bt_dualarm.runtime.layout import Picture

    opened.spawn_all()
    console = Console(highlight=False, height=_ENDLESS)
    symbols = suited_symbols(console, ascii_only=arguments.ascii)
    renderer = opened.renderer or ""
    console.print(Picture(opened.name, 0.0, None, renderer, opened.views(), symbols))
    return SUCCEEDED


def _show(arguments: argparse.Namespace, opened: Run) -> int:
    """Run it before somebody's eyes; the terminal is given back before the last words.

    Nobody waits for pictures to hear how it went.
    """
    from rich.console import Console

    from bt_dualarm.runtime.display import Caption, open_display, suited_mode, suited_symbols
    from bt_dualarm.runtime.report import Report

    console = Console(highlight=False)
    mode = suited_mode(console, arguments.display)
    symbols = suited_symbols(console, ascii_only=arguments.ascii)
    if mode != "quiet" and opened.renderer_message:
        print(opened.renderer_message, file=sys.stderr)
    caption = Caption(opened.name, opened.renderer or "")
    with open_display(mode, console, symbols, caption, time.perf_counter) as display:
        opened.watch(display)
        result = opened.finish()
    _say_what_broke(result, arguments.record)
    if mode != "quiet" or result.outcome != "SUCCESS":
        console = Console(stderr=mode == "quiet", highlight=False)
        console.print(Report(opened.name, result, arguments.record, symbols))
    drop_record(arguments, opened)
    return _code(result, complete=_written(opened))


def _code(result: RunResult, *, complete: bool) -> int:
    from bt_dualarm.runtime.outcome import Ending

    if result.ending is Ending.OVERRUN:
        return OVERRUN
    good = result.outcome == "SUCCESS" and result.at_rest and complete
    return SUCCEEDED if good else FAILED


def _written(opened: Run) -> bool:
    from bt_dualarm.runtime.record_folder import RecordError

    try:
        opened.write_record()
    except RecordError as error:
        complain("bt-run", error)
        return False
    return True


def _say_what_broke(result: RunResult, folder: Path | None) -> None:
    """An error of the run itself; what failed in a tree is in the report."""
    from bt_dualarm.runtime.outcome import Ending
    from bt_dualarm.runtime.record_folder import DIVERGENCE

    if result.ending is Ending.OVERRUN:
        print(f"bt-run: error: {result.error}", file=sys.stderr)
    elif result.ending is Ending.DIVERGED:
        where = (
            f"the last states are in {folder / DIVERGENCE}"
            if folder
            else "its last states were not kept; --record DIR keeps them"
        )
        print(f"bt-run: error: {result.error}; {where}", file=sys.stderr)
    elif result.error:
        print(f"bt-run: internal error: {result.error}", file=sys.stderr)


class _ToTerminal(logging.Handler):
    """Prints what is logged on the standard error of that moment, above a live display too."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print it, with its traceback; what would act on the terminal is only shown."""
        from bt_dualarm.spec.wording import one_line

        lines = self.format(record).split("\n")
        print(
            "\n".join(line if line.isprintable() else one_line(line) for line in lines),
            file=sys.stderr,
        )


@contextmanager
def _logging() -> Iterator[None]:
    """What the package and the skills log goes to the terminal."""
    logger = logging.getLogger("bt_dualarm")
    level, handler = logger.level, _ToTerminal()
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    try:
        yield
    finally:
        logger.setLevel(level)
        logger.removeHandler(handler)
