"""Rows of the interaction matrix: all operations on a tree file and on its record."""

from __future__ import annotations

import base64
import csv
import hashlib
import json
import re
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from threading import Thread
from typing import Any, Final
from urllib.parse import quote

import cv2
import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from PIL import Image
from pyarrow import parquet

import bt_dualarm as bt
from bt_dualarm.core.errors import RendererError
from bt_dualarm.replay.record import Record
from bt_dualarm.replay.timeline import recorded_frames
from bt_dualarm.runtime.interruption import StopRequest
from bt_dualarm.runtime.outcome import Ending
from bt_dualarm.sim.renderers import choose_renderer
from bt_dualarm.viewer.live_view import LiveView
from bt_dualarm.viewer.past import RecordView
from bt_dualarm.viewer.server import Served
from tests.families import WHOLE
from tests.matrix.columns import Column
from tests.matrix.recordings import Recording, Recordings, driven, output_of, run_of
from tests.viewer.browsers import Browser


@dataclass(frozen=True)
class Cell:
    """A column of the matrix with its recordings, the input of a row.

    Attributes:
        column: The column.
        recordings: Recorded runs of all columns.
        folder: Empty folder of this cell alone.
    """

    column: Column
    recordings: Recordings
    folder: Path

    @property
    def tree(self) -> Path:
        """The tree file."""
        return self.recordings.tree(self.column)

    @property
    def recording(self) -> Recording:
        """The recorded run of the column."""
        return self.recordings.of(self.column)

    @property
    def filmed(self) -> Recording:
        """The recording for videos, which take longer than runs: in ``make matrix`` the whole one
        of generated trees, otherwise the beginning.
        """
        if WHOLE and self.column.content is not None:
            return self.recording
        return self.recordings.beginning(self.column)

    @property
    def skills(self) -> list[str]:
        """``--skills`` with the column's folder of skills, if any."""
        return [] if self.column.skills is None else ["--skills", str(self.column.skills)]

    def check_ending(self, result: bt.RunResult) -> None:
        """Checks that outcome, ending and deciding failure are those of the column."""
        column = self.column
        leaves = [f"{leaf!r}" for arm in result.arms.values() for leaf in arm.leaves.values()]
        assert (result.outcome, result.ending) == (column.outcome, column.ending), leaves
        if column.failed is not None:
            arm, path, code = column.failed
            assert result.arms[arm].leaves[path].code == code

    def check_same_run(self, result: bt.RunResult) -> None:
        """Checks the ending, and that the states are those of the recording."""
        self.check_ending(result)
        assert result.state_sha256 == self.recording.digest


# Operations without a run.


def check(cell: Cell) -> None:
    """``bt-check`` finds no error."""
    output = output_of("bt-check", cell.tree, "--json", *cell.skills)
    problems = json.loads(output.out)
    assert [problem for problem in problems if problem["severity"] == "error"] == []
    assert output.code == 0


def graph_mmd(cell: Cell) -> None:
    """The Mermaid drawing has every arm and every node, each joined to its parent."""
    _drawn(cell, "mmd", r'^  n\d+\("(.*)"\):::', r"^  n\d+ --> n\d+$")


def graph_dot(cell: Cell) -> None:
    """The Graphviz drawing has every arm and every node, each joined to its parent."""
    _drawn(cell, "dot", r"^  n\d+ \[label=(.*), fillcolor", r"^  n\d+ -> n\d+;$")


def _drawn(cell: Cell, form: str, node: str, edge: str) -> None:
    path = cell.folder / f"trees.{form}"
    output = output_of("bt-check", cell.tree, "--graph", path, *cell.skills)
    assert output.code == 0
    text = path.read_text(encoding="utf-8")
    titles = re.findall(node, text, re.MULTILINE)
    run = _opened(cell)
    arms = {name: _names(root) for name, root in run.items()}
    assert len(titles) == len(arms) + sum(map(len, arms.values()))
    assert len(re.findall(edge, text, re.MULTILINE)) == sum(map(len, arms.values()))
    for name in (*arms, *(name for names in arms.values() for name in names)):
        assert any(name in title for title in titles), name


def _opened(cell: Cell) -> dict[str, Any]:
    """Root of each arm's tree before the first tick."""
    with bt.open(cell.tree, **cell.column.options) as opened:
        return {name: tree.snapshot() for name, tree in opened.trees.items()}


