"""The page of a record, and of the past of a live run, shows the same run at every time."""

from __future__ import annotations

import base64
import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Thread

import cv2
import numpy as np
import pytest

import bt_dualarm
from bt_dualarm.core.errors import DualArmError
from bt_dualarm.replay.record import Record, ReplayError
from bt_dualarm.replay.timeline import recorded_frames
from bt_dualarm.runtime.interruption import StopRequest
from bt_dualarm.viewer.events import rows_of
from bt_dualarm.viewer.live_view import LiveView
from bt_dualarm.viewer.past import RecordView
from bt_dualarm.viewer.server import Served
from bt_dualarm.viewer.signals import COLUMNS
from tests.listening import HEEDING
from tests.replay.runs import SHORT, recorded, write_short
from tests.viewer.browsers import Browser

FAILING = SHORT.replace(
    'reach_to_pose: {offset: "{goal}"}', "reach_to_pose: {offset: {xyz: [3, 0, 0]}}"
)
SEEING = """\
bt_dualarm: 1
name: seeing
world: {scene: empty, time_limit: 20}
objects:
  ball: {shape: sphere, size: [0.04], color: yellow, mass: 1, pose: {xyz: [0.9, 0.0, 0.04]}}
arms:
  arm1:
    robot: ur5
    base: {xyz: [0, 0, 0]}
    posture: present
    camera: {mount: wrist, fps: 30}
    tree: {wait: {seconds: 1.2}}
"""


@contextmanager
def shown(folder: Path) -> Iterator[Browser]:
    """A client of the served page of a record."""
    served = Served(RecordView(folder))
    served.begin()
    try:
        yield Browser(served.url)
    finally:
        served.end()


@pytest.fixture(scope="module")
def failed(tmp_path_factory: pytest.TempPathFactory) -> Record:
    return recorded(tmp_path_factory.mktemp("failed"), FAILING)


def numbers(text: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), np.float32)


def test_record_is_shown_at_any_time(failed: Record) -> None:
    """Statuses, poses and keys are those at the time; the scene is that of its generation."""
    with shown(failed.folder) as browser:
        now = browser.now()
        assert (now["kind"], now["until"]) == ("record", pytest.approx(failed.until, abs=1e-3))
        early, late = (browser.fetch(f"at?t={time}") for time in (0.3, failed.until))
        [arm] = early["arms"]
        assert [node["status"] for node in arm["nodes"]] == [
            "RUNNING",
            "SUCCESS",
            "RUNNING",
            "RUNNING",
            "INVALID",
        ]
        assert [key["key"] for key in arm["board"]] == ["goal"]
        assert late["arms"][0]["nodes"][-1]["reason"].startswith("INVALID_TARGET: ")
        assert late["arms"][0]["outcome"] == "FAILURE"
        assert not np.allclose(numbers(early["poses"]), numbers(late["poses"]), atol=1e-3)
        scene = browser.fetch(f"scene?generation={early['generation']}")
        assert len(numbers(early["poses"])) > 7 * max(s["body"] for s in scene["shapes"])


def test_signals_and_log_cover_the_whole_record(failed: Record) -> None:
    with shown(failed.folder) as browser:
        rows = numbers(browser.fetch("series")["arms"]["arm1"]).reshape(-1, len(COLUMNS))
        np.testing.assert_allclose(rows[[0, -1], 0], failed.times[[0, -1]], atol=1e-3)
        assert np.ptp(rows[:, 1:4], axis=0).max() == pytest.approx(0.06, abs=0.01), "aside"
        lines = browser.fetch("log?after=0")["lines"]
        assert len([line for line in lines if "→" in line["text"]]) == len(failed.events)
        assert any("FAILURE INVALID_TARGET" in line["text"] for line in lines)


def test_reasons_are_those_of_bt_why(failed: Record) -> None:
    with shown(failed.folder) as browser:
        [story] = browser.fetch("why?of=arm1:sequence/reach_to_pose")["stories"]
        assert "outside the reach" in story["causes"][0]["sentence"]
        [running] = browser.fetch("why?of=arm1:sequence&t=0.3")["stories"]
        assert (running["status"], running["leaf"]) == ("RUNNING", "sequence/aside/reach_to_pose")
        status, reply = browser.ask("why?of=arm1:nonsense")
        assert (status, reply.split(b";")[0]) == (400, b"no node is called 'arm1:nonsense'")


@pytest.mark.parametrize(
    "question",
    [
        *("at", "at?t=x", "at?t=-1", "at?t=nan", "at?t=1e99", "at?a=1&b=1&c=1&d=1&e=1"),
        *("mesh?name=x", "scene", "scene?generation=77", "eye?arm=arm1&t=0", "eye?t=0"),
        f"why?of={'x' * 600}",
    ],
)
def test_invalid_request_is_refused(failed: Record, question: str) -> None:
    with shown(failed.folder) as browser:
        assert browser.ask(question)[0] == 400
        assert browser.ask("do", {"action": "go"})[0] == 400
        assert browser.ask("elsewhere")[0] == 403


def test_contact_force_equals_the_weight(tmp_path: Path) -> None:
    """Of a ball of 1 kg on the floor."""
    bt_dualarm.run(SEEING, record=tmp_path / "out")
    view = RecordView(tmp_path / "out")
    moment = json.loads(view.questions["at"]({"t": "1.1"}).content)
    [contact] = [each for each in moment["contacts"] if "ball" in each["between"]]
    assert abs(contact["force"][2]) == pytest.approx(9.81, rel=0.02)
    assert contact["point"][2] == pytest.approx(0.0, abs=0.005)


