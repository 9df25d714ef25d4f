"""The recorder: writes the record of a run into the folder given by ``--record``."""

from __future__ import annotations

import errno
import fcntl
import json
import logging
import os
import shutil
import stat
import zipfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO, Final, TypeAlias

import numpy as np

from bt_dualarm.behaviors.report import StatusChange
from bt_dualarm.core.errors import DualArmError
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.core.share import kind_at, leftovers, write_atomically, write_text
from bt_dualarm.runtime.arm_runtime import IdleObserver, RunView
from bt_dualarm.runtime.history import History
from bt_dualarm.runtime.history_file import (
    HistoryError,
    ReadBudget,
    file_kind,
    parsed,
    read_regular,
)
from bt_dualarm.runtime.interruption import StopRequest
from bt_dualarm.runtime.observations import Journal, StateLog
from bt_dualarm.runtime.outcome import (
    Ending,
    Holdings,
    RunResult,
    Sample,
    Tracks,
)
from bt_dualarm.runtime.summary import json_ready, summary_of
from bt_dualarm.sim.painter import StillRenderer
from bt_dualarm.sim.world import World

_log = logging.getLogger(__name__)

_NAN_ROWS = 1 << 16
"""NaN rows written at a time to fill up a column that begins late."""


class GrowingArray:
    """A ``.npy`` file to which rows are appended; readable at any time, even after a crash.

    Rows are written before the header that counts them. NumPy pads its headers for a first axis of
    any length, so the new header fits over the old one.

    Args:
        path: The file to create.
        shape: Shape of one row.

    Raises:
        OSError: The file cannot be created.
    """

    def __init__(self, path: Path, shape: tuple[int, ...]) -> None:
        self.path = path
        self._shape = shape
        self._rows = 0
        with path.open("xb") as file:
            self._write_header(file)

    def append(self, values: Vector | Matrix) -> None:
        """Append rows, of shape (n, ...) where ... is the shape of one row.

        Raises:
            OSError: The disk is full, or the file is gone.
        """
        self._rows += len(values)
        with self.path.open("r+b") as file:
            file.seek(0, 2)
            file.write(np.ascontiguousarray(values, dtype="<f8").tobytes())
            file.flush()
            file.seek(0)
            self._write_header(file)

    def append_unknown(self, count: int) -> None:
        """Append ``count`` rows of NaN."""
        for first in range(0, count, _NAN_ROWS):
            self.append(np.full((min(_NAN_ROWS, count - first), *self._shape), np.nan))

    def _write_header(self, file: BinaryIO) -> None:
        header = {"descr": "<f8", "fortran_order": False, "shape": (self._rows, *self._shape)}
        np.lib.format.write_array_header_1_0(file, header)  # type: ignore[no-untyped-call]  # NumPy


_SAMPLES_PER_WRITE = 200
"""Two seconds at 100 Hz."""

_TIME = "time"
_BLOCK = 1 << 20


