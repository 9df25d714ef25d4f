"""The report of the experiments: HTML, Markdown, terminal table, images."""

from __future__ import annotations

import base64
import html
import io
import re
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from functools import cached_property, partial
from itertools import islice
from pathlib import Path
from typing import BinaryIO, Final, TypeAlias

import numpy as np
import scipy
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from rich import box
from rich.console import Console, JustifyMethod
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from bt_dualarm.core.pose import Vector
from bt_dualarm.core.share import write_atomically, write_text
from bt_dualarm.experiments.trials import Cell, Trial, TrialError, run_trials, tree_file
from bt_dualarm.perception.target_filter import TargetEstimate
from bt_dualarm.runtime.interruption import StopRequest
from bt_dualarm.runtime.plots import COLORS
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.node_types import counted
from bt_dualarm.spec.yaml_reader import Data

# Theoretical bounds: the smallest error for a camera of this rate, latency and noise.


_ASKED_A_FRAME = 4
_REST_S = 0.5  # time at rest before the curve begins


def bound(cell: Cell, trial: Trial) -> float:
    """Lower bound in m of the root mean square error of a controller on a curve."""
    if cell.controller == "proportional":
        return proportional_bound(trial.speed_rms, cell)
    return estimator_bound(trial, cell)


def proportional_bound(speed: float, cell: Cell) -> float:
    """``v / k`` at the highest stable gain k.

    On a ramp of speed v the error of ``x' = -k e(t - d)`` converges to v / k, and the loop is
    stable up to k = π / 2d; without overshoot k is at most 1 / (e d), and the error 2.7 v d.
    The delay d is the latency and, as a step is held for a frame, half a frame.
    """
    delay = cell.latency_s + 0.5 / cell.fps
    return 2.0 / np.pi * speed * delay


def estimator_bound(trial: Trial, cell: Cell) -> float:
    """Error of the filter with an ideal camera and arm: true positions plus white noise.

    The true path, with the rest before it, is sampled at the camera's rate with the measured
    deviation of a sighting; each sample is known one latency later, and the prediction to now
    compared with the truth.
    """
    rng = np.random.default_rng(trial.seed)
    spline = scipy.interpolate.CubicSpline(trial.times, trial.cube)
    begin = trial.times[0]
    end = trial.times[-1]
    estimate = TargetEstimate()
    errors = []
    for stamp in np.arange(begin - _REST_S, end, 1.0 / cell.fps):
        if rng.random() < cell.drop:
            continue
        seen = spline(max(stamp, begin)) + rng.normal(0.0, trial.sighting_sd, 2)
        estimate.update(float(stamp), seen, max(trial.sighting_sd, 1e-6))
        for share in range(_ASKED_A_FRAME):
            now = stamp + cell.latency_s + share / _ASKED_A_FRAME / cell.fps
            if begin <= now <= end:
                errors.append(estimate.predict(now).position - spline(now))
    return float(np.sqrt(np.mean(np.sum(np.square(errors), axis=1)))) if errors else 0.0


# Results of a cell over its repetitions, for tables and JSON.


@dataclass(frozen=True, eq=False)
class Result:
    """A cell with its trials, one per seed.

    Attributes:
        cell: Settings of the experiment.
        trials: Repetitions, at least one.
    """

    cell: Cell
    trials: Sequence[Trial]

    @cached_property
    def bounds(self) -> tuple[float, ...]:
        """Lower bound of each trial's RMS, in m."""
        return tuple(bound(self.cell, trial) for trial in self.trials)

    @property
    def bound(self) -> float:
        """Mean of `bounds`, in m."""
        return float(np.mean(self.bounds))

    @property
    def rms(self) -> float:
        """Root mean square over all trials, in m."""
        return float(np.sqrt(np.mean([trial.rms**2 for trial in self.trials])))

    @property
    def worst(self) -> float:
        """The largest error of all, in m."""
        return max(float(trial.error.max()) for trial in self.trials)

    def mean(self, name: str) -> float:
        """Mean of one number over the trials, by the number's name."""
        return float(np.mean([getattr(trial, name) for trial in self.trials]))

    def as_json(self) -> dict[str, Data]:
        """Settings and numbers; each list has one entry per seed."""
        trials = self.trials
        cell = self.cell
        return {
            "case": cell.case,
            "speed": cell.speed,
            "controller": cell.controller,
            "renderer": cell.renderer,
            "params": cell.params,
            "seeds": [trial.seed for trial in trials],
            "outcome": [trial.outcome for trial in trials],
            "yz_rms_m": [trial.rms for trial in trials],
            "yz_max_m": [float(trial.error.max()) for trial in trials],
            "lag_s": [trial.lag for trial in trials],
            "lost_count": [trial.lost_count for trial in trials],
            "amplitude_ratio": [trial.amplitude_ratio for trial in trials],
            "frames": [trial.frames for trial in trials],
            "sighting_sd_m": [trial.sighting_sd for trial in trials],
            "bound_m": list(self.bounds),
            "margins": [asdict(trial.margins) for trial in trials],
            "command": cell.command(trials[0].seed),
        }


