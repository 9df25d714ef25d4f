"""The files of a LeRobot data set: frames, episodes, tasks, statistics (parquet, JSON), films."""

from __future__ import annotations

import json
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from bt_dualarm.pose import Matrix
from bt_dualarm.replay.lerobot_episode import FPS, CameraView, Columns, Episode, differences
from bt_dualarm.replay.record import Facts, ReplayError
from bt_dualarm.replay.video import Encoder
from bt_dualarm.runtime.atomic_write import write_text

VERSION: Final = "v3.0"
MOST_DATA_MB: Final = 100
MOST_VIDEO_MB: Final = 200
FILES_A_CHUNK: Final = 1000
"""Files of a chunk, and how large they grow: what LeRobot takes by default."""

KEY_EVERY: Final = 2
"""Pictures from one that stands for itself to the next: training asks for them in any order."""

_DATA: Final = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_EPISODES: Final = "meta/episodes/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_VIDEO: Final = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
_TASKS: Final = "meta/tasks.parquet"
_SAMPLED_EVERY: Final = 10
"""Pictures from one to the next that the statistics of a video look at, each eighth pixel."""

_QUANTILES: Final = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}


@dataclass
class _Place:
    """The file of a series to which episodes are being added.

    Attributes:
        number: Its number, chunks counted through.
        writer: What adds to it; None before there is something.
        frames: Frames that are in it.
    """

    number: int
    writer: Any = None  # of pyarrow, which has no types, or an encoder
    frames: int = 0
    path: Path = field(default_factory=Path)

    @property
    def indices(self) -> dict[str, int]:
        """Chunk and file, as paths have them."""
        chunk, file = divmod(self.number, FILES_A_CHUNK)
        return {"chunk_index": chunk, "file_index": file}

    def close_at(self, megabytes: float) -> None:
        """Go on with the next file where this one has grown that large."""
        # The encoder is a process of its own: it makes the file when it comes to it.
        size = self.path.stat().st_size if self.path.exists() else 0
        if self.writer is not None and size >= megabytes * 2**20:
            self.writer.close()
            self.number, self.writer, self.frames = self.number + 1, None, 0


