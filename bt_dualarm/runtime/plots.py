"""Plots of a run: what was meant and what was done, in the plane and over time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import cycle, islice
from typing import TypedDict

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.runtime.plot_series import REFERENCES, errors, plane_of, positions
from bt_dualarm.runtime.series import Series
from bt_dualarm.world.rendering.still import Still
from bt_dualarm.world.rendering.viewpoint import Viewpoint

COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
"""Told apart by colour-blind readers too (Okabe and Ito, Color Universal Design, 2008)."""

_MOVED_M = 0.01
"""An object that moved less is not drawn."""

_TOOL, OBJECT = "tool_", "object_"
"""How the names of paths begin."""

_AXES = "xyz"
_MAX_PANELS = 6
_MAX_ROWS = 30
"""Quantities over time that are drawn; the series have them all."""

PICTURE = (640, 480)
"""Pixels of the world at one moment."""


class _Style(TypedDict, total=False):
    """How a line is drawn, in matplotlib's words."""

    color: str
    linewidth: float
    linestyle: tuple[int, tuple[int, int]]


def overview(paths: Mapping[str, Matrix], bases: Mapping[str, Vector]) -> Figure:
    """The paths of all tools and of all objects that moved, seen from above and from the side.

    Args:
        paths: Positions of tools and objects over time, by name.
        bases: Positions of the arms' bases, by the arms' names.
    """
    figure = Figure(figsize=(10, 4.8), dpi=120, layout="constrained")
    figure.suptitle("Paths of tools and objects")
    panels = figure.subplots(1, 2)
    shown = {name: path for name, path in paths.items() if name.startswith(_TOOL) or _moved(path)}
    for axes, (u, v), view in zip(panels, ((0, 1), (1, 2)), ("from above", "along x"), strict=True):
        for (name, path), color in zip(shown.items(), cycle(COLORS)):
            label = name.replace(_TOOL, "tool of ").replace(OBJECT, "")
            axes.plot(path[:, u], path[:, v], color=color, label=label, linewidth=1.2)
            axes.plot(*path[_first(path)][[u, v]], "o", color=color, markersize=5)
        for name, base in bases.items():
            axes.plot(base[u], base[v], "s", color="0.35", markersize=8)
            axes.annotate(
                name, base[[u, v]], (0, 7), textcoords="offset points", ha="center", fontsize=8
            )
        _label_plane(axes, u, v, f"seen {view}")
    if shown:
        panels[0].legend(fontsize=8, title="● start   ■ base", title_fontsize=8)
    return figure


def scene(stills: Sequence[Still], viewpoint: Viewpoint) -> Figure:
    """The world at some moments, side by side, all seen from one viewpoint."""
    figure = Figure(figsize=(6.4 * len(stills), 5.1), dpi=100, layout="constrained")
    panels = figure.subplots(1, len(stills), squeeze=False)[0]
    for axes, still, moment in zip(panels, stills, ("start", "end"), strict=False):
        axes.imshow(still.draw(viewpoint, *PICTURE), interpolation="antialiased")
        axes.set_title(f"{moment}: {still.time:.1f} s", fontsize=10)
        axes.set_axis_off()
    return figure


def in_plane(
    leaves: Mapping[str, Mapping[str, Series]],
    time: Vector,
    paths: Mapping[str, Matrix],
    title: str,
) -> Figure:
    """Each leaf's positions laid over each other in the plane that it worked in.

    Args:
        leaves: Series of one arm, by leaf and by name.
        time: Simulated seconds of ``paths``, of shape (n,).
        paths: Positions of each object while the arm held it, NaN at other times.
        title: Title of the figure.
    """
    shown = {leaf: found for leaf, all_ in leaves.items() if (found := positions(all_.values()))}
    shown = dict(list(shown.items())[:_MAX_PANELS])
    count = max(1, len(shown))
    figure = Figure(figsize=(1 + 4.6 * count, 5.0), dpi=120, layout="constrained")
    figure.suptitle(title)
    panels = figure.subplots(1, count, squeeze=False)[0]
    for axes, (leaf, series) in zip(panels, shown.items(), strict=False):
        u, v = plane_of(leaves[leaf])
        for name, path in _during(series, time, paths).items():
            axes.plot(path[:, u], path[:, v], color="0.75", linewidth=4, label=name)
        for one, style in _styled(series):
            axes.plot(one.values[:, u], one.values[:, v], label=one.name, **style)
        _label_plane(axes, u, v, leaf)
        axes.legend(fontsize=8)
    return figure


