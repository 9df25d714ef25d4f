"""Viewing, holding and stepping do not change a run, and only its own page may control it."""

from __future__ import annotations

import http.client
import json
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Thread
from urllib.parse import quote

import numpy as np
import pytest

import bt_dualarm
from bt_dualarm.behaviors.report import StatusChange
from bt_dualarm.runtime.interruption import StopRequest
from bt_dualarm.runtime.run import Run
from bt_dualarm.viewer.live_view import LiveView, Snapshot
from bt_dualarm.viewer.server import Gate, GateError, whole_page
from tests.replay.runs import write_short
from tests.viewer.browsers import Browser


@contextmanager
def watched(tree: Path, *, paused: bool = True) -> Iterator[tuple[Run, Browser, Thread]]:
    """A run that a thread advances, and a client of its page."""
    stop = StopRequest()
    with (
        bt_dualarm.open(tree, stop=stop) as run,
        LiveView(run, stop, paused=paused) as view,
    ):
        view.gate.set_speed(None)

        def finish() -> None:
            view.gate.hold()
            run.finish()

        thread = Thread(target=finish)
        thread.start()
        try:
            yield run, Browser(view.url), thread
        finally:
            stop.ask()
            thread.join(30)


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    return write_short(tmp_path / "trees")


def test_holding_and_stepping_do_not_change_the_hash(tree: Path) -> None:
    plain = bt_dualarm.run(tree).state_sha256
    rng = np.random.default_rng(3)
    with watched(tree) as (run, browser, thread):
        for _ in range(25):
            browser.press(str(rng.choice(["step", "tick", "step", "pause"])))
            browser.held()
        browser.press("go")
        thread.join(60)
        assert run.result.state_sha256 == plain


STANDING = """\
bt_dualarm: 1
world: {scene: empty, reality: rough}
objects:
  can: {shape: cylinder, size: [0.025, 0.088], mass: 0.187, pose: {xyz: [0.3, -0.3, 0.0445]}}
arms: {arm1: {robot: panda, gripper: robotiq_2f85, tree: {wait: 1}}}
"""


def test_contact_forces_add_up_to_the_weight_while_fingers_meet_their_stops() -> None:
    """Forces of other constraints were read where those of stops had come or gone in a step."""
    with bt_dualarm.open(STANDING) as run:
        snapshot = Snapshot(run.world, run.assembly.arms, run.views)
        run.step(0.1)
        shown = []
        for _ in range(100):
            run.step(0.002)
            snapshot.take()
            contacts = [one for one in snapshot.now["contacts"] if "can" in one["between"]]
            shown.append(sum(abs(one["force"][2]) for one in contacts))
    assert shown == pytest.approx(np.full(100, 0.187 * 9.81), abs=0.3)


def test_step_advances_one_step_and_tick_to_the_next_tick(tree: Path) -> None:
    with watched(tree) as (run, browser, _):
        assert browser.held()["time"] == 0.0
        browser.press("step")
        first = browser.held()
        assert (first["time"], first["why"]) == (pytest.approx(0.002), "one step")
        browser.press("tick")
        assert browser.held()["time"] == pytest.approx(0.022), "50 ticks a second"
        assert run.time == pytest.approx(0.022)


def test_breakpoint_holds_the_run_where_the_node_changes(tree: Path) -> None:
    with watched(tree) as (_, browser, _):
        browser.press("break", "reach_to_pose SUCCESS\n\n")
        browser.press("go")
        found = browser.held()
        assert found["why"] == "arm1:sequence/aside/reach_to_pose → SUCCESS"
        assert found["breakpoints"] == ["reach_to_pose SUCCESS"]
        [arm] = found["arms"]
        states = {(node["depth"], node["name"]): node["status"] for node in arm["nodes"]}
        assert states[(1, "aside")] == "SUCCESS"


