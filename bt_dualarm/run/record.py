"""What a run leaves behind in the folder of ``--record``."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from bt_dualarm.errors import DualArmError
from bt_dualarm.run.holding import Holdings, HoldingWorld
from bt_dualarm.run.outcome import Ending, RunResult
from bt_dualarm.run.parts import RunView
from bt_dualarm.run.series import SeriesLog
from bt_dualarm.run.signals import StopRequest
from bt_dualarm.run.state_log import HashedWorld, StateLog
from bt_dualarm.run.summary import json_ready, summary_of
from bt_dualarm.run.tracks import SampledWorld, Tracks
from bt_dualarm.run.whole_files import write_text, write_whole
from bt_dualarm.tree.report import StatusChange
from bt_dualarm.world.still import PicturedWorld, Still

SUMMARY, EVENTS, SAMPLES = "summary.json", "events.jsonl", "samples.npz"
LOG, DIVERGENCE = "run.log", "divergence.npz"
OVERVIEW, SCENE = "overview.png", "scene.png"


class RecordError(DualArmError):
    """The folder of ``--record`` cannot be used; the message names it."""


class RecordedWorld(SampledWorld, HashedWorld, HoldingWorld, PicturedWorld, Protocol):
    """All that is read of the world."""


@dataclass(frozen=True)
class Facts:
    """What the record says of a run besides its result.

    Attributes:
        seed: Of everything random.
        renderer: ``gl``, ``ray``, or None where no arm has a camera.
    """

    seed: int
    renderer: str | None


def prepare_folder(path: Path) -> Path:
    """Make the folder ready before the run, so that the run is not lost at its end.

    What an earlier run wrote there is taken away, other files stay.

    Raises:
        RecordError: It is no folder, or nothing can be written there.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
        plots = _plots_of_earlier_run(path / SUMMARY)
        write_text(path / SUMMARY, "")
        for name in (SUMMARY, EVENTS, SAMPLES, LOG, DIVERGENCE, *plots):
            (path / name).unlink(missing_ok=True)
    except FileExistsError:
        raise RecordError(f"cannot record to {path}: it is there and is not a folder") from None
    except OSError as error:
        raise RecordError(f"cannot record to {path}: {error.strerror or error}") from error
    return path


def _plots_of_earlier_run(summary: Path) -> list[str]:
    """Names of the plots that belong to a summary: none where it is not one of ours."""
    try:
        arms = [str(name) for name in json.loads(summary.read_bytes())["arms"]]
    except (FileNotFoundError, NotADirectoryError, ValueError, KeyError, TypeError):
        return []
    plots = [f"{name}_{kind}.png" for name in arms for kind in ("plane", "time")]
    return [OVERVIEW, SCENE, *(name for name in plots if Path(name).name == name)]


class Recorder:
    """An observer that keeps everything in memory and writes it when the run is over.

    The world is pictured as it is when the recorder is made, and when the record is written.

    Args:
        folder: From `prepare_folder`.
        world: The world.
        facts: Seed and renderer.
        series: What the skills measured.
    """

    def __init__(self, folder: Path, world: RecordedWorld, facts: Facts, series: SeriesLog) -> None:
        self._folder = folder
        self._facts = facts
        self._series = series
        self._world = world
        self._start = Still.of(world)
        self._tracks = Tracks(world)
        self._states = StateLog(world)
        self._holdings = Holdings(world)
        self._changes: list[StatusChange] = []
        self._log_lines: list[str] = []

    def on_event(self, change: StatusChange) -> None:
        """Keep it."""
        self._changes.append(change)

    def after_ticks(self, run: RunView) -> None:
        """See what has been attached or released."""
        self._holdings.after_ticks(run.time)

    def after_step(self, time: float) -> None:  # noqa: ARG002 - the parts read the world's clock
        """Sample and hash what is due."""
        self._tracks.after_step()
        self._states.after_step()

    @contextmanager
    def logging(self, logger: logging.Logger) -> Iterator[None]:
        """Take what is logged during the block up into ``run.log``."""
        handler = _Lines(self._log_lines)
        logger.addHandler(handler)
        try:
            yield
        finally:
            logger.removeHandler(handler)

    def write(self, result: RunResult, stop: StopRequest) -> tuple[Path, ...]:
        """Write every file; the summary comes last of those that a program reads.

        Args:
            result: What the run did.
            stop: Plots are left out where the end is urgent.

        Raises:
            RecordError: The disk is full, or the folder is gone.
        """
        try:
            return tuple(self._written(result, stop))
        except OSError as error:
            raise RecordError(
                f"the record in {self._folder} is not complete: {error.strerror or error}"
            ) from error

    def _written(self, result: RunResult, stop: StopRequest) -> Iterator[Path]:
        yield self._text(EVENTS, "".join(_line(change) for change in self._changes))
        if self._log_lines:
            yield self._text(LOG, "\n".join(self._log_lines) + "\n")
        samples = {"time": self._tracks.time, **self._tracks.positions()}
        yield self._archive(SAMPLES, samples)
        if result.ending is Ending.DIVERGED:
            write_whole(self._folder / DIVERGENCE, self._states.write_last)
            yield self._folder / DIVERGENCE
        yield self._text(SUMMARY, json.dumps(self._summary(result), indent=2, allow_nan=False))
        if not stop.urgent:
            from bt_dualarm.run import pictures  # half a second of imports that few runs need

            stills = (self._start, Still.of(self._world))
            seen = pictures.Seen(self._tracks, self._series, self._holdings, stills)
            yield from pictures.write_all(self._folder, result, seen, stop)

    def _summary(self, result: RunResult) -> dict[str, object]:
        return summary_of(
            result,
            seed=self._facts.seed,
            state_sha256=self._states.sha256,
            renderer=self._facts.renderer,
            attachments=self._holdings.as_dicts(self._tracks),
        )

    def _text(self, name: str, text: str) -> Path:
        write_text(self._folder / name, text)
        return self._folder / name

    def _archive(self, name: str, arrays: dict[str, np.ndarray]) -> Path:
        path = self._folder / name
        write_whole(path, lambda file: np.savez_compressed(file, allow_pickle=False, **arrays))
        return path


class _Lines(logging.Handler):
    """Keeps what is logged, tracebacks included."""

    def __init__(self, lines: list[str]) -> None:
        super().__init__()
        self._lines = lines

    def emit(self, record: logging.LogRecord) -> None:
        """Keep it, formatted."""
        self._lines.append(self.format(record))


def _line(change: StatusChange) -> str:
    """One status change as a line of JSON."""
    fields = {("time_s" if key == "time" else key): item for key, item in vars(change).items()}
    return json.dumps(json_ready(fields), allow_nan=False) + "\n"
