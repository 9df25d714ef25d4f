"""Figures of experiments are labeled with the seed, or the seeds, that they show."""

from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.experiments.report import Result, over_time, overlay
from bt_dualarm.experiments.trials import Cell, ControllerName
from tests.experiments.test_results import synthetic_trial


def result(controller: ControllerName, seeds: tuple[int, ...]) -> Result:
    """A result in which seed s is (1 + s) hundredths of a second late."""
    trials = [synthetic_trial(0.01 * (1 + seed), seed) for seed in seeds]
    return Result(Cell("circle", 1.0, controller), trials)


@pytest.mark.parametrize(
    ("proportional", "predictive", "shown"),
    [((0, 1, 2), (0, 1, 2), (0, 0)), ((1, 2), (0, 1), (1, 1)), ((0, 1), (2, 3), (0, 2))],
    ids=["all measured", "some not", "none in common"],
)
def test_paths_are_of_one_seed_and_labeled_with_it(
    proportional: tuple[int, ...], predictive: tuple[int, ...], shown: tuple[int, int]
) -> None:
    """The seed is the first one that both controllers have, so that the cube's path is the same."""
    results = [result("proportional", proportional), result("predictive", predictive)]
    for axes, seed, one in zip(overlay(results).axes, shown, results, strict=True):
        assert axes.get_title().startswith(f"{one.cell.controller}: path of seed {seed}\n")
        trial = next(trial for trial in one.trials if trial.seed == seed)
        _, cube, tracked = axes.get_lines()
        assert tracked.get_xdata() == pytest.approx(1e3 * trial.tracked[:, 0])
        assert cube.get_xdata() == pytest.approx(1e3 * trial.cube[:, 0])


def test_error_is_of_all_seeds_and_coordinates_are_of_one() -> None:
    results = [result("proportional", (0, 1, 2)), result("predictive", (0, 1, 2))]
    y, z, error = over_time(results).axes
    assert [axes.get_ylabel() for axes in (y, z)] == ["y [mm], seed 0", "z [mm], seed 0"]
    assert error.get_ylabel() == "error [mm], all seeds"
    mean = sum(trial.error.mean() for trial in results[0].trials) / 3
    assert np.asarray(error.get_lines()[0].get_ydata())[10] == pytest.approx(1e3 * mean, rel=1e-3)
    assert y.get_lines()[0].get_ydata() == pytest.approx(1e3 * results[0].trials[0].tracked[:, 0])