def _names(node: Any) -> list[str]:
    return [node.name, *(name for child in node.children for name in _names(child))]


def dry_run(cell: Cell) -> None:
    """Every arm is drawn with every node, and no file is written."""
    output = output_of("bt-run", cell.tree, "--dry-run", *cell.column.arguments)
    assert output.code == 0
    words = "".join(output.out.split())
    for arm, root in _opened(cell).items():
        assert arm in words
        for name in _names(root):
            assert "".join(name.split()) in words, name
    assert [*cell.folder.iterdir()] == []


# Runs.


def record(cell: Cell) -> None:
    """The record is complete: states have the recorded hash, samples all tools and objects."""
    of = cell.recording
    if of.output is not None:
        assert of.output.code == cell.column.exit_code
        assert cell.column.outcome in of.output.out
        for path in of.folder.glob("*.png"):
            assert cv2.imread(str(path)) is not None
    summary = of.summary
    ending = cell.column.ending
    assert (summary["outcome"], summary["ending"]) == (cell.column.outcome, ending)
    assert of.record.torn == ""
    digest = hashlib.sha256()
    for row in range(len(of.record.times)):
        moment = of.record.moment(row)
        for part in (np.float64(moment.time), moment.qpos, moment.qvel):
            digest.update(part.tobytes())
    assert of.record.end is not None
    assert digest.hexdigest() == of.record.end["state_sha256"] == of.digest
    with np.load(of.folder / "samples.npz") as samples:
        expected = {f"tool_{arm}" for arm in of.present} | {f"object_{name}" for name in of.objects}
        assert expected <= set(samples.files)
        for name in expected:
            assert np.isfinite(samples[name]).all(axis=1).any(), name
    assert {arm for arm, _ in of.statuses} == set(of.present)
    for name, arm in summary["arms"].items():
        for leaf in arm["leaves"]:
            assert leaf["code"] != "EXCEPTION", (name, leaf)


def run(cell: Cell) -> None:
    """``bt-run`` draws the trees while they run, and prints their outcomes."""
    if cell.column.stop_at is not None:
        pytest.skip("no command stops a run at a simulated time")
    arguments = ["--display", "live", "--ascii", "--renderer", "ray", *cell.column.arguments]
    output = output_of("bt-run", cell.tree, *arguments)
    assert output.code == cell.column.exit_code
    assert cell.column.outcome in output.out
    if cell.column.failed is not None:
        assert cell.column.failed[2] in output.out


def frames(cell: Cell) -> None:
    """Recording frames does not change the run; the page shows all of them, exports have them."""
    folder = cell.folder / "record"
    result = run_of(cell.column, cell.tree, record=folder, frames=True, renderer="ray")
    cell.check_same_run(result)
    kept = Counter(frame.arm for frame in recorded_frames(Record.read(folder)))
    assert kept == cell.recording.frame_counts
    page = RecordView(folder)
    lasts = {frame.arm: frame for frame in recorded_frames(Record.read(folder))}
    for arm, last in lasts.items():
        shown = page.questions["eye"]({"arm": arm, "t": f"{last.time + 1e-4:.4f}"}).content
        if last.region == (0, 0, *last.size):
            assert shown == last.whole, arm
        else:  # the page renders the surroundings of the recorded region
            left, top, right, bottom = last.region
            buffer = np.frombuffer(shown, np.uint8)
            image = cv2.imdecode(buffer, cv2.IMREAD_COLOR)
            assert image is not None
            part = image[top:bottom, left:right, ::-1].astype(float)
            assert np.abs(part - last.image[top:bottom, left:right]).mean() < 5.0, arm
    target = cell.folder / "run.mcap"
    assert output_of("bt-record", "export", folder, "--mcap", target).code == 0
    with target.open("rb") as file:
        schemas = [schema for schema, _, _ in make_reader(file).iter_messages()]
    images = [schema for schema in schemas if schema and schema.name == "foxglove.CompressedImage"]
    assert len(images) == sum(kept.values())
    for frame in recorded_frames(Record.read(folder)):
        camera = cell.recording.record.arms[frame.arm]["camera"]
        assert frame.image.shape == (*camera["resolution"][::-1], 3)
        assert len(np.unique(frame.image.reshape(-1, 3), axis=0)) > 1


