"""Records as a data set of demonstrations, in LeRobot's format v3.0, for imitation learning.

The files and their fields are those of https://huggingface.co/docs/lerobot/lerobot-dataset-v3:
parquet for numbers, MP4 for cameras, `meta/` for what they mean. A run is an episode.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from secrets import token_hex

from bt_dualarm.replay.lerobot_episode import episode_of
from bt_dualarm.replay.lerobot_tables import DatasetWriter
from bt_dualarm.replay.record import Record, ReplayError


@dataclass(frozen=True)
class Demonstrations:
    """What an export has written.

    Attributes:
        episodes: Runs that were written.
        failed: Those of them that did not succeed, which the data set marks.
        left_out: Runs that were left out, as they did not succeed.
        frames: Frames of all that were written.
    """

    episodes: int
    failed: int
    left_out: int
    frames: int


def write_dataset(
    folders: Sequence[Path],
    target: Path,
    *,
    only_successes: bool = False,
    append: bool = False,
    progress: Callable[[int, Path], None] | None = None,
) -> Demonstrations:
    """Write the runs of some records as one data set, whole or not at all.

    Args:
        folders: Folders of records, in the order of the episodes.
        target: Folder to write, which is not there yet, or empty.
        only_successes: Whether runs that did not succeed are left out.
        append: Whether the runs are added to the data set that is in the folder.
        progress: Called before a run is read, with how many were before it, and its folder.

    Raises:
        ReplayError: There is something in the folder already, or nothing to append to; a run's
            features are not those of the others, or it has no state; no run succeeded where only
            those are wanted; a package is not installed.
        HistoryError: A record cannot be read.
        OSError: It cannot be written there.
    """
    is_there = target.exists() and (not target.is_dir() or any(target.iterdir()))
    if is_there and not append:
        raise ReplayError(f"cannot write {target}: there is something already (--append adds runs)")
    if append and not (target / "meta" / "info.json").is_file():
        raise ReplayError(f"cannot append to {target}: there is no data set in it")
    target = Path(os.path.abspath(target))  # noqa: PTH100 - a name of its own, links not followed
    half = target.with_name(f".{target.name}.half.{token_hex(4)}")
    written = failed = left_out = frames = 0
    try:
        if append:
            shutil.copytree(target, half, copy_function=_linked)
        else:
            half.mkdir(parents=True)
        with DatasetWriter(half) as writer:
            for number, folder in enumerate(folders):
                if progress is not None:
                    progress(number, folder)
                record = Record.read(folder)
                if only_successes and not _succeeded(record):
                    left_out += 1
                    continue
                episode = episode_of(record)
                writer.add(episode, str(folder))
                written += 1
                failed += not episode.succeeded
                frames += episode.length
            if not written:
                raise ReplayError(
                    f"none of {len(folders)} runs succeeded: there is nothing to write"
                )
            writer.finish()
        _put(half, target)
    finally:
        shutil.rmtree(half, ignore_errors=True)
    return Demonstrations(written, failed, left_out, frames)


def _succeeded(record: Record) -> bool:
    return record.summary is not None and record.summary.get("outcome") == "SUCCESS"


def _linked(source: str, target: str) -> None:
    """The same file at another place, copied where that cannot be; nothing of it is changed."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copy2(source, target)


def _put(half: Path, target: Path) -> None:
    """Move a folder into its place, in which there may be an older one."""
    if target.is_dir() and any(target.iterdir()):
        old = target.with_name(f".{target.name}.old.{token_hex(4)}")
        target.replace(old)
        half.replace(target)
        shutil.rmtree(old)
    else:
        half.replace(target)
