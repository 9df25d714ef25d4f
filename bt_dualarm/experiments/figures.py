"""Pictures of the experiments: the paths laid over each other, and the errors over time."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from bt_dualarm.experiments.results import Result
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.run.plots import COLORS

_SAMPLES = 400


def png(figure: Figure) -> bytes:
    """A figure as the content of a file."""
    buffer = io.BytesIO()
    FigureCanvasAgg(figure)
    figure.savefig(buffer, format="png")
    return buffer.getvalue()


def overlay(results: Sequence[Result]) -> Figure:
    """Planned, cube and tracked in the plane, one panel a result; the first seed of each.

    Each with its figures over all seeds, and the bound that theory puts to the first of them.
    """
    figure = Figure(figsize=(4.4 * len(results), 4.6), dpi=110, layout="constrained")
    for axes, result in zip(
        figure.subplots(1, len(results), squeeze=False)[0], results, strict=True
    ):
        trial = result.trials[0]
        axes.plot(*trial.planned.T * 1e3, color="0.75", linewidth=5, label="planned")
        axes.plot(*trial.cube.T * 1e3, color="black", linewidth=1.6, label="cube")
        axes.plot(*trial.tracked.T * 1e3, color=COLORS[1], linewidth=1.0, label="tracked")
        figures = f"{result.rms * 1e3:.2f} mm RMS (bound {result.bound * 1e3:.2f})"
        worst = f"{result.worst * 1e3:.2f} mm at most"
        axes.set_title(f"{result.cell.controller}\n{figures}, {worst}", fontsize=10)
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
    runs = f"{cell.renderer}, {seeds} seed" + "s" * (seeds > 1)
    return f"{cell.name}: {runs}\n{camera}, {faults}"


def over_time(results: Sequence[Result]) -> Figure:
    """Both coordinates and the error over time, with bands from the least to the largest seed.

    Dashed in the panel of the error: the bound of its root mean square.
    """
    figure = Figure(figsize=(10.0, 6.4), dpi=100, layout="constrained")
    panels = figure.subplots(3, 1, sharex=True)
    for result, color in zip(results, (COLORS[1], COLORS[0]), strict=False):
        times, low, middle, high = _bands(result)
        for axes, column in zip(panels, range(3), strict=True):
            axes.fill_between(times, low[:, column], high[:, column], color=color, alpha=0.3)
            axes.plot(times, middle[:, column], color=color, label=result.cell.controller)
        bound = {"color": color, "linestyle": "--", "linewidth": 1.0}
        panels[2].axhline(1e3 * result.bound, label=f"bound, {result.cell.controller}", **bound)
    trial = results[0].trials[0]
    for axes, column in zip(panels, trial.cube.T, strict=False):
        axes.plot(trial.times, 1e3 * column, "--", color="black", linewidth=0.8, label="cube")
    for axes, label in zip(panels, (*results[0].cell.axis_names, "error"), strict=True):
        _finish(axes, f"{label} [mm]")
    panels[2].set_yscale("log")
    panels[2].set_ylim(bottom=1e-2)
    panels[2].set_xlabel("time since the curve began [s]")
    figure.suptitle(_conditions(results[0]), fontsize=11)
    return figure


def _finish(axes: Any, label: str) -> None:
    axes.set_ylabel(label)
    axes.grid(visible=True, alpha=0.3)
    axes.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))


def _bands(result: Result) -> tuple[Vector, Matrix, Matrix, Matrix]:
    """Times, and least, mean and largest of coordinates and error in mm, each of shape (n, 3)."""
    times = np.linspace(0.0, min(trial.times[-1] for trial in result.trials), _SAMPLES)
    stack = []
    for trial in result.trials:
        columns = np.column_stack([trial.tracked, trial.error]).T * 1e3
        stack.append([np.interp(times, trial.times, column) for column in columns])
    values = np.array(stack).transpose(0, 2, 1)
    return times, values.min(axis=0), values.mean(axis=0), values.max(axis=0)
