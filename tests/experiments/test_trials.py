"""Trials are yielded in order and end on request."""

from __future__ import annotations

from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool

import pytest

from bt_dualarm.core.errors import DualArmError
from bt_dualarm.experiments import trials
from bt_dualarm.experiments.trials import Cell, Trial, TrialError
from bt_dualarm.runtime.interruption import StopRequest
from bt_dualarm.skill.registry import Registry
from tests.experiments.test_results import synthetic_trial

RUNS = [(Cell("circle", 1.0), seed) for seed in range(6)]


@pytest.mark.parametrize("last", range(7))
def test_trial_that_is_incomplete_at_a_stop_request_is_not_yielded(
    last: int, registry: Registry, monkeypatch: pytest.MonkeyPatch
) -> None:
    stop = StopRequest()

    def run_trial(cell: Cell, seed: int, registry: Registry, stop: StopRequest) -> Trial:
        if seed == last:
            stop.ask()
        return synthetic_trial(seed=seed)

    monkeypatch.setattr(trials, "run_trial", run_trial)
    found = list(trials.run_trials(RUNS, registry, 1, stop))
    assert [trial.seed for trial in found if isinstance(trial, Trial)] == list(range(min(last, 6)))


def test_dead_worker_process_is_reported() -> None:
    dead: Future[Trial | TrialError] = Future()
    dead.set_exception(BrokenProcessPool("gone"))
    with pytest.raises(DualArmError, match="worker process died; --jobs 1 runs"):
        trials._outcome(dead)
