"""Export of records as a LeRobot data set (format v3.0), for imitation learning.

Files and fields follow https://huggingface.co/docs/lerobot/lerobot-dataset-v3: Parquet for numbers,
MP4 for cameras, `meta/` for their description. A run is an episode.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Final, TypeAlias

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.core.pose import Matrix
from bt_dualarm.core.share import beside, write_text
from bt_dualarm.export.video import Encoder, Picture
from bt_dualarm.replay.record import Facts, Moment, Record, ReplayError
from bt_dualarm.replay.timeline import GripperKind, file_part, gripper_kind, joints_of
from bt_dualarm.sim.frame import Exposure
from bt_dualarm.sim.renderers import RayRenderer

# Episodes


FPS: Final = 25
"""Frames per second: every second recorded state."""

STATE: Final = "observation.state"
"""Joint positions in rad, openings of grippers in m, share of a cup's full vacuum."""

VELOCITY: Final = "observation.velocity"
"""Joint velocities in rad/s, speeds of openings in m/s."""

EFFORT: Final = "observation.effort"
"""Commanded joint torques in N m, measured forces of grippers in N."""

ACTION: Final = "action"
"""Joint set-points in rad; commanded opening (m), speed (m/s) and force (N) of fingers; commanded
force of a cup in N, 0 to release."""

OBJECTS: Final = "observation.environment_state"
"""Poses of all movable objects: position in m, quaternion (w, x, y, z)."""

DONE: Final = "next.done"
SUCCESS: Final = "next.success"

_POSE: Final = ("x", "y", "z", "qw", "qx", "qy", "qz")

Columns: TypeAlias = dict[str, npt.NDArray[np.generic]]


@dataclass(frozen=True, eq=False)
class CameraView:
    """Full images of one camera in all frames, without noise.

    Attributes:
        record: The record.
        arm: Name of the camera's arm.
        width: Width in pixels, even, as H.264 in 4:2:0 requires.
        height: Height in pixels, even.
        moments: State of the run in each frame.
    """

    record: Record
    arm: str
    width: int
    height: int
    moments: Sequence[Moment]

    def pictures(self) -> Iterator[Picture]:
        """Render an image for each frame, of shape (height, width, 3); black without the camera."""
        renderer = RayRenderer()
        model = None
        data = None
        for moment in self.moments:
            if model is not self.record.model(moment.generation) or data is None:
                model = self.record.model(moment.generation)
                data = mujoco.MjData(model)
                kind = mujoco.mjtObj.mjOBJ_CAMERA
                camera = mujoco.mj_name2id(model, kind, f"{self.arm}/camera")
            if camera < 0:
                yield np.zeros((self.height, self.width, 3), np.uint8)
                continue
            data.qpos[:] = moment.qpos
            mujoco.mj_kinematics(model, data)
            mujoco.mj_camlight(model, data)
            yield renderer.render(model, data, Exposure(camera, self.width, self.height))


@dataclass(frozen=True, eq=False)
class Episode:
    """A run as a demonstration.

    Attributes:
        task: Description of the task.
        succeeded: Whether the run succeeded.
        robots: Titles of robot and gripper of each arm, in the order of the file.
        columns: Values of all frames by feature, each of shape (frames, n).
        names: Names of the n values of a feature, if n is not 1.
        views: Images of each camera, by feature.
    """

    task: str
    succeeded: bool
    robots: str
    columns: Columns
    names: Mapping[str, Sequence[str]]
    views: Mapping[str, CameraView]

    @property
    def length(self) -> int:
        """Number of frames."""
        return len(self.columns[ACTION])

    @property
    def features(self) -> dict[str, Facts]:
        """Description of each feature in ``meta/info.json``."""
        found: dict[str, Any] = {}
        for name, values in self.columns.items():
            names = self.names.get(name)
            shape = [values.shape[1]]
            found[name] = {
                "dtype": str(values.dtype),
                "shape": shape,
                "names": None if names is None else list(names),
            }
        for name, view in self.views.items():
            found[name] = {
                "dtype": "video",
                "shape": [view.height, view.width, 3],
                "names": ["height", "width", "channels"],
                "info": {
                    "video.height": view.height,
                    "video.width": view.width,
                    "video.codec": "h264",
                    "video.pix_fmt": "yuv420p",
                    "video.is_depth_map": False,
                    "video.fps": FPS,
                    "video.channels": 3,
                    "has_audio": False,
                },
            }
        return found


