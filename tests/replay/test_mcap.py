"""What is exported as MCAP has all that the record has, and the package of that name reads it."""

from __future__ import annotations

import json
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

from bt_dualarm import cli
from bt_dualarm.replay.mcap_export import write_mcap
from bt_dualarm.replay.messages import Message
from bt_dualarm.replay.record import Record
from tests.replay.runs import recorded


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> Record:
    return recorded(tmp_path_factory.mktemp("short"))


def test_it_has_all_events_and_joints_in_their_order(short: Record, tmp_path: Path) -> None:
    path = tmp_path / "short.mcap"
    assert cli.record(["export", str(short.folder), "--mcap", str(path)]) == 0
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        found = [*reader.iter_messages(log_time_order=False)]
        summary = reader.get_summary()
    times = [message.log_time for _, _, message in found]
    assert times == sorted(times)
    counts = Counter(channel.topic for _, channel, _ in found)
    assert counts["/status"] == len(short.events)
    assert counts["/arm1/joints"] == len(short.times)
    assert counts["/bodies"] == -(-len(short.times) // 2)
    said: list[dict[str, Any]] = [
        json.loads(message.data) for _, channel, message in found if channel.topic == "/status"
    ]
    assert said == list(short.events)
    assert summary is not None
    names = {schema.name for schema in summary.schemas.values()}
    assert "foxglove.FrameTransforms" in names


def test_what_is_no_number_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="Out of range"):
        write_mcap([Message("/a", "A", 0.0, {"x": float("nan")})], tmp_path / "a.mcap")
    assert [*tmp_path.iterdir()] == []


@pytest.mark.parametrize(
    ("form", "package"), [("--mcap", "mcap.writer"), ("--mp4", "imageio_ffmpeg")]
)
def test_without_the_extra_it_says_so(
    short: Record,
    tmp_path: Path,
    form: str,
    package: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    target = str(tmp_path / "a.mp4")
    assert cli.record(["export", str(short.folder), form, target]) == 2
    assert "the extra bt_dualarm[export]" in capsys.readouterr().err
