"""Cells of the benchmarks are run once each, with all their seeds, and errors are kept."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.tracking_bench import Bench
from bt_dualarm.experiments import trials
from bt_dualarm.experiments.trials import Cell, Trial, TrialError
from bt_dualarm.runtime.interruption import StopRequest
from bt_dualarm.skill.registry import Registry
from tests.experiments.test_results import synthetic_trial

CIRCLE = Cell("circle", 1.0)
LISSAJOUS = Cell("lissajous", 1.0)


@pytest.fixture
def runs(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, int]]:
    """Runs by curve and seed; a curve at speed 0.2 cannot be measured."""
    done: list[tuple[str, int]] = []

    def run_trial(cell: Cell, seed: int, registry: Registry, stop: StopRequest) -> Trial:
        done.append((cell.case, seed))
        if cell.speed == 0.2:
            raise TrialError("nothing to measure")
        return synthetic_trial(seed=seed)

    monkeypatch.setattr(trials, "run_trial", run_trial)
    return done


def test_each_cell_is_run_once(runs: list[tuple[str, int]], registry: Registry) -> None:
    bench = Bench(2, quick=False, out=Path(), registry=registry)
    assert [result.cell for result in bench.results([CIRCLE, LISSAJOUS, CIRCLE])] == [
        CIRCLE,
        LISSAJOUS,
        CIRCLE,
    ]
    assert bench.result(LISSAJOUS).trials[1].seed == 1
    assert runs == [("circle", 0), ("circle", 1), ("lissajous", 0), ("lissajous", 1)]


def test_results_are_yielded_one_by_one(runs: list[tuple[str, int]], registry: Registry) -> None:
    bench = Bench(1, quick=False, out=Path(), registry=registry)
    first = next(bench.results([CIRCLE, LISSAJOUS]))
    assert (first.cell, runs) == (CIRCLE, [("circle", 0)])


def test_cell_that_cannot_be_measured_has_no_result(
    runs: list[tuple[str, int]], registry: Registry
) -> None:
    bench = Bench(1, quick=False, out=Path(), registry=registry)
    slow = Cell("circle", 0.2)
    assert [str(trial) for (trial,) in bench.trials([slow])] == ["nothing to measure"]
    with pytest.raises(TrialError):
        bench.result(slow)
