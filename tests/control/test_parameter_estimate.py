"""Parameter estimates are least squares with a prior while parameters are added and dropped."""

from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.control.payload_estimation import ParameterEstimate


def test_mean_and_covariance_are_those_of_least_squares() -> None:
    rng = np.random.default_rng(1)
    columns = rng.normal(size=(40, 5))
    weights = rng.uniform(1, 50, 40)
    values = columns @ (truth := rng.normal(size=5)) + rng.normal(size=40) / np.sqrt(weights)
    estimate = ParameterEstimate(5)
    for part in np.split(np.arange(40), 8):
        estimate.measure(columns[part], values[part], weights[part])
    mean, covariance = estimate.marginal(0, 5)
    stacked = np.vstack((columns * np.sqrt(weights)[:, None], np.eye(5)))
    expected = np.linalg.lstsq(stacked, np.append(values * np.sqrt(weights), np.zeros(5)))[0]
    assert mean == pytest.approx(expected)
    assert covariance == pytest.approx(np.linalg.inv(stacked.T @ stacked))
    distance = (mean - truth) @ np.linalg.solve(covariance, mean - truth)
    assert distance < 20.5, "99.9 % of chi squared with 5 degrees of freedom"


def test_dropped_parameter_is_marginalized() -> None:
    """Others keep their estimates, and an added parameter starts with its prior."""
    rng = np.random.default_rng(2)
    columns = rng.normal(size=(30, 6))
    values = rng.normal(size=30)
    kept = ParameterEstimate(6)
    dropped = ParameterEstimate(6)
    for estimate in (kept, dropped):
        estimate.measure(columns, values, np.ones(30))
    dropped.drop(2, 2)
    dropped.add(1)
    mean, covariance = kept.marginal(0, 6)
    rest = [0, 1, 4, 5]
    assert dropped.marginal(0, 4)[0] == pytest.approx(mean[rest])
    assert dropped.marginal(0, 4)[1] == pytest.approx(covariance[np.ix_(rest, rest)])
    assert [one.item() for one in dropped.marginal(4, 1)] == [0.0, 1.0]


def test_outliers_hardly_count() -> None:
    """Friction against an object must not count as payload: estimates were 3 kg too high."""
    rng = np.random.default_rng(3)
    columns = rng.normal(size=(400, 4))
    truth = rng.normal(size=4)
    values = columns @ truth + 0.1 * rng.normal(size=400)
    contact = slice(200, 300)
    values[contact] += 3.0 * np.sign(
        columns[contact, 0]
    )  # 30 deviations, always with the same sign
    estimate = ParameterEstimate(4)
    for part in np.split(np.arange(400), 80):
        estimate.measure(columns[part], values[part], np.full(5, 100.0))
    mean, covariance = estimate.marginal(0, 4)
    assert mean == pytest.approx(truth, abs=0.05), "plain least squares have an error of 0.6"
    assert np.sqrt(np.diag(covariance)).max() < 0.01
