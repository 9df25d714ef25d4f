"""Statistics of sweeps: intervals of success rates, paired comparisons, numbers of runs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any, Final, Literal, TypeAlias

import numpy as np

from bt_dualarm.core.later import Later
from bt_dualarm.core.pose import Vector
from bt_dualarm.spec.node_types import counted

CONFIDENCE: Final = 0.95
"""Confidence of all intervals."""

_POWER: Final = 0.8
"""Probability with which a difference shall be found, in the numbers of pairs needed for it."""

stats: Any = Later("scipy.stats")  # takes longer to import than all else here

Verdict: TypeAlias = Literal["better", "worse", "undecided", "equal"]


@dataclass(frozen=True)
class SuccessRate:
    """Number of successes among trials.

    Attributes:
        successes: Number of successes.
        trials: Number of trials, at least 1 for an interval.
    """

    successes: int
    trials: int

    @property
    def value(self) -> float:
        """Fraction of successes; NaN without trials."""
        return self.successes / self.trials if self.trials else math.nan

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson score interval at `CONFIDENCE`; 0 to 1 without trials.

        Wilson, E. B. (1927), J. Am. Stat. Assoc. 22, 209. Unlike the normal approximation it is
        not empty when all trials succeed, and keeps its coverage for few trials.
        """
        if not self.trials:
            return 0.0, 1.0
        z = NormalDist().inv_cdf(0.5 + CONFIDENCE / 2)
        n, p = self.trials, self.value
        center = (p + z * z / (2 * n)) / (1 + z * z / n)
        half = z / (1 + z * z / n) * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
        return max(0.0, center - half), min(1.0, center + half)

    @property
    def width(self) -> float:
        """Width of the interval."""
        low, high = self.interval
        return high - low

    def __str__(self) -> str:
        low, high = self.interval
        return f"{100 * self.value:.1f} % ({100 * low:.1f} to {100 * high:.1f})"


@dataclass(frozen=True)
class Boundary:
    """The boundary found by a search.

    Attributes:
        names: Names of the one or two parameters.
        points: Points at which success turns to failure, between two tried points; each of shape
            (number of parameters,).
        spacing: Distance of the two tried points around each, along each parameter.
        rates: Success rate at every point that was tried.
    """

    names: tuple[str, ...]
    points: tuple[tuple[float, ...], ...]
    spacing: tuple[float, ...]
    rates: Mapping[tuple[float, ...], SuccessRate]

    def __str__(self) -> str:
        if not self.points:
            good = all(rate.value >= 0.5 for rate in self.rates.values())
            return f"no boundary: {'success' if good else 'failure'} everywhere"
        if len(self.names) == 1:
            places = ", ".join(f"{point[0]:.4g}" for point in self.points)
            return f"{self.names[0]} = {places} (± {self.spacing[0] / 2:.2g})"
        spread = ", ".join(
            f"{name} ± {spacing / 2:.2g}"
            for name, spacing in zip(self.names, self.spacing, strict=True)
        )
        return f"{counted(len(self.points), 'point')} in {', '.join(self.names)} ({spread})"


@dataclass(frozen=True)
class PairedRates:
    """Success of two versions in the same trials.

    Attributes:
        both: Trials in which both succeeded.
        only_a: Trials in which only the first one did.
        only_b: Trials in which only the second one did.
        neither: Trials in which neither did.
    """

    both: int
    only_a: int
    only_b: int
    neither: int

    @property
    def p_value(self) -> float:
        """Exact two-sided McNemar test: the pairs that differ, against a fair coin."""
        differing = self.only_a + self.only_b
        if not differing:
            return 1.0
        return float(stats.binomtest(self.only_b, differing, 0.5).pvalue)

    @property
    def difference(self) -> float:
        """Success rate of the second version minus that of the first."""
        total = self.both + self.only_a + self.only_b + self.neither
        return (self.only_b - self.only_a) / total if total else math.nan

    def runs_needed(self) -> int | None:
        """Pairs with which the current difference would be decided; None if there is none.

        Connor, R. J. (1987), Biometrics 43, 207: the sample size of McNemar's test.
        """
        total = self.both + self.only_a + self.only_b + self.neither
        if not total or self.only_a == self.only_b:
            return None
        psi = (self.only_a + self.only_b) / total
        delta = abs(self.only_b - self.only_a) / total
        z_alpha = NormalDist().inv_cdf(0.5 + CONFIDENCE / 2)
        z_beta = NormalDist().inv_cdf(_POWER)
        root = math.sqrt(max(psi - delta * delta, 0.0))
        return math.ceil(((z_alpha * math.sqrt(psi) + z_beta * root) / delta) ** 2)


