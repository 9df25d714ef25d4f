"""The folder of a record: taken before the run, so that nothing is lost at its end."""

from __future__ import annotations

import errno
import fcntl
import os
import stat
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from bt_dualarm.errors import DualArmError
from bt_dualarm.recording.untrusted import Budget, HistoryError, file_kind, parsed, read_regular
from bt_dualarm.runtime.atomic_write import leftovers

SUMMARY, EVENTS, SAMPLES = "summary.json", "events.jsonl", "samples.npz"
LOG, DIVERGENCE = "run.log", "divergence.npz"
HISTORY: Final = "run.history"
FRAMES: Final = "run.frames"
OVERVIEW, SCENE = "overview.png", "scene.png"

PARTS: Final = "samples.parts"
"""Folder of samples on their way; a run that was killed leaves it behind."""

LOCK: Final = ".recording"
"""Held by the run that records to a folder; one that was killed leaves it behind."""

_FILES: Final = (SUMMARY, EVENTS, SAMPLES, LOG, DIVERGENCE, HISTORY, FRAMES, OVERVIEW, SCENE)
_PLOTS: Final = ("plane", "time")

_OF_OURS: Final = frozenset({"outcome", "state_sha256", "arms"})
"""Keys by which the summary of a run is known."""

_MOST_SUMMARY: Final = 1 << 26
"""Bytes of a summary: of a run of a day with all of its leaves a hundredth."""

_NO_LOCKS: Final = frozenset({errno.ENOLCK, errno.EOPNOTSUPP})
"""What file systems say that know no locks: there nobody can be kept out."""


class RecordError(DualArmError):
    """The folder of a record cannot be used; the message names it."""


class RecordFolder:
    """A folder that one run has for itself until the end of a ``with`` block.

    What an earlier run wrote there is taken away, other files stay.

    Args:
        path: The folder; it is made if it is not there.
        arms: Names of the arms, whose plots are to be written.

    Raises:
        RecordError: It is no folder, nothing can be written there, another run is recording
            there, or a file that is of no run would be overwritten.
    """

    def __init__(self, path: Path, arms: Iterable[str]) -> None:
        self.path = path
        try:
            path.mkdir(parents=True, exist_ok=True)
            was_left = (path / LOCK).exists()
            self._lock = _locked(path / LOCK)
        except FileExistsError:
            raise RecordError(f"cannot record to {path}: it is there and is not a folder") from None
        except BlockingIOError:
            raise RecordError(f"cannot record to {path}: another run is recording there") from None
        except OSError as error:
            raise _cannot(path, error) from error
        try:
            self._clear([*_FILES, *_plots_of(arms)], was_left=was_left)
        except BaseException:
            self.release()
            raise

    def __enter__(self) -> RecordFolder:
        return self

    def __exit__(self, *error: object) -> None:
        """Let others record there."""
        self.release()

    def release(self) -> None:
        """Let others record there; the lock goes first, as whoever waits for it looks again."""
        (self.path / LOCK).unlink(missing_ok=True)
        os.close(self._lock)

    def _clear(self, names: list[str], *, was_left: bool) -> None:
        """Take away what an earlier run wrote.

        Raises:
            RecordError: Something of these names is there, and not of a run.
        """
        try:
            for name in names:
                _refuse_other_kinds(self.path / name)
            earlier = _arms_of_earlier_run(self.path / SUMMARY)
            if earlier is None and not was_left:
                self._refuse_foreign([*names, PARTS])
            _remove_parts(self.path / PARTS)
            for name in (*names, *_plots_of(earlier or ())):
                (self.path / name).unlink(missing_ok=True)
                for half in leftovers(self.path / name):
                    half.unlink(missing_ok=True)
        except OSError as error:
            raise _cannot(self.path, error) from error

    def _refuse_foreign(self, names: list[str]) -> None:
        for name in names:
            if os.path.lexists(self.path / name):
                raise RecordError(
                    f"cannot record to {self.path}: {name} is there and is not of a run; "
                    "it would be overwritten"
                )


def _refuse_other_kinds(path: Path) -> None:
    """Let nobody read or write pipes, devices, folders: opening some of them does not return.

    Raises:
        RecordError: Something is there that is no regular file.
    """
    try:
        mode = path.lstat().st_mode
    except FileNotFoundError:
        return
    if not stat.S_ISREG(mode):
        raise RecordError(
            f"cannot record to {path.parent}: {path.name} is there and is {file_kind(mode)}, "
            "not a regular file"
        )


def _remove_parts(folder: Path) -> None:
    """Take away the samples of a run that was killed.

    Raises:
        RecordError: Something else is there.
        OSError: Something else is in it.
    """
    try:
        mode = folder.lstat().st_mode
    except FileNotFoundError:
        return
    if not stat.S_ISDIR(mode):
        raise RecordError(f"cannot record to {folder.parent}: {folder.name} is there, no folder")
    for part in folder.glob("*.npy"):
        part.unlink()
    folder.rmdir()


def _cannot(path: Path, error: OSError) -> RecordError:
    return RecordError(f"cannot record to {path}: {error.strerror or error}")


def _locked(path: Path) -> int:
    """Descriptor of a lock that this process has for itself.

    Raises:
        BlockingIOError: Somebody else has it.
        OSError: The file cannot be made.
    """
    while True:
        _refuse_other_kinds(path)
        lock = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            # Whoever had it before may have taken the file away in the meantime.
            if os.path.samestat(os.fstat(lock), path.stat()):
                return lock
        except FileNotFoundError:
            pass
        except OSError as error:
            if error.errno in _NO_LOCKS:
                return lock
            os.close(lock)
            raise
        os.close(lock)


def _arms_of_earlier_run(summary: Path) -> list[str] | None:
    """Names of the arms of the run whose summary this is, None where it is of no run."""
    try:
        content = parsed(read_regular(summary, _MOST_SUMMARY), Budget())
        return [*map(str, content["arms"])] if content.keys() >= _OF_OURS else None
    except (HistoryError, ValueError, KeyError, TypeError, AttributeError):
        return None


def _plots_of(arms: Iterable[str]) -> list[str]:
    """File names of the arms' plots; a name that leads elsewhere is not one of ours."""
    names = [f"{arm}_{kind}.png" for arm in arms for kind in _PLOTS]
    return [name for name in names if name.isprintable() and Path(name).name == name]