def episode_of(record: Record) -> Episode:
    """Convert a record to an episode.

    An arm or object that is not in the world yet has zeros; one that was removed keeps its last
    values.

    Raises:
        ReplayError: The record has no states, or none of its grippers: it is of an earlier version.
    """
    if not len(record.times):
        raise ReplayError(f"{record.folder} contains no state")
    count = int((record.until - record.times[0]) * FPS) + 1
    times = record.times[0] + np.arange(count) / FPS
    rows = [record.index_at(time) for time in times.tolist()]
    moments = tuple(map(record.moment, rows))
    names: dict[str, list[str]] = {name: [] for name in (STATE, VELOCITY, EFFORT, ACTION)}
    parts: dict[str, list[npt.NDArray[np.float64]]] = {name: [] for name in names}
    for arm in record.arms:
        for name, (own, values) in _of_arm(record, arm, rows, moments).items():
            names[name] += own
            parts[name].append(values)
    columns: Columns = {
        name: np.concatenate(each, axis=1).astype(np.float32) for name, each in parts.items()
    }
    objects = [name for name, facts in record.start["objects"].items() if not facts.get("fixed")]
    if objects:
        names[OBJECTS] = [f"{obj}.{part}" for obj in objects for part in _POSE]
        columns[OBJECTS] = _objects(record, objects, moments).astype(np.float32)
    succeeded = _succeeded(record)
    is_last = np.arange(count)[:, None] == count - 1
    columns |= {DONE: is_last, SUCCESS: is_last & succeeded}
    views = {}
    for arm, facts in record.arms.items():
        if facts.get("camera"):
            width, height = (int(side) // 2 * 2 for side in facts["camera"]["resolution"])
            view = CameraView(record, arm, width, height, moments)
            views[f"observation.images.{file_part(arm)}"] = view
    robots = [
        f"{facts['robot']} with {facts['gripper']}" if facts.get("gripper") else str(facts["robot"])
        for facts in record.arms.values()
    ]
    task = record.name.replace("_", " ")
    return Episode(task, succeeded, "+".join(robots), columns, names, views)


def _of_arm(
    record: Record, arm: str, rows: Sequence[int], moments: Sequence[Moment]
) -> dict[str, tuple[list[str], npt.NDArray[np.float64]]]:
    """Names and values of an arm and its gripper by feature, of shape (frames, n)."""
    arm = file_part(arm)  # names become parts of columns
    sent = [record.arm_row(arm, row) for row in rows]
    known = next(((at, row) for at, row in enumerate(sent) if row is not None), None)
    if known is None:
        return {name: ([], np.zeros((len(rows), 0))) for name in (STATE, VELOCITY, EFFORT, ACTION)}
    model = record.model(moments[known[0]].generation)
    dof = len(known[1][0])
    kind = gripper_kind(model, arm)
    joints = [str(model.joint(j).name).replace("/", ".") for j in joints_of(model, arm, dof)]
    grip = f"{arm}.gripper"
    names = {
        STATE: {"fingers": [f"{grip}.width"], "suction": [f"{grip}.vacuum"]},
        VELOCITY: {"fingers": [f"{grip}.speed"], "suction": []},
        EFFORT: {"fingers": [f"{grip}.force"], "suction": [f"{grip}.force"]},
        ACTION: {
            "fingers": [f"{grip}.{what}" for what in ("width", "speed", "force")],
            "suction": [f"{grip}.force"],
        },
    }
    own = {name: joints + (by_kind[kind] if kind else []) for name, by_kind in names.items()}
    found = {name: np.zeros((len(rows), len(each))) for name, each in own.items()}
    for number, (row, moment, arm_row) in enumerate(zip(rows, moments, sent, strict=True)):
        if arm_row is None:
            for values in found.values():
                values[number] = values[number - 1] if number else 0.0
            continue
        model = record.model(moment.generation)
        ids = joints_of(model, arm, dof)
        gripper = _gripper_numbers(record, arm, row, kind)
        joint_numbers = {
            STATE: moment.qpos[model.jnt_qposadr[ids]],
            VELOCITY: moment.qvel[model.jnt_dofadr[ids]],
            EFFORT: arm_row[3],
            ACTION: arm_row[0],
        }
        for name, values in found.items():
            values[number] = [*joint_numbers[name], *gripper[name]]
    return {name: (own[name], found[name]) for name in own}


def _gripper_numbers(
    record: Record, arm: str, row: int, kind: GripperKind | None
) -> dict[str, list[float]]:
    """Names and values that a gripper adds to each feature."""
    if kind is None:
        return {STATE: [], VELOCITY: [], EFFORT: [], ACTION: []}
    state = record.gripper(arm, row)
    if state is None:
        raise ReplayError(
            f"{record.folder} does not contain the state of the gripper of {arm}: it was "
            "recorded by an earlier version; run its tree again with --record"
        )
    if kind == "fingers":
        asked = [state.commanded_width, state.commanded_speed, state.commanded_force]
        return {STATE: [state.width], VELOCITY: [state.speed], EFFORT: [state.force], ACTION: asked}
    sucks = state.commanded_width <= 0.0
    asked = [state.commanded_force if sucks else 0.0]
    return {STATE: [state.vacuum], VELOCITY: [], EFFORT: [state.force], ACTION: asked}


def _objects(
    record: Record, objects: Sequence[str], moments: Sequence[Moment]
) -> npt.NDArray[np.float64]:
    """Poses of objects in each frame, of shape (frames, 7 n)."""
    found = np.zeros((len(moments), len(objects), len(_POSE)))
    model = None
    data = None
    for number, moment in enumerate(moments):
        if model is not record.model(moment.generation) or data is None:
            model = record.model(moment.generation)
            data = mujoco.MjData(model)
            kind = mujoco.mjtObj.mjOBJ_BODY
            bodies = [mujoco.mj_name2id(model, kind, name) for name in objects]
        # Not read from the positions of joints: parts of objects move on hinges and slides.
        data.qpos[:] = moment.qpos
        mujoco.mj_kinematics(model, data)
        for place, body in enumerate(bodies):
            if body >= 0:
                found[number, place] = [*data.xpos[body], *data.xquat[body]]
            elif number:
                found[number, place] = found[number - 1, place]
    return found.reshape(len(moments), -1)


def differences(features: Facts, others: Facts) -> list[str]:
    """Differences between two sets of features of ``meta/info.json``, as sentences."""
    found = []
    for name in sorted(features.keys() | others.keys()):
        ours = features.get(name)
        theirs = others.get(name)
        if ours is None or theirs is None:
            found.append(f"{'it has no' if ours is None else 'only it has'} {name}")
        elif ours.get("names") != theirs.get("names"):
            lacks = [one for one in theirs["names"] or () if one not in (ours["names"] or ())]
            more = [one for one in ours["names"] or () if one not in (theirs["names"] or ())]
            parts = [f"lacks {_listed(lacks)}"] if lacks else []
            parts += [f"has {_listed(more)} besides"] if more else []
            found.append(f"its {name} {' and '.join(parts) or 'has a different order'}")
        elif (ours["dtype"], ours["shape"]) != (theirs["dtype"], theirs["shape"]):
            found.append(
                f"its {name} is {ours['dtype']} of shape {ours['shape']}, "
                f"not {theirs['dtype']} of shape {theirs['shape']}"
            )
    return found


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - 3} more" if len(names) > 3 else ""
    return f"{', '.join(names[:3])}{more}"