@dataclass(frozen=True)
class PairedMetric:
    """A metric of two versions in the same trials.

    Attributes:
        name: Name of the metric.
        pairs: Number of trials that have it in both.
        mean_a: Mean of the first version.
        mean_b: Mean of the second version.
        interval: Interval of the mean difference, second less first, at the confidence asked.
        differs: Whether the interval excludes zero.
        needed: Pairs with which the current difference would be decided; None if there is none.
    """

    name: str
    pairs: int
    mean_a: float
    mean_b: float
    interval: tuple[float, float]
    differs: bool
    needed: int | None

    @property
    def difference(self) -> float:
        """Mean of the second version minus that of the first."""
        return self.mean_b - self.mean_a


_RESAMPLES: Final = 4000
_SEED: Final = 0  # of the resampling, so that a comparison repeats

_FEW_PAIRS: Final = 1000
"""Pairs below which intervals of a bootstrap are too narrow to decide alone."""

_MOST_EXACT: Final = 12
"""Pairs up to which all changes of signs are tried."""


def randomization_p(difference: Vector, smallest: float) -> float:
    """Two-sided p-value of a mean difference, by random changes of the signs of the pairs.

    Without a difference between two versions, a pair could as well have been drawn the other way
    round. Fisher, R. A. (1935), The Design of Experiments, section 21. The test is exact, however
    few pairs there are.

    Args:
        difference: Differences of the pairs, of shape (n,).
        smallest: Value that has to be resolved: it determines the number of random changes.
    """
    n = len(difference)
    if n <= _MOST_EXACT:
        signs = 1.0 - 2.0 * ((np.arange(2**n)[:, None] >> np.arange(n)) & 1)
        means = signs @ difference / n
        known = 0
    else:
        rng = np.random.default_rng(_SEED)
        count = max(_RESAMPLES, math.ceil(20.0 / smallest))
        means = np.concatenate(
            [rng.choice((-1.0, 1.0), (len(part), n)) @ difference / n
             for part in np.array_split(np.arange(count), math.ceil(count * n / 1e6))]
        )  # fmt: skip
        known = 1  # the pairs as they are
    # Equal means must count as equal although they are summed in another order.
    limit = abs(float(difference.mean())) * (1.0 - 1e-9)
    extreme = int((np.abs(means) >= limit).sum())
    return (extreme + known) / (len(means) + known)


def paired_metric(name: str, a: Vector, b: Vector, confidence: float = CONFIDENCE) -> PairedMetric:
    """Compare a metric by a bootstrap of the mean paired difference.

    Efron, B. (1987), J. Am. Stat. Assoc. 82, 171: the bias-corrected and accelerated interval. Of
    few pairs it is too narrow; then a difference must also pass the exact `randomization_p`.

    Args:
        name: Name of the metric.
        a: Values of the first version, of shape (n,), n >= 2.
        b: Values of the second version in the same trials, of shape (n,).
        confidence: Confidence of the interval.
    """
    difference = b - a
    mean = float(difference.mean())
    spread = float(difference.std(ddof=1))
    if spread == 0.0:
        return PairedMetric(
            name, len(a), float(a.mean()), float(b.mean()), (mean, mean), mean != 0.0, None
        )
    with np.errstate(all="ignore"):
        found = stats.bootstrap(
            (difference,),
            np.mean,
            n_resamples=_RESAMPLES,
            confidence_level=confidence,
            method="BCa" if len(difference) >= 8 else "percentile",
            vectorized=True,
            rng=np.random.default_rng(_SEED),
        ).confidence_interval
    low, high = float(found.low), float(found.high)
    z = NormalDist().inv_cdf(0.5 + confidence / 2) + NormalDist().inv_cdf(_POWER)
    # The randomization test of fewer pairs cannot decide, whatever their values are.
    fewest = math.ceil(1.0 - math.log2(1.0 - confidence))
    needed = None if mean == 0.0 else max(fewest, math.ceil((z * spread / mean) ** 2))
    differs = bool(low > 0.0 or high < 0.0)
    if differs and len(difference) < _FEW_PAIRS:
        differs = randomization_p(difference, 1.0 - confidence) <= 1.0 - confidence
    return PairedMetric(
        name, len(a), float(a.mean()), float(b.mean()), (low, high), differs, needed
    )


def verdict_of(rates: PairedRates) -> Verdict:
    """Whether the second version succeeds more often than the first one."""
    if rates.p_value > 1 - CONFIDENCE:
        return "undecided"
    return "better" if rates.only_b > rates.only_a else "worse"
