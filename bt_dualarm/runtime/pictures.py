"""The pictures that a run leaves: which there are, of what, and writing them one by one."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.runtime.atomic_write import write_atomically
from bt_dualarm.runtime.holding import Holding, Holdings
from bt_dualarm.runtime.plots import OBJECT, PICTURE, in_plane, over_time, overview, scene
from bt_dualarm.runtime.result import RunResult
from bt_dualarm.runtime.series import Series
from bt_dualarm.runtime.signals import StopRequest
from bt_dualarm.runtime.tracks import Tracks
from bt_dualarm.world.rendering.still import Still, best_viewpoint

MOST_DRAWN = 8192
"""Points of a line that are drawn: several for each column of the picture."""


@dataclass(frozen=True)
class Observed:
    """What was observed during a run.

    Attributes:
        tracks: Positions of tools and objects over time.
        holdings: Who held what.
        stills: The world at the start and at the end.
    """

    tracks: Tracks
    holdings: Holdings
    stills: Sequence[Still]


def files_of(
    result: RunResult, observed: Observed, stop: StopRequest
) -> Iterator[tuple[str, Callable[[Path], None]]]:
    """Names of ``overview.png``, ``scene.png``, ``<arm>_plane.png`` and ``<arm>_time.png``.

    There is no scene where there is nothing to see, and no plot of an arm that measured nothing.

    Args:
        result: What the run did.
        observed: What the pictures show.
        stop: The rest is left out once the end is urgent.

    Yields:
        The name of a file, and what draws and writes it.
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
    yield "overview", partial(overview, paths, observed.tracks.bases)
    stills = [still for still in observed.stills if still.is_sound]
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
    """Which of so many points are drawn: all, or `MOST_DRAWN` of them, the ends included."""
    return np.linspace(0, count - 1, min(count, MOST_DRAWN)).round().astype(int)


def _carried(
    holdings: Sequence[Holding], time: Vector, paths: Mapping[str, Matrix]
) -> dict[str, Matrix]:
    """Where each object was while it was held, NaN at other times."""
    found: dict[str, Matrix] = {}
    for held in holdings:
        path = paths.get(OBJECT + held.object)
        if path is not None:
            during = held.during(time)
            found.setdefault(held.object, np.full_like(path, np.nan))[during] = path[during]
    return found
