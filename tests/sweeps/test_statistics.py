"""Intervals and tests agree with SciPy's, and verdicts with planted differences."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np
import pytest

from bt_dualarm.core.pose import Vector
from bt_dualarm.sweeps.statistics import (
    PairedRates,
    SuccessRate,
    paired_metric,
    randomization_p,
    verdict_of,
)


@pytest.fixture(scope="module")
def stats() -> Any:
    """SciPy's module, which takes half a second of each process that collects tests with it."""
    return import_module("scipy.stats")


@pytest.mark.parametrize(("k", "n"), [(0, 1), (1, 1), (0, 10), (10, 10), (97, 100), (3, 7)])
def test_interval_is_that_of_wilson(k: int, n: int, stats: Any) -> None:
    theirs = stats.binomtest(k, n).proportion_ci(method="wilson")
    assert SuccessRate(k, n).interval == pytest.approx((theirs.low, theirs.high), abs=1e-12)


def test_interval_without_trials_is_0_to_1() -> None:
    assert SuccessRate(0, 0).interval == (0.0, 1.0)


@pytest.mark.parametrize(
    ("counts", "verdict"),
    [
        ((50, 0, 0, 0), "undecided"),
        ((40, 1, 9, 0), "better"),
        ((40, 9, 1, 0), "worse"),
        ((40, 4, 6, 0), "undecided"),
        ((0, 0, 5, 5), "undecided"),  # five of five: p = 1/16
        ((0, 0, 6, 4), "better"),  # six of six: p = 1/32
    ],
)
def test_verdict_depends_on_the_pairs_that_differ(
    counts: tuple[int, int, int, int], verdict: str
) -> None:
    assert verdict_of(PairedRates(*counts)) == verdict


def test_smaller_differences_need_more_runs() -> None:
    clear = PairedRates(80, 2, 12, 6).runs_needed()
    faint = PairedRates(80, 6, 8, 6).runs_needed()
    assert clear is not None
    assert faint is not None
    assert clear < 120 < 1000 < faint
    assert PairedRates(80, 5, 5, 10).runs_needed() is None


def test_planted_difference_of_a_metric_is_found() -> None:
    rng = np.random.default_rng(1)
    a = rng.normal(1.0, 0.3, 60)
    found = paired_metric("m", a, a + rng.normal(0.05, 0.05, 60))
    assert found.differs
    assert 0.03 < found.interval[0] < found.difference < found.interval[1] < 0.07


def test_equal_versions_rarely_differ() -> None:
    """5 % of false differences are expected at 95 % confidence; at most 6 in 40 samples."""
    rng = np.random.default_rng(2)
    wrong = 0
    for _ in range(40):
        a = rng.normal(1.0, 0.3, 40)
        wrong += paired_metric("m", a, a + rng.normal(0.0, 0.1, 40)).differs
    assert wrong <= 6


def test_few_pairs_of_equal_versions_rarely_differ() -> None:
    """A bootstrap alone finds a difference in one of eight samples of eight pairs."""
    rng = np.random.default_rng(3)
    wrong = alone = 0
    for _ in range(120):
        found = paired_metric("m", rng.lognormal(0.0, 0.5, 8), rng.lognormal(0.0, 0.5, 8))
        wrong += found.differs
        alone += found.interval[0] > 0.0 or found.interval[1] < 0.0
    assert wrong <= 12 < alone  # 6 are expected; more than 12 occur once in 200 times


def test_too_few_pairs_are_undecided() -> None:
    a: Vector = np.arange(5, dtype=np.float64)
    found = paired_metric("m", a, a + np.array([1.0, 1.01, 1.0, 1.02, 1.0]))
    assert not found.differs  # one of 16 sign changes gives this
    assert found.needed == 6


@pytest.mark.parametrize("n", [6, 12, 13, 40])
def test_randomization_test_agrees_with_scipy(n: int, stats: Any) -> None:
    difference = np.random.default_rng(n).normal(0.3, 1.0, n)
    expected = stats.permutation_test(
        (difference,), np.mean, permutation_type="samples", n_resamples=20_000, rng=0
    ).pvalue
    assert randomization_p(difference, 1e-3) == pytest.approx(expected, abs=0.01)


def test_constant_differences_need_no_resampling() -> None:
    a: Vector = np.arange(5, dtype=np.float64)
    assert not paired_metric("m", a, a).differs
    assert paired_metric("m", a, a + 1.0).differs
