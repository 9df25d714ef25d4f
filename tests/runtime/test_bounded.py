"""Data of a run: bounded in memory, each item processed once, complete on disk."""

from __future__ import annotations

import json
import logging
import tracemalloc
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bt_dualarm.behaviors.report import MOST_RUNS, BoundedLog, LeafReport, LeafReports
from bt_dualarm.runtime import outcome
from bt_dualarm.runtime.interruption import StopRequest
from bt_dualarm.runtime.observations import MOST_LINES, Journal, LogCapture, StateLog
from bt_dualarm.runtime.outcome import Holdings, Sample, SeriesLog, Tracks
from bt_dualarm.runtime.recorder import (
    PARTS,
    GrowingArray,
    Recorder,
    RecordError,
    RecordFolder,
    SampleFiles,
)
from tests.runtime.test_record import CHANGE, FallingWorld, Held, View, result

NAMES = ("tool_arm1", "object_cube", "object_ball")


@given(st.integers(1, 6), st.lists(st.integers(), max_size=40))
def test_a_bounded_log_keeps_the_first_and_the_last_items(each: int, items: list[int]) -> None:
    kept: BoundedLog[int] = BoundedLog(each)
    for item in items:
        kept.add(item)
    if len(items) <= 2 * each:
        assert list(kept) == items
        assert kept.left_out == 0
    else:
        assert list(kept) == items[:each] + items[-each:]
        assert kept.left_out == len(items) - 2 * each


def test_every_leaf_is_kept_and_runs_stay_in_order() -> None:
    reports = LeafReports()
    for number in range(5 * MOST_RUNS):
        reports.add(LeafReport("main/often", "circle", "SUCCESS", float(number)))
        if number % MOST_RUNS == 3:
            reports.add(LeafReport(f"main/rare {number}", "stop", "SUCCESS", number + 0.5))
    kept = list(reports)
    assert [run.started_s for run in kept] == sorted(run.started_s for run in kept)
    assert sum(run.path.startswith("main/rare") for run in kept) == 5
    assert len(kept) == len(reports) == 2 * MOST_RUNS + 5
    assert reports.left_out == 3 * MOST_RUNS


@settings(max_examples=40)
@given(st.lists(st.integers(1, 30), min_size=1, max_size=30), st.sampled_from((1, 3)))
def test_a_long_series_is_thinned_evenly(batches: list[int], columns: int) -> None:
    """In any batches; a short series is complete."""
    total = sum(batches)
    time = 0.004 * np.arange(total)
    values = np.random.default_rng(total).normal(size=(total, columns))
    log = SeriesLog()
    first = 0
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(outcome, "MOST_SAMPLES", 64)
        for count in batches:
            part = slice(first, first + count)
            log.add("arm1", "leaf", "one", time[part], values[part])
            first += count
    (found,) = log
    stride = next(k for k in (1, 2, 4, 8, 16, 32) if len(found.time) == -(-total // k))
    assert len(found.time) <= 64
    assert stride == 1 or len(found.time) > 30
    assert np.array_equal(found.time, time[::stride])
    assert np.array_equal(found.values, values[::stride])


@settings(max_examples=25, deadline=None)
@given(st.lists(st.integers(0, 40), max_size=12), st.sampled_from(((), (3,))))
def test_a_growing_file_can_be_read_at_any_moment(
    tmp_path_factory: pytest.TempPathFactory, batches: list[int], shape: tuple[int, ...]
) -> None:
    """Even if the process died after writing the rows and before the header that counts them."""
    path = tmp_path_factory.mktemp("growing") / "one.npy"
    array = GrowingArray(path, shape)
    rng = np.random.default_rng(len(batches))
    whole = np.empty((0, *shape))
    for count in batches:
        rows = rng.normal(size=(count, *shape))
        before = path.read_bytes()
        array.append(rows)
        torn = before + rows.tobytes()[: rows.nbytes // 2]
        path.with_name("torn.npy").write_bytes(torn)
        assert np.array_equal(np.load(path.with_name("torn.npy")), whole)
        whole = np.concatenate((whole, rows))
        assert np.array_equal(np.load(path), whole)


def samples(seed: int, count: int) -> list[Sample]:
    """Samples in which objects appear and disappear."""
    rng = np.random.default_rng(seed)
    found = []
    names: tuple[str, ...] = NAMES[:1]
    for number in range(count):
        if rng.random() < 0.05:
            names = tuple(name for name in NAMES if rng.random() < 0.6)
        found.append(Sample(0.01 * number, names, rng.normal(size=(len(names), 3))))
    return found


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10**6), st.integers(0, 900))
def test_an_archive_has_every_sample(
    tmp_path_factory: pytest.TempPathFactory, seed: int, count: int
) -> None:
    """NaN where an object was not in the world; the parts are removed once it is written."""
    folder = tmp_path_factory.mktemp("samples")
    files = SampleFiles(folder / PARTS)
    taken = samples(seed, count)
    for sample in taken:
        files.add(sample)
    with (folder / "samples.npz").open("wb") as file:
        files.write_archive(file)
    files.remove()
    assert [path.name for path in folder.iterdir()] == ["samples.npz"]
    archive = np.load(folder / "samples.npz")
    assert np.array_equal(archive["time"], [sample.time for sample in taken])
    assert set(archive.files) == {"time"} | {name for sample in taken for name in sample.names}
    for name in archive.files[1:]:
        points = [sample.point(name) for sample in taken]
        expected = [np.full(3, np.nan) if point is None else point for point in points]
        assert np.array_equal(archive[name], expected, equal_nan=True)


def test_parts_always_have_equally_many_rows(tmp_path: Path) -> None:
    files = SampleFiles(tmp_path / PARTS)
    for sample in samples(1, 1000):
        files.add(sample)
        if (tmp_path / PARTS).is_dir():
            parts = [np.load(path) for path in (tmp_path / PARTS).glob("*.npy")]
            assert len({len(part) for part in parts}) == 1


@dataclass
class Stage:
    """A world in which one cube goes up and down and is held now and then."""

    generation: int = 0
    attachments: list[Held] = field(default_factory=list)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6))
