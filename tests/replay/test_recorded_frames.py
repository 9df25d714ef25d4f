"""Recorded frames: images that a record stores on request, as exposed, up to a size limit."""

from __future__ import annotations

import errno
import logging
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bt_dualarm
from bt_dualarm import cli
from bt_dualarm.core.errors import RunError
from bt_dualarm.core.pose import Pose
from bt_dualarm.replay.record import Record
from bt_dualarm.replay.rerun import Changed, resumed
from bt_dualarm.replay.timeline import recorded_frames
from bt_dualarm.runtime.history_file import HistoryError, HistoryWriter
from bt_dualarm.runtime.observations import PictureFile
from bt_dualarm.sim.frame import Frame
from bt_dualarm.skill.registry import Registry
from tests.replay.runs import WATCHING


def test_every_image_is_stored_as_exposed(tmp_path: Path) -> None:
    with bt_dualarm.open(WATCHING, record=tmp_path / "out", frames=True) as run:
        run.finish()
        arm: Any = run.assembly.arms.present[0]
        last: Frame = arm._camera.camera.latest
    record = Record.read(tmp_path / "out")
    listed = [(note["stamp"], note["region"]) for note in record.notes if note["kind"] == "frame"]
    stored = [*recorded_frames(record)]
    assert [(found.stamp, [*found.region]) for found in stored] == listed
    assert len({found.region for found in stored}) > 1  # a tracker exposes the region that it needs
    same = next(found for found in stored if found.stamp == last.stamp)
    assert same.image.shape == (120, 160, 3)
    error = np.abs(same.image.astype(int) - last.image.astype(int))
    assert error.mean() < 3.0  # JPEG, and a sensor's noise
    assert same.whole.startswith(b"\xff\xd8")
    until = listed[len(listed) // 2][0]
    changed = Changed(options={"record": tmp_path / "again", "frames": True})
    with resumed(record, until, Registry.load(), changed) as again:
        again.finish()
    first, second = (tmp_path / name / "run.frames" for name in ("out", "again"))
    assert first.read_bytes() == second.read_bytes()


def frame(stamp: float) -> Frame:
    """An image of 80 by 60 px of noise."""
    image = np.random.default_rng(0).integers(0, 255, (60, 80, 3)).astype(np.uint8)
    return Frame(stamp, image, Pose.identity(), 0.9, (0, 0, 80, 60))


def read(folder: Path) -> list[float]:
    """Stamps of the images stored in a folder."""
    record = Record(folder, {"arms": {"arm1": {}}}, (), {}, (), (), None, None, "")
    return [found.stamp for found in recorded_frames(record)]


def test_images_are_stored_up_to_the_size_limit(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    file = PictureFile(tmp_path / "run.frames", most_bytes=20_000)
    for number in range(9):
        file.add("arm1", number / 10, frame(number / 10))
    file.close()
    stamps = read(tmp_path)
    assert 1 < len(stamps) < 9
    assert caplog.text.count("images are stored up to") == 1
    assert (tmp_path / "run.frames").stat().st_size < 22_000


def test_a_full_disk_only_ends_the_storing_of_images(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    file = PictureFile(tmp_path / "run.frames")
    file.add("arm1", 0.0, frame(0.0))

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(HistoryWriter, "add", full)
    with caplog.at_level(logging.WARNING):
        file.add("arm1", 0.1, frame(0.1))
        file.add("arm1", 0.2, frame(0.2))
    file.close()
    assert read(tmp_path) == [0.0]
    assert "images are stored up to 0.10 s: No space left on device" in caplog.text


def test_a_file_without_images_is_refused(tmp_path: Path) -> None:
    assert read(tmp_path) == []
    (tmp_path / "run.frames").write_text("something else, longer than the mark of a history")
    with pytest.raises(HistoryError, match="is not the history of a run"):
        read(tmp_path)


def test_storing_images_needs_a_record(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(RunError, match="give its folder"):
        bt_dualarm.open(WATCHING, frames=True)
    with pytest.raises(SystemExit):
        cli.run(["circle", "--frames"])
    assert "add --record DIR" in capsys.readouterr().err
