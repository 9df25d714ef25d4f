"""Many experiments with many seeds: run, counted, and put together by experiment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import islice

from rich.console import Console

from bt_dualarm.experiments.cases import Cell
from bt_dualarm.experiments.progress import shown_progress
from bt_dualarm.experiments.results import Result
from bt_dualarm.experiments.trial import Trial, TrialError, tree_file
from bt_dualarm.experiments.trials import run_trials
from bt_dualarm.runtime.signals import StopRequest
from bt_dualarm.skill.registry import Registry


@dataclass
class Campaign:
    """What came of the experiments.

    Attributes:
        results: Experiments with the trials that could be measured, at least one each.
        failures: Sentences on those that could not.
    """

    results: list[Result] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)


def run_all(
    cells: Sequence[Cell], seeds: int, jobs: int, stop: StopRequest, console: Console
) -> Campaign:
    """Run every cell with every seed.

    Args:
        cells: Experiments, each of which is tried on the tree file before anything runs.
        seeds: Number of seeds, from 0 on.
        jobs: Number of processes side by side.
        stop: Request to end early; an experiment that is not complete then is left out.
        console: Where progress is shown.

    Raises:
        DualArmError: The file refuses a setting, or the renderer cannot work here.
    """
    registry, done = Registry.load(), Campaign()
    for cell in cells:
        tree_file(cell, registry)
    runs = [(cell, seed) for cell in cells for seed in range(seeds)]
    coming = run_trials(runs, registry, jobs, stop)
    with shown_progress([cell for cell, _ in runs], console) as is_over:
        for cell in cells:
            trials = []
            for trial in islice(coming, seeds):
                trials.append(trial)
                is_over(cell)
            if len(trials) < seeds:
                break
            _sort(cell, trials, done)
    return done


def _sort(cell: Cell, trials: Sequence[Trial | TrialError], done: Campaign) -> None:
    """Put what was measured with the results, and say of the rest why it was not."""
    measured = [trial for trial in trials if isinstance(trial, Trial)]
    done.failures += [
        f"{cell.name} {cell.controller}, seed {seed}: {trial}"
        for seed, trial in enumerate(trials)
        if isinstance(trial, TrialError)
    ]
    if measured:
        done.results.append(Result(cell, measured))