# Figures: overlaid paths, and errors over time.


_SAMPLES = 400


def png(figure: Figure) -> bytes:
    """A figure as the content of a file."""
    buffer = io.BytesIO()
    FigureCanvasAgg(figure)
    figure.savefig(buffer, format="png")
    return buffer.getvalue()


def overlay(results: Sequence[Result]) -> Figure:
    """Planned, true and tracked paths of one seed in the plane, one panel per result.

    Each panel has its numbers over all seeds, with the theoretical bound of the RMS error.
    """
    figure = Figure(figsize=(4.4 * len(results), 4.6), dpi=110, layout="constrained")
    panels = figure.subplots(1, len(results), squeeze=False)[0]
    shown = _shown(results)
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
    cell = result.cell
    seeds = len(result.trials)
    camera = f"{cell.fps:g} Hz, {1e3 * cell.latency_s:.0f} ms late"
    faults = f"{cell.drop:.0%} lost, {cell.noise:g} px of shake"
    runs = f"{cell.reality}, {cell.renderer}, {seeds} seed" + "s" * (seeds > 1)
    return f"{cell.name}: {runs}\n{camera}, {faults}"


def _shown(results: Sequence[Result]) -> list[Trial]:
    """One trial per result: that of the first seed that all have, otherwise the first one."""
    of_seeds = [{trial.seed: trial for trial in result.trials} for result in results]
    common = set.intersection(*(set(trials) for trials in of_seeds))
    return [trials[min(common or trials)] for trials in of_seeds]


