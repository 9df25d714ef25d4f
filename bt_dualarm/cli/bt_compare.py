"""``bt-compare``: compares two sweeps, paired by seed, parameters and reality."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import TYPE_CHECKING

from bt_dualarm.cli.entry import FAILED, SUCCEEDED, given_path, print_json, print_parts, table

if TYPE_CHECKING:
    from bt_dualarm.sweeps.comparison import Comparison
    from bt_dualarm.sweeps.statistics import PairedMetric

_EPILOG = """\
examples:
  bt-sweep circle --seeds 0:50 --out before      then change something, and
  bt-sweep circle --seeds 0:50 --out after
  bt-compare before after                        better, worse, or undecided

Success is compared by McNemar's exact test, each metric by a bootstrap of the mean difference of
pairs; the chance of any false difference is 5 %.

exit code: 0 compared   1 the second sweep is worse in success   2 no trials can be paired
"""

_MOST_METRICS = 30


def main(argv: Sequence[str] | None) -> int:
    """Compare two sweeps; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="bt-compare",
        description="Compare two sweeps, paired by seed, parameters and reality.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("a", metavar="A", type=given_path, help="folder of the first sweep")
    parser.add_argument("b", metavar="B", type=given_path, help="folder of the second sweep")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    arguments = parser.parse_args(argv)
    from bt_dualarm.sweeps.comparison import compare

    found = compare(arguments.a, arguments.b)
    if arguments.json:
        print_json(found.as_dict())
    else:
        _print(found)
    return FAILED if found.verdict == "worse" else SUCCEEDED


def _print(found: Comparison) -> None:
    from bt_dualarm.spec.node_types import counted

    print(
        f"{counted(found.pairs, 'pair')} of trials, {found.equal_states} of them with equal states"
    )
    if found.only_in_a or found.only_in_b:
        print(f"without a partner: {found.only_in_a} in A, {found.only_in_b} in B")
    rates = found.rates
    print(
        f"success: {found.verdict.upper()} "
        f"({100 * rates.difference:+.1f} points, p = {rates.p_value:.3f}; only A succeeds "
        f"{counted(rates.only_a, 'time')}, only B {counted(rates.only_b, 'time')})"
    )
    needed = rates.runs_needed()
    if found.verdict == "undecided" and needed is not None:
        more = counted(max(needed - found.pairs, 1), "more pair")
        print(f"         about {more} would decide this difference")
    if not found.metrics:
        return
    rows = (_row(one) for one in found.metrics[:_MOST_METRICS])
    titles = ("metric", "pairs", "mean of A", "mean of B", "difference", "verdict")
    print_parts(table(titles, rows))


def _row(one: PairedMetric) -> tuple[str, ...]:
    low, high = one.interval
    if one.differs:
        verdict = "higher in B" if one.difference > 0 else "lower in B"
    elif one.needed is not None and one.needed > one.pairs:
        verdict = f"undecided, {one.needed - one.pairs} more"
    else:
        verdict = "undecided"
    span = f"{low:+.3g} to {high:+.3g}"
    return one.name, str(one.pairs), f"{one.mean_a:.4g}", f"{one.mean_b:.4g}", span, verdict