class SampleFiles:
    """Positions over time in growing ``.npy`` files: ``time``, and one for each tool and object.

    All have the same number of rows, NaN while an object was not in the world. A write error does
    not end the run; `write_archive` raises it.

    Args:
        folder: The folder, created with the first samples.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._files: dict[str, GrowingArray] = {}
        self._waiting: list[Sample] = []
        self._rows = 0
        self._failure: OSError | None = None

    def add(self, sample: Sample) -> None:
        """Add one sample."""
        self._waiting.append(sample)
        if len(self._waiting) >= _SAMPLES_PER_WRITE:
            self.flush()

    def flush(self) -> None:
        """Write the buffered samples."""
        waiting = self._waiting
        self._waiting = []
        if self._failure is not None or not waiting:
            return
        try:
            self._append(waiting)
        except OSError as error:
            self._failure = error
            _log.warning("samples are no longer written during the run: %s", error)

    def write_archive(self, file: BinaryIO) -> None:
        """Write all files into one ``.npz`` archive, compressed block by block.

        Raises:
            OSError: The samples could not be written, or the disk is full.
        """
        self.flush()
        if self._failure is not None:
            raise self._failure
        self._file(_TIME, ())
        with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, array in self._files.items():
                with (
                    array.path.open("rb") as source,
                    archive.open(f"{name}.npy", "w", force_zip64=True) as target,
                ):
                    shutil.copyfileobj(source, target, _BLOCK)

    def remove(self) -> None:
        """Delete the folder, once the archive exists."""
        for array in self._files.values():
            array.path.unlink(missing_ok=True)
        if self._folder.is_dir():
            self._folder.rmdir()

    def _append(self, samples: list[Sample]) -> None:
        self._file(_TIME, ()).append(np.array([sample.time for sample in samples]))
        columns = {name: np.full((len(samples), 3), np.nan) for name in self._files}
        for row, sample in enumerate(samples):
            for name, point in zip(sample.names, sample.points, strict=True):
                if name not in columns:
                    columns[name] = np.full((len(samples), 3), np.nan)
                columns[name][row] = point
        for name, points in columns.items():
            if name != _TIME:
                self._file(name, (3,)).append(points)
        self._rows += len(samples)

    def _file(self, name: str, shape: tuple[int, ...]) -> GrowingArray:
        if name not in self._files:
            self._folder.mkdir(exist_ok=True)
            self._files[name] = GrowingArray(self._folder / f"{name}.npy", shape)
            self._files[name].append_unknown(self._rows)
        return self._files[name]


SUMMARY = "summary.json"
EVENTS = "events.jsonl"
SAMPLES = "samples.npz"
LOG = "run.log"
DIVERGENCE = "divergence.npz"
HISTORY: Final = "run.history"
FRAMES: Final = "run.frames"
OVERVIEW = "overview.png"
SCENE = "scene.png"

PARTS: Final = "samples.parts"
"""Folder of `SampleFiles`; a run that is killed leaves it behind."""

LOCK: Final = ".recording"
"""Lock file of the run that records to a folder; a run that is killed leaves it behind."""

EARLIER: Final = ".earlier"
"""Folder with the files of an earlier run, until the new record is complete; a run that is killed
leaves it behind."""

FILES: Final = (SUMMARY, EVENTS, SAMPLES, LOG, DIVERGENCE, HISTORY, FRAMES, OVERVIEW, SCENE)
"""Names of the files of a record, except the plots of each arm."""

_PLOTS: Final = ("plane", "time")

_SUMMARY_KEYS: Final = frozenset({"outcome", "state_sha256", "arms"})
"""Keys that identify the summary of a run."""

_MOST_SUMMARY_BYTES: Final = 1 << 26
"""Largest size of a summary that is read; a run of a day with many leaves has a hundredth of it."""

_LOCKS_UNSUPPORTED: Final = frozenset({errno.ENOLCK, errno.EOPNOTSUPP})
"""Errors of file systems without locks, where concurrent runs cannot be excluded."""


class RecordError(DualArmError):
    """The folder of a record cannot be used; the message names it."""


class RecordFolder:
    """Folder of a record, locked by one run until the end of a ``with`` block.

    It is claimed before the run starts, so that no result is lost at the end. Files of an earlier
    run are set aside and deleted at the end of the block, unless the record is withdrawn; other
    files stay.

    Args:
        path: The folder, created if missing.
        arms: Names of the arms whose plots will be written.

    Raises:
        RecordError: It is not a folder, it is not writable, another run is recording there, or a
            file that does not come from a run would be overwritten.
    """

    def __init__(self, path: Path, arms: Iterable[str]) -> None:
        self.path = path
        self._names = [*FILES, *_plots_of(arms)]
        self._is_withdrawn = False
        self._is_new = not kind_at(path)
        try:
            path.mkdir(parents=True, exist_ok=True)
            was_left = (path / LOCK).exists()
            self._lock = _locked(path / LOCK)
        except FileExistsError:
            raise RecordError(f"cannot record to {path}: it exists and is not a folder") from None
        except BlockingIOError:
            raise RecordError(f"cannot record to {path}: another run is recording there") from None
        except OSError as error:
            raise _cannot(path, error) from error
        try:
            self._set_earlier_aside(was_left=was_left)
        except BaseException:
            self._unlock()
            raise
        # Skills and notebooks may change the working directory before the record is written.
        self.path = path.absolute()

    def __enter__(self) -> RecordFolder:
        return self

    def __exit__(self, *error: object) -> None:
        """Unlock the folder."""
        self.release()

    def withdraw(self) -> None:
        """Let the end of the block delete the files of this run and restore those set aside.

        A folder that it has created is deleted as well.
        """
        self._is_withdrawn = True

    def release(self) -> None:
        """Delete the files of the earlier run, or those of a run that was withdrawn; unlock."""
        try:
            if self._is_withdrawn:
                for name in self._names:
                    (self.path / name).unlink(missing_ok=True)
                _remove_folder(self.path / PARTS)
                self._restore()
            _remove_folder(self.path / EARLIER)
        finally:
            self._unlock()
        if self._is_withdrawn and self._is_new:
            with suppress(OSError):  # something else has written to it meanwhile
                self.path.rmdir()

    def _unlock(self) -> None:
        """Release the lock; its file is deleted before that, see `_locked`."""
        (self.path / LOCK).unlink(missing_ok=True)
        os.close(self._lock)

    def _set_earlier_aside(self, *, was_left: bool) -> None:
        """Move the files of an earlier run out of the way.

        Raises:
            RecordError: A file with the name of one of a record does not come from a run.
        """
        aside = self.path / EARLIER
        try:
            for name in self._names:  # before any of them is read
                _refuse_other_kinds(self.path / name)
            earlier = _arms_of_earlier_run(self.path / SUMMARY)
            if earlier is None and not was_left:
                self._refuse_foreign([*self._names, PARTS, EARLIER])
            names = dict.fromkeys((*self._names, *_plots_of(earlier or ())))
            for name in names:
                _refuse_other_kinds(self.path / name)
            _refuse_foreign_parts(self.path / PARTS)
            _remove_folder(aside)
            for name in names:
                for half in leftovers(self.path / name):
                    half.unlink(missing_ok=True)
            found = [name for name in (*names, PARTS) if os.path.lexists(self.path / name)]
            if found:
                aside.mkdir()
            try:
                for name in found:
                    (self.path / name).rename(aside / name)
            except BaseException:
                self._restore()
                raise
        except OSError as error:
            raise _cannot(self.path, error) from error

    def _restore(self) -> None:
        """Move the files of the earlier run back."""
        aside = self.path / EARLIER
        if aside.is_dir():
            for file in aside.iterdir():
                file.rename(self.path / file.name)
            aside.rmdir()

    def _refuse_foreign(self, names: list[str]) -> None:
        for name in names:
            if os.path.lexists(self.path / name):
                raise RecordError(
                    f"cannot record to {self.path}: {name} exists and is not from a run; "
                    "it would be overwritten"
                )


def _refuse_other_kinds(path: Path) -> None:
    """Refuse pipes, devices and folders, some of which block when they are opened.

    Raises:
        RecordError: The path exists and is not a regular file.
    """
    try:
        mode = path.lstat().st_mode
    except FileNotFoundError:
        return
    if not stat.S_ISREG(mode):
        raise RecordError(
            f"cannot record to {path.parent}: {path.name} exists and is {file_kind(mode)}, "
            "not a regular file"
        )


def _refuse_foreign_parts(folder: Path) -> None:
    """Refuse samples that do not come from a run that was killed.

    Raises:
        RecordError: The path is not a folder, or contains other files.
    """
    if not os.path.lexists(folder):
        return
    if folder.is_symlink() or not folder.is_dir():
        what = "exists and is not a folder"
    elif any(file.suffix != ".npy" for file in folder.iterdir()):
        what = "contains files that are not from a run"
    else:
        return
    raise RecordError(f"cannot record to {folder.parent}: {folder.name} {what}")


def _remove_folder(folder: Path) -> None:
    """Delete a folder that a run has made, with the files that runs write.

    Raises:
        OSError: The folder contains other files, or is none.
    """
    if not os.path.lexists(folder):
        return
    for file in folder.iterdir():
        if file.name == PARTS:
            _remove_folder(file)
        elif file.name in FILES or file.suffix in (".npy", ".png"):
            file.unlink()
    folder.rmdir()


def _cannot(path: Path, error: OSError) -> RecordError:
    return RecordError(f"cannot record to {path}: {error.strerror or error}")


def _locked(path: Path) -> int:
    """File descriptor of an exclusive lock.

    Raises:
        BlockingIOError: Another process holds the lock.
        OSError: The file cannot be created.
    """
    while True:
        _refuse_other_kinds(path)
        lock = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            # The previous owner may have deleted the file in the meantime; then try again.
            if os.path.samestat(os.fstat(lock), path.stat()):
                return lock
        except FileNotFoundError:
            pass
        except OSError as error:
            if error.errno in _LOCKS_UNSUPPORTED:
                return lock
            os.close(lock)
            raise
        os.close(lock)


def _arms_of_earlier_run(summary: Path) -> list[str] | None:
    """Names of the arms in the summary of a run; None if the file is not such a summary."""
    try:
        content = parsed(read_regular(summary, _MOST_SUMMARY_BYTES), ReadBudget())
        return [*map(str, content["arms"])] if content.keys() >= _SUMMARY_KEYS else None
    except (HistoryError, ValueError, KeyError, TypeError, AttributeError):
        return None


def _plots_of(arms: Iterable[str]) -> list[str]:
    """File names of the arms' plots; arm names that would lead to another folder are skipped."""
    names = [f"{arm}_{kind}.png" for arm in arms for kind in _PLOTS]
    return [name for name in names if name.isprintable() and Path(name).name == name]


