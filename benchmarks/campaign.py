"""Campaigns: the independent cases of a benchmark, run by the engine of `bt-sweep`.

A benchmark adds the options with `add_options`, and runs a function of its module once per case;
its arguments and its result must be JSON values. Cases run in ``--jobs`` parallel worker processes;
a worker that dies costs one attempt of one case. ``--out`` keeps each result, so after Ctrl-C, or
with a longer list of cases, the same command runs only the missing ones. Results come in the order
of the cases and are the same for any number of workers. Progress with the remaining time and a
Wilson interval of the success rate goes to standard error.

Deliberately not run as campaigns:

- Benchmarks of the CPU time, latency or memory of one process, which parallel or fresh processes
  would change: `alternating`, `constant_jerk`, `control`, `gl_renderers`, `growth`, `ik`,
  `long_runs`, `multi_arm_ik`, `ompl_validators`, `peers`, `planning`, `real_time`, `reality`,
  `recording`, `record_formats`, `rendering`, `resuming`, `scenes`, `setpoint`, `soak`, `soak_view`,
  `start`, `tick`, `timing`, `viewing`, `waiting_leaves`, `kernel_arguments`, and the CPU time in
  `gripping`.
- Benchmarks that start, kill or compare processes: `coordination`, `interrupts`, `killed`,
  `planted_change`, `records`, `repeatability`, `same_behavior`, `same_pictures`, `scheduling`,
  `sweeps`.
- Benchmarks that run the experiments of `bt-experiments` with that command's processes: `tracking`
  and `proportional_gain`.
- Benchmarks without a simulation: `shapes`, `code_figures`.
"""

from __future__ import annotations

import argparse
import json
import math
import shutil
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack
from functools import cache, cached_property
from pathlib import Path
from tempfile import mkdtemp
from types import TracebackType
from typing import Any, Generic, Self, TypeVar

from rich.console import Console

from bt_dualarm.cli.bt_sweep import ProgressLines
from bt_dualarm.skill.registry import Registry
from bt_dualarm.sweeps.api import engine_of
from bt_dualarm.sweeps.calls import NO_RESULT, SKIPPED, Call, calls_of, run_calls
from bt_dualarm.sweeps.engine import Engine
from bt_dualarm.sweeps.job import Row

Item = TypeVar("Item")


def add_options(
    parser: argparse.ArgumentParser, jobs: int | None = None, *, has_out: bool = False
) -> None:
    """Add ``--jobs`` and ``--out``.

    Args:
        parser: Parser of the benchmark's command line.
        jobs: Default number of workers: None for one per core, 1 for a benchmark that also prints
            CPU times.
        has_out: Whether the benchmark has its own ``--out``, which receives the results, too.
    """
    parser.add_argument(
        "--jobs", type=int, default=jobs, help=f"worker processes ({jobs or 'one per core'})"
    )
    if not has_out:
        parser.add_argument(
            "--out", type=Path, help="folder that keeps the results (a temporary one)"
        )


@cache
def registry() -> Registry:
    """The shipped skills, loaded once per process."""
    return Registry.load()


class Drawn(Generic[Item]):
    """Randomly drawn items, accessed by number.

    They are not arguments of a case: each worker draws them itself. Access to an earlier item
    draws all items again.

    Args:
        begin: Returns an iterator over all items.
    """

    def __init__(self, begin: Callable[[], Iterator[Item]]) -> None:
        self._begin = begin
        self._upcoming = enumerate(begin())
        self._newest: tuple[int, Item] | None = None

    def __getitem__(self, number: int) -> Item:
        """The item with a number from 0."""
        if self._newest is not None and self._newest[0] > number:
            self._upcoming = enumerate(self._begin())
            self._newest = None
        while self._newest is None or self._newest[0] < number:
            self._newest = next(self._upcoming)
        return self._newest[1]


class Campaign:
    """Runs cases in a ``with`` block, which exits with code 1 if a case has no result.

    Args:
        options: Command line of a parser with `add_options`.

    Attributes:
        cpu_s: CPU seconds of all cases so far, including those of earlier commands.
    """

    def __init__(self, options: argparse.Namespace) -> None:
        self._start = engine_of(options.jobs, None, None)
        self._is_temporary = options.out is None
        self._folder = Path(mkdtemp(prefix="bt_campaign_")) if self._is_temporary else options.out
        self._stack = ExitStack()
        self._missing = 0
        self.cpu_s = 0.0

    def __enter__(self) -> Self:
        """Begin; worker processes start with the first case that has no result yet."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End all workers.

        Raises:
            SystemExit: A case has no result, or Ctrl-C was pressed.
        """
        self._stack.close()
        if kind is None and not self._missing:
            if self._is_temporary:
                shutil.rmtree(self._folder, ignore_errors=True)
            return
        is_interrupted = kind is not None and issubclass(kind, KeyboardInterrupt)
        message = "interrupted" if kind is not None else f"cases without a result: {self._missing}"
        _print_error(f"{message}; the same command with --out {self._folder} runs what is missing")
        if is_interrupted:
            raise SystemExit(130)
        if kind is None:
            raise SystemExit(1)

    def run(
        self,
        function: Callable[..., Any],
        cases: Iterable[Mapping[str, Any]],
        wanted: float | None = None,
    ) -> Iterator[tuple[Mapping[str, Any], Any]]:
        """Run a function once per case; yields arguments and results in the order of the cases.

        A case without a result is reported on standard error and omitted.

        Args:
            function: Function at the top level of a module. Its result must be a JSON value; a
                mapping may have an ``outcome``, for the progress, and a ``code`` of a failure.
                Its output is discarded.
            cases: Keyword arguments of each case; may be infinite if ``wanted`` is given.
            wanted: Number of results after which to stop; results with the outcome SKIPPED and
                None do not count. Without it all cases run; with infinity the caller stops the
                iteration.
        """
        total = wanted
        if total is None:
            cases = list(cases)
            total = len(cases)
        if not total:
            return
        known = int(total) if math.isfinite(total) else None
        counted = 0
        show = ProgressLines(Console(stderr=True, highlight=False))
        calls = calls_of(_name_of(function), cases)
        results = run_calls(calls, self._folder, lambda: self._engine, total=known, progress=show)
        try:
            for call, row in results:
                if row["outcome"] in NO_RESULT:
                    self._report_missing(call, row)
                else:
                    self.cpu_s += float(str(row["cpu_s"]))
                    yield call.arguments, json.loads(str(row["result"]))
                counted += wanted is None or row["outcome"] != SKIPPED
                if counted == total:
                    return
        finally:
            results.close()
            if wanted is not None:
                # The engine still runs calls that were started ahead, whose results would go to the
                # next run.
                self._stack.close()
                self.__dict__.pop("_engine", None)

    @cached_property
    def _engine(self) -> Engine:
        started = self._start()
        self._stack.callback(started.close)
        return started

    def _report_missing(self, call: Call, row: Row) -> None:
        self._missing += 1
        _print_error(f"{call.label}: {row['outcome']} {row['code']}: {row['reason']}")
        if self._missing == 1 and row.get("traceback"):
            _print_error(str(row["traceback"]))


def _name_of(function: Callable[..., Any]) -> str:
    """Name by which a worker imports a function; the main module has another name there."""
    module = sys.modules[function.__module__]
    spec = module.__spec__
    name = Path(str(module.__file__)).stem if spec is None else spec.name
    return f"{name if spec else f'benchmarks.{name}'}:{function.__qualname__}"


def _print_error(text: str) -> None:
    sys.stdout.flush()
    sys.stderr.write(f"{text}\n")
