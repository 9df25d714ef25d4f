"""``bt-run``: from a tree file to an exit code."""

from __future__ import annotations

import argparse
import logging
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from bt_dualarm.cli.run_arguments import command_line
from bt_dualarm.cli.words import (
    FAILED,
    SUCCEEDED,
    UNUSABLE,
    complain,
    nobody_reads,
    prepare_imports,
)
from bt_dualarm.errors import DualArmError
from bt_dualarm.run.signals import StopRequest, stop_on_signals

if TYPE_CHECKING:
    from bt_dualarm.run.outcome import RunResult
    from bt_dualarm.run.record import Recorder
    from bt_dualarm.run.session import Session
    from bt_dualarm.spec.document import TreeFile

_ENDLESS = 10**4
"""Lines of a terminal that is not to fold any tree."""


def run(argv: Sequence[str] | None = None) -> int:
    """Run a tree file; returns the exit code.

    Args:
        argv: Arguments without the program's name; those of the process by default.
    """
    parser = command_line()
    arguments = parser.parse_args(argv)
    prepare_imports()
    with stop_on_signals(StopRequest()) as stop:
        try:
            if arguments.version:
                return _version()
            if arguments.list:
                return _list()
            if arguments.file is None:
                parser.error("which tree file? (bt-run --list names the shipped ones)")
            code = _run(arguments, stop)
        except DualArmError as error:
            complain("bt-run", error)
            code = UNUSABLE
        except BrokenPipeError:
            code = nobody_reads()
        return stop.exit_code or code


def _version() -> int:
    from importlib.metadata import version

    print(f"bt-run {version('bt_dualarm')}")
    return SUCCEEDED


def _list() -> int:
    from bt_dualarm.run.shipped import shipped_trees

    trees = shipped_trees()
    width = max((len(tree.name) for tree in trees), default=0)
    lines = [f"{tree.name:<{width}}  {tree.description}".rstrip() for tree in trees]
    print("\n".join(lines), flush=True)
    return SUCCEEDED


def _run(arguments: argparse.Namespace, stop: StopRequest) -> int:
    """Check the file, run it, and say how it went."""
    from bt_dualarm.run.shipped import find_tree

    path = find_tree(arguments.file)

    from bt_dualarm.preflight.check import check
    from bt_dualarm.registry import Registry
    from bt_dualarm.run.session import Session, Wishes

    registry = Registry.load(arguments.skills)
    # The session composes the world itself, and says the same of what cannot be composed.
    checked = check(path, registry.kinds, dict(arguments.param), build=False)
    file = checked.runnable()
    if arguments.display != "quiet":
        for warning in checked.problems:
            print(warning, file=sys.stderr)
    wishes = Wishes(arguments.seed, arguments.duration, arguments.renderer)
    with Session(file, registry, wishes) as session:
        if arguments.dry_run:
            return _show_trees(arguments, file, session)
        recorder = session.recorder(arguments.record) if arguments.record else None
        with _logging(recorder):
            return _show(arguments, file, session, recorder, stop)


def _show_trees(arguments: argparse.Namespace, file: TreeFile, session: Session) -> int:
    """Bring in everything that the file declares, and draw the trees of all arms."""
    from bt_dualarm.run.display import Terminal, suited_symbols
    from bt_dualarm.run.layout import Picture

    world, arms = session.assembly.world, session.assembly.arms
    for name in file.arms.keys() - world.arms.keys():
        world.spawn_arm(name)
    arms.follow(0, ticked_from=0)
    console = Terminal(highlight=False, height=_ENDLESS)
    symbols = suited_symbols(console, ascii_only=arguments.ascii)
    renderer = session.renderer_name or ""
    console.print(Picture(file.name, 0.0, None, renderer, arms.views(), symbols))
    return SUCCEEDED


def _show(
    arguments: argparse.Namespace,
    file: TreeFile,
    session: Session,
    recorder: Recorder | None,
    stop: StopRequest,
) -> int:
    """Run it before somebody's eyes; the terminal is given back before the last words."""
    from bt_dualarm.run.display import (
        Caption,
        Terminal,
        open_display,
        suited_mode,
        suited_symbols,
    )
    from bt_dualarm.run.pacing import RealTime
    from bt_dualarm.run.report import Report

    console = Terminal(highlight=False)
    mode = suited_mode(console, arguments.display)
    symbols = suited_symbols(console, ascii_only=arguments.ascii)
    if mode != "quiet" and session.assembly.message:
        print(session.assembly.message, file=sys.stderr)
    caption = Caption(file.name, session.renderer_name or "")
    pacer = RealTime(time.perf_counter, time.sleep) if arguments.real_time else None
    with open_display(mode, console, symbols, caption, time.perf_counter) as display:
        observers = [display] if recorder is None else [recorder, display]
        result = session.run(observers, time.perf_counter, stop, pacer)
    complete = recorder is None or _written(recorder, result, stop)
    _say_what_broke(result, arguments.record)
    if mode != "quiet":
        console.print(Report(file.name, result, arguments.record, symbols))
    elif result.outcome != "SUCCESS":
        errors = Terminal(stderr=True, highlight=False)
        errors.print(Report(file.name, result, arguments.record, symbols))
    good = result.outcome == "SUCCESS" and result.at_rest and complete
    return SUCCEEDED if good else FAILED


def _written(recorder: Recorder, result: RunResult, stop: StopRequest) -> bool:
    from bt_dualarm.run.record import RecordError

    try:
        recorder.write(result, stop)
    except RecordError as error:
        complain("bt-run", error)
        return False
    return True


def _say_what_broke(result: RunResult, folder: Path | None) -> None:
    """An error of the run itself; what failed in a tree is in the report."""
    from bt_dualarm.run.outcome import Ending
    from bt_dualarm.run.record import DIVERGENCE

    if result.ending is Ending.DIVERGED:
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
        """Print it, with its traceback."""
        print(self.format(record), file=sys.stderr)


@contextmanager
def _logging(recorder: Recorder | None) -> Iterator[None]:
    """What the package and the skills log goes to the terminal, and into the record."""
    logger = logging.getLogger("bt_dualarm")
    level, handler = logger.level, _ToTerminal()
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    with ExitStack() as stack:
        stack.callback(logger.setLevel, level)
        stack.callback(logger.removeHandler, handler)
        if recorder is not None:
            stack.enter_context(recorder.logging(logger))
        yield
