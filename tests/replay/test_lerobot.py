"""A data set of a record is read back as LeRobot's format v3.0 says: files, fields, times."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from pyarrow import parquet

import bt_dualarm
from bt_dualarm import cli
from bt_dualarm.replay.record import Record
from tests.replay.runs import WATCHING, recorded

OF_ALL = {"timestamp", "frame_index", "episode_index", "index", "task_index"}
OF_AN_EPISODE = {
    "episode_index",
    "tasks",
    "length",
    "dataset_from_index",
    "dataset_to_index",
    "data/chunk_index",
    "data/file_index",
    "meta/episodes/chunk_index",
    "meta/episodes/file_index",
}
ARROW = {"float": "float32", "int64": "int64"}
"""Types of LeRobot's features by those of Arrow."""

CAMERA = "observation.images.arm1"


@pytest.fixture(scope="module")
def watching(tmp_path_factory: pytest.TempPathFactory) -> Record:
    folder = tmp_path_factory.mktemp("watching")
    bt_dualarm.run(WATCHING, record=folder)
    return Record.read(folder)


@pytest.fixture(scope="module")
def dataset(watching: Record, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sets") / "set"
    assert cli.record(["export", str(watching.folder), "--lerobot", str(folder)]) == 0
    return folder


def info_of(folder: Path) -> dict[str, Any]:
    info: dict[str, Any] = json.loads((folder / "meta" / "info.json").read_text())
    return info


def table(folder: Path, name: str) -> Any:
    return parquet.read_table(folder / name)  # type: ignore[no-untyped-call]  # it has none


def test_every_file_is_where_the_info_says(dataset: Path) -> None:
    info = info_of(dataset)
    where = {"chunk_index": 0, "file_index": 0, "video_key": CAMERA}
    files = {path.relative_to(dataset).as_posix() for path in dataset.rglob("*") if path.is_file()}
    assert files == {
        info["data_path"].format(**where),
        info["video_path"].format(**where),
        "meta/info.json",
        "meta/stats.json",
        "meta/tasks.parquet",
        "meta/episodes/chunk-000/file-000.parquet",
    }
    assert info["codebase_version"] == "v3.0"
    assert (info["total_episodes"], info["total_tasks"], info["splits"]) == (1, 1, {"train": "0:1"})


def test_frames_have_what_the_features_say(dataset: Path, watching: Record) -> None:
    info = info_of(dataset)
    frames = table(dataset, "data/chunk-000/file-000.parquet")
    tabled = {name: f for name, f in info["features"].items() if f["dtype"] != "video"}
    assert set(frames.column_names) == set(tabled) > OF_ALL
    assert not [name for name in info["features"] if "/" in name]
    count = info["total_frames"]
    assert count == frames.num_rows == int((watching.until - watching.times[0]) * info["fps"]) + 1
    for name, feature in tabled.items():
        values = np.array(frames[name].to_pylist()).reshape(count, -1)
        assert values.shape[1:] == tuple(feature["shape"])
        kind = frames.schema.field(name).type
        assert ARROW[str(getattr(kind, "value_type", kind))] == feature["dtype"]
    stamps = np.array(frames["timestamp"].to_pylist())
    np.testing.assert_allclose(stamps, np.arange(count) / info["fps"], atol=1e-6)
    row = watching.index_at(watching.times[0] + 10 / info["fps"])
    known = watching.arm_row("arm1", row)
    assert known is not None
    np.testing.assert_allclose(frames["action"][10].as_py(), known[0], atol=1e-6)
    away = np.subtract(frames["observation.state"][10].as_py(), frames["action"][10].as_py())
    assert 0 < np.abs(away).max() < 0.02


def test_the_video_has_a_picture_for_every_frame(dataset: Path) -> None:
    info = info_of(dataset)
    feature = info["features"][CAMERA]
    film = cv2.VideoCapture(str(dataset / f"videos/{CAMERA}/chunk-000/file-000.mp4"))
    assert film.get(cv2.CAP_PROP_FRAME_COUNT) == info["total_frames"]
    assert film.get(cv2.CAP_PROP_FPS) == info["fps"] == feature["info"]["video.fps"]
    last = None
    while (read := film.read())[0]:
        last = read[1]
    assert last is not None
    assert list(last.shape) == feature["shape"]
    hsv = cv2.cvtColor(last, cv2.COLOR_BGR2HSV)
    yellow = cv2.inRange(hsv, np.array((21, 100, 100)), np.array((35, 255, 255)))
    assert cv2.countNonZero(yellow) > 100, "the block that it watches"


def test_episodes_tasks_and_statistics_fit_the_frames(dataset: Path) -> None:
    info = info_of(dataset)
    (episode,) = table(dataset, "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    videos = {
        f"videos/{CAMERA}/{name}"
        for name in ("chunk_index", "file_index", "from_timestamp", "to_timestamp")
    }
    plain = {name for name in episode if not name.startswith("stats/")}
    assert plain == OF_AN_EPISODE | videos
    assert episode["length"] == episode["dataset_to_index"] == info["total_frames"]
    assert episode[f"videos/{CAMERA}/to_timestamp"] == info["total_frames"] / info["fps"]
    tasks = table(dataset, "meta/tasks.parquet")
    assert json.loads(tasks.schema.metadata[b"pandas"])["index_columns"] == ["task"]
    assert tasks.to_pylist() == [{"task_index": 0, "task": "watching"}]
    assert episode["tasks"] == ["watching"]
    statistics = json.loads((dataset / "meta" / "stats.json").read_text())
    assert statistics.keys() == info["features"].keys()
    frames = table(dataset, "data/chunk-000/file-000.parquet")
    state = np.array(frames["observation.state"].to_pylist())
    np.testing.assert_allclose(statistics["observation.state"]["mean"], state.mean(0), atol=1e-5)
    np.testing.assert_allclose(statistics["action"]["max"], np.max(frames["action"].to_pylist(), 0))
    assert np.shape(statistics[CAMERA]["mean"]) == (3, 1, 1)
    assert 0 < np.min(statistics[CAMERA]["mean"]) < np.max(statistics[CAMERA]["mean"]) < 1


def test_a_record_without_a_camera_has_no_video(tmp_path: Path) -> None:
    record = recorded(tmp_path)
    folder = tmp_path / "set"
    command = ["export", str(record.folder), "--lerobot", str(folder)]
    assert cli.record(command) == 0
    info = info_of(folder)
    assert info["video_path"] is None
    assert len(info["features"]["action"]["names"]) == 6
    assert not (folder / "videos").exists()


def test_nothing_is_overwritten_and_nothing_left_half(
    watching: Record, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mine").write_text("")
    assert cli.record(["export", str(watching.folder), "--lerobot", str(tmp_path)]) == 2
    assert "there is something already" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]


def test_without_pyarrow_it_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    record = recorded(tmp_path)
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert cli.record(["export", str(record.folder), "--lerobot", str(tmp_path / "set")]) == 2
    assert "the extra bt_dualarm[export]" in capsys.readouterr().err
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]
