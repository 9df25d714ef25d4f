"""Recorded image results are reused on resume; the run stays the same."""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path

import pytest

import bt_dualarm
from bt_dualarm.replay.record import Record
from bt_dualarm.replay.rerun import Changed, PastChangedError, resumed
from bt_dualarm.skill.registry import Registry

REGISTRY = Registry.load()

TREE = """\
bt_dualarm: 1
name: looking
world: {scene: empty, reality: rough, seed: 3, time_limit: 30}
objects:
  block:
    shape: box
    size: [0.06, 0.06, 0.04]
    mass: 0.1
    color: yellow
    pose: {xyz: [0.45, 0, 0.02]}
    marker: {dictionary: apriltag_36h11, id: 5, size: 0.045}
  disc:
    shape: cylinder
    size: [0.02, 0.02]
    mass: 0.1
    color: blue
    pose: {xyz: [0.45, 0.07, 0.01]}
arms:
  arm1:
    robot: panda
    camera: {mount: wrist, resolution: [320, 240], fov: 50, fps: 30, latency: 0.05, drop: 0.1}
    tree:
      sequence:
        - look_at: {at: {xyz: [0.45, 0, 0.02]}, distance: 0.35}
        - count: {object: block}
        - track: {color: blue, plane: xy, duration: 3.0}
        - look_at: {at: {xyz: [0.45, 0, 0.02]}, distance: 0.35}
        - locate: {object: block, by: marker, pose: "{block}"}
        - reach_to_pose: {offset: {xyz: [0, 0, 0.05]}}
"""


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Record:
    folder = tmp_path_factory.mktemp("looking")
    assert bt_dualarm.run(TREE, record=folder).outcome == "SUCCESS"
    return Record.read(folder)


def tracking_time(record: Record) -> float:
    """A time in the middle of the tracking, s."""
    frames = [note["time_s"] for note in record.notes if note["kind"] == "look"]
    return float(frames[len(frames) // 2])


def test_resuming_renders_no_earlier_image_and_yields_the_same_record(
    record: Record, tmp_path: Path
) -> None:
    """Checksums of images and results that were not computed again are equal, as is the hash."""
    changed = Changed(options={"record": tmp_path / "again"})
    with resumed(record, tracking_time(record), REGISTRY, changed) as run:
        frame_log = run.assembly.frame_logs["arm1"]
        frames = [n for n in record.notes if n["kind"] == "frame" and n["time_s"] < run.time]
        assert (frame_log.taken, frame_log.drawn) == (len(frames), 0)
        assert len(frames) > 50
        result = run.finish()
    assert record.end is not None
    assert result.state_sha256 == record.end["state_sha256"]
    assert Record.read(tmp_path / "again").notes == record.notes


def test_a_result_missing_from_the_record_is_computed_from_the_same_image(record: Record) -> None:
    """Images rendered late are those of their exposure: each result is the same."""
    remaining = [
        note for note in record.notes if note["kind"] != "found" or note["time_s"] % 0.3 < 0.1
    ]
    time = tracking_time(record)
    with resumed(replace(record, notes=tuple(remaining)), time, REGISTRY, Changed()) as run:
        assert 0 < run.assembly.frame_logs["arm1"].drawn < run.assembly.frame_logs["arm1"].taken
        result = run.finish()
    assert record.end is not None
    assert result.state_sha256 == record.end["state_sha256"]


def test_results_that_diverge_are_dropped_and_all_images_are_rendered(
    record: Record, caplog: pytest.LogCaptureFixture
) -> None:
    wrong = [note | {"answer": []} if note["kind"] == "found" else note for note in record.notes]
    false = replace(record, notes=tuple(wrong))
    with (
        caplog.at_level(logging.WARNING),
        resumed(false, tracking_time(record), REGISTRY, Changed()) as run,
    ):
        assert run.assembly.frame_logs["arm1"].taken == 0
        result = run.finish()
    assert "recorded image results diverge from the run from" in caplog.text
    assert record.end is not None
    assert result.state_sha256 == record.end["state_sha256"]


def test_another_color_in_the_past_is_refused(record: Record, tmp_path: Path) -> None:
    tree = tmp_path / "looking.yaml"
    tree.write_text(TREE.replace("track: {color: blue", "track: {color: red"))
    with pytest.raises(PastChangedError, match=r"sequence/track began at .* has another color now"):
        resumed(record, tracking_time(record), REGISTRY, Changed(tree))
