"""A record as a data set of one demonstration, in LeRobot's format v3.0, for imitation learning.

The files and their fields are those of https://huggingface.co/docs/lerobot/lerobot-dataset-v3:
parquet for numbers, MP4 for cameras, `meta/` for what they mean.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.pose import Matrix
from bt_dualarm.replay.lerobot_tables import Episode, write_tables
from bt_dualarm.replay.messages import joints_of
from bt_dualarm.replay.record import Facts, Moment, Record, ReplayError
from bt_dualarm.replay.video import Picture, encode
from bt_dualarm.world.rendering.raycast import RayRenderer
from bt_dualarm.world.rendering.renderer import Exposure

FPS: Final = 25
"""Frames a second: every second state that is kept."""

KEY_EVERY: Final = 2
"""Pictures from one that stands for itself to the next: training asks for them in any order."""

_VIDEO: Final = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
_DATA: Final = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_STATISTICS_EVERY: Final = 10


def write_dataset(record: Record, folder: Path) -> None:
    """Write a data set, whole or not at all.

    Args:
        record: The record.
        folder: Folder to write, which is not there yet, or empty.

    Raises:
        ReplayError: There is something in the folder already, the record has no state, or a
            package is not installed.
        OSError: It cannot be written there.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ReplayError(f"cannot write {folder}: there is something already")
    if not len(record.times):
        raise ReplayError(f"{record.folder} holds no state")
    half = folder.with_name(f".{folder.name}.half")
    try:
        half.mkdir(parents=True)
        demonstration = _Demonstration(record)
        pictures = {key: video.write(half) for key, video in demonstration.videos.items()}
        episode = Episode(record.name.replace("_", " "), FPS, demonstration.columns, pictures)
        write_tables(episode, half)
        info = json.dumps(demonstration.info, indent=4)
        (half / "meta" / "info.json").write_text(info, encoding="utf-8")
        half.replace(folder)
    finally:
        shutil.rmtree(half, ignore_errors=True)


@dataclass(frozen=True, eq=False)
class _Video:
    """What one camera has before it in all frames."""

    record: Record
    arm: str
    key: str
    size: tuple[int, int]
    moments: tuple[Moment, ...]

    def write(self, folder: Path) -> Matrix:
        """Write the film; returns some of its pixels, of shape (n, 3), from 0 to 1."""
        path = folder / _VIDEO.format(video_key=self.key, chunk_index=0, file_index=0)
        path.parent.mkdir(parents=True)
        seen: list[npt.NDArray[np.float64]] = []
        encode(self._kept(seen), self.size, FPS, path, KEY_EVERY)
        return np.concatenate(seen)

    def _kept(self, seen: list[npt.NDArray[np.float64]]) -> Iterator[Picture]:
        for number, picture in enumerate(self._pictures()):
            if number % _STATISTICS_EVERY == 0:
                seen.append(picture[::8, ::8].reshape(-1, 3) / 255.0)
            yield picture

    def _pictures(self) -> Iterator[Picture]:
        renderer, model, data = RayRenderer(), None, None
        width, height = self.size
        for moment in self.moments:
            if model is not self.record.model(moment.generation) or data is None:
                model = self.record.model(moment.generation)
                data = mujoco.MjData(model)
                kind = mujoco.mjtObj.mjOBJ_CAMERA
                camera = mujoco.mj_name2id(model, kind, f"{self.arm}/camera")
            if camera < 0:
                yield np.zeros((height, width, 3), np.uint8)
                continue
            data.qpos[:] = moment.qpos
            mujoco.mj_kinematics(model, data)
            mujoco.mj_camlight(model, data)
            yield renderer.render(model, data, Exposure(camera, width, height))


