"""The best constant gain of proportional control, for each experiment and frame rate.

    python -m benchmarks.proportional_gain [--fps 30 60] [--seeds 1] [--jobs 2]

Prints the error by gain, and the best gain of each case (`bt_dualarm.experiments.trials.GAINS`).
Gains are first swept in steps of 0.5, then 0.25 below and above the best one: 100 runs, half an
hour on one core.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from bt_dualarm.experiments.trials import CASES, Cell, Trial, gain_params, run_trials, usable_cores
from bt_dualarm.skill.registry import Registry

GRID: Final = tuple(0.5 * number for number in range(2, 10))
"""Gains from 1 to 4.5, the largest value of the parameter."""

REFINEMENT: Final = 0.25


class Sweep:
    """Errors by experiment and gain, each measured once.

    Args:
        seeds: Number of seeds per case and gain.
        jobs: Number of parallel processes.
    """

    def __init__(self, seeds: int, jobs: int) -> None:
        self._seeds = seeds
        self._jobs = jobs
        self._registry = Registry.load()
        self._rms: dict[tuple[str, float, float], float] = {}

    def measure(self, pairs: Sequence[tuple[Cell, float]]) -> None:
        """Measure RMS errors in m; infinite if the target was not followed."""
        new = [pair for pair in pairs if _key(*pair) not in self._rms]
        tuned = [replace(cell, more={**cell.more, **gain_params(gain)}) for cell, gain in new]
        runs = [(cell, seed) for cell in tuned for seed in range(self._seeds)]
        trials_of_runs = run_trials(runs, self._registry, self._jobs)
        for cell, gain in new:
            trials = [next(trials_of_runs) for _ in range(self._seeds)]
            rms = _rms(trials) if all(isinstance(one, Trial) for one in trials) else math.inf
            self._rms[_key(cell, gain)] = rms
            print(f"  {cell.name}, {cell.fps:g} Hz, {gain:g}: {1e3 * rms:.2f} mm", flush=True)

    def best(self, cell: Cell) -> tuple[float, float]:
        """The gain with the smallest error so far, and that error in m."""
        name, fps, _ = _key(cell, 0.0)
        found = {gain: rms for (n, f, gain), rms in self._rms.items() if (n, f) == (name, fps)}
        gain = min(found, key=lambda one: found[one])
        return gain, found[gain]


def _key(cell: Cell, gain: float) -> tuple[str, float, float]:
    return cell.name, cell.fps, gain


def _rms(trials: Sequence[object]) -> float:
    squares = [trial.rms**2 for trial in trials if isinstance(trial, Trial)]
    followed = all(trial.outcome == "SUCCESS" for trial in trials if isinstance(trial, Trial))
    return float(np.sqrt(np.mean(squares))) if followed else math.inf


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fps", type=float, nargs="+", default=[30.0, 60.0])
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=usable_cores())
    arguments = parser.parse_args()
    cells = [
        Cell(case, speed, "proportional", fps=fps) for fps in arguments.fps for case, speed in CASES
    ]
    sweep = Sweep(arguments.seeds, arguments.jobs)
    sweep.measure([(cell, gain) for cell in cells for gain in GRID])
    offsets = (-REFINEMENT, REFINEMENT)
    sweep.measure([(cell, sweep.best(cell)[0] + step) for cell in cells for step in offsets])
    for cell in cells:
        gain, rms = sweep.best(cell)
        print(f"{cell.name:<14} {cell.fps:4.0f} Hz  best gain {gain:4.2f}  {1e3 * rms:6.2f} mm RMS")
    return 0


if __name__ == "__main__":
    sys.exit(main())