def python_run(cell: Cell) -> None:
    """`bt_dualarm.run` of the file's content as data is the same run."""
    data = yaml.safe_load(cell.tree.read_text(encoding="utf-8"))
    cell.check_same_run(run_of(cell.column, data, renderer="ray"))


def python_step(cell: Cell) -> None:
    """A run that is advanced in uneven steps, and inspected between them, is the same run."""
    rng = np.random.default_rng(0)
    with bt.open(cell.tree, renderer="ray", **cell.column.options) as stepped:
        until = cell.column.stop_at or 1.5
        while not stepped.done and stepped.time < until - 0.2:
            stepped.step(round(float(rng.uniform(0.001, 0.2)), 3))
            for arm in stepped.arms.values():
                if arm.is_present:
                    assert np.isfinite(arm.tool_pose.position).all()
            for tree in stepped.trees.values():
                assert tree.snapshot().status in ("INVALID", "RUNNING", "SUCCESS", "FAILURE")
        result = driven(cell.column, stepped)
    cell.check_same_run(result)


def two_at_once(cell: Cell) -> None:
    """Two runs in one process, one ahead of the other, are each the same run as alone."""
    options = {"renderer": "ray", **cell.column.options}
    until = (cell.column.stop_at or 2.0) - 0.1
    with bt.open(cell.tree, **options) as first, bt.open(cell.tree, **options) as second:
        first.step(0.3)
        while not first.done and first.time < until:
            first.step(0.05)
            if not second.done:
                second.step(0.035)
        results = [driven(cell.column, each) for each in (first, second)]
    for result in results:
        cell.check_same_run(result)


def ideal(cell: Cell) -> None:
    """The run has the expected ending without model errors."""
    _in_reality(cell, "ideal")


def lab(cell: Cell) -> None:
    """The run has the expected ending in ``lab``."""
    _in_reality(cell, "lab")


def rough(cell: Cell) -> None:
    """In ``rough``, no leaf fails by an exception and no arm has a fault."""
    _in_reality(cell, "rough")


def _in_reality(cell: Cell, name: str) -> None:
    result = run_of(cell.column, cell.tree, reality=name, renderer="ray")
    leaves = [leaf for arm in result.arms.values() for leaf in arm.leaves.values()]
    assert not [leaf for leaf in leaves if leaf.code == "EXCEPTION"]
    assert not [arm for arm in result.arms.values() if arm.fault]
    if name == "rough":
        assert result.ending in (cell.column.ending, Ending.FINISHED)
    else:
        cell.check_ending(result)
    assert any(result.reality.values()) == (name != "ideal")
    if result.reality == cell.recording.summary["reality"]:
        assert result.state_sha256 == cell.recording.digest


def renderer_gl(cell: Cell) -> None:
    """The run has the expected ending with OpenGL, and without cameras it is the same run."""
    try:
        choose_renderer("gl")
    except RendererError as error:
        pytest.skip(f"no OpenGL here: {error}")
    result = run_of(cell.column, cell.tree, renderer="gl")
    cell.check_ending(result)
    assert result.renderer == ("gl" if cell.recording.cameras else None)
    if not cell.recording.cameras:
        assert result.state_sha256 == cell.recording.digest


def renderer_ray(cell: Cell) -> None:
    """A run with ray casting that is not recorded is the same run."""
    result = run_of(cell.column, cell.tree, renderer="ray")
    cell.check_same_run(result)
    assert result.renderer == ("ray" if cell.recording.cameras else None)


# Pages.


