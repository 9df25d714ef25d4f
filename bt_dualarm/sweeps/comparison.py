"""The comparison of two sweeps, paired by seed, parameters and reality."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bt_dualarm.sweeps.manifest import SweepError
from bt_dualarm.sweeps.statistics import (
    PairedMetric,
    PairedRates,
    Verdict,
    paired_metric,
    verdict_of,
)
from bt_dualarm.sweeps.table import TABLE, columns_of, ordered, read_file, read_rows

if TYPE_CHECKING:
    import pyarrow as pa

METRICS_CONFIDENCE: Final = 0.99
"""Confidence that no metric of equal versions is called different. It is higher than that of other
intervals: who compares every change would otherwise be misled once in twenty times."""

_LEAST_PAIRS: Final = 5
"""Pairs without which a metric is not compared."""


@dataclass(frozen=True)
class Comparison:
    """Two sweeps compared.

    Attributes:
        pairs: Number of trials with the same seed, parameters and reality in both.
        only_in_a: Trials without a partner in the second sweep.
        only_in_b: Trials without a partner in the first sweep.
        rates: Success in the pairs.
        verdict: Whether the second sweep succeeds more often.
        metrics: Metrics of trials that succeeded in both, those that differ first.
        equal_states: Pairs with the same state hash.
    """

    pairs: int
    only_in_a: int
    only_in_b: int
    rates: PairedRates
    verdict: Verdict
    metrics: tuple[PairedMetric, ...]
    equal_states: int

    @property
    def is_decided(self) -> bool:
        """Whether success or a metric differs."""
        return self.verdict in ("better", "worse") or any(one.differs for one in self.metrics)

    def as_dict(self) -> dict[str, object]:
        """The comparison as JSON-ready data."""
        return {
            "pairs": self.pairs,
            "only_in_a": self.only_in_a,
            "only_in_b": self.only_in_b,
            "equal_states": self.equal_states,
            "success": {
                **vars(self.rates),
                "difference": self.rates.difference,
                "p_value": self.rates.p_value,
                "verdict": self.verdict,
                "runs_needed": self.rates.runs_needed(),
            },
            "metrics": [vars(one) for one in self.metrics],
        }


def compare(a: Path, b: Path) -> Comparison:
    """Compare the sweeps in two output folders.

    Success is compared by McNemar's exact test. A metric is compared by a bootstrap of its mean
    paired difference over the trials that succeeded in both. As there are many metrics, each
    interval has a confidence that keeps the chance of any false difference at 1 % (Bonferroni).

    Raises:
        SweepError: A folder is not one of a sweep, or no trials can be paired.
    """
    tables = [_table(folder) for folder in (a, b)]
    keyed = [_keyed(table) for table in tables]
    common = [key for key in keyed[0] if key in keyed[1]]
    if not common:
        raise SweepError(
            f"{a} and {b} have no trials with the same seed, parameters and reality: run both with "
            "the same --seeds, --param and --reality"
        )
    rows = [np.array([index[key] for key in common]) for index in keyed]
    success = [
        np.array([one == "SUCCESS" for one in table["outcome"].to_pylist()])[row]
        for table, row in zip(tables, rows, strict=True)
    ]
    rates = PairedRates(
        int((success[0] & success[1]).sum()),
        int((success[0] & ~success[1]).sum()),
        int((~success[0] & success[1]).sum()),
        int((~success[0] & ~success[1]).sum()),
    )
    hashes = [table.column("state_sha256").to_pylist() if "state_sha256" in table.column_names
              else [None] * len(table) for table in tables]  # fmt: skip
    equal = sum(
        hashes[0][i] is not None and hashes[0][i] == hashes[1][j]
        for i, j in zip(*rows, strict=True)
    )
    return Comparison(
        len(common),
        len(keyed[0]) - len(common),
        len(keyed[1]) - len(common),
        rates,
        "equal" if equal == len(common) else verdict_of(rates),
        _metrics(tables, rows, success[0] & success[1]),
        equal,
    )


def _table(folder: Path) -> pa.Table:
    """Trials of the last sweep in a folder; all its rows if that sweep was killed.

    Raises:
        SweepError: The folder is not one of a sweep, or has no trials.
    """
    rows = read_rows([folder])
    if rows is None:
        raise SweepError(f"{folder} has no trials")
    return read_file(folder / TABLE) if (folder / TABLE).is_file() else ordered(rows)


def _keyed(table: pa.Table) -> dict[str, int]:
    """Row number of each trial by what pairs it; of several, the first one."""
    names = ["seed", "reality", *sorted(columns_of(table, "param.").values())]
    columns = [table[name].to_pylist() for name in names]
    found: dict[str, int] = {}
    for number, values in enumerate(zip(*columns, strict=True)):
        found.setdefault(json.dumps(dict(zip(names, values, strict=True))), number)
    return found


def _metrics(
    tables: list[pa.Table],
    rows: list[Any],  # Any: index arrays
    both: Any,  # Any: a mask
) -> tuple[PairedMetric, ...]:
    paired: dict[str, tuple[Any, Any]] = {}
    numeric = [_numeric(table) for table in tables]
    for name in numeric[0]:
        if name not in numeric[1]:
            continue
        a, b = (
            table[columns[name]].to_numpy(zero_copy_only=False).astype(float)[row]
            for table, columns, row in zip(tables, numeric, rows, strict=True)
        )
        known = both & np.isfinite(a) & np.isfinite(b)
        if known.sum() >= _LEAST_PAIRS and (a[known].std() > 0 or b[known].std() > 0):
            paired[name] = (a[known], b[known])
    confidence = 1 - (1 - METRICS_CONFIDENCE) / max(len(paired), 1)
    found = [paired_metric(name, a, b, confidence) for name, (a, b) in paired.items()]
    return tuple(sorted(found, key=lambda one: (not one.differs, one.name)))


def _numeric(table: pa.Table) -> Mapping[str, str]:
    return {
        name: column
        for name, column in {**columns_of(table, "metric."), "sim_time_s": "sim_time_s"}.items()
        if column in table.column_names and str(table.schema.field(column).type) == "double"
    }