# Files of a data set: frames, episodes, tasks, statistics (Parquet, JSON), videos


VERSION: Final = "v3.0"
MOST_DATA_MB: Final = 100
MOST_VIDEO_MB: Final = 200
FILES_A_CHUNK: Final = 1000
"""Number of files per chunk, and their sizes: the defaults of LeRobot."""

KEY_EVERY: Final = 2
"""Interval of key frames: short, because training reads frames in random order."""

_DATA: Final = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_EPISODES: Final = "meta/episodes/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_VIDEO: Final = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
_TASKS: Final = "meta/tasks.parquet"
_SAMPLED_EVERY: Final = 10
"""Interval of the frames in a video's statistics, of which every eighth pixel counts."""

_QUANTILES: Final = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}


@dataclass
class _Place:
    """The file of a series to which episodes are added.

    Attributes:
        number: Its number, over all chunks.
        writer: Its writer; None before the first episode.
        frames: Number of its frames.
    """

    number: int
    writer: Any = None  # a pyarrow writer, which has no types, or an encoder
    frames: int = 0
    path: Path = field(default_factory=Path)

    @property
    def indices(self) -> dict[str, int]:
        """Indices of chunk and file in paths."""
        chunk, file = divmod(self.number, FILES_A_CHUNK)
        return {"chunk_index": chunk, "file_index": file}

    def close_at(self, megabytes: float) -> None:
        """Continue with the next file if this one has reached its size."""
        # The encoder is a separate process, which creates the file later.
        size = self.path.stat().st_size if self.path.exists() else 0
        if self.writer is not None and size >= megabytes * 2**20:
            self.writer.close()
            self.number = self.number + 1
            self.writer = None
            self.frames = 0