def view(cell: Cell) -> None:
    """The page shows the run from beginning to end and does not change it."""
    of = cell.recording
    stop = StopRequest()
    options = {"renderer": "ray", "record": cell.folder / "record", **cell.column.options}
    with bt.open(cell.tree, stop=stop, **options) as shown, LiveView(shown, stop) as live:
        live.gate.set_speed(None)
        failure: list[BaseException] = []

        def advance() -> None:
            try:
                live.gate.hold()
                driven(cell.column, shown)
            except BaseException as error:  # noqa: BLE001 - checked by the main thread
                failure.append(error)

        thread = Thread(target=advance)
        thread.start()
        try:
            browser = Browser(live.url)
            assert browser.ask("")[1].lower().startswith(b"<!doctype html>")
            assert browser.held()["time"] == 0.0
            _has_scene(browser, "scene", of)
            for button in ("step", "tick"):
                browser.press(button)
                browser.held()
            browser.press("go")
            while thread.is_alive():
                now = browser.now()  # a request makes the run copy its state
                assert np.isfinite(_numbers(now["poses"])).all()
                thread.join(0.2)
            assert not failure, failure
            shown.write_record()  # as ``bt-run`` does before it lingers
            live._snapshot.take()  # as `LiveView.linger` does
            now = browser.now()
            assert now["over"]
            for arm in now["arms"]:
                if arm["arm"] in of.present:
                    _has_tree(arm, of)
                if shown.arms[arm["arm"]].is_present:
                    if cell.column.ending is not Ending.DIVERGED:  # otherwise the pose is NaN
                        tool = shown.arms[arm["arm"]].tool_pose.position
                        np.testing.assert_allclose(arm["tool"], tool, atol=1e-3)
                        assert np.isfinite(arm["error_deg"])
                else:
                    assert "tool" not in arm
            assert {arm["arm"] for arm in now["arms"]} == set(of.record.arms)
            assert browser.fetch("log?after=0")["next"] >= len(of.events)
            _has_past(browser, of)
        finally:
            stop.ask()
            thread.join(60)
        cell.check_same_run(shown.result)


def replay_served(cell: Cell) -> None:
    """The page of a record shows all its times, and at the end the final statuses of the trees."""
    of = cell.recording
    served = Served(RecordView(of.folder))
    served.begin()
    try:
        browser = Browser(served.url)
        assert browser.ask("")[1].lower().startswith(b"<!doctype html>")
        now = browser.now()
        assert (now["kind"], now["until"]) == ("record", pytest.approx(of.record.until, abs=1e-3))
        for generation in of.record.models:
            _has_scene(browser, f"scene?generation={generation}", of)
        lines = browser.fetch("log?after=0")["lines"]
        assert len([line for line in lines if "→" in line["text"]]) == len(of.events)
        _has_past(browser, of)
        last = browser.fetch(f"at?t={of.record.until}")
        for arm in last["arms"]:
            if arm["arm"] in of.present:
                _has_tree(arm, of)
    finally:
        served.end()


def _has_scene(browser: Browser, request: str, of: Recording) -> None:
    """Shapes belong to existing bodies, and every mesh can be fetched."""
    scene = browser.fetch(request)
    generations = of.record.models
    bodies = max(of.record.model(generation).nbody for generation in generations)
    assert scene["shapes"]
    assert max(shape["body"] for shape in scene["shapes"]) < bodies
    for name in scene["meshes"]:
        status, content = browser.ask(f"mesh?name={quote(name)}")
        assert (status, len(content) > 12) == (200, True), name


def _has_tree(arm: dict[str, Any], of: Recording) -> None:
    """All nodes of an arm are shown with their final statuses."""
    assert len(arm["nodes"]) == of.nodes[arm["arm"]]
    shown = {(arm["arm"], node["path"]): node["status"] for node in arm["nodes"]}
    assert shown == {node: of.statuses.get(node, "INVALID") for node in shown}
    ended = [event for event in of.events if event["new"] == "FAILURE" and event["code"]]
    reasons = {(event["arm"], event["path"]): event["code"] for event in ended}
    for node in arm["nodes"]:
        code = reasons.get((arm["arm"], node["path"]))
        if code and node["status"] == "FAILURE":
            assert node["reason"].startswith(f"{code}: ")


def _has_past(browser: Browser, of: Recording) -> None:
    """Poses, signals, camera images and reasons can be fetched for any time."""
    until = of.record.until
    _has_signals(browser.fetch("series"), of)
    for time in (0.0, until / 2, until):
        then = browser.until(f"at?t={time}", lambda then, t=time: abs(then["time"] - t) < 0.03)  # type: ignore[misc]  # the page reads a growing record now and then
        assert np.isfinite(_numbers(then["poses"])).all()
        then["arms"] = {arm["arm"]: arm for arm in then["arms"]}
        with np.load(of.folder / "samples.npz") as samples:
            row = int(np.searchsorted(samples["time"], then["time"] - 1e-9))
            for arm in of.present:
                tools = samples[f"tool_{arm}"]
                position = tools[min(row, len(tools) - 1)]
                if np.isfinite(position).all() and "tool" in then["arms"][arm]:
                    np.testing.assert_allclose(then["arms"][arm]["tool"], position, atol=0.03)
        for arm in of.cameras:
            if arm in {camera["arm"] for camera in then["cameras"]}:
                status, jpeg = browser.ask(f"eye?arm={arm}&t={time}")
                assert status == 200, jpeg
                image = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
                size = of.record.arms[arm]["camera"]["resolution"]
                assert image is not None
                assert list(image.shape[:2]) == size[::-1]
    assert "stories" in browser.fetch("why")


