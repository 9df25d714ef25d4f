"""What a run leaves behind in the folder of ``--record``."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Protocol, TypeAlias

from bt_dualarm.runtime.atomic_write import write_atomically, write_text
from bt_dualarm.runtime.history import History
from bt_dualarm.runtime.holding import Holdings, HoldingWorld
from bt_dualarm.runtime.journal import Journal
from bt_dualarm.runtime.outcome import Ending
from bt_dualarm.runtime.parts import IdleObserver, RunView
from bt_dualarm.runtime.record_folder import (
    DIVERGENCE,
    EVENTS,
    HISTORY,
    LOG,
    PARTS,
    SAMPLES,
    SUMMARY,
    RecordError,
)
from bt_dualarm.runtime.result import RunResult
from bt_dualarm.runtime.sample_files import SampleFiles
from bt_dualarm.runtime.signals import StopRequest
from bt_dualarm.runtime.state_log import HashedWorld, StateLog
from bt_dualarm.runtime.summary import json_ready, summary_of
from bt_dualarm.runtime.tracks import SampledWorld, Tracks
from bt_dualarm.tree.report import StatusChange
from bt_dualarm.world.rendering.still import PicturedWorld, Still

_log = logging.getLogger(__name__)

WriteFile: TypeAlias = Callable[[Path], object]
"""Writes one file, whole or not at all."""


class RecordedWorld(SampledWorld, HashedWorld, HoldingWorld, PicturedWorld, Protocol):
    """All that is read of the world."""


class Recorder(IdleObserver):
    """An observer that writes events, log and samples while the run goes on, the rest at its end.

    So what it keeps in memory does not grow with the run, and what is on the disk can be read if
    the process does not live to the end. The world is pictured as it is when the recorder is made,
    and when the record is written.

    Args:
        folder: Folder to write to, from `RecordFolder`.
        world: The world.
        states: The last states of the world, for the case that it diverges.
        log: Function that gives the lines that were logged since it was last asked.
        history: Writer of the history, which looks on for itself; None where there is to be none.
    """

    def __init__(
        self,
        folder: Path,
        world: RecordedWorld,
        states: StateLog,
        log: Callable[[], Sequence[str]],
        history: History | None = None,
    ) -> None:
        self._folder = folder
        self._world = world
        self._states = states
        self._log = log
        self._history = history
        self._start = Still.of(world)
        self._tracks = Tracks(world)
        self._holdings = Holdings(world)
        self._samples = SampleFiles(folder / PARTS)
        self._events: list[str] = []
        self._has_logged = self._is_closed = False
        self._journals = {name: Journal(folder / name) for name in (EVENTS, LOG)}

    def on_event(self, change: StatusChange) -> None:
        """Take it up, to be written after the tick."""
        self._events.append(_line(change))

    def after_ticks(self, run: RunView) -> None:
        """See what has been attached or released; note what has happened."""
        self._holdings.after_ticks(run.time)
        self._note()

    def _note(self) -> None:
        """Write events and log lines that are new."""
        events, self._events = self._events, []
        lines = self._log()
        self._has_logged = self._has_logged or bool(lines)
        for name, new in ((EVENTS, events), (LOG, lines)):
            self._journals[name].add("".join(f"{line}\n" for line in new))

    def after_step(self, time: float) -> None:  # noqa: ARG002 - the parts read the world's clock
        """Sample what is due."""
        sample = self._tracks.after_step()
        if sample is not None:
            self._holdings.sampled(sample)
            self._samples.add(sample)

    def write(self, result: RunResult, stop: StopRequest) -> tuple[Path, ...]:
        """Write every file; the summary comes last of those that a program reads.

        What cannot be written is left out, and the rest is written.

        Args:
            result: What the run did.
            stop: Plots are left out where the end is urgent.

        Raises:
            RecordError: The disk is full, the folder is gone, or a file could not be made.
        """
        if self._is_closed:
            return ()
        self._note()
        written: list[Path] = []
        problems: list[str] = []
        for name, write in self._files(result, stop):
            try:
                write(self._folder / name)
            except OSError as error:
                raise self._incomplete(error.strerror or str(error)) from error
            except Exception as error:  # noqa: BLE001 - the end of a run is never lost
                _log.exception("%s could not be made", name)
                problems.append(f"{name} could not be made: {type(error).__name__}: {error}")
            else:
                written.append(self._folder / name)
        self.close()
        if problems:
            raise self._incomplete("; ".join(problems))
        return tuple(written)

    def close(self) -> None:
        """Let go of all files, which stay as they are: nothing is written any more."""
        self._is_closed = True
        for journal in self._journals.values():
            journal.close()
        if self._history is not None:
            self._history.close()

    def _files(self, result: RunResult, stop: StopRequest) -> Iterator[tuple[str, WriteFile]]:
        """Names of the files, and what writes each; made when they are asked for."""
        yield EVENTS, lambda _: self._journals[EVENTS].finish()
        if self._has_logged:
            yield LOG, lambda _: self._journals[LOG].finish()
        yield SAMPLES, self._write_samples
        history = self._history
        if history is not None:
            yield HISTORY, lambda _: history.finish(result.state_sha256)
        if result.ending is Ending.DIVERGED:
            yield DIVERGENCE, lambda path: write_atomically(path, self._states.write_last)
        yield SUMMARY, lambda path: write_text(path, _as_json(self._summary(result)))
        if not stop.urgent:
            from bt_dualarm.runtime import pictures  # half a second of imports that few runs need

            stills = (self._start, Still.of(self._world))
            observed = pictures.Observed(self._tracks, self._holdings, stills)
            yield from pictures.files_of(result, observed, stop)

    def _incomplete(self, why: str) -> RecordError:
        return RecordError(f"the record in {self._folder} is not complete: {why}")

    def _summary(self, result: RunResult) -> dict[str, object]:
        return summary_of(result, self._holdings.as_dicts(), self._holdings.left_out)

    def _write_samples(self, path: Path) -> None:
        write_atomically(path, self._samples.write_archive)
        self._samples.remove()


def _as_json(summary: dict[str, object]) -> str:
    return json.dumps(summary, indent=2, allow_nan=False)


def _line(change: StatusChange) -> str:
    """One status change as a line of JSON."""
    fields = {("time_s" if key == "time" else key): item for key, item in vars(change).items()}
    return json.dumps(json_ready(fields), allow_nan=False)
