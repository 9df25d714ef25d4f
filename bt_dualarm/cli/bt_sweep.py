"""``bt-sweep``: runs a tree over seeds, parameters and realities; reports how often it works."""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Final

from bt_dualarm.cli.entry import FAILED, SUCCEEDED, add_skills, given_path, positive, with_trials
from bt_dualarm.runtime.interruption import StopRequest

if TYPE_CHECKING:
    from rich.console import Console, Group

    from bt_dualarm.sweeps.sweep import Progress, SweepResult

_EXAMPLES: Final = """\
examples:
  bt-sweep circle --seeds 0:100 --reality lab,rough       100 seeds in two realities
  bt-sweep circle --param speed=0.2:1.0:5 --out out/speed 10 seeds at each of five speeds
  bt-sweep circle --param speed=0.2:1.0 --param radius=0.05:0.15 --sample sobol --samples 64
                                                          64 points spread over two ranges
  bt-sweep my_tree.yaml --param x=0.3:0.9 --search 4      where success turns into failure
  bt-sweep my_sweep.yaml --until "ci<0.02"                a manifest file; ends early if precise
  bt-sweep circle --seeds 0:1000 --shard 2/4 --out part2  the second quarter, on another machine
  bt-sweep --merge part1 part2 part3 part4 --out all      the report of all four

A sweep that is started again runs only the trials that have no row yet. Values of a parameter are
FROM:TO:COUNT, FROM:TO for samples or a search, or a list: 0.2,0.5 or fingers,attach.

exit code: 0 all trials have run and the report was written (whatever their outcome), 1 some trials
have no result, 2 invalid arguments or tree, 130 or 143 interrupted: finished trials are kept
"""


def main(argv: Sequence[str] | None) -> int:
    """Run a sweep, or report on several folders; returns the exit code."""
    parser = _command_line()
    arguments = parser.parse_args(argv)
    if arguments.merge:
        if arguments.tree is not None:
            parser.error("--merge reports on folders of sweeps; it runs no tree")
        return _merge(arguments)
    if arguments.tree is None:
        parser.error("a tree or a manifest file is missing")
    names = [name for name, _ in arguments.param]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        parser.error(f"--param {twice} is given twice; list its values: {twice}=VALUE,VALUE")
    return with_trials("bt-sweep", lambda stop: _run(arguments, stop))


def _command_line() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="bt-sweep",
        description="Run a tree over seeds, parameters and realities; report success rates.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("tree", metavar="FILE", nargs="?", help="a tree, or a manifest file (bt_sweep: 1)")
    add("--seeds", metavar="FIRST:END", help="seeds, end excluded (default: 0:10)")
    add(
        "--param",
        metavar="NAME=VALUES",
        type=_assignment,
        action="append",
        default=[],
        help="values of a parameter that the file declares (may be repeated)",
    )
    add(
        "--faults",
        metavar="FILE",
        type=given_path,
        help="inject the faults in this file in every trial",
    )
    add("--reality", metavar="NAME,...", help="ideal, lab, rough (default: the file's)")
    add("--sample", choices=("lhs", "sobol"), help="draw samples from ranges of parameters")
    add("--samples", metavar="N", type=_count, default=0, help="number of samples")
    add("--sampling-seed", metavar="N", type=_count, default=0, help="seed of the samples (0)")
    add(
        "--search",
        metavar="N",
        type=_count,
        help="search the boundary of success in one or two ranges by N halvings",
    )
    add("--duration", metavar="S", type=positive, help="end each trial after S simulated seconds")
    add("--jobs", metavar="N", type=_count, help="worker processes (default: one per core)")
    add("--dask", metavar="ADDRESS", help="run on a Dask cluster: tcp://HOST:PORT, or local:N")
    add("--shard", metavar="K/N", default="1/1", help="run only part K of N")
    add("--until", metavar="COND", help="end early: 'ci<0.02' once all intervals are this narrow")
    add("--audit", metavar="SHARE", type=_share, default=0.0, help="repeat this share, as 1%%")
    add("--keep", choices=("failures", "all", "none"), default="failures", help="records to keep")
    add("--timeout", metavar="S", type=positive, help="give up a trial after S wall-clock seconds")
    add("--watchdog", metavar="S", type=positive, help="wall-clock budget of a tick of skill code")
    add(
        "--merge", metavar="DIR", nargs="+", type=given_path, help="report on the trials in folders"
    )
    add(
        "--out",
        metavar="DIR",
        type=given_path,
        default=Path("out/sweep"),
        help="folder (out/sweep)",
    )
    add("--quiet", action="store_true", help="print only the result")
    add_skills(parser)
    return parser


def _assignment(text: str) -> tuple[str, str]:
    name, equals, values = text.partition("=")
    if not name or not equals or not values:
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form NAME=VALUES")
    return name, values


def _count(text: str) -> int:
    if not text.isascii() or not text.isdecimal() or len(text) > 9:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number")
    return int(text)


def _share(text: str) -> float:
    try:
        number = float(text.removesuffix("%")) / (100 if text.endswith("%") else 1)
    except ValueError:
        number = math.nan
    if not 0.0 <= number <= 1.0:
        raise argparse.ArgumentTypeError(f"{text!r} is not a share, such as 1% or 0.01")
    return number


