"""Beliefs are least squares with a prior, whatever comes and goes meanwhile."""

from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.control.payload_estimation import ParameterEstimate


def test_mean_and_covariance_are_those_of_least_squares() -> None:
    rng = np.random.default_rng(1)
    columns = rng.normal(size=(40, 5))
    weights = rng.uniform(1, 50, 40)
    values = columns @ (truth := rng.normal(size=5)) + rng.normal(size=40) / np.sqrt(weights)
    beliefs = ParameterEstimate(5)
    for part in np.split(np.arange(40), 8):
        beliefs.measure(columns[part], values[part], weights[part])
    mean, covariance = beliefs.marginal(0, 5)
    stacked = np.vstack((columns * np.sqrt(weights)[:, None], np.eye(5)))
    wanted = np.linalg.lstsq(stacked, np.append(values * np.sqrt(weights), np.zeros(5)))[0]
    assert mean == pytest.approx(wanted)
    assert covariance == pytest.approx(np.linalg.inv(stacked.T @ stacked))
    away = (mean - truth) @ np.linalg.solve(covariance, mean - truth)
    assert away < 20.5, "99.9 % of chi squared with 5 degrees of freedom"


def test_what_is_dropped_has_told_what_it_knew_of_the_others() -> None:
    """As if it were still there and nobody asked for it; what comes is not believed to be any."""
    rng = np.random.default_rng(2)
    columns = rng.normal(size=(30, 6))
    values = rng.normal(size=30)
    kept = ParameterEstimate(6)
    dropped = ParameterEstimate(6)
    for beliefs in (kept, dropped):
        beliefs.measure(columns, values, np.ones(30))
    dropped.drop(2, 2)
    dropped.add(1)
    mean, covariance = kept.marginal(0, 6)
    rest = [0, 1, 4, 5]
    assert dropped.marginal(0, 4)[0] == pytest.approx(mean[rest])
    assert dropped.marginal(0, 4)[1] == pytest.approx(covariance[np.ix_(rest, rest)])
    assert [one.item() for one in dropped.marginal(4, 1)] == [0.0, 1.0]


def test_what_is_far_from_expected_hardly_counts() -> None:
    """An arm that rubs against something is not weighed by that: it believed in 3 kg too much."""
    rng = np.random.default_rng(3)
    columns = rng.normal(size=(400, 4))
    truth = rng.normal(size=4)
    values = columns @ truth + 0.1 * rng.normal(size=400)
    rubs = slice(200, 300)
    values[rubs] += 3.0 * np.sign(columns[rubs, 0])  # 30 deviations, always in the same sense
    beliefs = ParameterEstimate(4)
    for part in np.split(np.arange(400), 80):
        beliefs.measure(columns[part], values[part], np.full(5, 100.0))
    mean, covariance = beliefs.marginal(0, 4)
    assert mean == pytest.approx(truth, abs=0.05), "least squares are off by 0.6"
    assert np.sqrt(np.diag(covariance)).max() < 0.01