def test_camera_image_is_rendered_again(tmp_path: Path) -> None:
    bt_dualarm.run(SEEING, record=tmp_path / "out")
    view = RecordView(tmp_path / "out")
    content = view.questions["eye"]({"arm": "arm1", "t": "0.5"}).content
    image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    [camera] = json.loads(view.questions["at"]({"t": "0.5"}).content)["cameras"]
    assert image.shape[:2] == tuple(camera["size"][::-1])
    assert len(np.unique(image.reshape(-1, 3), axis=0)) > 20


def test_recorded_camera_images_are_shown(tmp_path: Path) -> None:
    """They contain the camera's noise, unlike images that are rendered again."""
    tree = SEEING.replace("{wait: {seconds: 1.2}}", "{wait_for: {object: ball, wait: 1}}")
    shown = []
    for name, frames in (("kept", True), ("drawn", False)):
        bt_dualarm.run(tree, record=tmp_path / name, frames=frames, reality="rough")
        record = Record.read(tmp_path / name)
        stamp = next(event["stamp"] for event in record.notes if event["kind"] == "frame")
        view = RecordView(tmp_path / name)
        shown.append(view.questions["eye"]({"arm": "arm1", "t": f"{stamp}"}).content)
    [kept, *_] = recorded_frames(Record.read(tmp_path / "kept"))
    assert shown[0] == kept.whole
    assert shown[1] != kept.whole


def test_past_of_a_live_run_is_shown(tmp_path: Path) -> None:
    """The view of a past time is the same as at that time."""
    stop = StopRequest()
    tree = write_short(tmp_path / "trees")
    with (
        bt_dualarm.open(tree, stop=stop, record=tmp_path / "out") as run,
        LiveView(run, stop) as view,
    ):
        view.gate.set_speed(None)
        view.gate.set_breakpoints(["aside SUCCESS"])

        def finish() -> None:
            view.gate.hold()
            run.finish()

        thread = Thread(target=finish)
        thread.start()
        try:
            browser = Browser(view.url)
            browser.now()
            for asked in ("why", "why?of=arm1:sequence&t=0", "at?t=0", "eye?arm=arm1&t=0"):
                assert browser.ask(asked) == (400, b"nothing has happened yet: press Go")
            browser.press("go")
            held = browser.held()
            [key] = held["arms"][0]["board"]
            assert (key["key"], key["leaf"]) == ("goal", "sequence/set")
            then = browser.fetch("at?t=0.5")
            assert then["time"] == pytest.approx(0.5, abs=0.02)
            assert then["arms"][0]["nodes"][2]["status"] == "RUNNING"
            [story] = browser.fetch(f"why?of=arm1:sequence&t={held['time']}")["stories"]
            assert story["status"] == "RUNNING"
            assert browser.fetch("log?after=0")["next"] >= 5
            browser.press("break", "")
            browser.press("go")
            thread.join(60)
        finally:
            stop.ask()
            thread.join(30)


def test_missing_record_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(ReplayError, match="there is no folder"):
        RecordView(tmp_path / "nothing")


@pytest.mark.parametrize("host", ["0.0.0.0", "example.org", "::1", "224.0.0.1"])  # noqa: S104 - it is refused
def test_server_listens_on_one_interface_only(failed: Record, host: str) -> None:
    with pytest.raises(DualArmError, match=r"IPv4 address|one interface"):
        Served(RecordView(failed.folder), 0, host)


def test_command_serves_the_page_until_it_is_interrupted(failed: Record) -> None:
    program = f"{HEEDING}import bt_dualarm.cli as cli, sys; sys.exit(cli.replay())"
    command = [sys.executable, "-c", program, str(failed.folder)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        reply = process.stderr.readline()
        assert reply.startswith("serving until Ctrl-C: http://127.0.0.1:")
        assert Browser(reply.split()[-1]).now()["name"] == "short"
        process.send_signal(2)
        assert process.wait(30) == 130


def test_halted_tree_keeps_the_status_of_finished_nodes(tmp_path: Path) -> None:
    """As in the live page and the terminal, running nodes are shown as halted."""
    tree = write_short(tmp_path / "trees")
    with bt_dualarm.open(tree, record=tmp_path / "out", duration=0.5) as run:
        run.finish()
        [live] = run.views()
    view = RecordView(tmp_path / "out")
    until = Record.read(tmp_path / "out").until
    [arm] = json.loads(view.questions["at"]({"t": f"{until}"}).content)["arms"]
    now = [(row["status"], row["halted"], row["since"]) for row in rows_of(live.tree)]
    assert [(row["status"], row["halted"], row["since"]) for row in arm["nodes"]] == now
    assert [status for status, _, _ in now] == ["INVALID", "SUCCESS", *["INVALID"] * 3]
    assert [halted for _, halted, _ in now] == [True, False, True, True, False]


def test_diverged_run_is_shown_to_its_end(tmp_path: Path) -> None:
    """It ends one step after the last kept state; its last time shows the tree halted."""
    alone = SHORT.replace("include: [parts.yaml]\n", "").partition("    tree:")[0]
    folder = Path(__file__).parents[1] / "faults" / "skills"
    tree = f"{alone}    tree: {{poison: {{after: 0.2}}}}\n"
    bt_dualarm.run(tree, record=tmp_path / "out", skills=[folder])
    record = Record.read(tmp_path / "out")
    assert record.events[-1]["time_s"] > record.until
    [arm] = json.loads(
        RecordView(tmp_path / "out").questions["at"]({"t": f"{record.until}"}).content
    )["arms"]
    assert [(row["status"], row["halted"]) for row in arm["nodes"]] == [("INVALID", True)]
