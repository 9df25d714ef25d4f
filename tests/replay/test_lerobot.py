"""LeRobot data sets of records: files, fields and times as in its format v3.0."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

import bt_dualarm
from bt_dualarm import cli
from bt_dualarm.export.lerobot import FPS, OBJECTS, episode_of, write_dataset
from bt_dualarm.export.mcap import messages_of
from bt_dualarm.export.tables import tables_of
from bt_dualarm.replay.record import Record, ReplayError
from bt_dualarm.runtime.history_file import Block
from tests.replay.runs import SHORT, WATCHING, recorded

COMMON_COLUMNS = {
    *("timestamp", "frame_index", "episode_index", "index", "task_index"),
    *("next.done", "next.success"),
}
EPISODE_COLUMNS = {
    "success",
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
ARROW = {"float": "float32", "int64": "int64", "bool": "bool"}
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


def test_every_file_is_at_the_path_in_the_info(dataset: Path) -> None:
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


def test_frames_match_the_features(dataset: Path, watching: Record) -> None:
    info = info_of(dataset)
    frames = table(dataset, "data/chunk-000/file-000.parquet")
    tabled = {name: f for name, f in info["features"].items() if f["dtype"] != "video"}
    assert set(frames.column_names) == set(tabled) > COMMON_COLUMNS
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
    error = np.subtract(frames["observation.state"][10].as_py(), frames["action"][10].as_py())
    assert 0 < np.abs(error).max() < 0.02


def test_the_video_has_an_image_for_every_frame(dataset: Path) -> None:
    info = info_of(dataset)
    feature = info["features"][CAMERA]
    video = cv2.VideoCapture(str(dataset / f"videos/{CAMERA}/chunk-000/file-000.mp4"))
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == info["total_frames"]
    assert video.get(cv2.CAP_PROP_FPS) == info["fps"] == feature["info"]["video.fps"]
    last = None
    while (read := video.read())[0]:
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
    assert plain == EPISODE_COLUMNS | videos
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


def test_nothing_is_overwritten_or_left_incomplete(
    watching: Record, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mine").write_text("")
    assert cli.record(["export", str(watching.folder), "--lerobot", str(tmp_path)]) == 2
    assert "it already exists" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]


def test_a_missing_pyarrow_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    record = recorded(tmp_path)
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert cli.record(["export", str(record.folder), "--lerobot", str(tmp_path / "set")]) == 2
    assert "the extra bt_dualarm[export]" in capsys.readouterr().err
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]


FAILING = SHORT.replace(
    'reach_to_pose: {offset: "{goal}"}', "reach_to_pose: {offset: {xyz: [3, 0, 0]}}"
)
"""The same arm and task; its last leaf cannot reach its target."""


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Three runs of one tree: the second failed."""
    folder = tmp_path_factory.mktemp("runs")
    texts = (SHORT, FAILING, SHORT.replace("0.06", "0.05"))
    return [recorded(folder / str(number), text).folder for number, text in enumerate(texts)]


def export(runs: list[Path], target: Path, *options: str) -> int:
    return cli.record(["export", *map(str, runs), "--lerobot", str(target), *options])