def test_a_holding_reports_how_far_it_was_lifted(seed: int) -> None:
    """It is that of the complete path: from its first sample to its highest."""
    rng = np.random.default_rng(seed)
    stage: Any = Stage()
    time = []
    heights = []
    spans: list[list[float]] = []
    holdings = Holdings(stage)
    for number in range(300):
        now = 0.01 * number
        if rng.random() < 0.1 and stage.attachments:
            spans[-1][1] = now
            stage.attachments = []
        elif rng.random() < 0.1 and not stage.attachments:
            stage.attachments = [Held("arm1", "cube", now)]
            spans.append([now, np.inf])
        holdings.after_ticks(now)
        after_step = now + 0.002
        time.append(after_step)
        heights.append(rng.normal())
        points = np.array([[0.0, 0.0, heights[-1]]])
        holdings.sampled(Sample(after_step, ("object_cube",), points))
    found = holdings.of("arm1")
    assert [[one.attached_s, one.released_s or np.inf] for one in found] == spans
    for one in found:
        held = np.array(heights)[one.during(np.array(time))]
        assert one.lifted_m == pytest.approx(held.max() - held[0])


def test_an_attachment_that_is_over_is_not_updated_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """Otherwise the time for a record would grow with the square of their number."""
    updates = []
    update = outcome._Lift.update

    def counted(self: outcome._Lift, sample: Sample) -> None:
        updates.append(sample.time)
        update(self, sample)

    monkeypatch.setattr(outcome._Lift, "update", counted)
    stage: Any = Stage()
    holdings = Holdings(stage)
    for number in range(3000):
        stage.attachments = [Held("arm1", "cube", 0.01 * number)]
        holdings.after_ticks(0.01 * number)
        holdings.sampled(Sample(0.01 * number, ("object_cube",), np.zeros((1, 3))))
    assert len(updates) <= 2 * 3000
    assert holdings.left_out == 3000 - 2 * outcome.MOST_HOLDINGS
    assert len(holdings.as_dicts()) == 2 * outcome.MOST_HOLDINGS