class DatasetWriter:
    """Adds episodes to a new or existing data set.

    Args:
        folder: Folder of the data set. If it has `meta/info.json`, episodes are added in new
            files: existing ones are not changed, except for three in `meta/`.

    Raises:
        ReplayError: The package pyarrow is not installed, or the existing data set is
            incompatible.
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
        self._first = "what the data set contains"
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
        self._open.__exit__(kind, error, trace)

    def _next(self, pattern: str) -> int:
        """Number of the first file of a series that does not exist yet."""
        found = [
            FILES_A_CHUNK * int(path.parent.name.partition("-")[2])
            + int(path.stem.partition("-")[2])
            for path in self._folder.glob(pattern)
        ]
        return max(found, default=-1) + 1

    def _take_up(self) -> None:
        """Read the existing data set."""
        try:
            info = json.loads((self._folder / "meta" / "info.json").read_bytes())
            if info["codebase_version"] != VERSION or info["fps"] != FPS:
                raise ReplayError(
                    f"cannot append to a data set of version {info['codebase_version']} with "
                    f"{info['fps']} frames a second: {VERSION} with {FPS} is written"
                )
            self._episodes = int(info["total_episodes"])
            self._frames = int(info["total_frames"])
            tasks = self._parquet.read_table(self._folder / _TASKS).to_pylist()
            tasks.sort(key=lambda row: row["task_index"])
            self._tasks = [str(row["task"]) for row in tasks]
            self._info = dict(info)
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise ReplayError(f"cannot append: this is not a LeRobot data set: {error}") from error
        videos = [name for name, feature in info["features"].items() if feature["dtype"] == "video"]
        for path in sorted(self._folder.glob("meta/episodes/*/*.parquet")):
            for row in self._parquet.read_table(path).to_pylist():
                for key in videos:
                    statistics = {
                        name.rpartition("/")[2]: value
                        for name, value in row.items()
                        if name.startswith(f"stats/{key}/")
                    }
                    self._pixels.setdefault(key, []).append(statistics)

    def add(self, episode: Episode, source: str) -> None:
        """Add an episode.

        Args:
            episode: The episode.
            source: Name of the run, for errors.

        Raises:
            ReplayError: Its features differ from those of the data set, or the package
                imageio-ffmpeg is not installed.
            OSError: It cannot be written.
        """
        if self._info is None:
            self._info = _info(episode)
            self._first = source
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
            location, statistics[key] = self._add_film(key, view)
            row |= {f"videos/{key}/{name}": value for name, value in location.items()}
            self._pixels.setdefault(key, []).append(statistics[key])
        for feature, found in statistics.items():
            row |= {f"stats/{feature}/{name}": value for name, value in found.items()}
        self._rows.append(row)
        self._episodes += 1
        self._frames += episode.length

    def _refuse_other_features(self, episode: Episode, source: str) -> None:
        assert self._info is not None  # noqa: S101 - as it was read, or begun
        ours = _info(episode)
        known = self._info
        found = differences(ours["features"], known["features"])
        if ours["robot_type"] != known["robot_type"]:
            found.insert(0, f"its robots are {ours['robot_type']}, not {known['robot_type']}")
        if found:
            raise ReplayError(
                f"{source} cannot be in one data set with {self._first}: {'; '.join(found[:4])}"
            )

    def _indices(self, episode: Episode) -> Columns:
        """Columns of every data set."""
        frames = np.arange(episode.length)
        return {
            "timestamp": (frames / FPS).astype(np.float32)[:, None],
            "frame_index": frames[:, None],
            "episode_index": np.full((episode.length, 1), self._episodes),
            "index": self._frames + frames[:, None],
            "task_index": np.full((episode.length, 1), self._tasks.index(episode.task)),
        }

    def _add_frames(self, columns: Columns) -> dict[str, int]:
        """Add the values of all frames; returns the indices of their file."""
        pa = self._pa
        place = self._data
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
        """Add the images of a camera; returns their location and their statistics."""
        place = self._films.get(key)
        if place is None:
            place = self._films[key] = _Place(self._next(f"videos/{key}/*/file-*.mp4"))
        place.close_at(MOST_VIDEO_MB)
        if place.writer is None:
            place.path = self._folder / _VIDEO.format(video_key=key, **place.indices)
            place.path.parent.mkdir(parents=True, exist_ok=True)
            encoder = Encoder(place.path, (view.width, view.height), FPS, KEY_EVERY)
            place.writer = self._open.enter_context(encoder)
        seen = []
        for number, picture in enumerate(view.pictures()):
            place.writer.add(picture)
            if number % _SAMPLED_EVERY == 0:
                seen.append(picture[::8, ::8].reshape(-1, 3) / 255.0)
        first = place.frames
        place.frames = place.frames + len(view.moments)
        channels = _summarized(np.concatenate(seen))
        statistics = {name: [[[x]] for x in each] for name, each in channels.items()}
        stamps = {"from_timestamp": first / FPS, "to_timestamp": place.frames / FPS}
        return {**place.indices, **stamps}, {**statistics, "count": [len(view.moments)]}

    def finish(self) -> None:
        """Write the description of all episodes; no more can be added afterwards.

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
        (self._folder / _TASKS).unlink(missing_ok=True)  # it may be a hard link
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
        """Statistics of all frames by feature: exact for values, from samples for images."""
        assert self._info is not None  # noqa: S101 - there is an episode
        paths = sorted(self._folder.glob("data/*/*.parquet"))
        found: Facts = {}
        for name, feature in self._info["features"].items():
            if feature["dtype"] == "video":
                found[name] = _pooled(self._pixels[name])
                continue
            parts = []
            for path in paths:
                column = self._parquet.read_table(path, columns=[name])[name].combine_chunks()
                flat = column.flatten() if feature["shape"] != [1] else column
                parts.append(flat.to_numpy(zero_copy_only=False).reshape(-1, *feature["shape"]))
            found[name] = _statistics(np.concatenate(parts))
        return found


