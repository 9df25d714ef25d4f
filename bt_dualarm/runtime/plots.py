"""Plots of a run: planned and executed paths in the plane and over time, and their files."""

from __future__ import annotations

import colorsys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import cycle, islice
from pathlib import Path
from typing import TypedDict

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from scipy.spatial import ConvexHull

from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.core.share import write_atomically
from bt_dualarm.runtime.interruption import StopRequest
from bt_dualarm.runtime.outcome import Holding, Holdings, RunResult, Series, Tracks
from bt_dualarm.sim.frame import Viewpoint
from bt_dualarm.sim.painter import StillRenderer, are_lost, best_viewpoint

REFERENCES = ("planned", "target")
"""Names of reference series: drawn in black and dashed, errors are measured from them."""

NORMAL = "plane_normal"
"""Name of the series with the normal of a leaf's plane: not drawn, selects the plotted axes."""


def positions(series: Iterable[Series]) -> list[Series]:
    """The position series to be drawn."""
    return [one for one in series if one.is_position and one.name != NORMAL]


def plane_of(series: Mapping[str, Series]) -> tuple[int, int]:
    """The two world axes that show a leaf's plane best, in alphabetical order.

    For a leaf without a plane, the axes with the largest extent of its first position series.
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
    """Distance of each position series from its leaf's reference, m, by quantity.

    A leaf that records an error itself (in its plane, for example) is skipped.
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
            expected = np.column_stack(
                [np.interp(one.time, reference.time, column) for column in reference.values.T]
            )
            distance = np.linalg.norm(one.values - expected, axis=1)
            quantity = f"{reference.name} to {one.name}_m"
            rows.setdefault(quantity, []).append((leaf, one.time, distance))
    return rows


COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
"""Palette for color-blind readers (Okabe and Ito, Color Universal Design, 2008)."""

_GOLDEN = 0.618034
"""Steps of this share of the color circle keep hues apart, however many there are."""