def _numbers(text: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), np.float32)


def _has_signals(series: dict[str, Any], of: Recording) -> None:
    """Arms and grippers have signals for the whole time in which they are in the world."""
    columns = series["columns"]
    for arm in of.present:
        rows = _numbers(series["arms"][arm]).reshape(-1, len(columns))
        numbers = dict(zip(columns, rows.T, strict=True))
        assert len(rows) > 20 * (rows[-1, 0] - rows[0, 0])
        for name in ("time", "x", "y", "z", "error_deg", "torque_share"):
            assert np.isfinite(numbers[name]).all(), (arm, name)
        assert np.isfinite(numbers["force_n"]).any() == (arm in of.grippers()), arm
        fingers = any(joint.startswith(f"{arm}/gripper/") for joint in of.joints)
        assert np.isfinite(numbers["opening_m"]).any() == fingers, arm


# Records.


def replay_check(cell: Cell) -> None:
    """``bt-replay --check`` reproduces the run up to an external intervention, if any."""
    output = output_of("bt-replay", cell.recording.folder, "--check", "--json", *cell.skills)
    found = json.loads(output.out)
    assert found["agrees"], found
    assert output.code == 0
    if cell.column.repeats:
        assert found["steps"] == cell.recording.record.steps
        assert found["hash_agrees"]
    else:
        assert found["steps"] > 0.7 * cell.recording.record.steps


def resume_third(cell: Cell) -> None:
    """A run resumed at a third of its record is the same run."""
    _resumed(cell, 1 / 3)


def resume_two_thirds(cell: Cell) -> None:
    """A run resumed at two thirds of its record is the same run, and its record can be checked."""
    folder = _resumed(cell, 2 / 3)
    output = output_of("bt-replay", folder, "--check", "--json", *cell.skills)
    assert json.loads(output.out)["agrees"], output.out
    assert output.code == 0


def _resumed(cell: Cell, share: float) -> Path:
    """Folder of the record of the resumed run."""
    of = cell.recording
    column = cell.column
    place = f"{of.folder}@{share * of.record.until:.3f}"
    given = list(column.arguments)
    if column.stop_at is not None:  # the recorded run was stopped and has no other end
        given += ["--duration", str(column.stop_at)]
    folder = cell.folder / "record"
    output = output_of("bt-run", "--resume", place, "--record", folder, "--display", "log", *given)
    assert output.code == column.exit_code, output.err
    assert f"continued from the past of {of.folder} up to " in output.err
    again = Record.read(folder)
    assert again.summary is not None
    assert again.summary["outcome"] == column.outcome
    if column.stop_at is None:
        assert again.summary["state_sha256"] == of.digest
    else:
        steps = round(column.stop_at / float(of.record.start["timestep"]))
        np.testing.assert_array_equal(again.checksums()[:steps], of.record.checksums()[:steps])
    return folder