def test_the_memory_of_a_recorder_does_not_grow(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A run ten times as long needs no more for events, log, samples, holdings and series."""
    monkeypatch.setattr(outcome, "MOST_POINTS", 1 << 10)
    monkeypatch.setattr(outcome, "MOST_SAMPLES", 1 << 8)
    monkeypatch.setattr(outcome, "MOST_HOLDINGS", 10)
    peaks = {}
    for length in (4_000, 40_000):
        world: Any = FallingWorld()
        log = SeriesLog()
        folder = tmp_path / str(length)
        folder.mkdir()
        recorder = Recorder(folder, world, StateLog(world), lambda: ["a line"])
        tracemalloc.start()
        for step in range(length):
            world.data.time = step * world.timestep
            if step % 50 == 0:
                world.attachments = [Held("arm1", "cube", world.time)] if step % 100 else []
                recorder.on_event(CHANGE)
                recorder.after_ticks(View(world.time))
                log.add("arm1", "main/circle", "force_N", world.time, 3.0)
            recorder.after_step(world.time)
        peaks[length] = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        recorder.write(result(series=log), StopRequest(15, 2))
        summary: dict[str, Any] = json.loads((folder / "summary.json").read_text())
        assert len((folder / "events.jsonl").read_text().splitlines()) == length // 50
        assert len((folder / "run.log").read_text().splitlines()) >= length // 50
        assert len(np.load(folder / "samples.npz")["time"]) == length // 5
        assert len(summary["attachments"]) == 20
        assert summary["attachments_left_out"] == length // 100 - 20
        assert not (folder / PARTS).exists()
    assert peaks[40_000] - peaks[4_000] < 2 * 36_000, "less than two bytes a step"


def test_tracks_of_a_long_run_still_have_its_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(outcome, "MOST_POINTS", 1 << 8)
    world: Any = FallingWorld()
    kept = Tracks(world)
    for _ in range(3000):
        world.step()
        kept.after_step()
    assert 32 < len(kept.time) <= 64
    assert kept.time[0] == pytest.approx(world.timestep), "the end of the first step"
    assert kept.time[-1] > 0.9 * world.time
    assert np.allclose(np.diff(kept.time), kept.time[1] - kept.time[0])
    assert kept.positions()["object_cube"].shape == (len(kept.time), 3)


def test_a_record_whose_folder_was_deleted_is_not_complete(tmp_path: Path) -> None:
    """It could not be written to, and is not reported as complete."""
    folder = tmp_path / "out"
    world: Any = FallingWorld()
    taken = RecordFolder(folder, ["arm1"])
    recorder = Recorder(folder, world, StateLog(world), list)
    recorder.on_event(CHANGE)
    recorder.after_ticks(View(0.0))
    for path in folder.iterdir():
        path.unlink()
    folder.rmdir()
    with pytest.raises(RecordError, match="not complete: No such file"):
        recorder.write(result(), StopRequest())
    assert not folder.exists()
    with pytest.raises(FileNotFoundError):
        taken.path.stat()


def test_samples_that_cannot_be_written_are_reported_at_the_end(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    world: Any = FallingWorld()
    recorder = Recorder(tmp_path, world, StateLog(world), list)
    (tmp_path / PARTS).write_text("in the way")
    for _ in range(3000):
        world.step()
        recorder.after_step(world.time)
    assert "samples are no longer written" in caplog.text
    with pytest.raises(RecordError, match="not complete"):
        recorder.write(result(), StopRequest())


def test_a_failed_journal_is_reported_at_the_end(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "none" / "events.jsonl")
    journal.add("a line\n")
    with pytest.raises(OSError, match="No such file"):
        journal.finish()


def test_log_lines_that_are_not_taken_are_bounded() -> None:
    log = LogCapture()
    with log.during():
        for number in range(MOST_LINES + 5):
            logging.getLogger("bt_dualarm.test").info("%d", number)
    lines = log.take()
    assert (len(lines), lines[-1]) == (MOST_LINES, str(MOST_LINES + 4))
    assert log.take() == []


def test_parts_that_a_killed_run_left_are_removed(tmp_path: Path) -> None:
    with RecordFolder(tmp_path / "out", []) as taken:
        files = SampleFiles(taken.path / PARTS)
        for sample in samples(2, 400):
            files.add(sample)
        (taken.path / "summary.json").write_text(
            json.dumps({"outcome": "SUCCESS", "state_sha256": "0", "arms": {}})
        )
    assert (tmp_path / "out" / PARTS).is_dir()
    with RecordFolder(tmp_path / "out", []):
        assert not (tmp_path / "out" / PARTS).exists()
