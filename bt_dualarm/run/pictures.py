"""The pictures that a run leaves: which there are, of what, and writing them one by one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.run.holding import Holding, Holdings
from bt_dualarm.run.outcome import RunResult
from bt_dualarm.run.plots import OBJECT, PICTURE, in_plane, over_time, overview, scene
from bt_dualarm.run.series import SeriesLog
from bt_dualarm.run.signals import StopRequest
from bt_dualarm.run.tracks import Tracks
from bt_dualarm.run.whole_files import write_whole
from bt_dualarm.world.still import Still, best_viewpoint


@dataclass(frozen=True)
class Seen:
    """What was observed during a run.

    Attributes:
        tracks: Where tools and objects were.
        series: What the skills measured.
        holdings: Who held what.
        stills: The world at the start and at the end.
    """

    tracks: Tracks
    series: SeriesLog
    holdings: Holdings
    stills: Sequence[Still]


def write_all(folder: Path, result: RunResult, seen: Seen, stop: StopRequest) -> Iterator[Path]:
    """Write ``overview.png``, ``scene.png``, ``<arm>_plane.png`` and ``<arm>_time.png``.

    There is no scene where there is nothing to see, and no plot of an arm that measured nothing.

    Args:
        folder: Where to.
        result: Names the arms.
        seen: What they show.
        stop: The rest is left out once the end is urgent.
    """
    if stop.urgent or not len(seen.tracks.time):
        return
    for name, figure in _figures(result, seen):
        canvas = FigureCanvasAgg(figure)
        write_whole(folder / f"{name}.png", canvas.print_png)
        yield folder / f"{name}.png"
        if stop.urgent:
            return


def _figures(result: RunResult, seen: Seen) -> Iterator[tuple[str, Figure]]:
    """Each drawn when it is asked for."""
    time, paths = seen.tracks.time, seen.tracks.positions()
    yield "overview", overview(paths, seen.tracks.bases)
    stills = [still for still in seen.stills if still.is_sound]
    viewpoint = best_viewpoint(stills, PICTURE[0] / PICTURE[1])
    if viewpoint is not None:
        yield "scene", scene(stills, viewpoint)
    for arm in result.arms:
        leaves = {
            leaf.partition("/")[2] or leaf: all_ for leaf, all_ in seen.series.of(arm.name).items()
        }
        if leaves:
            title = f"{arm.name} ({arm.robot})"
            carried = _carried(seen.holdings.of(arm.name), time, paths)
            yield f"{arm.name}_plane", in_plane(leaves, time, carried, title)
            yield f"{arm.name}_time", over_time(leaves, title)


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
