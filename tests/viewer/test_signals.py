"""Signals of a page depend on the run, not on the requests of the page."""

from __future__ import annotations

import base64
import json
from functools import partial
from pathlib import Path
from threading import Thread
from typing import Any

import cv2
import numpy as np
import pytest

import bt_dualarm
from bt_dualarm.core.pose import Matrix
from bt_dualarm.runtime.interruption import StopRequest
from bt_dualarm.sim.frame import Frame, Image
from bt_dualarm.viewer import signals as signals_module
from bt_dualarm.viewer.live_view import LiveView
from bt_dualarm.viewer.past import Pictures, RecordView
from bt_dualarm.viewer.server import Viewers
from bt_dualarm.viewer.signals import COLUMNS, Signals
from tests.replay.runs import RETURNING

GRASPING = """\
bt_dualarm: 1
name: grasping
world: {scene: empty, time_limit: 20}
objects:
  cube: {shape: box, size: [0.05, 0.05, 0.05], mass: 0.1, color: red, pose: {xyz: [0.45, 0, 0.025]}}
arms:
  arm1:
    robot: panda
    gripper: panda_hand
    tree: {sequence: [{grasp: {object: cube}}, {fail: {reason: enough}}]}
"""
TRACKING = """\
bt_dualarm: 1
name: tracking
world: {scene: empty, time_limit: 20}
objects:
  block:
    shape: box
    size: [0.06, 0.06, 0.04]
    mass: 0.1
    color: yellow
    pose: {xyz: [0.45, 0, 0.02]}
arms:
  arm1:
    robot: panda
    camera: {mount: wrist, resolution: [160, 120], fov: 70, fps: 30}
    tree:
      sequence:
        - look_at: {at: {xyz: [0.45, 0, 0.02]}, distance: 0.35}
        - track: {color: yellow, plane: xy, duration: 0.6}
"""


def answer_of(view: Any, what: str, **query: object) -> Any:
    given = {name: str(value) for name, value in query.items()}
    return json.loads(view.questions[what](given).content)


def table(series: Any, arm: str = "arm1") -> Matrix:
    assert tuple(series["columns"]) == COLUMNS
    rows = np.frombuffer(base64.b64decode(series["arms"][arm]), np.float32)
    return rows.reshape(-1, len(COLUMNS)).astype(float)


@pytest.fixture(scope="module")
def grasped(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Any, Any, Any]:
    """A record, and the live view's answers at its end, without earlier requests."""
    folder = tmp_path_factory.mktemp("grasped") / "out"
    stop = StopRequest()
    with (
        bt_dualarm.open(GRASPING, stop=stop, record=folder) as run,
        LiveView(run, stop, paused=False) as view,
    ):
        view.gate.set_speed(None)
        run.finish()
        answers = tuple(answer_of(view, what) for what in ("series", "now", "log"))
    return (folder, *answers)


def test_signals_are_sampled_without_requests(grasped: tuple[Path, Any, Any, Any]) -> None:
    """25 times per simulated second from the beginning, as in the record."""
    folder, series, now, _ = grasped
    live = table(series)
    past = table(answer_of(RecordView(folder), "series"))
    assert np.diff(live[:, 0]) == pytest.approx(0.04, abs=1e-4)
    assert len(live) == pytest.approx(25 * now["time"], abs=2)
    at = np.searchsorted(past[:, 0], live[:, 0] - 1e-4)
    np.testing.assert_allclose(live, past[at], atol=2e-3)


def test_gripper_state_is_shown(grasped: tuple[Path, Any, Any, Any]) -> None:
    """Opening, force and held objects, live and from the record."""
    folder, series, now, _ = grasped
    rows = table(series)
    assert rows[0, 6] == pytest.approx(0.08, abs=0.002)
    assert rows[-1, 6] == pytest.approx(0.05, abs=0.002)
    assert rows[-1, 7] > 1.0
    [arm] = now["arms"]
    assert now["over"]
    assert [node["status"] for node in arm["nodes"]] == ["FAILURE", "SUCCESS", "FAILURE"]
    assert arm["gripper"]["holds"] == ["cube"]
    assert arm["gripper"]["opening_m"] == pytest.approx(0.05, abs=0.002)
    assert arm["gripper"]["force_n"] > 1.0
    view = RecordView(folder)
    [early], [late] = (answer_of(view, "at", t=time)["arms"] for time in (0.1, now["time"]))
    assert (early["gripper"]["holds"], late["gripper"]["holds"]) == ([], ["cube"])
    assert late["gripper"]["force_n"] == pytest.approx(arm["gripper"]["force_n"], abs=1.0)
    assert late["gripper"]["opening_m"] == pytest.approx(arm["gripper"]["opening_m"], abs=1e-3)


def test_failures_are_listed_separately_from_the_log(grasped: tuple[Path, Any, Any, Any]) -> None:
    """Identical live and from the record, with time, node, reason, for marks on the time line."""
    folder, _, _, log = grasped
    assert [line["level"] for line in log["failures"]] == ["FAILURE"] * 2
    assert "enough" in log["failures"][0]["text"]
    assert answer_of(RecordView(folder), "log")["failures"] == log["failures"]
    now = answer_of(RecordView(folder), "now")
    assert now["begin"] == pytest.approx(log["failures"][0]["time"], abs=1e-3)


