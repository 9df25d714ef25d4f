"""``bt-run``: runs a tree file and returns an exit code."""

from __future__ import annotations

import argparse
import logging
import math
import os
import re
import shutil
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory, gettempdir
from typing import TYPE_CHECKING, Final

from bt_dualarm.cli.entry import (
    FAILED,
    OVERRUN,
    SUCCEEDED,
    UNUSABLE,
    add_params,
    add_skills,
    add_view,
    complain,
    early,
    given_path,
    imported_skills,
    seed,
)
from bt_dualarm.core.errors import DualArmError
from bt_dualarm.runtime.interruption import StopRequest, stop_on_signals

if TYPE_CHECKING:
    from bt_dualarm.runtime.outcome import RunResult
    from bt_dualarm.runtime.run import Run
    from bt_dualarm.viewer.live_view import LiveView


_EXAMPLES = """\
examples:
  bt-run pick_and_track                     a shipped tree by name, from any folder
  bt-run my_tree.yaml --record out/first    write summary, events, samples and plots
  bt-run circle --display log --seed 3      one line per change; another random layout
  bt-run pick_and_track --real-time         no faster than the wall clock
  bt-run --resume out@12.4                  continue the run recorded in out from 12.4 s
  bt-run my_tree.yaml --resume out@12.4     with an edited tree; its past must be the same
  bt-run pick_and_track --view              watch it in a browser; pause, step, breakpoints
  bt-run my_tree.yaml --watch --view        edit the tree while it runs
  bt-run --list                             list the shipped trees

exit code:
  0 every tree succeeded   1 a tree failed or did not finish   2 invalid file or command line
  129, 130, 143 stopped by SIGHUP (the terminal was closed), SIGINT (Ctrl-C) or SIGTERM; a second
  signal ends the run without waiting for arms and plots
  154 skill code did not return in time (--watchdog)
"""


