"""The search for the boundary between success and failure in one or two parameters.

A coarse grid is tried first. Then every interval (or square) whose corners disagree is halved,
level by level: all trials lie near the boundary, and each level halves its uncertainty. Which
trials a level has depends only on the results of the levels before it, so a search can be ended
and resumed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import TYPE_CHECKING, Final

from bt_dualarm.spec.yaml_reader import Data
from bt_dualarm.sweeps.manifest import Grid, Manifest, SweepError
from bt_dualarm.sweeps.statistics import Boundary, SuccessRate

if TYPE_CHECKING:
    import pyarrow as pa

    from bt_dualarm.sweeps.sweep import SweepResult

COARSE: Final = 5
"""Points of the first grid along each parameter."""

MOST_LEVELS: Final = 12


def search_boundary(manifest: Manifest, run: Callable[[Manifest], SweepResult]) -> SweepResult:
    """Search the boundary at which half of the seeds succeed.

    Args:
        manifest: Manifest with one or two parameters as ranges, FROM:TO; the others are listed, and
            have one value each. ``search`` is the number of halvings after the coarse grid. Success
            at a point is the share of its seeds and realities.
        run: Runs a manifest of explicit points.

    Returns:
        The result of the last run, with all trials of the search and the boundary.

    Raises:
        SweepError: The manifest has no range or more than two, or another parameter varies.
    """
    ranges = {n: v for n, v in manifest.params.items() if isinstance(v, Grid) and v.count is None}
    if not 1 <= len(ranges) <= 2:
        raise SweepError(
            f"a search needs one or two parameters as a range, FROM:TO; there are {len(ranges)}"
        )
    levels = manifest.search or 0
    if not 0 <= levels <= MOST_LEVELS:
        raise SweepError(f"{levels} is not a number of halvings from 0 to {MOST_LEVELS}")
    fixed: dict[str, Data] = {}
    for name, values in manifest.params.items():
        if name not in ranges:
            listed = values.values() if isinstance(values, Grid) else values
            if len(listed) != 1:
                raise SweepError(f"{name}: in a search, the other parameters have one value each")
            fixed[name] = listed[0]
    names = tuple(ranges)
    # Points have integer coordinates on the finest grid, so that equal points are equal.
    finest = (COARSE - 1) * 2**levels
    step = 2**levels

    def at(point: tuple[int, ...]) -> tuple[float, ...]:
        return tuple(
            float(f"{one.low + (one.high - one.low) * number / finest:.12g}")
            for one, number in zip(ranges.values(), point, strict=True)
        )

    tried: dict[tuple[int, ...], SuccessRate] = {}
    result = None
    squares = [
        tuple(number * step for number in corner)
        for corner in product(range(COARSE - 1), repeat=len(names))
    ]
    for _ in range(levels + 1):
        wanted = {c for square in squares for c in _corners(square, step)} - tried.keys()
        every = sorted({*tried, *wanted})
        explicit = tuple({**fixed, **dict(zip(names, at(point), strict=True))} for point in every)
        result = run(replace(manifest, params={}, explicit=explicit, search=None))
        rates = _rates(result.table, names)
        tried = {point: rates.get(at(point), SuccessRate(0, 0)) for point in every}
        mixed = [square for square in squares if _is_mixed(square, step, tried)]
        if step == 1 or not result.complete:
            break
        step //= 2
        squares = [
            tuple(a + step * b for a, b in zip(square, half, strict=True))
            for square in mixed
            for half in product((0, 1), repeat=len(names))
        ]
        if not squares:
            break
    if result is None:
        raise AssertionError("there is at least one level")
    spacing = tuple((one.high - one.low) * step / finest for one in ranges.values())
    points = tuple(
        tuple((a + b) / 2 for a, b in zip(at(low), at(high), strict=True))
        for low, high in _crossings(tried, step)
    )
    rates_at = {at(point): rate for point, rate in tried.items()}
    return replace(result, boundary=Boundary(names, points, spacing, rates_at))


def _corners(square: tuple[int, ...], step: int) -> list[tuple[int, ...]]:
    return [
        tuple(a + step * b for a, b in zip(square, corner, strict=True))
        for corner in product((0, 1), repeat=len(square))
    ]


def _is_mixed(
    square: tuple[int, ...], step: int, tried: Mapping[tuple[int, ...], SuccessRate]
) -> bool:
    known = [tried[corner].value >= 0.5 for corner in _corners(square, step) if corner in tried]
    return any(known) and not all(known)


def _crossings(
    tried: Mapping[tuple[int, ...], SuccessRate], step: int
) -> list[tuple[tuple[int, ...], tuple[int, ...]]]:
    """Pairs of neighbors on the finest tried grid that disagree."""
    found = []
    for point, rate in sorted(tried.items()):
        for axis in range(len(point)):
            other = tuple(n + step * (axis == k) for k, n in enumerate(point))
            if other in tried and (rate.value >= 0.5) != (tried[other].value >= 0.5):
                found.append((point, other))
    return found


def _rates(table: pa.Table, names: Sequence[str]) -> dict[tuple[float, ...], SuccessRate]:
    columns = [table[f"param.{name}"].to_pylist() for name in names]
    found: dict[tuple[float, ...], SuccessRate] = {}
    for *point, outcome in zip(*columns, table["outcome"].to_pylist(), strict=True):
        key = tuple(map(float, point))
        before = found.get(key, SuccessRate(0, 0))
        found[key] = SuccessRate(before.successes + (outcome == "SUCCESS"), before.trials + 1)
    return found