class _Demonstration:
    """Numbers and cameras of a record, frame by frame.

    An arm that is not in the world yet has zeros; of one that was removed the last values stay.
    """

    def __init__(self, record: Record) -> None:
        self._record = record
        count = int((record.until - record.times[0]) * FPS) + 1
        times = record.times[0] + np.arange(count) / FPS
        self._rows = [record.index_at(time) for time in times.tolist()]
        moments = tuple(map(record.moment, self._rows))
        self._names: list[str] = []
        parts: dict[str, list[Matrix]] = {name: [] for name in _COLUMNS}
        for arm in record.arms:
            for name, part in self._of_arm(arm, moments).items():
                parts[name].append(part)
        self.columns = {
            name: np.concatenate(each, axis=1).astype(np.float32) for name, each in parts.items()
        }
        self.videos = {
            f"observation.images.{arm}": _Video(
                record, arm, f"observation.images.{arm}", _even(facts["camera"]), moments
            )
            for arm, facts in record.arms.items()
            if facts.get("camera")
        }

    def _of_arm(self, arm: str, moments: tuple[Moment, ...]) -> dict[str, Matrix]:
        """Each column of an arm, of shape (frames, dof)."""
        sent = [self._record.arm_row(arm, row) for row in self._rows]
        first = next((row for row in sent if row is not None), None)
        dof = 0 if first is None else len(first[0])
        found = {name: np.zeros((len(moments), dof)) for name in _COLUMNS}
        for number, (moment, row) in enumerate(zip(moments, sent, strict=True)):
            if row is None:
                for column in found.values():
                    column[number] = column[number - 1] if number else 0.0
                continue
            model = self._record.model(moment.generation)
            joints = joints_of(model, arm)
            found["observation.state"][number] = moment.qpos[model.jnt_qposadr[joints]]
            found["observation.velocity"][number] = moment.qvel[model.jnt_dofadr[joints]]
            found["observation.effort"][number] = row[3]
            found["action"][number] = row[0]
        known = next((m for m, row in zip(moments, sent, strict=True) if row is not None), None)
        if known is not None:
            model = self._record.model(known.generation)
            self._names += [str(model.joint(j).name) for j in joints_of(model, arm)]
        return found

    @property
    def info(self) -> Facts:
        """What ``meta/info.json`` says."""
        names = [name.replace("/", ".") for name in self._names]
        features: dict[str, Any] = {
            name: {"dtype": "float32", "shape": [len(names)], "names": names} for name in _COLUMNS
        }
        for key, video in self.videos.items():
            features[key] = _video_feature(*video.size)
        for name, kind in _INDICES.items():
            features[name] = {"dtype": kind, "shape": [1], "names": None}
        robots = sorted({str(arm["robot"]) for arm in self._record.arms.values()})
        return {
            "codebase_version": "v3.0",
            "robot_type": "+".join(robots),
            "total_episodes": 1,
            "total_frames": len(self._rows),
            "total_tasks": 1,
            "chunks_size": 1000,
            "data_files_size_in_mb": 100,
            "video_files_size_in_mb": 200,
            "fps": FPS,
            "splits": {"train": "0:1"},
            "data_path": _DATA,
            "video_path": _VIDEO if self.videos else None,
            "features": features,
        }


_COLUMNS: Final = ("observation.state", "observation.velocity", "observation.effort", "action")
"""Joint positions (rad), velocities (rad/s), commanded torques (N m), and set-points (rad)."""

_INDICES: Final = {
    "timestamp": "float32",
    "frame_index": "int64",
    "episode_index": "int64",
    "index": "int64",
    "task_index": "int64",
}


def _even(camera: Facts) -> tuple[int, int]:
    """Width and height of a camera's pictures; H.264 in 4:2:0 has no odd ones."""
    width, height = camera["resolution"]
    return width - width % 2, height - height % 2


def _video_feature(width: int, height: int) -> Facts:
    return {
        "dtype": "video",
        "shape": [height, width, 3],
        "names": ["height", "width", "channels"],
        "info": {
            "video.height": height,
            "video.width": width,
            "video.codec": "h264",
            "video.pix_fmt": "yuv420p",
            "video.is_depth_map": False,
            "video.fps": FPS,
            "video.channels": 3,
            "has_audio": False,
        },
    }
