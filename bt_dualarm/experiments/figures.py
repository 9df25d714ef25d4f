"""Pictures of the experiments: the paths laid over each other, and the errors over time."""

from __future__ import annotations

import io
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from bt_dualarm.experiments.results import Result
from bt_dualarm.experiments.trial import Trial
from bt_dualarm.pose import Vector
from bt_dualarm.runtime.plots import COLORS

_SAMPLES = 400


def png(figure: Figure) -> bytes:
    """A figure as the content of a file."""
    buffer = io.BytesIO()
    FigureCanvasAgg(figure)
    figure.savefig(buffer, format="png")
    return buffer.getvalue()


def overlay(results: Sequence[Result]) -> Figure:
    """Planned, cube and tracked in the plane, one panel a result: the paths of one seed.

    Each with its figures over all seeds, and the bound that theory puts to the first of them.
    """
    figure = Figure(figsize=(4.4 * len(results), 4.6), dpi=110, layout="constrained")
    panels, shown = figure.subplots(1, len(results), squeeze=False)[0], _shown(results)
    for axes, result, trial in zip(panels, results, shown, strict=True):
        axes.plot(*trial.planned.T * 1e3, color="0.75", linewidth=5, label="planned")
        axes.plot(*trial.cube.T * 1e3, color="black", linewidth=1.6, label="cube")
        axes.plot(*trial.tracked.T * 1e3, color=COLORS[1], linewidth=1.0, label="tracked")
        figures = f"{result.rms * 1e3:.2f} mm RMS (bound {result.bound * 1e3:.2f})"
        worst = f"{result.worst * 1e3:.2f} mm at most"
        of_seed = f": path of seed {trial.seed}" if len(result.trials) > 1 else ""
        title = f"{result.cell.controller}{of_seed}\n{figures}, {worst}"
        axes.set_title(title, fontsize=10)
        axes.set_xlabel(f"{result.cell.axis_names[0]} [mm]")
        axes.set_ylabel(f"{result.cell.axis_names[1]} [mm]")
        axes.set_aspect("equal", adjustable="datalim")
        axes.grid(visible=True, alpha=0.3)
    figure.legend(
        *axes.get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=9
    )
    figure.suptitle(_conditions(results[0]), fontsize=11)
    return figure


def _conditions(result: Result) -> str:
    cell, seeds = result.cell, len(result.trials)
    camera = f"{cell.fps:g} Hz, {1e3 * cell.latency_s:.0f} ms late"
    faults = f"{cell.drop:.0%} lost, {cell.noise:g} px of shake"
    runs = f"{cell.reality}, {cell.renderer}, {seeds} seed" + "s" * (seeds > 1)
    return f"{cell.name}: {runs}\n{camera}, {faults}"


def _shown(results: Sequence[Result]) -> list[Trial]:
    """One trial of each result: of the first seed that all have, else the first of each."""
    of_seeds = [{trial.seed: trial for trial in result.trials} for result in results]
    common = set.intersection(*(set(trials) for trials in of_seeds))
    return [trials[min(common or trials)] for trials in of_seeds]


def over_time(results: Sequence[Result]) -> Figure:
    """Both coordinates of one seed over time, and the error of all seeds.

    Each seed fetches the cube from elsewhere and takes another time for its curve, so means of
    coordinates would be of no run. The error is drawn as mean over the seeds, with a band from the
    least to the largest; dashed, the bound of its root mean square.
    """
    figure = Figure(figsize=(10.0, 6.4), dpi=100, layout="constrained")
    panels = figure.subplots(3, 1, sharex=True)
    shown = _shown(results)
    for result, trial, color in zip(results, shown, (COLORS[1], COLORS[0]), strict=False):
        name = result.cell.controller
        for axes, column in zip(panels, trial.tracked.T, strict=False):
            axes.plot(trial.times, 1e3 * column, color=color, label=name)
        times, low, middle, high = _band(result)
        panels[2].fill_between(times, low, high, color=color, alpha=0.3)
        panels[2].plot(times, middle, color=color, label=name)
        bound = {"color": color, "linestyle": "--", "linewidth": 1.0}
        panels[2].axhline(1e3 * result.bound, label=f"bound, {name}", **bound)
    for axes, column in zip(panels, shown[0].cube.T, strict=False):
        axes.plot(shown[0].times, 1e3 * column, "--", color="black", linewidth=0.8, label="cube")
    for axes, axis in zip(panels, results[0].cell.axis_names, strict=False):
        _finish(axes, f"{axis} [mm], seed {shown[0].seed}")
    _finish(panels[2], "error [mm], all seeds")
    panels[2].set_yscale("log")
    panels[2].set_ylim(bottom=1e-2)
    panels[2].set_xlabel("time since the curve began [s]")
    figure.suptitle(_conditions(results[0]), fontsize=11)
    return figure


def _finish(axes: Axes, label: str) -> None:
    axes.set_ylabel(label)
    axes.grid(visible=True, alpha=0.3)
    axes.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))


def _band(result: Result) -> tuple[Vector, Vector, Vector, Vector]:
    """Times in s up to the end of the shortest trial; least, mean and largest error in mm."""
    times = np.linspace(0.0, min(trial.times[-1] for trial in result.trials), _SAMPLES)
    errors = [np.interp(times, trial.times, 1e3 * trial.error) for trial in result.trials]
    return times, np.min(errors, axis=0), np.mean(errors, axis=0), np.max(errors, axis=0)
