"""How far the experiments are, and how long they will still take."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Final, TypeAlias

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from bt_dualarm.experiments.cases import Cell

RunIsOver: TypeAlias = Callable[[Cell], None]
"""To be called with the cell of each run, when it is over."""

_FETCHED_S, _DRAWN_S = 5.0, 5.0
"""Simulated seconds until the cube is fetched, and those of a curve at full speed, roughly."""

_REDRAWN_HZ: Final = 2.0


class Forecast:
    """Time left, from the share of the work that is done.

    Runs cost as much as they simulate, and a curve at half the speed takes twice as long.

    Args:
        runs: Cell of each run, in any order.
        clock: Seconds on the wall.
    """

    def __init__(self, runs: Sequence[Cell], clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._began = clock()
        self._all = sum(map(_work, runs))
        self._done = 0.0

    def count(self, cell: Cell) -> None:
        """One run of a cell is over."""
        self._done += _work(cell)

    def __str__(self) -> str:
        if not self._done:
            return "(time left: after the first run)"
        left = max(self._all - self._done, 0.0)
        spent = self._clock() - self._began
        return f"about {_duration(spent * left / self._done)} left" if left else ""


@contextmanager
def shown_progress(runs: Sequence[Cell], console: Console) -> Iterator[RunIsOver]:
    """Show how far the runs are: a bar on a terminal, else a line when a cell is over.

    Args:
        runs: Cell of each run, in the order in which they end.
        console: Where to.
    """
    forecast = Forecast(runs)
    if console.is_terminal:
        with _bar(runs, forecast, console) as is_over:
            yield is_over
    else:
        yield _lines(runs, forecast, console)


@contextmanager
def _bar(runs: Sequence[Cell], forecast: Forecast, console: Console) -> Iterator[RunIsOver]:
    what, left = TextColumn("{task.description}"), TextColumn("{task.fields[left]}")
    columns = what, BarColumn(None), TimeElapsedColumn(), left
    with Progress(
        *columns, console=console, expand=True, refresh_per_second=_REDRAWN_HZ
    ) as progress:
        task = progress.add_task(_title(runs, 0), total=sum(map(_work, runs)), left=str(forecast))
        over = 0

        def is_over(cell: Cell) -> None:
            nonlocal over
            over += 1
            forecast.count(cell)
            title = _title(runs, over)
            progress.update(task, advance=_work(cell), description=title, left=str(forecast))

        yield is_over


def _lines(runs: Sequence[Cell], forecast: Forecast, console: Console) -> RunIsOver:
    over = 0

    def is_over(cell: Cell) -> None:
        nonlocal over
        over += 1
        forecast.count(cell)
        if over == len(runs) or runs[over] != cell:
            words = f"{_label(cell)}: {over} of {len(runs)} runs", str(forecast)
            console.print(", ".join(filter(None, words)), markup=False, soft_wrap=True)

    console.print(f"{len(runs)} runs", soft_wrap=True)
    return is_over


def _title(runs: Sequence[Cell], over: int) -> str:
    """What runs now, and how many are over."""
    running = f"{_label(runs[over])}, " if over < len(runs) else ""
    return f"{running}{over}/{len(runs)}"


def _label(cell: Cell) -> str:
    return f"{cell.name} {cell.controller} {cell.renderer}"


def _work(cell: Cell) -> float:
    return _FETCHED_S + _DRAWN_S / cell.speed


def _duration(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes / 60:.1f} h"
