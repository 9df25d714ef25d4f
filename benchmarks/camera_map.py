"""Map of tracking error and stability over camera faults."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from bt_dualarm.experiments.trials import Cell, Trial, TrialError

SCALES = ((0.0, 0.025, 0.05, 0.075, 0.1), (0.0, 0.1, 0.2, 0.3), (0.0, 1.0, 2.0))
"""Latency in s, share of lost frames, shake in px."""

CURVE = Cell("circle", 1.0, more={"turns": "4"})
"""The tracked curve: at full speed, with enough turns for an error to grow."""

_GROWTH = 2.0
_GROWTH_M = 2e-3
_AMPLITUDES = (0.7, 1.3)
"""Size of the tracked path over the true one; outside, a follower oscillates or stands still."""


@dataclass(frozen=True)
class Faults:
    """Faults of a camera.

    Attributes:
        latency: Time from exposure to delivery, s.
        drop: Share of lost frames.
        noise: Shake, px.
    """

    latency: float
    drop: float
    noise: float

    @property
    def cell(self) -> Cell:
        """The experiment with this camera."""
        return replace(CURVE, latency=self.latency, drop=self.drop, noise=self.noise)

    def __str__(self) -> str:
        return f"{1e3 * self.latency:.0f} ms, {self.drop:.0%} lost, {self.noise:g} px"


@dataclass(frozen=True)
class Spot:
    """One point of the map.

    Attributes:
        faults: Faults of the camera.
        rms: RMS error over all seeds, m; NaN if a run could not be measured.
        complaints: Reasons of instability; empty if it is stable.
    """

    faults: Faults
    rms: float
    complaints: tuple[str, ...]


Measure: TypeAlias = Callable[[Sequence[Cell]], Iterable[Sequence[Trial | TrialError]]]
"""Runs every cell with every seed."""


def survey(measure: Measure, *, coarse: bool) -> list[Spot]:
    """Measure the whole map.

    Args:
        measure: Runner of cells.
        coarse: Whether to measure only the ends of each scale.
    """
    scales = [scale[:: len(scale) - 1] if coarse else scale for scale in SCALES]
    all_faults = [Faults(*values) for values in itertools.product(*scales)]
    found = measure([faults.cell for faults in all_faults])
    return [_spot(faults, trials) for faults, trials in zip(all_faults, found, strict=True)]


def _spot(faults: Faults, trials: Sequence[Trial | TrialError]) -> Spot:
    measured = [trial for trial in trials if isinstance(trial, Trial)]
    broken = tuple(str(trial) for trial in trials if isinstance(trial, TrialError))
    complaints = [f"seed {trial.seed}: {why}" for trial in measured if (why := instability(trial))]
    rms = float(np.sqrt(np.mean([trial.rms**2 for trial in measured]))) if measured else np.nan
    return Spot(faults, np.nan if broken else rms, (*broken, *complaints))


def instability(trial: Trial) -> str:
    """Why a run was not stable, or an empty text.

    A stable run succeeds, the error of its last third is not much larger than twice that of the
    first, and the tracked curve is about as large as the target's.
    """
    if trial.outcome != "SUCCESS":
        return f"{trial.outcome} {trial.reason}".strip()
    first, _, last = (np.sqrt(np.mean(part**2)) for part in np.array_split(trial.error, 3))
    if last > _GROWTH * first + _GROWTH_M:
        return f"its error grows from {1e3 * first:.1f} to {1e3 * last:.1f} mm"
    low, high = _AMPLITUDES
    if not low <= trial.amplitude_ratio <= high:
        return f"its curve is {trial.amplitude_ratio:.2f} times as large as the target's"
    return ""


def table(spots: Sequence[Spot]) -> str:
    """RMS errors in mm as text: a block for each shake, a row for each share of lost frames."""
    lines = []
    latencies = sorted({spot.faults.latency for spot in spots})
    for noise in sorted({spot.faults.noise for spot in spots}):
        head = "".join(f"{1e3 * latency:6.0f} ms" for latency in latencies)
        lines.append(f"  shake {noise:g} px{'':6}{head}")
        for drop in sorted({spot.faults.drop for spot in spots}):
            row = (_at(spots, Faults(latency, drop, noise)) for latency in latencies)
            cells = "".join(f"{1e3 * spot.rms:8.2f}{'!' * bool(spot.complaints):1}" for spot in row)
            lines.append(f"  {drop:4.0%} lost{'':8}{cells}")
    return "\n".join(lines)


def draw(spots: Sequence[Spot], seeds: int, path: Path) -> None:
    """Draw a panel for each shake, latency by lost frames; unstable points are framed in red.

    Args:
        spots: All points of the map.
        seeds: Number of seeds of each point.
        path: Image file; its suffix determines the format.
    """
    latencies, drops, noises = (
        sorted({getattr(spot.faults, name) for spot in spots})
        for name in ("latency", "drop", "noise")
    )
    rms = 1e3 * np.array([spot.rms for spot in spots])
    colors = LogNorm(max(float(np.nanmin(rms)), 0.1), float(np.nanmax(rms)))
    figure = Figure(figsize=(4.4 * len(noises) + 1.0, 3.8), dpi=110, layout="constrained")
    panels = figure.subplots(1, len(noises), sharey=True, squeeze=False)[0]
    for axes, noise in zip(panels, noises, strict=True):
        grid = [[_at(spots, Faults(late, drop, noise)) for late in latencies] for drop in drops]
        values = 1e3 * np.array([[spot.rms for spot in row] for row in grid])
        image = axes.imshow(values, norm=colors, cmap="viridis", aspect="auto", origin="lower")
        for (row, column), value in np.ndenumerate(values):
            ink = "black" if colors(value) > 0.6 else "white"
            axes.text(column, row, f"{value:.1f}", ha="center", va="center", color=ink, fontsize=9)
            if grid[row][column].complaints:
                corner = (column - 0.48, row - 0.48)
                axes.add_patch(Rectangle(corner, 0.96, 0.96, fill=False, edgecolor="red", lw=2))
        axes.set_title(f"shake {noise:g} px", fontsize=10)
        axes.set_xticks(range(len(latencies)), [f"{1e3 * late:.0f}" for late in latencies])
        axes.set_xlabel("latency [ms]")
    panels[0].set_yticks(range(len(drops)), [f"{drop:.0%}" for drop in drops])
    panels[0].set_ylabel("frames lost")
    figure.colorbar(image, ax=panels, label="RMS [mm]")
    title = f"{CURVE.name}, 60 Hz, {seeds} seed{'s' * (seeds > 1)}; framed red: not stable"
    figure.suptitle(title, fontsize=11)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path)


def _at(spots: Sequence[Spot], faults: Faults) -> Spot:
    return next(spot for spot in spots if spot.faults == faults)