def _run(arguments: argparse.Namespace, stop: StopRequest) -> int:
    from bt_dualarm.spec.node_types import counted
    from bt_dualarm.sweeps.api import sweep

    realities = None if arguments.reality is None else arguments.reality.split(",")
    with shown_progress(quiet=arguments.quiet) as progress:
        result = sweep(
            arguments.tree,
            out=arguments.out,
            seeds=arguments.seeds,
            params=dict(arguments.param),
            reality=realities,
            jobs=arguments.jobs,
            keep=arguments.keep,
            until=arguments.until,
            audit=arguments.audit,
            shard=arguments.shard,
            sample=arguments.sample,
            samples=arguments.samples,
            sampling_seed=arguments.sampling_seed,
            search=arguments.search,
            duration=arguments.duration,
            watchdog=arguments.watchdog,
            timeout=arguments.timeout,
            dask=arguments.dask,
            skills=arguments.skills,
            faults=arguments.faults,
            stop=stop,
            progress=progress,
        )
    _print_result(result, arguments.out)
    if stop.asked:
        left = result.progress.total - result.progress.done
        print(
            f"bt-sweep: interrupted, {counted(left, 'trial')} left; "
            "run the same command to continue",
            file=sys.stderr,
        )
    return SUCCEEDED if (result.complete or result.enough) and not _lost(result) else FAILED


def _lost(result: SweepResult) -> bool:
    return bool(result.progress.outcomes["CRASHED"])


def _merge(arguments: argparse.Namespace) -> int:
    from bt_dualarm.sweeps.api import merge

    result = merge(arguments.merge, arguments.out)
    _print_result(result, arguments.out)
    if not result.complete:
        missing = result.progress.total - len(result.table)
        print(f"bt-sweep: missing trials: {missing} of {result.progress.total}", file=sys.stderr)
    return SUCCEEDED if result.complete and not _lost(result) else FAILED


def _print_result(result: SweepResult, out: Path) -> None:
    from bt_dualarm.spec.node_types import counted
    from bt_dualarm.sweeps.report import PAGE, causes_of

    print(f"{counted(len(result.table), 'trial')}: {result.rate} succeed (95 % interval)")
    for cause in causes_of(result.table)[:8]:
        where = f" [{cause.where}]" if cause.where else ""
        what = " ".join(filter(None, (cause.code, cause.arm, cause.leaf)))
        print(f"  {cause.count:6d}  {what}{where}\n          {cause.sentence}")
    if result.boundary is not None:
        print(f"boundary: {result.boundary}")
    if result.progress.audited:
        audited = counted(result.progress.audited, "trial")
        print(f"audit: {audited} gave the same state on another worker")
    if result.progress.retried:
        print(f"trials repeated because their workers had died: {result.progress.retried}")
    print(f"hash of all results: {result.sha256[:16]}")
    print(f"report: {out / PAGE}")


@contextmanager
def shown_progress(*, quiet: bool) -> Iterator[Callable[[Progress], None] | None]:
    """Show the progress: a live panel in a terminal, otherwise a line now and then."""
    from rich.console import Console

    console = Console(stderr=True, highlight=False)
    if quiet:
        yield None
    elif console.is_terminal:
        from rich.live import Live

        with Live(console=console, refresh_per_second=4, transient=True) as live:
            yield lambda state: live.update(_panel(state))
    else:
        yield ProgressLines(console)


def _panel(state: Progress) -> Group:
    from rich.console import Group
    from rich.progress_bar import ProgressBar
    from rich.text import Text

    from bt_dualarm.spec.node_types import counted

    head = Text.assemble(
        (f"{state.done}/{counted(state.total, 'trial')}", "bold"),
        f"  {_left(state)}" + (f"  {state.known} known before" if state.known else ""),
    )
    rate = Text(f"success {state.rate}") if state.done else Text("success: after the first trial")
    failures = [
        Text(f"  {count:6d}  {what}", style="red") for what, count in state.failures.most_common(8)
    ]
    return Group(head, ProgressBar(state.total, state.done, width=60), rate, *failures)


def _left(state: Progress) -> str:
    seconds = state.left_s
    if state.done >= state.total:
        return ""
    if not state.workers:
        return "waiting for a worker of the cluster"
    if not math.isfinite(seconds):
        return "(time left: after the first trial)"
    if seconds < 90:
        return f"about {seconds:.0f} s left"
    minutes = seconds / 60
    return f"about {minutes:.0f} min left" if minutes < 90 else f"about {minutes / 60:.1f} h left"


class ProgressLines:
    """Prints a line at every twentieth part of a sweep, and at least every 30 s."""

    _EVERY_S = 30.0

    def __init__(self, console: Console) -> None:
        self._console = console
        self._printed = -1
        self._at = 0.0

    def __call__(self, state: Progress) -> None:
        """Print the state, if it is time to."""
        now = time.monotonic()
        part = 20 * state.done // max(state.total, 1)
        is_waiting = not state.workers
        if state.done == 0 and not is_waiting:
            return
        if part == self._printed and now - self._at < self._EVERY_S:
            return
        self._printed, self._at = part, now
        failures = ", ".join(f"{what} {n}" for what, n in state.failures.most_common(3))
        rate = f"success {state.rate}" if state.done else ""
        parts = f"{state.done}/{state.total}", rate, _left(state), failures
        self._console.print(", ".join(filter(None, parts)), markup=False, soft_wrap=True)
