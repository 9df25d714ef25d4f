"""MCAP export: the file has all that the record has, and the mcap package can read it."""

from __future__ import annotations

import base64
import json
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from mcap.reader import make_reader

import bt_dualarm
from bt_dualarm import cli
from bt_dualarm.export.mcap import Message, messages_of, schema_of, write_mcap
from bt_dualarm.replay.record import Record
from tests.replay.runs import WATCHING, recorded


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> Record:
    return recorded(tmp_path_factory.mktemp("short"))


def test_the_file_has_all_events_and_joints_in_order(short: Record, tmp_path: Path) -> None:
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
    statuses: list[dict[str, Any]] = [
        json.loads(message.data) for _, channel, message in found if channel.topic == "/status"
    ]
    assert statuses == list(short.events)
    assert summary is not None
    names = {schema.name for schema in summary.schemas.values()}
    assert "foxglove.FrameTransforms" in names


SPECIFIED = {
    "foxglove.FrameTransforms": {"transforms"},
    "foxglove.JointStates": {"timestamp", "joints"},
    "foxglove.CompressedImage": {"timestamp", "frame_id", "data", "format"},
    "foxglove.CameraCalibration": set("DKRP")
    | {"timestamp", "frame_id", "width", "height", "distortion_model"},
    "foxglove.SceneUpdate": {"deletions", "entities"},
    "foxglove.ImageAnnotations": {"circles", "points", "texts"},
    "foxglove.Log": {"timestamp", "level", "message", "name", "file", "line"},
}
"""Fields of docs.foxglove.dev/docs/sdk/schemas that every message of that name has."""


def test_every_message_matches_its_schema(tmp_path: Path) -> None:
    """Including images, intrinsics and detections; timestamps agree with the messages' times."""
    assert bt_dualarm.run(WATCHING, record=tmp_path, frames=True).outcome == "SUCCESS"
    record = Record.read(tmp_path)
    messages = messages_of(record)
    seen = {message.schema for message in messages}
    assert seen >= SPECIFIED.keys() | {"bt_dualarm.Look", "bt_dualarm.Found", "bt_dualarm.Ports"}
    validators = {name: jsonschema.Draft202012Validator(schema_of(name)) for name in seen}
    for message in messages:
        validators[message.schema].validate(json.loads(json.dumps(message.content)))
        if message.schema in SPECIFIED:
            assert message.content.keys() == SPECIFIED[message.schema]
        stamp: Any = message.content.get("timestamp")
        if stamp is not None:
            assert stamp["sec"] * 10**9 + stamp["nsec"] == message.nanoseconds
    image = next(m for m in messages if m.schema == "foxglove.CompressedImage")
    assert base64.b64decode(str(image.content["data"])).startswith(b"\xff\xd8")
    frames: Any = next(m for m in messages if m.topic == "/bodies").content["transforms"]
    assert image.content["frame_id"] in {frame["child_frame_id"] for frame in frames}


def test_a_fault_of_an_object_belongs_to_the_world(tmp_path: Path) -> None:
    """Its topic once was ``//fault``."""
    push = "{kind: pushed_object, object: ball, force: [1, 0, 0], begin: 0.1 s, until: 0.2 s}"
    late = "{arm: arm1, leaf: wait, effect: fail, phase: end}"
    text = f"""
bt_dualarm: 1
world: {{scene: empty}}
objects: {{ball: {{shape: sphere, size: [0.05], mass: 1, pose: {{xyz: [0.8, 0.4, 0.05]}}}}}}
arms: {{arm1: {{robot: ur5, tree: {{wait: 0.3 s}}}}}}
faults: {{push: {push}, late: {late}}}
"""
    bt_dualarm.run(text, record=tmp_path)
    faults = [m for m in messages_of(Record.read(tmp_path)) if m.schema == "bt_dualarm.Fault"]
    assert {message.topic for message in faults} == {"/world/fault", "/arm1/fault"}
    for message in faults:
        jsonschema.validate(json.loads(json.dumps(message.content)), schema_of(message.schema))
        assert {"name", "fault", "objects"} <= set(schema_of(message.schema)["required"])


def test_joints_are_those_of_the_state_and_of_the_set_point(short: Record) -> None:
    messages = {m.topic: m for m in messages_of(short) if m.time_s == short.times[-1]}
    joints: Any = messages["/arm1/joints"].content["joints"]
    set_points: Any = messages["/arm1/set_point"].content["joints"]
    assert [joint["name"] for joint in joints] == [joint["name"] for joint in set_points]
    assert len(joints) == 6
    for measured, set_point in zip(joints, set_points, strict=True):
        assert measured["position"] == pytest.approx(set_point["position"], abs=0.01)
        assert measured.keys() == {"name", "position", "velocity", "effort"}


def test_nan_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="Out of range"):
        write_mcap([Message("/a", "A", 0.0, {"x": float("nan")})], tmp_path / "a.mcap")
    assert [*tmp_path.iterdir()] == []


@pytest.mark.parametrize(
    ("form", "package"), [("--mcap", "mcap.writer"), ("--mp4", "imageio_ffmpeg")]
)
def test_a_missing_extra_is_reported(
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