def test_scene_contains_meshes_of_existing_bodies(tree: Path) -> None:
    """The visual meshes of the robot can be fetched by name."""
    with watched(tree) as (run, browser, _):
        scene = json.loads(browser.ask("scene")[1])
        assert browser.now()["name"] == "short"
        bodies = run.world.model.nbody
        assert max(shape["body"] for shape in scene["shapes"]) < bodies
        assert len(browser.now()["poses"]) == -(-7 * 4 * bodies // 3) * 4
        meshes = {name: browser.ask(f"mesh?name={quote(name)}") for name in scene["meshes"]}
        assert {status for status, _ in meshes.values()} == {200}
        triangles = 0
        for _, content in meshes.values():
            vertices, faces = np.frombuffer(content[:8], np.uint32).tolist()
            assert len(content) == 32 + 9 * vertices + 6 * faces
            triangles += faces
        assert triangles > 50_000, "visual meshes of a UR5, not its convex hulls"
        assert browser.ask("mesh?name=nothing")[0] == 400


def test_unauthorized_requests_are_refused(tree: Path) -> None:
    """Without the token, or with another host, origin or content type, nothing happens."""
    with watched(tree) as (_, browser, _):
        port = browser.place.port
        go = {"action": "go"}
        refused = [
            browser.ask("now", token=False),
            browser.ask("0123456789abcdef012345/now", token=False),
            browser.ask("now", Host=f"evil.example:{port}"),
            browser.ask("now", Host="127.0.0.1"),
            browser.ask("now", Origin="http://evil.example"),
            browser.ask("now", Origin="null"),
            browser.ask("do", go, Origin=f"http://127.0.0.1:{(port or 0) + 1}"),
            browser.ask("do", go, Host=f"evil.example:{port}"),
            browser.ask("do", go, Content_Type="text/plain"),
            browser.ask("do", go, token=False),
            browser.ask("../do", go),
        ]
        assert {status for status, _ in refused} == {403}
        assert {content for _, content in refused} == {b"nothing is served here"}
        assert browser.now()["paused"]
        assert browser.ask("now", Origin=f"http://127.0.0.1:{port}")[0] == 200


@pytest.mark.parametrize(
    "body",
    [
        b"",
        b"{",
        b"[]",
        b"[" * 15_000,
        b" " * 30_000,
        {"action": "explode"},
        {"action": "speed", "value": "fast"},
        {"action": "speed", "value": -1},
        {"action": "speed", "value": [1]},
        {"action": "speed", "value": True},
        {"action": "speed", "value": 10**400},
        {"action": "speed", "value": -(10**400)},
        b'{"action": "speed", "value": 1e999}',
        b'{"action": "speed", "value": NaN}',
        b'{"action": "speed", "value": ' + b"9" * 15_000 + b"}",
        {"action": "break", "value": 10**4000},
        {"action": "break", "value": "x\n" * 60},
        {"action": "break", "value": "x" * 400},
        {"action": {"action": "go"}},
    ],
)
def test_invalid_command_is_refused_without_effect(tree: Path, body: object) -> None:
    with watched(tree) as (_, browser, _):
        status, content = browser.ask("do", body)
        assert status == 400
        assert content
        state = browser.now()
        assert (state["paused"], state["speed"], state["breakpoints"]) == (True, None, [])


def test_dropped_connections_do_not_affect_the_run(tree: Path) -> None:
    plain = bt_dualarm.run(tree).state_sha256
    with watched(tree) as (run, browser, thread):
        browser.press("go")
        for _ in range(100):
            connection = http.client.HTTPConnection("127.0.0.1", browser.place.port or 0)
            connection.connect()
            connection.sock.sendall(b"GET /x HTTP/1.1\r\nHost: \xff\xfe\r\n")
            connection.close()
        thread.join(60)
        assert run.result.state_sha256 == plain


def test_held_run_ends_on_a_stop_request(tree: Path) -> None:
    stop = StopRequest()
    with bt_dualarm.open(tree, stop=stop) as run, LiveView(run, stop) as view:
        Thread(target=stop.ask).start()
        view.gate.hold()
        assert run.finish().ending == "a stop was requested"


def test_speed_limits_simulated_time(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [100.0]
    monkeypatch.setattr("bt_dualarm.viewer.server.time.monotonic", lambda: clock[0])
    slept: list[float] = []

    def sleep(seconds: float) -> None:
        slept.append(seconds)
        clock[0] += seconds

    monkeypatch.setattr("bt_dualarm.viewer.server.time.sleep", sleep)
    gate = Gate(lambda: False, paused=False, speed=2.0)
    for step in range(500):
        gate.after_step(0.002 * (step + 1))
    assert clock[0] - 100.0 == pytest.approx(499 * 0.002 / 2.0)
    gate.set_speed(None)
    del slept[:]
    gate.after_step(9.0)
    assert slept == []
    with pytest.raises(GateError, match=r"from 0\.001 to 1000"):
        gate.set_speed(float("nan"))


def test_breakpoint_is_a_node_a_status_or_both() -> None:
    change = StatusChange(1.0, "arm1", "main/circle", "circle", "RUNNING", "FAILURE")
    for name, holds in (
        ("circle", True),
        ("main/circle", True),
        ("FAILURE", True),
        ("circle FAILURE", True),
        ("circle SUCCESS", False),
        ("SUCCESS", False),
        ("line", False),
    ):
        gate = Gate(lambda: False, paused=False)
        gate.set_breakpoints([name])
        gate.on_event(change)
        assert gate.state["paused"] is holds, name


def test_command_prints_the_address_and_waits(tree: Path) -> None:
    program = "import bt_dualarm.cli as cli, sys; sys.exit(cli.run())"
    command = [sys.executable, "-c", program, str(tree), "--view", "--display", "quiet"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        reply = process.stderr.readline()
        assert reply.startswith("waiting for Go at http://127.0.0.1:")
        browser = Browser(reply.split()[-1])
        assert browser.ask("")[1].decode() == whole_page()
        browser.press("speed", None)
        browser.press("go")
        assert process.wait(60) == 0


def test_file_saved_while_the_run_is_held_is_reloaded(tree: Path) -> None:
    """The page shows errors of the file; a valid file is displayed at once."""
    program = "import bt_dualarm.cli as cli, sys; sys.exit(cli.run())"
    command = [sys.executable, "-c", program, str(tree), "--view", "--watch", "--display", "quiet"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stderr is not None
            browser = Browser(process.stderr.readline().split()[-1])
            browser.press("tick")
            browser.held()
            text = tree.read_text()
            tree.write_text(text.replace("reach_to_pose", "reach"))
            reply = browser.until("log?after=0", lambda log: "saved with errors" in str(log))
            assert "there is no node or skill" in str(reply)
            tree.write_text(
                text.replace('reach_to_pose: {offset: "{goal}"}', "wait: {seconds: 0.1}")
            )
            now = browser.until("now", lambda now: now["arms"][0]["nodes"][-1]["kind"] == "wait")
            assert now["held"]
            browser.press("speed", None)
            browser.press("go")
            assert process.wait(60) == 0
        finally:
            process.kill()


def test_two_browsers_share_one_state(tree: Path) -> None:
    plain = bt_dualarm.run(tree).state_sha256
    with watched(tree) as (run, browser, thread):
        other = Browser(browser.url)
        other.press("tick")
        assert browser.held()["time"] == other.held()["time"]
        browser.press("break", "FAILURE")
        assert other.now()["breakpoints"] == ["FAILURE"]
        other.press("go")
        thread.join(60)
        assert run.result.state_sha256 == plain


def test_viewer_is_imported_only_when_used(tree: Path) -> None:
    program = (
        "import bt_dualarm.cli as cli, sys; cli.run([sys.argv[1], '--display', 'quiet']);"
        "late = ('bt_dualarm.viewer', 'bt_dualarm.replay');"
        "sys.exit(any(name.startswith(late) for name in sys.modules))"
    )
    assert subprocess.run([sys.executable, "-c", program, str(tree)], check=False).returncode == 0


def test_page_contacts_no_other_server_and_its_script_is_valid(tmp_path: Path) -> None:
    page = whole_page()
    named = page.replace("http://www.w3.org/2000/svg", "")  # an XML namespace, which is not fetched
    assert "https:" not in named
    assert "http:" not in named
    assert "connect-src 'self'" in page
    node = shutil.which("node")
    if node is None:
        pytest.skip("there is no node to read the page's script")
    script = tmp_path / "page.js"
    script.write_text(page[page.rindex("<script>") + 8 : page.rindex("</script>")])
    assert subprocess.run([node, "--check", script], check=False).returncode == 0