class DatasetWriter:
    """Adds episodes to a data set, new or not.

    Args:
        folder: Folder of the data set; one that has `meta/info.json` is added to, in files of
            its own: those that are there already are not changed, but for three in `meta/`.

    Raises:
        ReplayError: The package pyarrow is not installed, or what is there is no data set that
            can be added to.
    """

    def __init__(self, folder: Path) -> None:
        try:
            import pyarrow as pa
            from pyarrow import parquet
        except ImportError as error:
            message = "--lerobot needs the package pyarrow (the extra bt_dualarm[export])"
            raise ReplayError(message) from error
        self._pa: Any = pa  # the package has no types
        self._parquet: Any = parquet
        self._folder = folder
        self._info: Facts | None = None
        self._first = "what is in the data set"
        self._tasks: list[str] = []
        self._episodes = self._frames = 0
        self._rows: list[Facts] = []
        self._pixels: dict[str, list[Facts]] = {}
        if (folder / "meta" / "info.json").exists():
            self._take_up()
        self._data = _Place(self._next("data/*/file-*.parquet"))
        self._films: dict[str, _Place] = {}
        self._open = ExitStack()

    def __enter__(self) -> DatasetWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._open.close()

    def _next(self, pattern: str) -> int:
        """Number of the first file of a series that is not there yet."""
        found = [
            FILES_A_CHUNK * int(path.parent.name.partition("-")[2])
            + int(path.stem.partition("-")[2])
            for path in self._folder.glob(pattern)
        ]
        return max(found, default=-1) + 1

    def _take_up(self) -> None:
        """Read what is there already."""
        try:
            info = json.loads((self._folder / "meta" / "info.json").read_bytes())
            if info["codebase_version"] != VERSION or info["fps"] != FPS:
                raise ReplayError(
                    f"cannot append to a data set of version {info['codebase_version']} with "
                    f"{info['fps']} frames a second: {VERSION} with {FPS} is written"
                )
            self._episodes, self._frames = int(info["total_episodes"]), int(info["total_frames"])
            tasks = self._parquet.read_table(self._folder / _TASKS).to_pylist()
            tasks.sort(key=lambda row: row["task_index"])
            self._tasks = [str(row["task"]) for row in tasks]
            self._info = dict(info)
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise ReplayError(
                f"cannot append: this is no data set of LeRobot's: {error}"
            ) from error
        videos = [name for name, said in info["features"].items() if said["dtype"] == "video"]
        for path in sorted(self._folder.glob("meta/episodes/*/*.parquet")):
            for row in self._parquet.read_table(path).to_pylist():
                for key in videos:
                    said = {
                        name.rpartition("/")[2]: value
                        for name, value in row.items()
                        if name.startswith(f"stats/{key}/")
                    }
                    self._pixels.setdefault(key, []).append(said)

    def add(self, episode: Episode, source: str) -> None:
        """Add an episode.

        Args:
            episode: The episode.
            source: Name of the run, for errors.

        Raises:
            ReplayError: Its features are not those of the data set; the package imageio-ffmpeg is
                not installed.
            OSError: It cannot be written.
        """
        if self._info is None:
            self._info, self._first = _info(episode), source
        self._refuse_other_features(episode, source)
        if episode.task not in self._tasks:
            self._tasks.append(episode.task)
        columns: Columns = {**episode.columns, **self._indices(episode)}
        row: Facts = {
            "episode_index": self._episodes,
            "tasks": [episode.task],
            "length": episode.length,
            "dataset_from_index": self._frames,
            "dataset_to_index": self._frames + episode.length,
            "success": episode.succeeded,
        }
        row |= {f"data/{name}": at for name, at in self._add_frames(columns).items()}
        statistics = {name: _statistics(values) for name, values in columns.items()}
        for key, view in episode.views.items():
            said, statistics[key] = self._add_film(key, view)
            row |= {f"videos/{key}/{name}": value for name, value in said.items()}
            self._pixels.setdefault(key, []).append(statistics[key])
        for feature, found in statistics.items():
            row |= {f"stats/{feature}/{name}": value for name, value in found.items()}
        self._rows.append(row)
        self._episodes += 1
        self._frames += episode.length

    def _refuse_other_features(self, episode: Episode, source: str) -> None:
        assert self._info is not None  # noqa: S101 - as it was read, or begun
        ours, known = _info(episode), self._info
        found = differences(ours["features"], known["features"])
        if ours["robot_type"] != known["robot_type"]:
            found.insert(0, f"its robots are {ours['robot_type']}, not {known['robot_type']}")
        if found:
            raise ReplayError(
                f"{source} cannot be in one data set with {self._first}: {'; '.join(found[:4])}"
            )

    def _indices(self, episode: Episode) -> Columns:
        """Columns that every data set has."""
        frames = np.arange(episode.length)
        return {
            "timestamp": (frames / FPS).astype(np.float32)[:, None],
            "frame_index": frames[:, None],
            "episode_index": np.full((episode.length, 1), self._episodes),
            "index": self._frames + frames[:, None],
            "task_index": np.full((episode.length, 1), self._tasks.index(episode.task)),
        }

    def _add_frames(self, columns: Columns) -> dict[str, int]:
        """Add the numbers of all frames; returns which file they are in."""
        pa, place = self._pa, self._data
        place.close_at(MOST_DATA_MB)
        arrays = {
            name: pa.array(values.ravel())
            if values.shape[1] == 1
            else pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), values.shape[1])
            for name, values in columns.items()
        }
        table = pa.table(arrays)
        if place.writer is None:
            place.path = self._folder / _DATA.format(**place.indices)
            place.path.parent.mkdir(parents=True, exist_ok=True)
            place.writer = self._parquet.ParquetWriter(place.path, table.schema)
            self._open.callback(place.writer.close)
        place.writer.write_table(table)
        return place.indices

    def _add_film(self, key: str, view: CameraView) -> tuple[Facts, Facts]:
        """Add the pictures of a camera; returns where they are, and their statistics."""
        place = self._films.get(key)
        if place is None:
            place = self._films[key] = _Place(self._next(f"videos/{key}/*/file-*.mp4"))
        place.close_at(MOST_VIDEO_MB)
        if place.writer is None:
            place.path = self._folder / _VIDEO.format(video_key=key, **place.indices)
            place.path.parent.mkdir(parents=True, exist_ok=True)
            place.writer = Encoder(place.path, (view.width, view.height), FPS, KEY_EVERY)
            self._open.callback(place.writer.close)
        seen = []
        for number, picture in enumerate(view.pictures()):
            place.writer.add(picture)
            if number % _SAMPLED_EVERY == 0:
                seen.append(picture[::8, ::8].reshape(-1, 3) / 255.0)
        first, place.frames = place.frames, place.frames + len(view.moments)
        channels = _summarized(np.concatenate(seen))
        statistics = {name: [[[x]] for x in each] for name, each in channels.items()}
        stamps = {"from_timestamp": first / FPS, "to_timestamp": place.frames / FPS}
        return {**place.indices, **stamps}, {**statistics, "count": [len(view.moments)]}

    def finish(self) -> None:
        """Write what is said of all episodes; nothing can be added after that.

        Raises:
            OSError: It cannot be written.
        """
        assert self._info is not None  # noqa: S101 - there is an episode
        self._open.close()
        place = _Place(self._next("meta/episodes/*/file-*.parquet"))
        for row in self._rows:
            row |= {f"meta/episodes/{name}": at for name, at in place.indices.items()}
        path = self._folder / _EPISODES.format(**place.indices)
        path.parent.mkdir(parents=True, exist_ok=True)
        self._parquet.write_table(self._pa.Table.from_pylist(self._rows), path)
        (self._folder / _TASKS).unlink(missing_ok=True)  # it may be linked from elsewhere
        self._parquet.write_table(_tasks(self._pa, self._tasks), self._folder / _TASKS)
        counts = {
            "total_episodes": self._episodes,
            "total_frames": self._frames,
            "total_tasks": len(self._tasks),
            "splits": {"train": f"0:{self._episodes}"},
        }
        statistics = json.dumps(self._all_statistics(), indent=4, allow_nan=False)
        write_text(self._folder / "meta" / "stats.json", statistics)
        info = json.dumps({**self._info, **counts}, indent=4)
        write_text(self._folder / "meta" / "info.json", info)

    def _all_statistics(self) -> Facts:
        """Statistics of all frames by feature: of numbers exactly, of pictures from samples."""
        assert self._info is not None  # noqa: S101 - there is an episode
        paths = sorted(self._folder.glob("data/*/*.parquet"))
        found: Facts = {}
        for name, said in self._info["features"].items():
            if said["dtype"] == "video":
                found[name] = _pooled(self._pixels[name])
                continue
            parts = []
            for path in paths:
                column = self._parquet.read_table(path, columns=[name])[name].combine_chunks()
                flat = column.flatten() if said["shape"] != [1] else column
                parts.append(flat.to_numpy(zero_copy_only=False).reshape(-1, *said["shape"]))
            found[name] = _statistics(np.concatenate(parts))
        return found


