"""What the series of a leaf show: positions, their plane, how far they are from what was meant."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from bt_dualarm.pose import Vector
from bt_dualarm.runtime.series import Series

REFERENCES = ("planned", "target")
"""Series that say where something ought to be: drawn black and dashed, errors count from them."""

NORMAL = "plane_normal"
"""Series of a leaf that says in which plane it worked: it is not drawn, and chooses the axes."""


def positions(series: Iterable[Series]) -> list[Series]:
    """Those that are to be drawn as points of the world."""
    return [one for one in series if one.is_position and one.name != NORMAL]


def plane_of(series: Mapping[str, Series]) -> tuple[int, int]:
    """The two axes that show a leaf's plane best, in alphabetical order.

    Of one that does not say its plane, those along which something was to move most.
    """
    if NORMAL in series:
        shown = -np.abs(series[NORMAL].values[-1])
    else:
        shown = np.ptp(positions(series.values())[0].values, axis=0)
    u, v = sorted(np.argsort(shown, kind="stable")[1:])
    return int(u), int(v)


def errors(
    leaves: Mapping[str, Mapping[str, Series]],
) -> dict[str, list[tuple[str, Vector, Vector]]]:
    """Distance of each position series from its leaf's reference, where they can be compared.

    A leaf that records an error of its own (in its plane, say) is not measured once more.
    """
    rows: dict[str, list[tuple[str, Vector, Vector]]] = {}
    for leaf, all_ in leaves.items():
        if any(name.startswith("error") for name in all_):
            continue
        series = positions(all_.values())
        reference = next((one for one in series if one.name in REFERENCES), None)
        for one in series:
            if reference is None or one is reference:
                continue
            ought = np.column_stack(
                [np.interp(one.time, reference.time, column) for column in reference.values.T]
            )
            distance = np.linalg.norm(one.values - ought, axis=1)
            quantity = f"{reference.name} to {one.name}_m"
            rows.setdefault(quantity, []).append((leaf, one.time, distance))
    return rows