def _info(episode: Episode) -> Facts:
    """Content of ``meta/info.json``, except for counts."""
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
    """Table of tasks, their texts as index, as pandas would write it."""
    numbers = pa.array(range(len(tasks)), pa.int64())
    table = pa.table({"task_index": numbers, "task": pa.array(tasks)})
    columns = [
        _column("task_index", "int64", "int64"),
        _column("task", "unicode", "object"),
    ]
    names = {**_column("", "unicode", "object"), "name": None, "field_name": None}
    metadata = {
        "index_columns": ["task"],
        "column_indexes": [{**names, "metadata": {"encoding": "UTF-8"}}],
        "columns": columns,
        "creator": {"library": "pyarrow", "version": pa.__version__},
        "pandas_version": "2.0.0",
    }
    return table.replace_schema_metadata({"pandas": json.dumps(metadata)})


def _column(name: str, kind: str, numpy_kind: str) -> Facts:
    return {
        "name": name,
        "field_name": name,
        "pandas_type": kind,
        "numpy_type": numpy_kind,
        "metadata": None,
    }


def _statistics(values: npt.NDArray[np.generic]) -> Facts:
    """Statistics of the values of a feature, of shape (frames, n)."""
    return {**_summarized(values.astype(float)), "count": [len(values)]}