def _info(episode: Episode) -> Facts:
    """What ``meta/info.json`` says, but for what is counted."""
    indices: Facts = {
        name: {"dtype": kind, "shape": [1], "names": None}
        for name, kind in (
            ("timestamp", "float32"),
            ("frame_index", "int64"),
            ("episode_index", "int64"),
            ("index", "int64"),
            ("task_index", "int64"),
        )
    }
    return {
        "codebase_version": VERSION,
        "robot_type": episode.robots,
        "total_episodes": 0,
        "total_frames": 0,
        "total_tasks": 0,
        "chunks_size": FILES_A_CHUNK,
        "data_files_size_in_mb": MOST_DATA_MB,
        "video_files_size_in_mb": MOST_VIDEO_MB,
        "fps": FPS,
        "splits": {},
        "data_path": _DATA,
        "video_path": _VIDEO if episode.views else None,
        "features": episode.features | indices,
    }


def _tasks(pa: Any, tasks: list[str]) -> Any:  # the package has no types
    """Numbers of the tasks with their texts as index, as pandas would write it."""
    numbers = pa.array(range(len(tasks)), pa.int64())
    table = pa.table({"task_index": numbers, "task": pa.array(tasks)})
    columns = [
        _column("task_index", "int64", "int64"),
        _column("task", "unicode", "object"),
    ]
    names = {**_column("", "unicode", "object"), "name": None, "field_name": None}
    said = {
        "index_columns": ["task"],
        "column_indexes": [{**names, "metadata": {"encoding": "UTF-8"}}],
        "columns": columns,
        "creator": {"library": "pyarrow", "version": pa.__version__},
        "pandas_version": "2.0.0",
    }
    return table.replace_schema_metadata({"pandas": json.dumps(said)})


def _column(name: str, kind: str, numpy_kind: str) -> Facts:
    return {
        "name": name,
        "field_name": name,
        "pandas_type": kind,
        "numpy_type": numpy_kind,
        "metadata": None,
    }


def _statistics(values: npt.NDArray[np.generic]) -> Facts:
    """Statistics of the numbers of a feature, of shape (frames, n)."""
    return {**_summarized(values.astype(float)), "count": [len(values)]}


def _summarized(rows: Matrix) -> dict[str, list[float]]:
    """Least, largest, mean, spread and quantiles of columns of a table of shape (n, columns)."""
    summary = {
        "min": rows.min(axis=0),
        "max": rows.max(axis=0),
        "mean": rows.mean(axis=0),
        "std": rows.std(axis=0),
    }
    summary |= {name: np.quantile(rows, share, axis=0) for name, share in _QUANTILES.items()}
    return {name: [float(x) for x in values] for name, values in summary.items()}


def _pooled(parts: list[Facts]) -> Facts:
    """Statistics of several episodes as one, as LeRobot's own `aggregate_stats` pools them.

    Exact but for the quantiles, which are means weighted by the numbers of frames.
    """
    counts = np.array([part["count"][0] for part in parts], float)
    weights = counts / counts.sum()

    def weighted(name: str) -> npt.NDArray[np.float64]:
        values = np.array([part[name] for part in parts], float)
        return np.tensordot(weights, values, axes=1)

    mean = weighted("mean")
    squares = [
        np.square(part["std"]) + np.square(np.subtract(part["mean"], mean)) for part in parts
    ]
    return {
        "min": np.min([part["min"] for part in parts], axis=0).tolist(),
        "max": np.max([part["max"] for part in parts], axis=0).tolist(),
        "mean": mean.tolist(),
        "std": np.sqrt(np.tensordot(weights, np.array(squares), axes=1)).tolist(),
        **{name: weighted(name).tolist() for name in _QUANTILES},
        "count": [int(counts.sum())],
    }
