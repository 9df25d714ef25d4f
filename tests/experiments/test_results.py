"""Numbers and reports of the experiments, from synthetic trials."""

from __future__ import annotations

import json
import shlex
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.experiments.report import (
    HEADER,
    Result,
    estimator_bound,
    proportional_bound,
    row,
    write_report,
)
from bt_dualarm.experiments.trials import (
    CASES,
    GAINS,
    TREE,
    UNTUNED,
    Cell,
    CurveName,
    Margins,
    Trial,
    best_gain,
)
from bt_dualarm.runtime.options import find_tree
from bt_dualarm.skill.registry import Registry


def synthetic_trial(late: float = 0.02, seed: int = 0) -> Trial:
    """A tool that lags ``late`` seconds behind a cube on a circle of 0.1 m with a period of 2 s."""
    times = np.linspace(0.0, 5.98, 300)

    def circle(at: Vector) -> Matrix:
        return 0.1 * np.column_stack([np.cos(np.pi * at), np.sin(np.pi * at)])

    return Trial(
        seed=seed,
        times=times,
        planned=circle(times),
        cube=circle(times),
        tracked=circle(times - late),
        lost_count=0,
        frames=360,
        sighting_sd=1e-4,
        margins=Margins(0.5, 0.4, 0.3),
        outcome="SUCCESS",
    )


def test_lag_is_measured() -> None:
    """On a circle every error is the chord of the lag, and the amplitude is preserved."""
    trial = synthetic_trial(late=0.03)
    chord = 2 * 0.1 * np.sin(np.pi * 0.03 / 2)
    assert trial.rms == pytest.approx(chord, rel=1e-9)
    assert trial.error.max() == pytest.approx(chord, rel=1e-9)
    assert trial.lag == pytest.approx(0.03, abs=2e-3)
    assert trial.amplitude_ratio == pytest.approx(1.0, abs=1e-3)
    assert trial.speed_rms == pytest.approx(0.1 * np.pi, rel=1e-2)


def test_bounds_grow_with_latency_and_noise() -> None:
    cell = Cell("circle", 1.0)
    trial = synthetic_trial()
    assert estimator_bound(trial, cell) < estimator_bound(trial, replace(cell, latency=0.05))
    assert estimator_bound(trial, cell) < estimator_bound(replace(trial, sighting_sd=1e-3), cell)
    assert estimator_bound(trial, cell) < 1e-3
    assert proportional_bound(0.3, cell) == pytest.approx(0.3 * 0.025 * 2 / np.pi)


def test_every_case_has_a_command() -> None:
    for case, speed in CASES:
        command = Cell(case, speed).command(4)
        assert f"--seed 4 --param case={case} --param speed={speed}" in command


@given(
    case=st.sampled_from(get_args(CurveName)),
    speed=st.floats(0.05, 1.0),
    fps=st.floats(5.0, 200.0),
)
def test_gain_is_interpolated_between_neighbors_in_the_table(
    case: CurveName, speed: float, fps: float
) -> None:
    """Each tuned cell has its own gain; all others lie between tuned gains."""
    tuned = [gain for gains in GAINS[case].values() for gain in gains]
    assert min(tuned) <= best_gain(case, speed, fps) <= max(tuned)
    for known, (slow, fast) in GAINS[case].items():
        assert (best_gain(case, known, 30.0), best_gain(case, known, 60.0)) == (slow, fast)


def test_every_experiment_has_its_own_gain() -> None:
    for case, speed in CASES:
        assert speed in GAINS[case]
        params = Cell(case, speed, "proportional").params
        assert float(params["gain_u"]) == pytest.approx(0.2176 * GAINS[case][speed][1])


def test_json_has_one_number_per_seed() -> None:
    result = Result(Cell("circle", 1.0), [synthetic_trial(seed=0), synthetic_trial(seed=1)])
    content = json.loads(json.dumps(result.as_json()))
    for name in ("seeds", "yz_rms_m", "yz_max_m", "lag_s", "lost_count", "bound_m"):
        assert len(content[name]) == 2


def test_report_needs_no_other_files(tmp_path: Path) -> None:
    """HTML contains its figures, and Markdown has them in the same folder."""
    results = [
        Result(Cell("circle", 1.0, "proportional", label="3:2, fast"), [synthetic_trial(0.03)]),
        Result(Cell("circle", 1.0, "predictive", label="3:2, fast"), [synthetic_trial(0.001)]),
    ]
    write_report(tmp_path, results)
    sources: list[str] = []

    class Sources(HTMLParser):
        def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
            sources.extend(value or "" for name, value in attrs if name in ("src", "href"))

    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    Sources().feed(page)
    assert len(sources) == 2
    assert all(source.startswith("data:image/png;base64,") for source in sources)
    text = (tmp_path / "report.md").read_text(encoding="utf-8")
    for name in ("3_2_fast_ray_plane.png", "3_2_fast_ray_time.png"):
        assert f"({name})" in text
        assert (tmp_path / name).read_bytes()[1:4] == b"PNG"
    assert len(row(results[0])) == len(HEADER)
    assert all(cell in page for cell in row(results[0]))


@pytest.mark.parametrize("cell", UNTUNED, ids=lambda cell: cell.name)
def test_untuned_curves_are_parameters_of_the_same_file(cell: Cell) -> None:
    """The file accepts them, and the command that repeats a run has them, quoted for a shell."""
    node_types = Registry.load().kinds
    file = load_tree_file(find_tree(TREE), node_types, cell.params)
    assert file.objects["cube"].pose.xyz[2] > 0.7
    words = shlex.split(cell.command(3))
    given = dict(word.split("=", 1) for word in words if "=" in word)
    assert load_tree_file(find_tree(TREE), node_types, given).objects == file.objects


def test_plane_of_a_cell_is_that_of_its_curve() -> None:
    planes = {cell.name: cell.axes.tolist() for cell in UNTUNED}
    assert planes.pop("circle in XZ") == [[1, 0, 0], [0, 0, 1]]
    assert list(planes.values()) == [[[0, 1, 0], [0, 0, 1]]] * 4
    assert {cell.axis_names for cell in UNTUNED} == {("x", "z"), ("y", "z")}
    oblique = Cell("circle", 1.0, more={"plane": "{normal: [1, 1, 0]}"})
    assert oblique.axis_names == ("u", "z")
