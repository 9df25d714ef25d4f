"""Map of the error over a camera's faults: the criterion of stability, and the output."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.camera_map import Faults, draw, instability, survey, table
from bt_dualarm.experiments.trials import Cell, Trial, TrialError
from tests.experiments.test_results import synthetic_trial


def test_steady_error_is_stable() -> None:
    assert instability(synthetic_trial(late=0.02)) == ""


def test_growing_or_oscillating_error_or_failure_is_unstable() -> None:
    steady = synthetic_trial(late=0.02)
    drift = np.linspace(0.0, 0.1, len(steady.times))[:, None]
    assert "grows from" in instability(replace(steady, tracked=steady.cube + drift))
    assert "1.50 times as large" in instability(replace(steady, tracked=1.5 * steady.cube))
    lost = replace(steady, outcome="FAILURE", reason="the target was last seen 2.0 s ago")
    assert instability(lost) == "FAILURE the target was last seen 2.0 s ago"


@pytest.fixture
def requested() -> list[Cell]:
    return []


def test_every_cell_is_measured_shown_and_drawn(requested: list[Cell], tmp_path: Path) -> None:
    """The worst corner is marked as unstable with its seed; the other cells have their error."""

    def measure(cells: Sequence[Cell]) -> list[list[Trial | TrialError]]:
        requested.extend(cells)
        worst = replace(synthetic_trial(seed=1), outcome="FAILURE", reason="lost")
        bad = ("0.1", "0.3", "2.0")
        faults = [tuple(cell.params[key] for key in ("latency", "drop", "noise")) for cell in cells]
        return [
            [synthetic_trial(), worst if found == bad else synthetic_trial(seed=1)]
            for found in faults
        ]

    spots = survey(measure, coarse=True)
    assert len(requested) == len(spots) == 8
    assert {cell.latency for cell in requested} == {0.0, 0.1}
    unstable = [spot for spot in spots if spot.complaints]
    assert [spot.faults for spot in unstable] == [Faults(0.1, 0.3, 2.0)]
    assert unstable[0].complaints == ("seed 1: FAILURE lost",)
    assert table(spots).count(f"{1e3 * synthetic_trial().rms:.2f}") == 8
    assert table(spots).count("!") == 1
    draw(spots, 2, tmp_path / "new" / "map.png")
    assert (tmp_path / "new" / "map.png").read_bytes()[1:4] == b"PNG"


def test_run_without_a_measurement_has_no_error() -> None:
    spots = survey(lambda cells: [[TrialError("nothing")] for _ in cells], coarse=True)
    assert all(np.isnan(spot.rms) and spot.complaints == ("nothing",) for spot in spots)