def command_line() -> argparse.ArgumentParser:
    """The parser of ``bt-run``; building it needs no slow import."""
    parser = argparse.ArgumentParser(
        prog="bt-run",
        description="Run the behavior trees of a file, one per robot arm, in one simulated world.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("file", metavar="FILE", nargs="?", help="a tree file, or the name of a shipped tree")
    add("--list", action="store_true", help="list the shipped trees and exit")
    add(
        "--resume",
        metavar="DIR@S",
        help="continue from S simulated seconds of the record in DIR, with its tree or FILE",
    )
    add(
        "--record",
        metavar="DIR",
        type=given_path,
        help="write summary, events, samples and plots to this folder",
    )
    add(
        "--frames",
        action="store_true",
        help="also write the camera images to the folder of --record",
    )
    add(
        "--display",
        choices=("live", "log", "quiet"),
        help="live: the trees, redrawn; log: one line per change; quiet: errors only "
        "(default: live in a terminal, otherwise log)",
    )
    add("--ascii", action="store_true", help="draw with ASCII characters only")
    add("--seed", metavar="N", type=seed, help="random seed (default: the file's)")
    _add_conditions(parser)
    add(
        "--dry-run",
        action="store_true",
        help="build everything and print the trees, without running",
    )
    add_skills(parser)
    add_params(parser)
    add("--version", action="store_true", help="print the version and exit")
    return parser


def _add_conditions(parser: argparse.ArgumentParser) -> None:
    """Add the options of a run."""
    add = parser.add_argument
    add("--duration", metavar="S", type=_seconds, help="end after this simulated time")
    add(
        "--renderer",
        choices=("ray", "gl", "auto"),
        help="camera renderer: ray casting, OpenGL, or OpenGL if available (default: the file's)",
    )
    add(
        "--reality",
        choices=("ideal", "lab", "rough"),
        help="how far all arms deviate from their nominal models (default: the file's)",
    )
    add(
        "--faults",
        metavar="FILE",
        type=given_path,
        help="inject the faults in the section 'faults' of this file, in addition to the tree's",
    )
    add(
        "--view", action="store_true", help="show the run in a browser; it starts when you click Go"
    )
    add_view(parser)
    add(
        "--watch",
        action="store_true",
        help="reload the trees whenever the file is saved: unchanged running leaves continue, "
        "others restart; errors are reported, and the run continues unchanged",
    )
    add("--real-time", action="store_true", help="run no faster than the wall clock")
    add(
        "--watchdog",
        metavar="S",
        type=_budget,
        default=30.0,
        help="end the run if a tick or callback of a skill, or the import of all skills, does not "
        "return within this wall-clock time (default: 30; 0: no limit)",
    )


def _seconds(text: str) -> float:
    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if not (seconds > 0 and math.isfinite(seconds)):
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of seconds above 0")
    return seconds


def _budget(text: str) -> float:
    if text.strip() == "off":
        return math.inf
    try:
        return math.inf if float(text) == 0.0 else _seconds(text)
    except (ValueError, argparse.ArgumentTypeError):
        message = f"{text!r} is not a number of seconds above 0, nor 0 for no limit"
        raise argparse.ArgumentTypeError(message) from None


_REPLACED = ("seed", "duration", "renderer", "reality")
"""Options of a record that the command line may replace."""


def opened_again(arguments: argparse.Namespace, kept: Path | None, stop: StopRequest) -> Run:
    """Repeat the run of a record up to the time from which it continues.

    Args:
        arguments: Arguments of ``bt-run``.
        kept: Folder of the record of the new run, None for no record.
        stop: Request to end early.

    Raises:
        ReplayError: There is no such record or time, or the past differs.
        DualArmError: The run cannot be prepared.
    """
    # Imported here, because a run without --resume does not need the packages for replay.
    from bt_dualarm.replay.record import Record, ReplayError
    from bt_dualarm.replay.rerun import Changed, parse_place, resumed
    from bt_dualarm.runtime.options import find_tree

    folder, time = parse_place(arguments.resume)
    record = Record.read(folder)
    given = {name: getattr(arguments, name) for name in _REPLACED}
    options = {name: value for name, value in given.items() if value is not None}
    options |= {"watchdog": arguments.watchdog, "duration": arguments.duration}
    if kept is not None:
        if kept.resolve() == folder.resolve():
            raise ReplayError(f"{folder} is being read; --record needs another folder")
        options |= {"record": kept, "frames": arguments.frames}
    tree = None if arguments.file is None else find_tree(arguments.file)
    registry = imported_skills("bt-run", arguments.skills, arguments.watchdog)
    changed = Changed(tree, options, dict(arguments.param))
    run = resumed(record, time, registry, changed, stop)
    if arguments.display != "quiet":
        print(f"continued from the past of {folder} up to {run.time:.3f} s", file=sys.stderr)
    return run


_FOLDER_NAME: Final = re.compile(r"bt_dualarm_view_(\d{1,9})_\w+")


@contextmanager
def view_folder() -> Iterator[Path]:
    """Temporary folder for the record of a view; folders left by killed processes are removed."""
    _clear_left_behind()
    prefix = f"bt_dualarm_view_{os.getpid()}_"
    with TemporaryDirectory(prefix=prefix, ignore_cleanup_errors=True) as folder:
        yield Path(folder)


def _clear_left_behind() -> None:
    """Remove this user's folders whose process has ended."""
    for folder in Path(gettempdir()).glob("bt_dualarm_view_*"):
        named = _FOLDER_NAME.fullmatch(folder.name)
        if named and not _lives(int(named[1])) and _is_own(folder):
            shutil.rmtree(folder, ignore_errors=True)


def _is_own(folder: Path) -> bool:
    try:
        return folder.lstat().st_uid == os.getuid() and not folder.is_symlink()
    except OSError:  # another process has removed it
        return False


def _lives(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:  # a process of another user
        return True
    return True


@contextmanager
def record_folder(arguments: argparse.Namespace) -> Iterator[Path | None]:
    """Folder of the record; for a view without ``--record`` a temporary one."""
    if arguments.dry_run:
        yield None
    elif arguments.record is not None or not arguments.view:
        yield arguments.record
    else:
        with view_folder() as folder:
            yield folder


@contextmanager
def viewed(
    arguments: argparse.Namespace, opened: Run, stop: StopRequest
) -> Iterator[LiveView | None]:
    """Serve the page within the block, if ``--view`` is given.

    The viewer is imported only then.
    """
    if not arguments.view:
        yield None
        return
    from bt_dualarm.viewer.live_view import LiveView

    with LiveView(opened, stop, arguments.view_port, arguments.view_host) as view:
        print(f"waiting for Go at {view.url}", file=sys.stderr, flush=True)
        yield view


def linger(view: LiveView) -> None:
    """After the run, keep serving while a page is open."""
    if view.is_watched:
        message = "the run has ended; the page is served until it is closed, or until Ctrl-C"
        print(message, file=sys.stderr, flush=True)
    view.linger()


@contextmanager
def watched(arguments: argparse.Namespace, opened: Run, view: LiveView | None) -> Iterator[None]:
    """Apply the trees of the file whenever it is saved within the block, if ``--watch`` is given.

    Raises:
        DualArmError: The file has errors, or does not exist.
    """
    if not arguments.watch:
        yield
        return
    from bt_dualarm.runtime.api import registry_of
    from bt_dualarm.runtime.options import find_tree
    from bt_dualarm.runtime.run import FileWatch

    path = find_tree(arguments.file)
    registry = registry_of(arguments.skills)
    with FileWatch(opened, path, registry, dict(arguments.param)) as watch:
        if view is not None:
            view.gate.chores.append(watch.take)
        yield


def drop_record(arguments: argparse.Namespace, opened: Run) -> None:
    """Do not complete a record that exists only for the page."""
    if arguments.record is None and opened.open_record is not None:
        opened.open_record.recorder.close()


_UNFOLDED_HEIGHT = 10**4
"""Height in lines of a console that does not fold any tree."""


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
        parser.error("--real-time and --resume cannot be combined")
    if arguments.frames and arguments.record is None:
        parser.error("--frames writes images to a record; add --record DIR")
    for name in () if arguments.view else ("view_port", "view_host"):
        if getattr(arguments, name) != parser.get_default(name):
            parser.error(f"--{name.replace('_', '-')} is for the page of a run; add --view")
    if arguments.file is None and arguments.resume is None:
        parser.error("no tree file given (bt-run --list lists the shipped trees)")
    if arguments.faults is not None and arguments.resume is not None:
        parser.error("--resume injects the faults of its record; leave out --faults")
    if arguments.watch and arguments.file is None:
        parser.error("--watch: no tree file given")
    return _run(arguments, stop)


def _version() -> int:
    from importlib.metadata import version

    print(f"bt-run {version('bt_dualarm')}")
    return SUCCEEDED


def _list() -> int:
    from bt_dualarm.runtime.options import shipped_trees

    trees = shipped_trees()
    width = max((len(tree.name) for tree in trees), default=0)
    lines = [f"{tree.name:<{width}}  {tree.description}".rstrip() for tree in trees]
    print("\n".join(lines), flush=True)
    return SUCCEEDED


def _run(arguments: argparse.Namespace, stop: StopRequest) -> int:
    """Open the file, run it, and report the result."""
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
        from bt_dualarm.cli.entry import ProcessEnd, exit_refused

        with stop_on_signals(stop), exit_refused(), ProcessEnd("bt-run", stop) as last_resort:
            opened.watchdog.last_resort = last_resort
            for number in early.numbers:  # signals received during the imports
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
    from bt_dualarm.runtime.options import find_tree

    if arguments.resume is not None:
        return opened_again(arguments, folder, stop)
    tree = find_tree(arguments.file)  # reports a wrong name before the slow imports

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
        faults=arguments.faults,
        stop=stop,
    )


def _show_trees(arguments: argparse.Namespace, opened: Run) -> int:
    """Spawn everything that the file declares, and draw the trees of all arms."""
    from rich.console import Console

    from bt_dualarm.runtime.display import Picture, suited_symbols

    opened.spawn_all()
    console = Console(highlight=False, height=_UNFOLDED_HEIGHT)
    symbols = suited_symbols(console, ascii_only=arguments.ascii)
    renderer = opened.renderer or ""
    views = [replace(one, tree=opened.trees[one.name].snapshot()) for one in opened.views()]
    console.print(Picture(opened.name, opened.time, None, renderer, views, symbols))
    return SUCCEEDED


def _show(arguments: argparse.Namespace, opened: Run) -> int:
    """Run with a display, restore the terminal, and print the report before plots are drawn."""
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
    _print_run_error(result, arguments.record)
    if mode != "quiet" or result.outcome != "SUCCESS" or not result.goals_met:
        console = Console(stderr=mode == "quiet", highlight=False)
        console.print(Report(opened.name, result, arguments.record, symbols))
    drop_record(arguments, opened)
    return _code(result, complete=_written(opened))


def _code(result: RunResult, *, complete: bool) -> int:
    from bt_dualarm.runtime.outcome import Ending

    if result.ending is Ending.OVERRUN:
        return OVERRUN
    good = result.outcome == "SUCCESS" and result.goals_met and result.at_rest and complete
    return SUCCEEDED if good else FAILED


def _written(opened: Run) -> bool:
    from bt_dualarm.runtime.recorder import RecordError

    try:
        opened.write_record()
    except RecordError as error:
        complain("bt-run", error)
        return False
    return True


def _print_run_error(result: RunResult, folder: Path | None) -> None:
    """Print an error of the run itself; failures of trees are part of the report."""
    from bt_dualarm.runtime.outcome import Ending
    from bt_dualarm.runtime.recorder import DIVERGENCE

    if result.ending in (Ending.OVERRUN, Ending.INVARIANT):
        print(f"bt-run: error: {result.error}", file=sys.stderr)
    elif result.ending is Ending.DIVERGED:
        where = (
            f"the last states are in {folder / DIVERGENCE}"
            if folder
            else "its last states were not saved; --record DIR saves them"
        )
        print(f"bt-run: error: {result.error}; {where}", file=sys.stderr)
    elif result.error:
        print(f"bt-run: internal error: {result.error}", file=sys.stderr)


class _ToTerminal(logging.Handler):
    """Prints log lines to the current standard error, above a live display."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print a line with its traceback; control characters are escaped."""
        from bt_dualarm.spec.node_types import one_line

        lines = self.format(record).split("\n")
        print(
            "\n".join(line if line.isprintable() else one_line(line) for line in lines),
            file=sys.stderr,
        )


@contextmanager
def _logging() -> Iterator[None]:
    """Print the log of the package and the skills to the terminal within the block."""
    logger = logging.getLogger("bt_dualarm")
    level = logger.level
    handler = _ToTerminal()
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    try:
        yield
    finally:
        logger.setLevel(level)
        logger.removeHandler(handler)