def check_whole(folder: Path, runs: list[Path]) -> None:
    """Indices go through all episodes without a gap, and each has the frames of its run."""
    info = info_of(folder)
    frames = pa.concat_tables(
        [table(folder, str(path.relative_to(folder))) for path in sorted(folder.glob("data/*/*"))]
    )
    episodes = [
        row
        for path in sorted(folder.glob("meta/episodes/*/*"))
        for row in table(folder, str(path.relative_to(folder))).to_pylist()
    ]
    assert info["total_episodes"] == len(episodes) == len(runs)
    assert info["total_frames"] == frames.num_rows == sum(row["length"] for row in episodes)
    assert info["splits"] == {"train": f"0:{len(runs)}"}
    assert frames["index"].to_pylist() == list(range(frames.num_rows))
    begin = 0
    for number, (row, run) in enumerate(zip(episodes, runs, strict=True)):
        record = Record.read(run)
        part = frames.slice(begin, row["length"])
        assert row["episode_index"] == number
        assert (row["dataset_from_index"], row["dataset_to_index"]) == (
            begin,
            begin + row["length"],
        )
        assert set(part["episode_index"].to_pylist()) == {number}
        assert part["frame_index"].to_pylist() == list(range(row["length"]))
        last = record.index_at(record.times[0] + (row["length"] - 1) / info["fps"])
        known = record.arm_row("arm1", last)
        assert known is not None
        np.testing.assert_allclose(part["action"][-1].as_py()[: len(known[0])], known[0], atol=1e-6)
        succeeded = record.summary is not None and record.summary["outcome"] == "SUCCESS"
        assert row["success"] == succeeded == part["next.success"][-1].as_py()
        begin += row["length"]
    statistics = json.loads((folder / "meta" / "stats.json").read_text())
    for name in ("action", "observation.state", "index", "next.done"):
        values = np.array(frames[name].to_pylist(), float).reshape(frames.num_rows, -1)
        np.testing.assert_allclose(statistics[name]["mean"], values.mean(0), atol=1e-6)
        np.testing.assert_allclose(statistics[name]["q10"], np.quantile(values, 0.1, 0), atol=1e-6)
        assert statistics[name]["count"] == [frames.num_rows]


