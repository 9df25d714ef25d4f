"""Export of records to formats that need nothing of this project: web page, tables, videos."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from bt_dualarm import cli
from bt_dualarm.export.tables import tables_of
from bt_dualarm.export.video import (
    Encoder,
    FilmPanel,
    FilmScene,
    clear_corner,
    followed,
    write_animation,
)
from bt_dualarm.replay.record import Record
from tests.replay.runs import RETURNING, SHORT, recorded

BACK = 'reach_to_pose: {offset: "{goal}"}'
FAILING = SHORT.replace(BACK, "reach_to_pose: {offset: {xyz: [3, 0, 0]}}")


@pytest.fixture(scope="module")
def failed(tmp_path_factory: pytest.TempPathFactory) -> Record:
    return recorded(tmp_path_factory.mktemp("failed"), FAILING)


@pytest.fixture(scope="module")
def begun(tmp_path_factory: pytest.TempPathFactory) -> Record:
    return recorded(tmp_path_factory.mktemp("begun"), FAILING, duration=0.1)


def test_tables_have_the_values_of_the_record(failed: Record) -> None:
    tables = dict(tables_of(failed))
    assert set(tables) == {"events.csv", "notes.csv", "arm_arm1.csv", "states_0.csv"}
    events = [*csv.DictReader(tables["events.csv"].splitlines())]
    assert [event["new"] for event in events] == [event["new"] for event in failed.events]
    states = [*csv.reader(tables["states_0.csv"].splitlines())]
    assert len(states) == len(failed.times) + 1
    assert len(states[0]) == len(set(states[0])) == len(states[1])
    last = failed.moment(len(failed.times) - 1)
    np.testing.assert_array_equal(
        np.array(states[-1], dtype=float), [last.time, *last.qpos, *last.qvel]
    )
    arm = [*csv.reader(tables["arm_arm1.csv"].splitlines())]
    assert arm[0][:2] == ["time_s", "q_rad[0]"]
    assert len(arm[0]) == 25


def test_the_command_writes_page_and_tables(
    failed: Record, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "a.html"
    tables = tmp_path / "deep" / "tables"
    command = ["export", str(failed.folder), "--html", str(page), "--csv", str(tables)]
    assert cli.record(command) == 0
    assert capsys.readouterr().out == f"written: {page}\nwritten: {tables}\n"
    assert page.read_text(encoding="utf-8").startswith("<!doctype html>")
    assert (tables / "events.csv").exists()


def test_tables_of_two_runs_are_not_mixed(
    failed: Record, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """All tables of an earlier export are replaced, or none."""
    command = ["export", str(failed.folder), "--csv", str(tmp_path)]
    names = {"analysis.ipynb", *dict(tables_of(failed))}
    for name in names:
        (tmp_path / name).write_text("before", encoding="utf-8")
    assert cli.record(command) == 0
    assert {path.name for path in tmp_path.iterdir()} == names
    assert [
        name for name in names if (tmp_path / name).read_text(encoding="utf-8") == "before"
    ] == ["analysis.ipynb"]
    (tmp_path / "events.csv").write_text("before", encoding="utf-8")
    (tmp_path / "gripper_arm2.csv").write_text("before", encoding="utf-8")
    capsys.readouterr()
    assert cli.record(command) == 2
    assert "it has tables that this record does not, gripper_arm2.csv" in capsys.readouterr().err
    assert {path.name for path in tmp_path.iterdir()} == names | {"gripper_arm2.csv"}
    assert (tmp_path / "events.csv").read_text(encoding="utf-8") == "before"


def test_an_export_destroys_neither_the_record_nor_another_export(
    failed: Record, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nothing is written, not even the first of two exports."""
    command = ["export", str(failed.folder)]
    (tmp_path / "link").symlink_to(failed.folder)
    for name in ("run.history", "events.jsonl"):
        content = (failed.folder / name).read_bytes()
        for folder in (failed.folder, tmp_path / "link"):
            assert cli.record([*command, "--html", str(folder / name)]) == 2
            assert "is a file of the record" in capsys.readouterr().err
        assert (failed.folder / name).read_bytes() == content
    page = tmp_path / "page"
    (tmp_path / "deep").mkdir()
    again = tmp_path / "deep" / ".." / "page"
    assert cli.record([*command, "--html", str(page), "--mcap", str(again)]) == 2
    assert "two exports" in capsys.readouterr().err
    assert not page.exists()