def over_time(results: Sequence[Result]) -> Figure:
    """Both coordinates of one seed over time, and the error of all seeds.

    Cube position and duration differ between seeds, so mean coordinates would not belong to any
    run. The error is drawn as mean over the seeds, with a band from the
    smallest to the largest; dashed, the bound of its root mean square.
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
    """Times in s up to the end of the shortest trial; smallest, mean and largest error in mm."""
    times = np.linspace(0.0, min(trial.times[-1] for trial in result.trials), _SAMPLES)
    errors = [np.interp(times, trial.times, 1e3 * trial.error) for trial in result.trials]
    return times, np.min(errors, axis=0), np.mean(errors, axis=0), np.max(errors, axis=0)


# The report: one self-contained HTML file, and Markdown with separate images.


HEADER = (
    "experiment", "controller", "renderer", "RMS [mm]", "max [mm]", "bound [mm]", "lag [ms]",
    "amplitude", "lost", "images", "sighting sd [mm]", "joint margin [°]", "peak velocity",
    "peak acceleration",
)  # fmt: skip

EXPLANATION = (
    "Error: distance of the following tool from the true cube in the plane at equal times, "
    "minus their mean offset, from the first to the last moment of the leading arm's curve; the "
    "follower knows its camera and its joints only. RMS and maximum over all seeds, the others "
    "are means. Bound: for proportional control the lag at the highest stable gain, "
    "2/π · v · (latency + half a frame); for predictive control the error of the same filter "
    "fed with true positions and white noise of the measured deviation of a sighting, through the "
    "same latency. Amplitude: spread of the tracked path over that of the true one. Images: the "
    "number that the follower used, its effective waypoints. Margin: distance to a joint's limit; "
    "peaks: measured, as fractions of the limits; each the worst of all joints, times and seeds. "
    "Set-points always respect the limits; a measured acceleration may briefly exceed 100 % where "
    "that of the set-points changes suddenly."
)


def row(result: Result) -> tuple[str, ...]:
    """A result as texts, in the order of `HEADER`."""
    cell = result.cell
    margins = [trial.margins for trial in result.trials]
    return (
        cell.name,
        cell.controller,
        cell.renderer,
        f"{1e3 * result.rms:.2f}",
        f"{1e3 * result.worst:.2f}",
        f"{1e3 * result.bound:.2f}",
        f"{1e3 * result.mean('lag'):.1f}",
        f"{result.mean('amplitude_ratio'):.3f}",
        f"{sum(trial.lost_count for trial in result.trials)}",
        f"{result.mean('frames'):.0f}",
        f"{1e3 * result.mean('sighting_sd'):.3f}",
        f"{57.29578 * min(m.position_rad for m in margins):.0f}",
        f"{max(m.velocity for m in margins):.0%}",
        f"{max(m.acceleration for m in margins):.0%}",
    )


def write_report(folder: Path, results: Sequence[Result]) -> None:
    """Write ``report.html``, ``report.md`` and the images of the latter.

    Args:
        folder: Folder of the report; created if missing.
        results: Results in the order of the table, at least one; those of the same case and
            renderer are drawn together.

    Raises:
        OSError: The folder cannot be written to.
    """
    folder.mkdir(parents=True, exist_ok=True)
    pictures: list[tuple[str, bytes]] = []
    for title, group in _groups(results):
        name = re.sub(r"\W+", "_", title)
        pictures += [
            (f"{name}_plane.png", png(overlay(group))),
            (f"{name}_time.png", png(over_time(group))),
        ]
    for name, content in pictures:
        write_atomically(folder / name, partial(_put, content))
    write_text(folder / "report.md", _markdown(results, [name for name, _ in pictures]))
    write_text(folder / "report.html", _html(results, pictures))


def _put(content: bytes, file: BinaryIO) -> None:
    file.write(content)


def _groups(results: Sequence[Result]) -> Iterator[tuple[str, list[Result]]]:
    found: dict[str, list[Result]] = {}
    for result in results:
        found.setdefault(f"{result.cell.name}, {result.cell.renderer}", []).append(result)
    yield from found.items()


def _commands(results: Sequence[Result]) -> Iterator[str]:
    yield from (result.cell.command(result.trials[0].seed) for result in results)


def _seeds(results: Sequence[Result]) -> str:
    seeds = sorted({trial.seed for result in results for trial in result.trials})
    return "Seeds: " + ", ".join(map(str, seeds)) + "."


def _markdown(results: Sequence[Result], pictures: Sequence[str]) -> str:
    lines = ["# Tracking experiments", "", EXPLANATION, "", _seeds(results), ""]
    lines += ["| " + " | ".join(HEADER) + " |", "|" + "---|" * len(HEADER)]
    lines += ["| " + " | ".join(row(result)) + " |" for result in results]
    lines += ["", *(f"![{name}]({name})" for name in pictures)]
    lines += ["", "## Commands for each row", "", "```text", *_commands(results), "```", ""]
    return "\n".join(lines)


_STYLE = (
    "body{font:15px/1.5 sans-serif;max-width:1150px;margin:2em auto;padding:0 1em}"
    "table{border-collapse:collapse;font-size:13px}td,th{border:1px solid #ccc;padding:3px 7px;"
    "text-align:right}td:first-child,td:nth-child(2),td:nth-child(3){text-align:left}"
    "img{max-width:100%}pre{background:#f4f4f4;padding:1em;white-space:pre-wrap;font-size:12px}"
)


def _html(results: Sequence[Result], pictures: Sequence[tuple[str, bytes]]) -> str:
    def line(tag: str, texts: Sequence[str]) -> str:
        return "<tr>" + "".join(f"<{tag}>{html.escape(text)}</{tag}>" for text in texts) + "</tr>"

    images = "".join(
        f'<p><img alt="{html.escape(name)}" '
        f'src="data:image/png;base64,{base64.b64encode(content).decode()}"></p>'
        for name, content in pictures
    )
    rows = "".join(line("td", row(result)) for result in results)
    commands = html.escape("\n".join(_commands(results)))
    return (
        '<!doctype html><html lang="en"><meta charset="utf-8"><title>Tracking experiments</title>'
        f"<style>{_STYLE}</style><h1>Tracking experiments</h1><p>{html.escape(EXPLANATION)}</p>"
        f"<p>{_seeds(results)}</p><table>{line('th', HEADER)}{rows}</table>{images}"
        f"<h2>Every row by hand</h2><pre>{commands}</pre></html>\n"
    )


# The table of results in a terminal of 80 columns.


_WORDS: Final = 3
"""Columns of text, on the left; columns of numbers follow."""

_SHOWN: Final = 9
"""Columns in the terminal; the report has all."""


def table_of(results: Sequence[Result]) -> Table:
    """One line per result; units are below the names of the columns, which saves width."""
    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=0)
    for number, name in enumerate(HEADER[:_SHOWN]):
        justify: JustifyMethod = "left" if number < _WORDS else "right"
        heading = Text(name.replace(" [", "\n["), justify=justify)
        table.add_column(heading, justify=justify, vertical="bottom", overflow="fold")
    for result in results:
        table.add_row(*(Text(cell) for cell in row(result)[:_SHOWN]))
    return table


# Progress, and the estimate of the remaining time.


RunIsOver: TypeAlias = Callable[[Cell], None]
"""Callback that receives the cell of each finished run."""

_FETCHED_S = 5.0
_DRAWN_S = 5.0
"""Approximate simulated seconds to fetch the cube, and for a curve at full speed."""

_REDRAWN_HZ: Final = 2.0


class Forecast:
    """Remaining time, from the fraction of the work that is done.

    The cost of a run is proportional to its simulated time, and a curve at half the speed takes
    twice as long.

    Args:
        runs: Cell of each run, in any order.
        clock: Wall clock in seconds.
    """

    def __init__(self, runs: Sequence[Cell], clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._began = clock()
        self._all = sum(map(_work, runs))
        self._done = 0.0

    def count(self, cell: Cell) -> None:
        """Count a finished run of a cell."""
        self._done += _work(cell)

    def __str__(self) -> str:
        if not self._done:
            return "(time left: after the first run)"
        left = max(self._all - self._done, 0.0)
        spent = self._clock() - self._began
        return f"about {_duration(spent * left / self._done)} left" if left else ""


@contextmanager
def shown_progress(runs: Sequence[Cell], console: Console) -> Iterator[RunIsOver]:
    """Show the progress: a bar in a terminal, otherwise one line per finished cell.

    Args:
        runs: Cell of each run, in the order in which they end.
        console: Where to.
    """
    forecast = Forecast(runs)
    if console.is_terminal:
        with _bar(runs, forecast, console) as is_over:
            yield is_over
    else:
        yield _lines(runs, forecast, console)


@contextmanager
def _bar(runs: Sequence[Cell], forecast: Forecast, console: Console) -> Iterator[RunIsOver]:
    what = TextColumn("{task.description}")
    left = TextColumn("{task.fields[left]}")
    columns = what, BarColumn(None), TimeElapsedColumn(), left
    with Progress(
        *columns, console=console, expand=True, refresh_per_second=_REDRAWN_HZ
    ) as progress:
        task = progress.add_task(_title(runs, 0), total=sum(map(_work, runs)), left=str(forecast))
        over = 0

        def is_over(cell: Cell) -> None:
            nonlocal over
            over += 1
            forecast.count(cell)
            title = _title(runs, over)
            progress.update(task, advance=_work(cell), description=title, left=str(forecast))

        yield is_over


def _lines(runs: Sequence[Cell], forecast: Forecast, console: Console) -> RunIsOver:
    over = 0

    def is_over(cell: Cell) -> None:
        nonlocal over
        over += 1
        forecast.count(cell)
        if over == len(runs) or runs[over] != cell:
            words = f"{_label(cell)}: {over} of {counted(len(runs), 'run')}", str(forecast)
            console.print(", ".join(filter(None, words)), markup=False, soft_wrap=True)

    console.print(counted(len(runs), "run"), soft_wrap=True)
    return is_over


def _title(runs: Sequence[Cell], over: int) -> str:
    """Text on the current cell and the number of finished runs."""
    running = f"{_label(runs[over])}, " if over < len(runs) else ""
    return f"{running}{over}/{len(runs)}"


def _label(cell: Cell) -> str:
    return f"{cell.name} {cell.controller} {cell.renderer}"


def _work(cell: Cell) -> float:
    return _FETCHED_S + _DRAWN_S / cell.speed


def _duration(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes / 60:.1f} h"


# Running experiments with several seeds, and collecting results by experiment.


@dataclass
class Campaign:
    """Outcome of the experiments.

    Attributes:
        results: Experiments with the trials that could be measured, at least one each.
        failures: Sentences on those that could not be measured.
    """

    results: list[Result] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)


def run_all(
    cells: Sequence[Cell], seeds: int, jobs: int, stop: StopRequest, console: Console
) -> Campaign:
    """Run every cell with every seed.

    Args:
        cells: Experiments; all are validated with the tree file before anything runs.
        seeds: Number of seeds, from 0 on.
        jobs: Number of parallel processes.
        stop: Request to end early; incomplete experiments are then left out.
        console: Receiver of the progress.

    Raises:
        DualArmError: The file rejects a setting, or the renderer does not work here.
    """
    registry = Registry.load()
    done = Campaign()
    for cell in cells:
        tree_file(cell, registry)
    runs = [(cell, seed) for cell in cells for seed in range(seeds)]
    coming = run_trials(runs, registry, jobs, stop)
    with shown_progress([cell for cell, _ in runs], console) as is_over:
        for cell in cells:
            trials = []
            for trial in islice(coming, seeds):
                trials.append(trial)
                is_over(cell)
            if len(trials) < seeds:
                break
            _sort(cell, trials, done)
    return done


def _sort(cell: Cell, trials: Sequence[Trial | TrialError], done: Campaign) -> None:
    """Add measured trials to the results, and the reasons of the others to the complaints."""
    measured = [trial for trial in trials if isinstance(trial, Trial)]
    done.failures += [
        f"{cell.name} {cell.controller}, seed {seed}: {trial}"
        for seed, trial in enumerate(trials)
        if isinstance(trial, TrialError)
    ]
    if measured:
        done.results.append(Result(cell, measured))
