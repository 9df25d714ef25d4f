"""Runs cells of the tracking experiments for the benchmarks, optionally in parallel."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path

from bt_dualarm.experiments.report import Result
from bt_dualarm.experiments.trials import Cell, Trial, TrialError, run_trials
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.document import RealityName


@dataclass
class Bench:
    """Settings, results and missed goals that all figures share.

    Attributes:
        seeds: Number of repetitions.
        quick: Whether to run fewer cases.
        out: Folder for images.
        jobs: Number of parallel processes for trials, in figures 1 to 4.
        reality: Reality of all cells.
        missed: Goals that were missed.
    """

    seeds: int
    quick: bool
    out: Path
    jobs: int = 1
    reality: RealityName = "lab"
    registry: Registry = field(default_factory=Registry.load)
    missed: list[str] = field(default_factory=list)
    _known: dict[str, Result] = field(default_factory=dict)

    def report(self, label: str, value: float, goal: float, unit: str = "mm") -> None:
        """Print a figure with its goal, an upper limit, and record whether it is missed."""
        good = value <= goal
        verdict = "ok" if good else "MISSED"
        print(f"  {label:<58} {value:9.3f} {unit:<3} (goal ≤ {goal:.3g}) {verdict}", flush=True)
        if not good:
            self.missed.append(label)

    def result(self, cell: Cell) -> Result:
        """Results of all seeds of a cell, run once.

        Raises:
            TrialError: A trial could not be measured.
        """
        return next(self.results([cell]))

    def results(self, cells: Sequence[Cell]) -> Iterator[Result]:
        """Results of all cells in order, each run once; raises like `result`."""
        new = [cell for cell in cells if cell.command(0) not in self._known]
        running = self.trials(new)
        for cell in cells:
            if cell.command(0) not in self._known:
                self._known[cell.command(0)] = Result(cell, _measured(next(running)))
            yield self._known[cell.command(0)]

    def trials(self, cells: Sequence[Cell]) -> Iterator[list[Trial | TrialError]]:
        """Trials of all seeds of each cell in order, or why there is no measurement."""
        real = [replace(cell, reality=self.reality) for cell in cells]
        runs = [(cell, seed) for cell in real for seed in range(self.seeds)]
        results_of_runs = run_trials(runs, self.registry, self.jobs)
        yield from (list(islice(results_of_runs, self.seeds)) for _ in cells)


def _measured(trials: Sequence[Trial | TrialError]) -> list[Trial]:
    """The trials, if all of them could be measured.

    Raises:
        TrialError: One of them could not.
    """
    for trial in trials:
        if isinstance(trial, TrialError):
            raise trial
    return [trial for trial in trials if isinstance(trial, Trial)]