@pytest.mark.parametrize("end", [".html", ".mcap", ".mp4", ".webp", "_csv", "_lerobot"])
def test_name_may_be_as_long_as_the_file_system_allows(
    begun: Record, tmp_path: Path, capsys: pytest.CaptureFixture[str], end: str
) -> None:
    """A longer one is refused before the record is read, which may take minutes."""
    target = tmp_path / ("é" * 100 + "x" * (55 - len(end)) + end)
    assert cli.record(["export", str(begun.folder), f"--{end[1:]}", str(target)]) == 0
    assert [path.name for path in tmp_path.iterdir()] == [target.name]
    capsys.readouterr()
    longer = tmp_path / f"x{target.name}"
    assert cli.record(["export", "no such record", f"--{end[1:]}", str(longer)]) == 2
    assert "File name too long" in capsys.readouterr().err


def test_a_video_has_25_frames_per_second(
    begun: Record, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    video = tmp_path / "a.mp4"
    assert cli.record(["export", str(begun.folder), "--mp4", str(video)]) == 0
    reader = cv2.VideoCapture(str(video))
    count = reader.get(cv2.CAP_PROP_FRAME_COUNT)
    assert count == pytest.approx(25 * begun.until, abs=1.0)
    assert reader.get(cv2.CAP_PROP_FPS) == 25
    good, first = reader.read()
    assert good
    assert first.shape == (720, 1280, 3)
    assert len(np.unique(first[:, :880])) > 50, "a scene, not one color"
    assert [path.name for path in tmp_path.iterdir()] == ["a.mp4"]
    nowhere = str(tmp_path / "no" / "a.mp4")
    assert cli.record(["export", str(begun.folder), "--mp4", nowhere]) == 2
    assert "cannot write" in capsys.readouterr().err
    for form, end in (("--mp4", ".mp4"), ("--webp", ".webp")):
        with pytest.raises(SystemExit):
            cli.record(["export", str(begun.folder), form, "film.avi"])
        assert f"does not end with {end}" in capsys.readouterr().err


def test_a_full_disk_is_reported(tmp_path: Path) -> None:
    (tmp_path / "full.mp4").symlink_to("/dev/full")
    encoder = Encoder(tmp_path / "full.mp4", (64, 48), 25)
    encoder.add(np.zeros((48, 64, 3), np.uint8))
    with pytest.raises(OSError, match="No space left on device"):
        encoder.close()


def test_an_error_during_encoding_is_raised(tmp_path: Path) -> None:
    encoder = Encoder(tmp_path / "film.mp4", (64, 48), 25)
    with pytest.raises(ZeroDivisionError), encoder:
        raise ZeroDivisionError


def test_the_folder_of_a_video_may_have_a_colon(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To ffmpeg, the part before a colon is a protocol."""
    monkeypatch.chdir(tmp_path)
    Path("12:30").mkdir()
    with Encoder(Path("12:30/film.mp4"), (64, 48), 25) as video:
        video.add(np.zeros((48, 64, 3), np.uint8))
    assert Path("12:30/film.mp4").stat().st_size > 500


def test_an_animation_moves_and_is_small(failed: Record, tmp_path: Path) -> None:
    path = tmp_path / "a.webp"
    write_animation(failed, path)
    with Image.open(path) as video:
        assert (video.n_frames, video.size) == (round(10 * failed.until), (800, 450))  # type: ignore[attr-defined]
        first = np.asarray(video.convert("RGB")).astype(int)
        video.seek(video.n_frames // 2)  # type: ignore[attr-defined]
        later = np.asarray(video.convert("RGB")).astype(int)
    assert np.abs(first - later)[:, :550].max() > 60
    assert path.stat().st_size < 3 * 2**20


def test_the_panel_highlights_running_and_failed_leaves(failed: Record) -> None:
    """A running leaf is lit, a failed one is red with its reason below it."""
    panel = FilmPanel(failed, (400, 720))
    (end,) = [event["time_s"] for event in failed.events if event["code"] and event["reason"]][:1]
    during = np.asarray(panel.draw(end / 2.0)).reshape(-1, 3).tolist()
    after = np.asarray(panel.draw(end)).reshape(-1, 3).tolist()
    lit = [255, 240, 214]
    red = [200, 30, 40]
    assert during.count(lit) > 1000
    assert after.count(red) > during.count(red) + 50


@pytest.mark.parametrize("width", [250, 400])
def test_the_panel_marks_what_was_halted_and_shows_whole_reasons(
    width: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As on the terminal; reasons are wrapped to the width of the panel, whatever the letters."""
    reason = "the tool gets no closer to the target than 136.7 mm and 3.5 degrees"
    late = "timeout: {seconds: 0.1, child: {wait: 1 s}}"
    tree = f"{{selector: [{{{late}}}, {{fail: {{reason: {reason}}}}}]}}"
    record = recorded(
        tmp_path,
        f"bt_dualarm: 1\nworld: {{scene: empty}}\narms: {{arm1: {{robot: ur5, tree: {tree}}}}}\n",
    )
    texts: list[str] = []

    def write(_: object, __: object, text: str, **___: object) -> None:
        texts.append(text)

    monkeypatch.setattr("PIL.ImageDraw.ImageDraw.text", write)
    FilmPanel(record, (width, 450)).draw(record.until)
    assert "■" in texts
    assert reason in " ".join(texts)


def test_the_camera_follows_without_a_jolt(failed: Record) -> None:
    """It keeps its direction, and moves by no more than 0.5 m/s."""
    times = np.arange(0.02, failed.until, 0.04).tolist()
    views = followed(failed, times, 1.2)
    eyes = np.array([view.eye for view in views])
    assert np.abs(np.diff(eyes, axis=0)).max() < 0.5 * 0.04
    sides = np.array([view.axes[:, 2] for view in views])
    assert np.ptp(sides, axis=0).max() < 1e-6
    assert clear_corner(failed, times, views, 1.2) in {(x, y) for x in (0, 1) for y in (0, 1)}


def test_an_impossible_export_exits_with_code_2(
    failed: Record, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert (
        cli.record(["export", str(failed.folder), "--html", str(tmp_path / "no" / "a.html")]) == 2
    )
    assert "No such file or directory" in capsys.readouterr().err
    assert cli.record(["export", str(tmp_path), "--html", str(tmp_path / "a.html")]) == 2
    assert "contains no record" in capsys.readouterr().err
    with pytest.raises(SystemExit) as ended:
        cli.record(["export", str(failed.folder)])
    assert ended.value.code == 2
    assert "choose a format:" in capsys.readouterr().err


def test_no_cell_is_a_formula(failed: Record) -> None:
    """A spreadsheet would evaluate it; numbers stay numbers, and escape sequences are removed."""
    event = {
        **failed.events[0],
        "path": "@x",
        "reason": '=HYPERLINK("x")',
        "code": "",
        "kind": "\tx",
    }
    event["metrics"] = {"a": "\x1b[2J"}
    event["time_s"] = -0.5
    tables = dict(tables_of(replace(failed, events=(event,))))
    rows = [*csv.DictReader(tables["events.csv"].splitlines())]
    assert rows[0]["path"] == "'@x"
    assert rows[0]["reason"] == '\'=HYPERLINK("x")'
    assert rows[0]["kind"] == "'\tx"
    assert rows[0]["time_s"] == "-0.5"
    assert "\x1b" not in tables["events.csv"]


def test_no_trail_leads_to_an_arm_that_was_spawned_again(tmp_path: Path) -> None:
    """Its earlier trail would lead from where it was removed straight to its home posture."""
    record = recorded(tmp_path, RETURNING)
    moments = [record.moment(record.index_at(time)) for time in (0.1, 0.3, 0.48, 0.6, 0.64)]
    assert [record.lives("arm2", moment.generation) for moment in moments] == [1, 1, 1, 2, 2]
    [viewpoint] = followed(record, [0.6], 4 / 3)
    whole, since = (FilmScene(record, (160, 120)) for _ in range(2))
    for moment in moments[:3]:
        whole.draw(moment, viewpoint)
    for moment in moments[3:]:
        images = [np.asarray(scene.draw(moment, viewpoint)).astype(int) for scene in (whole, since)]
    differs = np.abs(images[0] - images[1]).max(axis=2) > 40
    # The other arm did not move: its trail is a point.
    assert np.count_nonzero(differs) == 0
