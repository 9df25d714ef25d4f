"""The tables of a LeRobot data set: frames, the episode, the task, statistics (parquet, JSON)."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from bt_dualarm.pose import Matrix
from bt_dualarm.replay.record import Facts, ReplayError

_QUANTILES: Final = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}


@dataclass(frozen=True, eq=False)
class Episode:
    """One demonstration.

    Attributes:
        task: What it shows, in words.
        fps: Frames a second.
        columns: Numbers of all frames by feature, each of shape (frames, n).
        pixels: Some pixels of each video by feature, of shape (n, 3), from 0 to 1.
    """

    task: str
    fps: int
    columns: Mapping[str, npt.NDArray[np.float32]]
    pixels: Mapping[str, Matrix]

    @property
    def length(self) -> int:
        """Number of frames."""
        return len(next(iter(self.columns.values())))


def write_tables(episode: Episode, folder: Path) -> None:
    """Write all of them below a folder.

    Raises:
        ReplayError: The package pyarrow is not installed.
        OSError: They cannot be written there.
    """
    try:
        import pyarrow as pa
        from pyarrow import parquet
    except ImportError as error:
        message = "--lerobot needs the package pyarrow (the extra bt_dualarm[export])"
        raise ReplayError(message) from error
    statistics = _statistics(episode)
    tables = {
        "data/chunk-000/file-000.parquet": _frames(pa, episode),
        "meta/episodes/chunk-000/file-000.parquet": _episodes(pa, episode, statistics),
        "meta/tasks.parquet": _tasks(pa, episode),
    }
    for name, table in tables.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        parquet.write_table(table, folder / name)  # type: ignore[no-untyped-call]  # it has none
    text = json.dumps(statistics, indent=4, allow_nan=False)
    (folder / "meta" / "stats.json").write_text(text, encoding="utf-8")


def _indices(episode: Episode) -> dict[str, npt.NDArray[np.generic]]:
    """Columns that every data set has."""
    frames = np.arange(episode.length)
    zeros = np.zeros(episode.length, np.int64)
    return {
        "timestamp": (frames / episode.fps).astype(np.float32),
        "frame_index": frames,
        "episode_index": zeros,
        "index": frames,
        "task_index": zeros,
    }


def _frames(pa: Any, episode: Episode) -> Any:  # the package has no types
    columns = {
        name: pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), values.shape[1])
        for name, values in episode.columns.items()
    }
    return pa.table(columns | {name: pa.array(each) for name, each in _indices(episode).items()})


def _episodes(pa: Any, episode: Episode, statistics: Facts) -> Any:  # as above
    """One row: where its frames are, and what is in them."""
    row: Facts = {
        "episode_index": 0,
        "tasks": [episode.task],
        "length": episode.length,
        "dataset_from_index": 0,
        "dataset_to_index": episode.length,
        "data/chunk_index": 0,
        "data/file_index": 0,
        "meta/episodes/chunk_index": 0,
        "meta/episodes/file_index": 0,
    }
    for key in episode.pixels:
        row[f"videos/{key}/chunk_index"] = row[f"videos/{key}/file_index"] = 0
        row[f"videos/{key}/from_timestamp"] = 0.0
        row[f"videos/{key}/to_timestamp"] = episode.length / episode.fps
    for feature, found in statistics.items():
        row |= {f"stats/{feature}/{name}": value for name, value in found.items()}
    return pa.Table.from_pylist([row])


def _tasks(pa: Any, episode: Episode) -> Any:  # as above
    """Numbers of the tasks with their texts as index, as pandas would write it."""
    table = pa.table({"task_index": pa.array([0], pa.int64()), "task": pa.array([episode.task])})
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


def _statistics(episode: Episode) -> Facts:
    """Least, largest, mean, spread and quantiles of each feature; of videos by channel."""
    found: Facts = {}
    for name, values in {**episode.columns, **_indices(episode)}.items():
        rows = np.asarray(values, float).reshape(episode.length, -1)
        found[name] = {**_of(rows), "count": [episode.length]}
    for key, pixels in episode.pixels.items():
        channels = {name: [[[x]] for x in each] for name, each in _of(pixels).items()}
        found[key] = {**channels, "count": [episode.length]}
    return found


def _of(rows: Matrix) -> dict[str, list[float]]:
    """Statistics of each column of a table of shape (n, columns)."""
    summary = {
        "min": rows.min(axis=0),
        "max": rows.max(axis=0),
        "mean": rows.mean(axis=0),
        "std": rows.std(axis=0),
    }
    summary |= {name: np.quantile(rows, share, axis=0) for name, share in _QUANTILES.items()}
    return {name: [float(x) for x in values] for name, values in summary.items()}