def why(cell: Cell) -> None:
    """``bt-why`` names the cause of the run's outcome, and the leaves running at a given time."""
    of = cell.recording
    column = cell.column
    reported = json.loads(output_of("bt-why", of.folder, "--json").out)["stories"]
    text = output_of("bt-why", of.folder)
    assert text.code == (0 if reported else 1)
    if column.outcome == "SUCCESS":
        assert reported or "every tree succeeded" in text.out
        for story in reported:  # an arm that was removed on purpose: the story names the remover
            assert of.summary["arms"][story["arm"]]["outcome"] == "REMOVED", story
            assert "remove" in " ".join(cause["sentence"] for cause in story["causes"]), story
    for story in reported:
        assert f"{story['leaf']}" in text.out
        assert of.statuses[story["arm"], story["leaf"]] is not None
    if column.failed is not None:
        arm, leaf, code = column.failed
        assert [(s["arm"], s["leaf"], s["code"]) for s in reported[:1]] == [(arm, leaf, code)]
        assert reported[0]["causes"], "a failure has a cause"
    elif column.outcome != "SUCCESS":
        assert {story["arm"] for story in reported} <= set(of.present)
        assert reported
    for time in (of.record.until / 4, of.record.until / 2):
        then = json.loads(output_of("bt-why", of.folder, f"{time:.3f}", "--json").out)["stories"]
        running = {(s["arm"], s["leaf"]) for s in then if s["status"] == "RUNNING"}
        assert running == {*_running_leaves(of, time)}


def _running_leaves(of: Recording, time: float) -> Iterator[tuple[str, str]]:
    statuses = {
        (event["arm"], event["path"]): event["new"]
        for event in of.events
        if event["time_s"] <= round(time, 3) + 1e-9
    }
    running = {node for node, status in statuses.items() if status == "RUNNING"}
    for arm, path in running:
        if not any(name == arm and other.startswith(f"{path}/") for name, other in running):
            yield arm, path


# Exports.


def _exported(cell: Cell, form: str, name: str, of: Recording | None = None) -> Path:
    target = cell.folder / name
    record = (of or cell.recording).folder
    output = output_of("bt-record", "export", record, f"--{form}", target)
    assert output.code == 0, output.err
    assert f"written: {target}" in output.out
    return target


def html(cell: Cell) -> None:
    """The page makes no requests, and shows the same content as the replay."""
    of = cell.recording
    page = _exported(cell, "html", "page.html").read_text(encoding="utf-8")
    assert "connect-src 'none'" in page
    [kept] = re.findall(r'<script type="text/plain" id="record">([A-Za-z0-9+/=]+)</script>', page)
    shown = json.loads(zlib.decompress(base64.b64decode(kept)))
    assert shown["now"]["until"] == pytest.approx(of.record.until, abs=1e-3)
    lines = shown["log"]["lines"]
    assert len([line for line in lines if "→" in line["text"]]) == len(of.events)
    _has_signals(shown["series"], of)
    generations = {str(moment["generation"]) for moment in shown["moments"]}
    assert generations == set(shown["scenes"])
    for scene in shown["scenes"].values():
        assert scene["shapes"]
        assert set(scene["meshes"]) <= set(shown["meshes"])
    last = shown["moments"][-1]
    assert last["time"] == pytest.approx(of.record.until, abs=1e-3)
    for arm in last["arms"]:
        if arm["arm"] in of.present:
            _has_tree(arm, of)
    for arm, count in of.frame_counts.items():
        assert 0 < len(shown["pictures"][arm]) <= count + 1
    for event in of.events:
        if event["code"]:
            assert f"{event['arm']}:{event['path']}" in shown["why"]["of"]


def mcap(cell: Cell) -> None:
    """Messages include every status, every joint of arms and grippers, and every body."""
    of = cell.recording
    topics: Counter[str] = Counter()
    joints: set[str] = set()
    bodies: set[str] = set()
    with _exported(cell, "mcap", "run.mcap").open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            topics[channel.topic] += 1
            content = json.loads(message.data)
            assert schema is not None
            if schema.name == "foxglove.JointStates":
                joints |= {joint["name"] for joint in content["joints"]}
                values = [value for joint in content["joints"] for value in joint.values()]
                assert np.isfinite([v for v in values if not isinstance(v, str)]).all()
            elif schema.name == "foxglove.FrameTransforms":
                bodies |= {frame["child_frame_id"] for frame in content["transforms"]}
    assert topics["/status"] == len(of.events)
    assert joints >= of.joints, of.joints - joints
    assert bodies >= of.bodies, of.bodies - bodies
    for arm in of.grippers():
        assert any(topic.startswith(f"/{arm}/gripper") for topic in topics), [*topics]