def distinct_colors(count: int) -> list[str]:
    """As many different colors: those of `COLORS`, then darker and lighter hues in turn."""
    colors = list(COLORS[:count])
    for extra in range(count - len(colors)):
        hue = (0.05 + extra * _GOLDEN) % 1.0
        lightness = (0.3, 0.62)[extra % 2]
        colors.append(to_hex(colorsys.hls_to_rgb(hue, lightness, (0.55, 0.85)[extra // 2 % 2])))
    return colors


_MOVED_M = 0.01
"""Smallest movement in m for which an object is drawn."""

_FLAT_M = 1e-6
_HUGE_M = 4.0
"""Smallest extent in m of an outline that is drawn, and largest of one that is shown whole."""

_ONE_POINT_M = 0.03
"""Distance in m of two points whose labels would overlap."""

_TOOL = "tool_"
OBJECT = "object_"
"""Prefixes of the names of paths."""

_AXES = "xyz"
_MAX_PANELS = 6
_MAX_ROWS = 30
"""Largest number of quantities plotted over time."""

PICTURE = (640, 480)
"""Width and height in pixels of a rendering of the world."""


class _Style(TypedDict, total=False):
    """Keyword arguments of a line in matplotlib."""

    color: str
    linewidth: float
    linestyle: tuple[int, tuple[int, int]]


def overview(
    paths: Mapping[str, Matrix],
    bases: Mapping[str, Vector],
    fixed: Mapping[str, Sequence[Matrix]] | None = None,
) -> Figure:
    """Figure of the paths of all tools and moved objects, seen from above and from the side.

    Args:
        paths: Positions of tools and objects over time in the world, each of shape (n, 3), m, by
            name.
        bases: Positions of the arms' bases in the world, each of shape (3,), m, by the arms' names.
        fixed: Fixed objects and the scene, by name: points whose convex hulls are their shapes,
            each of shape (n, 3), m.
    """
    figure = Figure(figsize=(10, 4.8), dpi=120, layout="constrained")
    figure.suptitle("Paths of tools and objects")
    panels = figure.subplots(1, 2)
    shown = {name: path for name, path in paths.items() if name.startswith(_TOOL) or _moved(path)}
    colors = distinct_colors(len(shown))
    for axes, (u, v), view in zip(panels, ((0, 1), (1, 2)), ("from above", "along x"), strict=True):
        _draw_fixed(axes, fixed or {}, u, v)
        for (name, path), color in zip(shown.items(), colors, strict=True):
            label = name.replace(_TOOL, "tool of ").replace(OBJECT, "")
            axes.plot(path[:, u], path[:, v], color=color, label=label, linewidth=1.2)
            axes.plot(*path[_first(path)][[u, v]], "o", color=color, markersize=5)
        for names, base in _at_one_point({name: base[[u, v]] for name, base in bases.items()}):
            axes.plot(*base, "s", color="0.35", markersize=8)
            axes.annotate(names, base, (0, 7), textcoords="offset points", ha="center", fontsize=8)
        _label_plane(axes, u, v, f"seen {view}")
    if shown:
        panels[0].legend(fontsize=8, title="● start   ■ base", title_fontsize=8)
    return figure


def _draw_fixed(axes: Axes, fixed: Mapping[str, Sequence[Matrix]], u: int, v: int) -> None:
    """Draw outlines in gray, the largest first, each with its name in its lower left corner."""
    outlines = [
        (name, flat[ConvexHull(flat, qhull_options="QJ").vertices])  # QJ: however thin it is
        for name, shapes in fixed.items()
        for flat in (shape[:, [u, v]] for shape in shapes)
        if np.ptp(flat, axis=0).min() > _FLAT_M
    ]
    outlines.sort(key=lambda pair: -float(np.ptp(pair[1], axis=0).prod()))
    corners: dict[str, Vector] = {}
    for name, outline in outlines:
        shape = Polygon(outline, facecolor="0.93", edgecolor="0.65", linewidth=0.8, zorder=0.5)
        if np.ptp(outline, axis=0).max() <= _HUGE_M:
            axes.add_patch(shape)
            corners.setdefault(name, outline.min(axis=0))
        else:  # a wall or floor; an artist does not count for the section that is shown
            axes.add_artist(shape)
    for names, corner in _at_one_point(corners):
        axes.annotate(
            names, corner, (3, 3), textcoords="offset points", fontsize=7, color="0.45", zorder=1
        )


def _at_one_point(points: Mapping[str, Vector]) -> Iterator[tuple[str, tuple[float, float]]]:
    """Yields labels of points, of shape (2,), in m: one label for all names at nearly one point.

    Parts of arms, such as their pedestals, get none.
    """
    left = {name: point for name, point in points.items() if name and "/" not in name}
    while left:
        point = next(iter(left.values()))
        names = [name for name, at in left.items() if np.abs(at - point).max() < _ONE_POINT_M]
        yield ", ".join(names), (float(point[0]), float(point[1]))
        left = {name: at for name, at in left.items() if name not in names}


def scene(stills: Sequence[StillRenderer], viewpoint: Viewpoint) -> Figure:
    """Figure of the world at the start and at the end, side by side, seen from one viewpoint."""
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
    """Figure of each leaf's position series in its plane.

    Args:
        leaves: Series of one arm, by leaf and by name.
        time: Simulated seconds of ``paths``, of shape (n,).
        paths: Positions of each object while the arm held it, of shape (n, 3), m, else NaN.
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
    """Figure of coordinates in the plane, distances from references, and scalars over time.

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
    """Plot one coordinate of every position series; each name appears in the legend once."""
    named: set[str] = set()
    for all_ in leaves.values():
        for one, style in _styled(positions(all_.values())):
            label = None if one.name in named else one.name
            named.add(one.name)
            axes.plot(one.time, one.values[:, coordinate], label=label, **style)
    axes.set_ylabel(f"{_AXES[coordinate]} [m]")
    axes.legend(fontsize=8, loc="upper right")


def _shown_unit(quantity: str) -> tuple[float, str]:
    """Factor from the unit at the end of a name to the unit shown, and the axis label."""
    name, _, unit = quantity.rpartition("_")
    factor, shown = {"m": (1e3, "mm"), "rad": (np.degrees(1.0), "°")}.get(unit, (1.0, unit))
    if not name:
        return 1.0, quantity
    return float(factor), f"{name.replace('_', ' ')} [{shown}]"


def _styled(series: Sequence[Series]) -> Iterator[tuple[Series, _Style]]:
    """Yields each series with its style: first measured ones in colors, then dashed references."""
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
    """Sections of the paths during the leaf's series, of objects that moved then."""
    during = (time >= series[0].time[0]) & (time <= series[0].time[-1])
    then = {name: path[during] for name, path in paths.items()}
    return {name: path for name, path in then.items() if _moved(path)}


def _without_lost(paths: Mapping[str, Matrix], bases: Mapping[str, Vector]) -> dict[str, Matrix]:
    """The paths, without the sections of objects that are far from all arms: NaN there.

    A fault that takes an object away puts it there, and an object may roll or fall out of the cell.
    """
    arms = [*bases.values(), *(path for name, path in paths.items() if name.startswith(_TOOL))]
    points = np.vstack([np.zeros((0, 3)), *arms])
    if not len(points):
        return dict(paths)
    return {
        name: path
        if name.startswith(_TOOL)
        else np.where(are_lost(path, points)[:, None], np.nan, path)
        for name, path in paths.items()
    }


def _moved(path: Matrix) -> bool:
    """Whether a path has positions and moves."""
    known = path[~np.isnan(path[:, 0])]
    return len(known) > 0 and bool(np.ptp(known, axis=0).max() > _MOVED_M)


def _first(path: Matrix) -> int:
    """Row of the first known position of a path."""
    return int(np.argmin(np.isnan(path[:, 0])))


def _label_plane(axes: Axes, u: int, v: int, title: str) -> None:
    axes.set_xlabel(f"{_AXES[u]} [m]")
    axes.set_ylabel(f"{_AXES[v]} [m]")
    axes.set_title(title, fontsize=10)
    axes.set_aspect("equal", adjustable="datalim")
    axes.grid(visible=True, alpha=0.3)


MOST_DRAWN = 8192
"""Points plotted per line: several for each column of pixels."""


@dataclass(frozen=True)
class Observed:
    """Data for the plots of a run.

    Attributes:
        tracks: Positions of tools and objects over time.
        holdings: Attachments of objects to arms.
        stills: Renderings of the world at the start and at the end.
    """

    tracks: Tracks
    holdings: Holdings
    stills: Sequence[StillRenderer]


def files_of(
    result: RunResult, observed: Observed, stop: StopRequest
) -> Iterator[tuple[str, Callable[[Path], None]]]:
    """Yields ``overview.png``, ``scene.png``, ``<arm>_plane.png`` and ``<arm>_time.png``.

    There is no scene without a visible object, and no plot of an arm without series.

    Args:
        result: Result of the run.
        observed: Data to plot.
        stop: The remaining files are skipped once the end is urgent.

    Yields:
        Name of a file, and the function that draws and writes it.
    """
    if not len(observed.tracks.time):
        return
    for name, draw in _drawings(result, observed):
        if stop.urgent:
            return
        yield f"{name}.png", partial(_write, draw)


def _write(draw: Callable[[], Figure], path: Path) -> None:
    write_atomically(path, FigureCanvasAgg(draw()).print_png)


def _drawings(result: RunResult, observed: Observed) -> Iterator[tuple[str, Callable[[], Figure]]]:
    time = observed.tracks.time
    shown = _drawn(len(time))
    time = time[shown]
    paths = {name: path[shown] for name, path in observed.tracks.positions().items()}
    paths = _without_lost(paths, observed.tracks.bases)
    stills = [still for still in observed.stills if still.is_sound]
    fixed = {name: one for still in stills for name, one in still.fixed_outlines().items()}
    yield "overview", partial(overview, paths, observed.tracks.bases, fixed)
    viewpoint = best_viewpoint(stills, PICTURE[0] / PICTURE[1])
    if viewpoint is not None:
        yield "scene", partial(scene, stills, viewpoint)
    for arm in result.arms.values():
        leaves = {
            leaf.partition("/")[2] or leaf: {name: _thinned(one) for name, one in series.items()}
            for leaf, series in arm.series.items()
        }
        if leaves:
            title = f"{arm.name} ({arm.robot})"
            carried = _carried(observed.holdings.of(arm.name), time, paths)
            yield f"{arm.name}_plane", partial(in_plane, leaves, time, carried, title)
            yield f"{arm.name}_time", partial(over_time, leaves, title)


def _thinned(series: Series) -> Series:
    shown = _drawn(len(series.time))
    return replace(series, time=series.time[shown], values=series.values[shown])


def _drawn(count: int) -> npt.NDArray[np.int_]:
    """Indices of the points to plot: all, or `MOST_DRAWN` of them, including the ends."""
    return np.linspace(0, count - 1, min(count, MOST_DRAWN)).round().astype(int)


def _carried(
    holdings: Sequence[Holding], time: Vector, paths: Mapping[str, Matrix]
) -> dict[str, Matrix]:
    """Path of each object while it was held, NaN at other times."""
    found: dict[str, Matrix] = {}
    for held in holdings:
        path = paths.get(OBJECT + held.object)
        if path is not None:
            during = held.during(time)
            found.setdefault(held.object, np.full_like(path, np.nan))[during] = path[during]
    return found