def test_an_arm_that_was_spawned_again_begins_another_life(tmp_path: Path) -> None:
    """Its tool jumps home within a sample: no trail leads there, and it has no speed."""
    stop = StopRequest()
    with (
        bt_dualarm.open(RETURNING, stop=stop, record=tmp_path / "out") as run,
        LiveView(run, stop, paused=False) as view,
    ):
        view.gate.set_speed(None)
        run.finish()
        live = answer_of(view, "series")
        now = answer_of(view, "now")
    record = RecordView(tmp_path / "out")
    for series in (live, answer_of(record, "series")):
        rows = table(series, "arm2")
        [back] = np.flatnonzero(np.diff(rows[:, 8]))
        assert set(rows[:, 8]) == {1.0, 2.0}
        assert np.linalg.norm(rows[back + 1, 1:4] - rows[back, 1:4]) > 0.05
        assert set(table(series)[:, 8]) == {1.0}
    lives = [[arm["life"] for arm in at["arms"]] for at in (now, answer_of(record, "at", t=0.3))]
    assert lives == [[1, 2], [1, 1]]


def test_samples_of_long_runs_are_thinned(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(signals_module, "MOST_ROWS", 20)
    with bt_dualarm.open(TRACKING) as run:
        signals = Signals(run.world, run.assembly.arms)
        run.watch(signals)
        run.step(2.0)
        rows = table(signals.since(0.0))
        assert 10 <= len(rows) <= 21
        assert np.diff(rows[:, 0]) == pytest.approx(rows[1, 0] - rows[0, 0], abs=1e-3)
        assert rows[-1, 0] > 1.7
        late = table(signals.since(rows[-3, 0]))
        np.testing.assert_array_equal(late, rows[-2:])
        assert table(signals.since(99.0)).shape == (0, len(COLUMNS))


def test_whole_image_is_shown_if_only_a_region_was_exposed(tmp_path: Path) -> None:
    """The exposed region is unchanged, and the rest is rendered; the hash does not change."""
    plain = bt_dualarm.run(TRACKING).state_sha256
    shown: list[tuple[Frame, Image]] = []
    with bt_dualarm.open(TRACKING, record=tmp_path / "out") as run:
        pictures = Pictures(run.world, lambda: True)

        def record(arm: str, frame: Frame) -> None:
            pictures.take(arm, frame)
            content = np.frombuffer(pictures.jpeg(arm) or b"", np.uint8)
            whole = cv2.imdecode(content, cv2.IMREAD_COLOR_RGB)
            assert whole is not None
            shown.append((frame, whole.astype(np.uint8)))

        assert run.open_record is not None
        run.open_record.trace.frame_readers.append(record)
        assert run.finish().state_sha256 == plain
    parts = [pair for pair in shown if pair[0].region != (0, 0, 160, 120)]
    assert len(parts) > 5
    for frame, whole in parts[-3:]:
        left, top, right, bottom = frame.region
        outside = np.ones(whole.shape[:2], bool)
        outside[top:bottom, left:right] = False
        assert frame.image[outside].max() == 0, "not exposed"
        assert (whole[outside].max(axis=-1) > 20).mean() > 0.95, "rendered"
        inside = np.abs(whole[~outside].astype(int) - frame.image[~outside])
        assert np.median(inside) < 8, "as exposed, up to JPEG compression"


def test_viewer_waits_until_the_page_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    """It waits even if the page is silent: a browser may stall, or its window may be hidden."""
    clock = [100.0]
    monkeypatch.setattr("bt_dualarm.viewer.server.time.monotonic", lambda: clock[0])
    viewers = Viewers()
    assert not viewers.is_anyone_there
    for report, seconds in (
        (partial(viewers.asked, ""), 2.0),
        (viewers.fetched, 10.0),
        (partial(viewers.asked, "one"), 600.0),
    ):
        report()
        clock[0] += seconds - 0.1
        assert viewers.is_anyone_there
        clock[0] += 0.2
        assert not viewers.is_anyone_there
    viewers.asked("one")
    viewers.asked("two")
    viewers.left("one")
    clock[0] += 60.0
    assert viewers.is_anyone_there, "the other page is still open"
    viewers.left("two")
    assert viewers.is_anyone_there, "the page may only be reloading"
    clock[0] += 3.1
    assert not viewers.is_anyone_there
    for number in range(1000):
        viewers.asked(f"page {number}" * 100)
    assert len(viewers._until) <= 100


def test_run_is_shown_after_its_end_until_the_page_is_closed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bt_dualarm.viewer.server._RELOAD_S", 0.0)
    stop = StopRequest()
    tree = GRASPING.replace("{grasp: {object: cube}}, ", "")
    with (
        bt_dualarm.open(tree, stop=stop, record=tmp_path / "out") as run,
        LiveView(run, stop, paused=False) as view,
    ):
        run.finish()
        answer_of(view, "now", page="one")
        waits = Thread(target=view.linger)
        waits.start()
        assert answer_of(view, "now", page="one")["over"]
        assert waits.is_alive()
        view.do({"action": "leave", "value": "one"})
        waits.join(30)
        assert not waits.is_alive()