def mp4(cell: Cell) -> None:
    """The video has 25 frames per second and shows motion."""
    of = cell.filmed if WHOLE else cell.recordings.beginning(cell.column, 0.12)
    film = cv2.VideoCapture(str(_exported(cell, "mp4", "film.mp4", of)))
    count = film.get(cv2.CAP_PROP_FRAME_COUNT)
    assert film.get(cv2.CAP_PROP_FPS) == 25
    assert count == pytest.approx(25 * of.record.until, abs=1.0)
    good, first = film.read()
    last = first
    while (read := film.read())[0]:
        last = read[1]
    assert good
    assert len(np.unique(first[:, :880].reshape(-1, 3), axis=0)) > 50
    assert np.abs(first.astype(int) - last)[:, :880].max() > 60


def webp(cell: Cell) -> None:
    """The animation is small and shows motion."""
    path = _exported(cell, "webp", "film.webp", cell.filmed)
    assert path.stat().st_size < 3 * 2**20
    with Image.open(path) as film:
        frames = film.n_frames  # type: ignore[attr-defined]  # an animation has it
        first = np.asarray(film.convert("RGB")).astype(int)
        film.seek(frames - 1)
        later = np.asarray(film.convert("RGB")).astype(int)
    assert frames > 3
    assert np.abs(first - later)[:, :550].max() > 60


def lerobot(cell: Cell) -> None:
    """The data set has a row for each frame, with all joints, grippers and cameras."""
    of = cell.recording
    folder = _exported(cell, "lerobot", "set")
    info = json.loads((folder / "meta" / "info.json").read_text())
    table: Any = parquet.read_table(folder / "data/chunk-000/file-000.parquet")  # type: ignore[no-untyped-call]
    assert table.num_rows == info["total_frames"] > 10
    for feature in ("observation.state", "action"):
        names = info["features"][feature]["names"]
        values = np.array(table[feature].to_pylist(), dtype=float)
        assert values.shape == (table.num_rows, len(names))
        assert np.isfinite(values).all()
        joined = " ".join(names)
        for arm in of.present:
            for joint in of.arm_joints(arm):
                assert joint in joined or joint.partition("/")[2] in joined, joint
        for arm in of.grippers():
            found = [name for name in names if name.startswith(arm) and "gripper" in name]
            assert found, names
    for arm in of.cameras:
        key = f"observation.images.{arm}"
        film = cv2.VideoCapture(str(folder / f"videos/{key}/chunk-000/file-000.mp4"))
        assert film.get(cv2.CAP_PROP_FRAME_COUNT) == info["total_frames"]


def csv_tables(cell: Cell) -> None:
    """Tables include every event, every joint of arms and grippers, and every object."""
    of = cell.recording
    folder = _exported(cell, "csv", "tables")
    tables = {}
    for path in folder.rglob("*.csv"):
        with path.open(encoding="utf-8", newline="") as file:
            tables[path.name] = [*csv.reader(file)]
        assert len({len(row) for row in tables[path.name]}) == 1, path.name
    assert [row[5] for row in tables["events.csv"][1:]] == [event["new"] for event in of.events]
    states = [name for name in tables if name.startswith("states_")]
    columns = {name for table in states for name in tables[table][0]}
    for name in of.joints | (of.objects - _fixed(of)):
        assert any(f" {name}[" in column for column in columns), name
    rows = sum(len(tables[table]) - 1 for table in states)
    assert rows == len(of.record.times)
    for arm in of.present:
        assert len(tables[f"arm_{arm}.csv"]) > 10
    for arm in of.grippers():
        assert any("gripper" in name and arm in name for name in tables), [*tables]


def _fixed(of: Recording) -> set[str]:
    return {name for name, obj in of.record.start["objects"].items() if obj.get("fixed")}


ROWS: Final[dict[str, Callable[[Cell], None]]] = {
    row.__name__: row
    for row in (
        check,
        graph_mmd,
        graph_dot,
        dry_run,
        record,
        run,
        frames,
        python_run,
        python_step,
        two_at_once,
        ideal,
        lab,
        rough,
        renderer_ray,
        renderer_gl,
        view,
        replay_served,
        replay_check,
        resume_third,
        resume_two_thirds,
        why,
        html,
        mcap,
        mp4,
        webp,
        lerobot,
        csv_tables,
    )
}
"""All rows, by name."""

WITHOUT_A_RUN: Final = ("check", "graph_mmd", "graph_dot", "dry_run")
"""Rows that need no recorded run."""

FILMS: Final = ("mp4", "webp")
"""Rows that take far longer than a run."""