def _summarized(rows: Matrix) -> dict[str, list[float]]:
    """Minimum, maximum, mean, standard deviation and quantiles of a table, (n, columns)."""
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


# Records as a data set of demonstrations, in LeRobot's format v3.0, for imitation learning.
#
# The files and their fields are those of https://huggingface.co/docs/lerobot/lerobot-dataset-v3:
# parquet for numbers, MP4 for cameras, `meta/` for what they mean. A run is an episode.


@dataclass(frozen=True)
class Demonstrations:
    """Counts of an export.

    Attributes:
        episodes: Number of runs that were written.
        failed: Number of those that did not succeed, which the data set marks.
        left_out: Number of runs that were left out, as they did not succeed.
        frames: Number of frames that were written.
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
    """Write the runs of some records as one data set, which appears only when it is complete.

    Args:
        folders: Folders of records, in the order of the episodes.
        target: Folder to write, which does not exist yet, or is empty.
        only_successes: Whether runs that did not succeed are left out.
        append: Whether the runs are added to the data set in the folder.
        progress: Called before a run is read, with the number of runs before it, and its folder.

    Raises:
        ReplayError: The folder is not empty, or has no data set to append to; the features of runs
            differ, or a run has no states; only successes are requested, but no run succeeded; a
            package is not installed.
        HistoryError: A record cannot be read.
        OSError: The data set cannot be written.
    """
    is_there = target.exists() and (not target.is_dir() or any(target.iterdir()))
    if is_there and not append:
        raise ReplayError(f"cannot write {target}: it already exists (--append adds runs)")
    if append and not (target / "meta" / "info.json").is_file():
        raise ReplayError(f"cannot append to {target}: there is no data set in it")
    target = Path(os.path.abspath(target))  # noqa: PTH100 - a name of its own, links not followed
    half = beside(target)
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
                raise ReplayError("no run succeeded: there is nothing to write")
            writer.finish()
        _put(half, target)
    finally:
        shutil.rmtree(half, ignore_errors=True)
    return Demonstrations(written, failed, left_out, frames)


def _succeeded(record: Record) -> bool:
    """Whether all trees succeeded, and the goals of the file, if it has any, were met."""
    summary = record.summary or {}
    return summary.get("outcome") == "SUCCESS" and not summary.get("false_success")


def _linked(source: str, target: str) -> None:
    """Hard-link a file, or copy it where that is impossible; it must not be changed afterwards."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copy2(source, target)


def _put(half: Path, target: Path) -> None:
    """Move a folder to its target, replacing an older one."""
    if target.is_dir() and any(target.iterdir()):
        old = beside(target)
        target.replace(old)
        half.replace(target)
        shutil.rmtree(old)
    else:
        half.replace(target)