def over_time(leaves: Mapping[str, Mapping[str, Series]], title: str) -> Figure:
    """Coordinates in the plane, distances between what was meant and what was done, scalars.

    Args:
        leaves: Series of one arm, by leaf and by name.
        title: Title of the figure.
    """
    rows = errors(leaves)
    for leaf, all_ in leaves.items():
        for one in all_.values():
            if not one.is_position:
                rows.setdefault(one.name, []).append((leaf, one.time, one.values[:, 0]))
    rows = dict(islice(rows.items(), _MAX_ROWS))
    planes = [plane_of(all_) for all_ in leaves.values() if positions(all_.values())]
    coordinates = planes[0] if planes else ()
    count = max(1, len(rows) + len(coordinates))
    figure = Figure(figsize=(9, 1 + 2.2 * count), dpi=120, layout="constrained")
    figure.suptitle(title)
    panels = list(figure.subplots(count, 1, squeeze=False, sharex=True)[:, 0])
    for axes, coordinate in zip(panels, coordinates, strict=False):
        _draw_coordinate(axes, leaves, coordinate)
    for axes, (quantity, curves) in zip(panels[len(coordinates) :], rows.items(), strict=False):
        scale, label = _shown_unit(quantity)
        for (leaf, stamps, values), color in zip(curves, cycle(COLORS)):
            axes.plot(stamps, values * scale, color=color, linewidth=1.0, label=leaf)
        axes.set_ylabel(label)
        axes.legend(fontsize=8, loc="upper right")
    for axes in panels:
        axes.grid(visible=True, alpha=0.3)
    panels[-1].set_xlabel("simulated time [s]")
    return figure


def _draw_coordinate(
    axes: Axes, leaves: Mapping[str, Mapping[str, Series]], coordinate: int
) -> None:
    """One coordinate of every position series; each name stands in the legend once."""
    named: set[str] = set()
    for all_ in leaves.values():
        for one, style in _styled(positions(all_.values())):
            label = None if one.name in named else one.name
            named.add(one.name)
            axes.plot(one.time, one.values[:, coordinate], label=label, **style)
    axes.set_ylabel(f"{_AXES[coordinate]} [m]")
    axes.legend(fontsize=8, loc="upper right")


def _shown_unit(quantity: str) -> tuple[float, str]:
    """Factor from the unit that a name ends with to the one shown, and the axis label."""
    name, _, unit = quantity.rpartition("_")
    factor, shown = {"m": (1e3, "mm"), "rad": (np.degrees(1.0), "°")}.get(unit, (1.0, unit))
    if not name:
        return 1.0, quantity
    return float(factor), f"{name.replace('_', ' ')} [{shown}]"


def _styled(series: Sequence[Series]) -> Iterator[tuple[Series, _Style]]:
    """What was done in colours below, what was meant dashed above."""
    colors = iter(cycle(COLORS))
    for one in series:
        if one.name not in REFERENCES:
            yield one, {"color": next(colors), "linewidth": 1.4}
    for one in series:
        if one.name in REFERENCES:
            yield one, {"color": "black", "linewidth": 0.8, "linestyle": (0, (4, 3))}


def _during(
    series: Sequence[Series], time: Vector, paths: Mapping[str, Matrix]
) -> dict[str, Matrix]:
    """The part of the paths while the leaf ran, of what moved then."""
    during = (time >= series[0].time[0]) & (time <= series[0].time[-1])
    then = {name: path[during] for name, path in paths.items()}
    return {name: path for name, path in then.items() if _moved(path)}


def _moved(path: Matrix) -> bool:
    """Whether it was in the world and moved."""
    there = path[~np.isnan(path[:, 0])]
    return len(there) > 0 and bool(np.ptp(there, axis=0).max() > _MOVED_M)


def _first(path: Matrix) -> int:
    """Row at which a thing came into the world."""
    return int(np.argmin(np.isnan(path[:, 0])))


def _label_plane(axes: Axes, u: int, v: int, title: str) -> None:
    axes.set_xlabel(f"{_AXES[u]} [m]")
    axes.set_ylabel(f"{_AXES[v]} [m]")
    axes.set_title(title, fontsize=10)
    axes.set_aspect("equal", adjustable="datalim")
    axes.grid(visible=True, alpha=0.3)
