"""The repetitions of a cell put together: what goes into tables and JSON."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property

import numpy as np

from bt_dualarm.experiments.bounds import bound
from bt_dualarm.experiments.cases import Cell
from bt_dualarm.experiments.trial import Trial
from bt_dualarm.spec.source import Data


@dataclass(frozen=True, eq=False)
class Result:
    """A cell with its trials, one a seed.

    Attributes:
        cell: Settings of the experiment.
        trials: Repetitions, at least one.
    """

    cell: Cell
    trials: Sequence[Trial]

    @cached_property
    def bounds(self) -> tuple[float, ...]:
        """Lower bound of each trial's RMS, in m."""
        return tuple(bound(self.cell, trial) for trial in self.trials)

    @property
    def bound(self) -> float:
        """Mean of `bounds`, in m."""
        return float(np.mean(self.bounds))

    @property
    def rms(self) -> float:
        """Root mean square over all trials, in m."""
        return float(np.sqrt(np.mean([trial.rms**2 for trial in self.trials])))

    @property
    def worst(self) -> float:
        """The largest error of all, in m."""
        return max(float(trial.error.max()) for trial in self.trials)

    def mean(self, name: str) -> float:
        """Mean of one number over the trials, by the number's name."""
        return float(np.mean([getattr(trial, name) for trial in self.trials]))

    def as_json(self) -> dict[str, Data]:
        """Settings and numbers; one entry a seed in every list."""
        trials, cell = self.trials, self.cell
        return {
            "case": cell.case,
            "speed": cell.speed,
            "controller": cell.controller,
            "renderer": cell.renderer,
            "params": cell.params,
            "seeds": [trial.seed for trial in trials],
            "outcome": [trial.outcome for trial in trials],
            "yz_rms_m": [trial.rms for trial in trials],
            "yz_max_m": [float(trial.error.max()) for trial in trials],
            "lag_s": [trial.lag for trial in trials],
            "lost_count": [trial.lost_count for trial in trials],
            "amplitude_ratio": [trial.amplitude_ratio for trial in trials],
            "frames": [trial.frames for trial in trials],
            "sighting_sd_m": [trial.sighting_sd for trial in trials],
            "bound_m": list(self.bounds),
            "margins": [asdict(trial.margins) for trial in trials],
            "command": cell.command(trials[0].seed),
        }