def test_many_runs_are_one_data_set(
    runs: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "set"
    assert export(runs, folder) == 0
    assert "3 episodes, 1 failed (success is false)" in capsys.readouterr().out
    check_whole(folder, runs)
    assert table(folder, "meta/tasks.parquet").num_rows == 1


def test_failed_runs_can_be_left_out(
    runs: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "set"
    assert export(runs, folder, "--only-successes") == 0
    assert "2 episodes, 1 left out" in capsys.readouterr().out
    check_whole(folder, [runs[0], runs[2]])
    assert export(runs[1:2], tmp_path / "none", "--only-successes") == 2
    assert "no run succeeded" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["set"]


CHEST = """\
  chest:
    shape: compound
    mass: 1
    pose: {xyz: [0.4, -0.4, 0.3]}
    parts:
      body: {shape: bin, size: [0.12, 0.07, 0.08], wall: 0.005}
      lid: {shape: box, size: [0.12, 0.07, 0.006], pose: {xyz: [0, 0, 0.0435]}}
    joints:
      hinge:
        {type: hinge, parts: [lid], axis: [0, -1, 0], anchor: [-0.06, 0, 0.0405], range: [0, 100]}
"""


def test_parts_that_move_on_joints_have_poses_in_the_world(tmp_path: Path) -> None:
    """The chest falls, and its lid opens as it hits the floor."""
    text = SHORT.replace("arms:\n", f"{CHEST}arms:\n", 1)
    record = recorded(tmp_path, text, duration=0.6)
    episode = episode_of(record)
    names = [name.removesuffix(".x") for name in episode.names[OBJECTS] if name.endswith(".x")]
    assert names == ["ball", "chest", "chest.hinge"]
    times = record.times[0] + np.arange(episode.length) / FPS
    rows = [record.index_at(time) for time in times.tolist()]
    tracks = [bt_dualarm.load(record.folder).objects[name] for name in names]
    poses = [np.hstack((track.position, track.quaternion))[rows] for track in tracks]
    columns = episode.columns[OBJECTS].astype(float)
    np.testing.assert_allclose(columns, np.hstack(poses), atol=1e-6)


def test_a_run_that_missed_its_goal_is_no_success(tmp_path: Path) -> None:
    """Its tree reports SUCCESS; the goal says that the task was not done."""
    goal = "goal: {far: {tool: arm1, at: {xyz: [2, 0, 1]}, within: 0.1}}\n"
    record = recorded(tmp_path / "run", SHORT + goal)
    assert record.summary is not None
    assert (record.summary["outcome"], record.summary["false_success"]) == ("SUCCESS", True)
    assert not episode_of(record).succeeded
    assert export([record.folder], tmp_path / "set", "--only-successes") == 2


def test_progress_is_reported_for_each_run(
    runs: list[Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """It is passed to a callback, and printed to standard error for several runs."""
    calls: list[tuple[int, Path]] = []
    done = write_dataset(
        runs, tmp_path / "a", progress=lambda number, folder: calls.append((number, folder))
    )
    assert calls == [*enumerate(runs)]
    assert (done.episodes, done.failed, done.left_out) == (3, 1, 0)
    assert export(runs, tmp_path / "b") == 0
    assert capsys.readouterr().err.splitlines() == [
        f"{number} of 3: {run}" for number, run in enumerate(runs, 1)
    ]
    assert export(runs[:1], tmp_path / "c") == 0
    assert capsys.readouterr().err == ""


def test_runs_are_appended(
    runs: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Existing data stay the same byte for byte; a refused append changes nothing."""
    folder = tmp_path / "set"
    assert export(runs[:1], folder, "--append") == 2
    assert "there is no data set in it" in capsys.readouterr().err
    assert export(runs[:1], folder) == 0
    before = (folder / "data/chunk-000/file-000.parquet").read_bytes()
    assert export(runs[1:], folder, "--append") == 0
    assert (folder / "data/chunk-000/file-000.parquet").read_bytes() == before
    check_whole(folder, runs)
    other = recorded(
        tmp_path / "other", SHORT.replace("ur5", "ur10").replace("present", "home")
    ).folder
    whole = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    assert export([other], folder, "--append") == 2
    assert "its robots are ur10, not ur5" in capsys.readouterr().err
    assert whole == {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    assert {path.name for path in tmp_path.iterdir()} == {"set", "other"}


@pytest.mark.parametrize(
    ("change", "reported"),
    [
        (("robot: ur5", "robot: ur10"), "its robots are ur10, not ur5"),
        (("robot: ur5", "robot: panda"), "its robots are panda, not ur5"),
        (("arm1:", "left:"), "its action lacks arm1.shoulder_pan_joint"),
        (("  ball:", "  box:"), "observation.environment_state lacks ball.x"),
        (("robot: ur5", "robot: ur5\n    gripper: suction_cup"), "ur5 with suction_cup, not ur5"),
    ],
)
def test_incompatible_runs_are_refused(
    runs: list[Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    change: tuple[str, str],
    reported: str,
) -> None:
    """The message names the run and what differs; nothing is left behind."""
    text = SHORT.replace("posture: present", "posture: home").replace(*change)
    other = recorded(tmp_path / "other", text).folder
    assert export([runs[0], other], tmp_path / "set") == 2
    error = capsys.readouterr().err
    assert reported in " ".join(error.split())
    assert str(other) in error.replace("\n", "")
    assert [path.name for path in tmp_path.iterdir()] == ["other"]


def test_videos_of_several_runs_are_concatenated(watching: Record, tmp_path: Path) -> None:
    """Each run begins in the video where the one before ended."""
    folder = tmp_path / "set"
    assert export([watching.folder, watching.folder], folder) == 0
    info = info_of(folder)
    first, second = table(folder, "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    length = first["length"] / info["fps"]
    assert (first[f"videos/{CAMERA}/from_timestamp"], first[f"videos/{CAMERA}/to_timestamp"]) == (
        0,
        length,
    )
    assert second[f"videos/{CAMERA}/from_timestamp"] == length
    assert second[f"videos/{CAMERA}/to_timestamp"] == 2 * length
    video = cv2.VideoCapture(str(folder / f"videos/{CAMERA}/chunk-000/file-000.mp4"))
    images = []
    while (read := video.read())[0]:
        images.append(read[1].astype(int))
    assert len(images) == info["total_frames"]
    half = len(images) // 2
    for index in (0, half - 1):
        assert np.abs(images[index] - images[half + index]).mean() < 3, "the same image"
    statistics = json.loads((folder / "meta" / "stats.json").read_text())
    alone = second[f"stats/{CAMERA}/std"]
    np.testing.assert_allclose(statistics[CAMERA]["std"], alone)


def test_large_files_are_followed_by_new_ones(
    watching: Record, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("MOST_DATA_MB", "MOST_VIDEO_MB"):
        monkeypatch.setattr(f"bt_dualarm.export.lerobot.{name}", 0)
    monkeypatch.setattr("bt_dualarm.export.lerobot.FILES_A_CHUNK", 2)
    folder = tmp_path / "set"
    assert export([watching.folder] * 3, folder) == 0
    rows = table(folder, "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    for number, row in enumerate(rows):
        chunk, file = divmod(number, 2)
        for what in ("data", f"videos/{CAMERA}"):
            assert (row[f"{what}/chunk_index"], row[f"{what}/file_index"]) == (chunk, file)
        assert row[f"videos/{CAMERA}/from_timestamp"] == 0
        where = {"chunk_index": chunk, "file_index": file, "video_key": CAMERA}
        info = info_of(folder)
        assert table(folder, info["data_path"].format(**where)).num_rows == row["length"]
        video = cv2.VideoCapture(str(folder / info["video_path"].format(**where)))
        assert video.get(cv2.CAP_PROP_FRAME_COUNT) == row["length"]


def test_a_record_without_gripper_states_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Earlier versions wrote such records; other exports have the rest of the data."""
    record = recorded(tmp_path, SHORT.replace("robot: ur5", "robot: ur5\n    gripper: panda_hand"))
    earlier = replace(record, seconds=tuple(map(_without_grippers, record.seconds)))
    with pytest.raises(ReplayError, match="recorded by an earlier version"):
        episode_of(earlier)
    assert earlier.gripper("arm1", 0) is None
    assert "gripper_arm1.csv" not in dict(tables_of(earlier))
    messages = {message.topic: message for message in messages_of(earlier)}
    assert "/arm1/gripper" not in messages
    joints: Any = messages["/arm1/joints"].content["joints"]
    assert [joint.keys() for joint in joints[-2:]] == [{"name", "position", "velocity"}] * 2


def _without_grippers(block: Block) -> Block:
    arrays = {name: each for name, each in block.arrays.items() if not name.startswith("gripper:")}
    return replace(block, arrays=arrays)


@pytest.mark.parametrize("form", ["--lerobot", "--csv"])
def test_no_name_in_a_record_leads_out_of_the_folder(
    form: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """An arm that no tree file can declare is refused, wherever its name points to."""
    bt_dualarm.run(WATCHING, record=tmp_path / "out")
    record = Record.read(tmp_path / "out")
    evil = "x/../../../pwned"
    arms = {evil: record.start["arms"]["arm1"]}
    seconds = tuple(
        replace(block, arrays={**block.arrays, f"arm:{evil}": block.arrays["arm:arm1"]})
        for block in record.seconds
    )
    forged = replace(record, start={**record.start, "arms": arms}, seconds=seconds)
    monkeypatch.setattr(Record, "read", lambda _: forged)
    target = tmp_path / "deep" / "target"
    assert cli.record(["export", "out", form, str(target)]) == 2
    assert evil in " ".join(capsys.readouterr().err.split())
    assert not [path for path in tmp_path.rglob("*") if "pwned" in path.name]


def test_several_records_can_only_be_exported_to_lerobot(
    capsys: pytest.CaptureFixture[str],
) -> None:
    for command, reported in (
        (["a", "b", "--csv", "t"], "several records can only be exported"),
        (["a", "--csv", "t", "--append"], "require --lerobot"),
    ):
        with pytest.raises(SystemExit):
            cli.record(["export", *command])
        assert reported in capsys.readouterr().err