WriteFile: TypeAlias = Callable[[Path], object]
"""Writes one file atomically."""


class Recorder(IdleObserver):
    """Observer that writes events, log and samples during the run, the other files at its end.

    Its memory therefore does not grow with the run, and the files are readable if the process is
    killed. The world is rendered as it is when the recorder is created and when the record is
    written.

    Args:
        folder: Folder to write to, from `RecordFolder`.
        world: The world.
        states: The last states of the world, written if it diverges.
        log: Returns the lines logged since its last call.
        history: Writer of the history, an observer of its own; None to write no history.
    """

    def __init__(
        self,
        folder: Path,
        world: World,
        states: StateLog,
        log: Callable[[], Sequence[str]],
        history: History | None = None,
    ) -> None:
        self._folder = folder
        self._world = world
        self._states = states
        self._log = log
        self._history = history
        self._start = StillRenderer.of(world)
        self._tracks = Tracks(world)
        self._holdings = Holdings(world)
        self._samples = SampleFiles(folder / PARTS)
        self._events: list[str] = []
        self._has_logged = self._is_closed = False
        self._journals = {name: Journal(folder / name) for name in (EVENTS, LOG)}

    def on_event(self, change: StatusChange) -> None:
        """Buffer the change, to be written after the tick."""
        self._events.append(_line(change))

    def after_ticks(self, run: RunView) -> None:
        """Update the attachments; write new events and log lines."""
        self._holdings.after_ticks(run.time)
        self._write_new_lines()

    def _write_new_lines(self) -> None:
        """Write buffered events and new log lines."""
        events = self._events
        self._events = []
        lines = self._log()
        self._has_logged = self._has_logged or bool(lines)
        for name, new in ((EVENTS, events), (LOG, lines)):
            self._journals[name].add("".join(f"{line}\n" for line in new))

    def after_step(self, time: float) -> None:  # noqa: ARG002 - the parts read the world's clock
        """Take a sample if one is due."""
        sample = self._tracks.after_step()
        if sample is not None:
            self._holdings.sampled(sample)
            self._samples.add(sample)

    def write(self, result: RunResult, stop: StopRequest) -> tuple[Path, ...]:
        """Write every file; the summary is the last one of those that programs read.

        A file that cannot be made is skipped, and the others are written.

        Args:
            result: Result of the run.
            stop: Plots are skipped if the end is urgent.

        Raises:
            RecordError: The disk is full, the folder is gone, or a file could not be made.
        """
        if self._is_closed:
            return ()
        self._write_new_lines()
        written: list[Path] = []
        problems: list[str] = []
        for name, write in self._files(result, stop):
            try:
                write(self._folder / name)
            except OSError as error:
                raise self._incomplete(error.strerror or str(error)) from error
            except Exception as error:  # noqa: BLE001 - one file must not cost the others
                _log.exception("%s could not be written", name)
                problems.append(f"{name} could not be written: {type(error).__name__}: {error}")
            else:
                written.append(self._folder / name)
        self.close()
        if problems:
            raise self._incomplete("; ".join(problems))
        return tuple(written)

    def close(self) -> None:
        """Close all files; nothing is written any more."""
        self._is_closed = True
        for journal in self._journals.values():
            journal.close()
        if self._history is not None:
            self._history.close()

    def _files(self, result: RunResult, stop: StopRequest) -> Iterator[tuple[str, WriteFile]]:
        """Yields the name and the writer of each file."""
        yield EVENTS, lambda _: self._journals[EVENTS].finish()
        if self._has_logged:
            yield LOG, lambda _: self._journals[LOG].finish()
        yield SAMPLES, self._write_samples
        history = self._history
        if history is not None:
            yield HISTORY, lambda _: history.finish(result.state_sha256)
        if result.ending is Ending.DIVERGED:
            yield DIVERGENCE, lambda path: write_atomically(path, self._states.write_last)
        yield SUMMARY, lambda path: self._write_summary(path, result)
        if not stop.urgent:
            stills = (self._start, StillRenderer.of(self._world))
            # Imported here: matplotlib takes as long to import as a short run.
            from bt_dualarm.runtime import plots

            observed = plots.Observed(self._tracks, self._holdings, stills)
            yield from plots.files_of(result, observed, stop)

    def _incomplete(self, why: str) -> RecordError:
        return RecordError(f"the record in {self._folder} is not complete: {why}")

    def _write_summary(self, path: Path, result: RunResult) -> None:
        summary = summary_of(result, self._holdings.as_dicts(), self._holdings.left_out)
        write_text(path, json.dumps(summary, indent=2, allow_nan=False))

    def _write_samples(self, path: Path) -> None:
        write_atomically(path, self._samples.write_archive)
        self._samples.remove()


def _line(change: StatusChange) -> str:
    """One status change as a line of JSON."""
    fields = {("time_s" if key == "time" else key): item for key, item in vars(change).items()}
    return json.dumps(json_ready(fields), allow_nan=False)
