"""Maps of path error and stability over errors of an arm's model and limits of its drives.

    python -m benchmarks.plant_map [--robots ur5 panda] [--seeds 2] [--out out]

One map over the errors of link masses and friction in the model, one over the delay and bandwidth
of the drives; all else is as in ``lab``. Each point is a circle of 0.1 m at speed 1.0, the worst of
the seeds. Prints the maps and draws them (``plant_map.png``). Goal: every point is stable; exits
with code 1 otherwise.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from benchmarks.campaign import Campaign, add_options, registry
from benchmarks.path_reality import Figures, curves, measured, world_of
from bt_dualarm.core.pose import Matrix, Pose
from bt_dualarm.robots.robot_description import robot_names
from bt_dualarm.trajectory.trajectory import Trajectory

_GROWTH = 2.0
_GROWTH_MM = 0.3
_FAR_MM = 5.0
"""Path error beyond which a run counts as unstable even if it ends at rest."""


@dataclass(frozen=True)
class Scales:
    """One map: its axes, and the reality of a point.

    Attributes:
        across: Title of the horizontal axis.
        up: Title of the vertical axis.
        columns: Values along the horizontal axis.
        rows: Values along the vertical axis.
        reality: Function from a column and a row value to a reality as in a file.
    """

    across: str
    up: str
    columns: tuple[float, ...]
    rows: tuple[float, ...]
    reality: Callable[[float, float], Mapping[str, object]]


def _links_and_friction(links: float, friction: float) -> Mapping[str, object]:
    return {
        "set": "lab",
        "links": {"mass": links, "inertia": links},
        "friction": {"coulomb": friction, "viscous": friction},
    }


def _drives(delay: float, bandwidth: float) -> Mapping[str, object]:
    return {"set": "lab", "drive": {"delay": delay, "bandwidth": bandwidth}}


MAPS: Final = (
    Scales(
        "error of masses and inertias [share]",
        "error of friction [share]",
        (0.0, 0.1, 0.2, 0.3, 0.4),
        (0.0, 0.3, 0.6, 0.9),
        _links_and_friction,
    ),
    Scales(
        "delay of the drives [s]",
        "bandwidth of the drives [Hz]",
        (0.0, 0.001, 0.002, 0.003, 0.004),
        (100.0, 200.0, 500.0, 1000.0),
        _drives,
    ),
)


@dataclass(frozen=True)
class Place:
    """One point of a map: the worst RMS in mm over its seeds, and reasons of instability."""

    rms: float
    complaints: tuple[str, ...]


def instability(one: Figures) -> str:
    """Why a run was not stable, or an empty text.

    A stable run ends at rest and stays near its path, and its error does not grow.
    """
    if one.fault:
        return one.fault
    if one.worst > _FAR_MM:
        return f"it is {one.worst:.1f} mm off its path"
    first, _, last = one.thirds
    if last > _GROWTH * first + _GROWTH_MM:
        return f"its error grows from {first:.2f} to {last:.2f} mm"
    return ""


def stood(name: str, chart: int, across: float, up: float, seed: int) -> dict[str, Any]:
    """Error of a run at a point of a map, and why it was not stable."""
    tool, motion, planned = _curve(name)
    reality = MAPS[chart].reality(across, up)
    found = measured(world_of(name, tool, reality, "none", seed, registry().kinds), motion, planned)
    why = instability(found)
    return {"outcome": "FAILURE" if why else "SUCCESS", "rms": found.rms, "complaint": why}


@cache
def _curve(name: str) -> tuple[Pose, Trajectory, Matrix]:
    return next(curves(name))


def survey(name: str, chart: int, seeds: int, campaign: Campaign) -> list[list[Place]]:
    """All points of a map for one robot, in rows of the vertical axis, the lowest first."""
    scales = MAPS[chart]
    cases = [
        {"name": name, "chart": chart, "across": across, "up": up, "seed": seed}
        for up in scales.rows
        for across in scales.columns
        for seed in range(seeds)
    ]
    found = defaultdict[tuple[float, float], list[Any]](list)
    for case, one in campaign.run(stood, cases):
        found[case["up"], case["across"]].append(one)

    def place(up: float, across: float) -> Place:
        runs = found[up, across]
        complaints = tuple(one["complaint"] for one in runs if one["complaint"])
        return Place(max((one["rms"] for one in runs), default=math.nan), complaints)

    return [[place(up, across) for across in scales.columns] for up in scales.rows]


def table(scales: Scales, grid: Sequence[Sequence[Place]]) -> str:
    """RMS errors in mm as text, with ``!`` at points that are not stable."""
    head = "".join(f"{value:9g}" for value in scales.columns)
    lines = [f"  {scales.up} by {scales.across}", f"  {'':8}{head}"]
    for up, row in zip(scales.rows, grid, strict=True):
        cells = "".join(f"{one.rms:8.3f}{'!' * bool(one.complaints):1}" for one in row)
        lines.append(f"  {up:8g}{cells}")
    return "\n".join(lines)


def draw(grids: Mapping[str, Sequence[Sequence[Sequence[Place]]]], seeds: int, path: Path) -> None:
    """Draw a row of panels for each robot; points that are not stable are framed in red.

    Args:
        grids: Maps in the order of `MAPS`, by robot.
        seeds: Number of seeds of which each value is the worst.
        path: Image file; its suffix determines the format.
    """
    size = (5.2 * len(MAPS) + 1.0, 3.2 * len(grids) + 0.5)
    figure = Figure(figsize=size, dpi=110, layout="constrained")
    panels = figure.subplots(len(grids), len(MAPS), squeeze=False)
    values_mm = [one.rms for maps in grids.values() for grid in maps for row in grid for one in row]
    colors = LogNorm(min(values_mm), max(values_mm))
    for line, (name, maps) in zip(panels, grids.items(), strict=True):
        for axes, scales, grid in zip(line, MAPS, maps, strict=True):
            values = np.array([[one.rms for one in row] for row in grid])
            image = axes.imshow(values, norm=colors, cmap="viridis", aspect="auto", origin="lower")
            for (row, column), value in np.ndenumerate(values):
                ink = "black" if colors(value) > 0.6 else "white"
                axes.text(column, row, f"{value:.3f}", ha="center", va="center", color=ink)
                if grid[row][column].complaints:
                    corner = (column - 0.48, row - 0.48)
                    axes.add_patch(Rectangle(corner, 0.96, 0.96, fill=False, edgecolor="red", lw=2))
            axes.set_xticks(range(len(scales.columns)), [f"{one:g}" for one in scales.columns])
            axes.set_yticks(range(len(scales.rows)), [f"{one:g}" for one in scales.rows])
            axes.set(xlabel=scales.across, ylabel=scales.up, title=name)
    figure.colorbar(image, ax=panels, label="RMS [mm]")
    text = f"{seeds} seed{'s' * (seeds > 1)}; framed red: not stable"
    figure.suptitle(f"circle of 0.1 m at speed 1.0 in lab, worst of {text}", fontsize=11)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path)


def main() -> int:
    """Print and draw the maps; returns 1 if a point is not stable."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--robots", nargs="+", default=["ur5", "panda"], choices=robot_names())
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("out"))
    add_options(parser, has_out=True)
    arguments = parser.parse_args()
    with Campaign(arguments) as campaign:
        return run_maps(arguments, campaign)


def run_maps(arguments: argparse.Namespace, campaign: Campaign) -> int:
    """Print and draw the maps; returns 1 if a point is not stable."""
    unstable = 0
    grids: dict[str, list[list[list[Place]]]] = {}
    for name in arguments.robots:
        grids[name] = []
        for chart, scales in enumerate(MAPS):
            grid = survey(name, chart, arguments.seeds, campaign)
            print(f"{name}\n{table(scales, grid)}", flush=True)
            for row in grid:
                for one in row:
                    for complaint in one.complaints:
                        unstable += 1
                        print(f"    {complaint}", flush=True)
            grids[name].append(grid)
    draw(grids, arguments.seeds, arguments.out / "plant_map.png")
    print(f"runs that were not stable: {unstable}")
    return int(unstable > 0)


if __name__ == "__main__":
    sys.exit(main())
