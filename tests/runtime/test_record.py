"""Recorder: complete files with exact fields, and no other files touched."""

from __future__ import annotations

import json
import logging
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure

import bt_dualarm
from bt_dualarm.behaviors.report import LeafReport, StatusChange
from bt_dualarm.core.errors import SkillError
from bt_dualarm.core.pose import Pose
from bt_dualarm.core.share import write_atomically, write_text
from bt_dualarm.runtime import plots
from bt_dualarm.runtime.arm_runtime import ArmView
from bt_dualarm.runtime.interruption import StopRequest
from bt_dualarm.runtime.observations import LogCapture, StateLog
from bt_dualarm.runtime.outcome import (
    ArmResult,
    Ending,
    Holding,
    Outcome,
    RunResult,
    SeriesLog,
    Tracks,
)
from bt_dualarm.runtime.recorder import Recorder, RecordError, RecordFolder
from bt_dualarm.runtime.summary import json_ready
from bt_dualarm.sim.painter import StillRenderer, best_viewpoint

MODEL = """
<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <body name="tool" pos="0 0 1"><joint type="slide" axis="0 0 1"/>
      <geom size="0.02" mass="1" group="3"/><site name="tip" pos="0 0 0.1"/></body>
    <body name="cube" pos="0.5 0 1"><freejoint/>
      <geom size="0.02" mass="1" group="1"/></body>
  </worldbody>
</mujoco>
"""


@dataclass
class Body:
    tool_site: int
    base: Pose = field(default_factory=lambda: Pose.from_rpy((0.0, 0.3, 0.0), (0, 0, 0)))


@dataclass
class Held:
    arm: str
    object: str
    since: float


@dataclass
class FallingWorld:
    """A real simulation: a tool on a rail and a cube, both falling."""

    push: float = 0.0
    generation: int = 0
    attachments: list[Held] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.model: Any = mujoco.MjModel.from_xml_string(MODEL)
        self.data: Any = mujoco.MjData(self.model)
        self.data.qvel[1] = self.push
        self.arms = {"arm1": Body(self.model.site("tip").id)}
        self.objects: dict[str, Any] = {"cube": None}

    @property
    def time(self) -> float:
        return float(self.data.time)

    @property
    def timestep(self) -> float:
        return float(self.model.opt.timestep)

    def object_body(self, name: str) -> int:
        return int(self.model.body(name).id)

    def step(self) -> None:
        """Step; like the world's steps, this ends with up-to-date positions."""
        mujoco.mj_step(self.model, self.data)
        mujoco.mj_kinematics(self.model, self.data)


class View:
    """A run at a moment."""

    def __init__(self, time: float) -> None:
        self.time = time

    def views(self) -> tuple[ArmView, ...]:
        return ()


LEAF = LeafReport(
    "main/circle",
    "circle",
    "SUCCESS",
    0.0,
    0.5,
    metrics={"path_rms_m": np.float64(1e-4), "odd": float("nan")},
)
CHANGE = StatusChange(0.5, "arm1", "main/circle", "circle", "RUNNING", "INVALID", "HALTED")


def result(
    ending: Ending = Ending.FINISHED, series: SeriesLog | None = None, sha256: str = ""
) -> RunResult:
    measured = (series or SeriesLog()).of("arm1")
    arm = ArmResult("arm1", "ur5", Outcome.SUCCESS, 0.5, 3, (LEAF,), series=measured)
    return RunResult(
        ending,
        0.6,
        0.1,
        {"arm1": arm},
        at_rest=True,
        seed=5,
        renderer="ray",
        state_sha256=sha256,
    )


def record(
    folder: Path, *, ending: Ending = Ending.FINISHED, push: float = 0.0, urgent: bool = False
) -> dict[str, Any]:
    world: Any = FallingWorld(push)
    series = SeriesLog()
    states = StateLog(world)
    taken = RecordFolder(folder, ["arm1"])
    recorder = Recorder(folder, world, states, list)
    for step in range(300):
        if step == 100:
            world.attachments.append(Held("arm1", "cube", world.time))
        if step == 200:
            world.attachments.clear()
        if step % 10 == 0:
            recorder.after_ticks(View(world.time))
            series.add("arm1", "main/circle", "planned", world.time, [0.0, step, 0.0])
            series.add("arm1", "main/circle", "executed", world.time, [0.0, step + 0.1, 0.0])
            series.add("arm1", "main/circle", "force_N", world.time, 3.0)
        world.step()
        recorder.after_step(world.time)
        states.after_step(world.time)
    recorder.on_event(CHANGE)
    stop = StopRequest(15, 2) if urgent else StopRequest()
    with taken:
        recorder.write(result(ending, series, states.sha256), stop)
    content: dict[str, Any] = json.loads((folder / "summary.json").read_text())
    return content


@pytest.mark.usefixtures("without_plots")
def test_the_summary_has_exactly_the_fields_that_programs_expect(tmp_path: Path) -> None:
    summary = record(tmp_path / "new" / "folder")
    assert list(summary) == [
        "outcome",
        "ending",
        "error",
        "at_rest",
        "sim_time_s",
        "wall_time_s",
        "real_time_factor",
        "seed",
        "reality",
        "state_sha256",
        "processor",
        "versions",
        "renderer",
        "attachments",
        "attachments_left_out",
        "goals",
        "faults",
        "false_success",
        "arms",
    ]
    assert (summary["outcome"], summary["seed"], summary["renderer"]) == ("SUCCESS", 5, "ray")
    assert summary["real_time_factor"] == 6.0
    assert summary["versions"]["mujoco"] == mujoco.__version__
    assert summary["ending"] == "every tree has ended"
    assert (summary["error"], summary["at_rest"]) == ("", True)
    arm = summary["arms"]["arm1"]
    fields = ["outcome", "robot", "fault", "lives", "lives_left_out"]
    fields += ["clipped_setpoints", "guard", "slow_ticks", "runs_left_out", "leaves"]
    assert list(arm) == fields
    leaf = summary["arms"]["arm1"]["leaves"][0]
    assert list(leaf) == [
        "path",
        "skill",
        "status",
        "started_s",
        "ended_s",
        "code",
        "reason",
        "metrics",
    ]
    assert leaf["metrics"] == {"path_rms_m": 1e-4, "odd": None}


@pytest.mark.usefixtures("without_plots")
def test_an_attachment_is_remembered_after_its_end(tmp_path: Path) -> None:
    (held,) = record(tmp_path)["attachments"]
    assert (held["arm"], held["object"]) == ("arm1", "cube")
    assert held["attached_s"] == pytest.approx(0.2)
    assert held["released_s"] == pytest.approx(0.4)
    assert held["lifted_m"] == 0.0, "it fell"


@pytest.mark.usefixtures("without_plots")
def test_the_events_are_lines_of_json(tmp_path: Path) -> None:
    record(tmp_path)
    (line,) = (tmp_path / "events.jsonl").read_text().splitlines()
    assert json.loads(line) == {
        "time_s": 0.5,
        "arm": "arm1",
        "path": "main/circle",
        "kind": "circle",
        "old": "RUNNING",
        "new": "INVALID",
        "code": "HALTED",
        "reason": "",
        "metrics": {},
    }


@pytest.mark.usefixtures("without_plots")
def test_samples_have_the_positions_of_tools_and_objects(tmp_path: Path) -> None:
    record(tmp_path)
    samples = np.load(tmp_path / "samples.npz")
    time = samples["time"]
    assert np.allclose(np.diff(time), 0.01)
    fall = 0.5 * 9.81 * time**2
    # The semi-implicit integrator falls by g t h / 2 too far: 6 mm in 0.6 s at steps h of 2 ms.
    assert np.allclose(samples["tool_arm1"][:, 2], 1.1 - fall, atol=0.007)
    assert np.allclose(samples["object_cube"][:, 2], 1.0 - fall, atol=0.007)
    early = time < 0.05
    assert np.allclose(samples["object_cube"][early, 2], (1.0 - fall)[early], atol=0.0006)


def test_a_removed_object_is_nan() -> None:
    world: Any = FallingWorld()
    tracks = Tracks(world)
    for step in range(20):
        if step == 10:
            world.objects.clear()
            world.generation += 1
        world.step()
        tracks.after_step()
    assert np.isnan(tracks.positions()["object_cube"][:, 0]).tolist() == [False] * 2 + [True] * 2


@pytest.mark.usefixtures("without_plots")
def test_only_equal_runs_have_equal_hashes(tmp_path: Path) -> None:
    first, again, other = (
        record(tmp_path / str(number), push=push)["state_sha256"]
        for number, push in enumerate((0.0, 0.0, 1e-12))
    )
    assert first == again
    assert first != other


@pytest.mark.usefixtures("without_plots")
def test_a_divergence_leaves_its_last_states(tmp_path: Path) -> None:
    record(tmp_path, ending=Ending.DIVERGED)
    states = np.load(tmp_path / "divergence.npz")
    assert states["qpos"].shape == (250, 8)
    assert states["time"][-1] == pytest.approx(0.6)


def test_last_states_of_another_size_are_left_out(tmp_path: Path) -> None:
    world: Any = FallingWorld()
    log = StateLog(world)
    log.after_step(0.0)
    world.data = mujoco.MjData(mujoco.MjModel.from_xml_string("<mujoco/>"))
    log.after_step(0.0)
    write_atomically(tmp_path / "last.npz", log.write_last)
    assert np.load(tmp_path / "last.npz")["time"].shape == (1,)


def test_plots_are_png_images(tmp_path: Path) -> None:
    record(tmp_path)
    names = sorted(path.name for path in tmp_path.glob("*.png"))
    assert names == ["arm1_plane.png", "arm1_time.png", "overview.png", "scene.png"]
    for path in tmp_path.glob("*.png"):
        assert path.read_bytes().startswith(b"\x89PNG")


def test_the_scene_shows_start_and_end_and_changes_nothing() -> None:
    """A state that diverged cannot be drawn; then only the start is shown."""
    world: Any = FallingWorld()
    start = StillRenderer.of(world)
    for _ in range(100):
        world.step()
    before = world.data.qpos.copy(), world.data.xpos.copy(), world.data.cam_xpos.copy()
    stills = (start, StillRenderer.of(world))
    viewpoint = best_viewpoint(stills, 4 / 3)
    assert viewpoint is not None
    figure: Figure = plots.scene(stills, viewpoint)
    assert [axes.get_title() for axes in figure.axes] == ["start: 0.0 s", "end: 0.2 s"]
    first, last = (np.asarray(axes.images[0].get_array()) for axes in figure.axes)
    assert first.shape == last.shape == (480, 640, 3)
    assert (first != last).any()
    after = world.data.qpos, world.data.xpos, world.data.cam_xpos
    assert all((a == b).all() for a, b in zip(before, after, strict=True))
    world.data.qpos[0] = np.nan
    assert not StillRenderer.of(world).is_sound


def test_an_urgent_end_leaves_out_the_plots_only(tmp_path: Path) -> None:
    assert record(tmp_path, urgent=True)["outcome"] == "SUCCESS"
    assert not list(tmp_path.glob("*.png"))
    assert (tmp_path / "samples.npz").exists()


def test_an_error_plot_is_in_millimeters() -> None:
    series = SeriesLog()
    series.add("arm1", "circle", "planned", [0.0, 1.0], [[0, 0, 0], [0, 1, 0]])
    series.add("arm1", "circle", "executed", [0.0, 1.0], [[0.0, 0.0, 0.0], [0.0, 1.0, 0.002]])
    figure: Figure = plots.over_time(series.of("arm1"), "arm1")
    *coordinates, axes = figure.axes
    assert [one.get_ylabel() for one in coordinates] == ["y [m]", "z [m]"]
    assert axes.get_ylabel() == "planned to executed [mm]"
    assert np.allclose(axes.lines[0].get_ydata(), [0.0, 2.0])


def curve(leaf: str = "arm1") -> SeriesLog:
    """A circle of 2 cm, during the first second."""
    series = SeriesLog()
    turn = np.linspace(0.0, 2 * np.pi, 51)
    points = 0.02 * np.column_stack((np.cos(turn), np.sin(turn), 0 * turn))
    for name in ("planned", "executed"):
        series.add("arm1", leaf, name, turn / (2 * np.pi), points)
    return series


def test_a_plane_shows_only_objects_held_by_its_own_arm() -> None:
    """Another arm's cube a meter away once shrank the curve to a blob."""
    time = np.linspace(0.0, 2.0, 21)
    path = np.column_stack((1.0 + time, time, time))
    paths = {"object_mine": 0.1 * path, "object_other": path}
    carried = plots._carried([Holding("arm1", "mine", 0.5, 1.5)], time, paths)
    figure: Figure = plots.in_plane(curve().of("arm1"), time, carried, "arm1")
    (axes,) = figure.axes
    assert [line.get_label() for line in axes.lines] == ["mine", "executed", "planned"]
    held = np.asarray(axes.lines[0].get_xdata(), float)
    assert np.isnan(held[:5]).all(), "before it was attached"
    assert np.allclose(held[5:], 0.1 + 0.1 * time[5:11])


@settings(max_examples=15)
@given(
    st.sampled_from(("xy", "xz", "yz", "yx", "zy", "zx")),
    st.floats(-0.5, 0.5),
    st.floats(0.0, 0.1),
    st.lists(st.floats(0.0, 1.0), min_size=3, max_size=3),
)
def test_a_leaf_that_reports_its_plane_is_shown_in_it(
    plane: str, tilt: float, offset: float, moved: list[float]
) -> None:
    """However far the target moves along any axis, and for a slightly tilted plane."""
    normal = np.full(3, tilt)
    normal["xyz".index(next(axis for axis in "xyz" if axis not in plane))] = 1.0
    log = SeriesLog()
    for name in ("target", "tracked"):
        log.add("arm1", "track", name, [0.0, 1.0], [[0.0, 0.0, offset], moved])
    log.add("arm1", "track", "plane_normal", 1.0, normal)
    (axes,) = plots.in_plane(log.of("arm1"), np.array([0.0, 1.0]), {}, "arm1").axes
    u, v = sorted(plane)
    assert (axes.get_xlabel(), axes.get_ylabel()) == (f"{u} [m]", f"{v} [m]")
    assert [line.get_label() for line in axes.lines] == ["tracked", "target"]


def test_the_overview_shows_tools_that_stand_still_and_every_base() -> None:
    """A motion of a millimeter once left it empty."""
    still = np.tile([0.5, 0.2, 0.3], (4, 1)) + np.linspace(0, 1e-3, 4)[:, None]
    paths = {"tool_arm1": still, "object_cube": still}
    base = np.array([0.0, -0.4, 0.7])
    figure: Figure = plots.overview(paths, {"arm1": base})
    for axes, (u, v) in zip(figure.axes, ((0, 1), (1, 2)), strict=True):
        marks = {line.get_marker(): line.get_xydata() for line in axes.lines}
        assert np.allclose(marks["o"], still[:1, [u, v]]), "the tool"
        assert np.allclose(marks["s"], base[[u, v]]), "the base"
        assert [text.get_text() for text in axes.texts] == ["arm1"]
    legend: Any = figure.axes[0].get_legend()
    labels = [text.get_text() for text in legend.get_texts()]
    assert labels == ["tool of arm1"], "an object at rest is not shown"


TAKEN_AWAY = """
bt_dualarm: 1
world: {scene: empty}
objects:
  ball: {shape: sphere, size: [0.05], mass: 1, pose: {xyz: [0.6, 0.4, 0.05]}}
arms:
  arm1: {robot: ur5, tree: {wait: 0.3 s}}
faults:
  gone: {kind: removed_object, object: ball, begin: 0.1 s, until: 0.2 s}
"""


def test_the_overview_is_not_widened_by_an_object_far_away(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A fault takes it 50 m away, and puts it back."""
    drawn: list[Any] = []
    overview = plots.overview

    def drawing(paths: Any, *given: Any) -> Figure:
        drawn.append(paths)
        return overview(paths, *given)

    monkeypatch.setattr(plots, "overview", drawing)
    bt_dualarm.run(TAKEN_AWAY, record=tmp_path / "out")
    [paths] = drawn
    heights = paths["object_ball"][:, 2]
    assert np.isnan(heights).mean() == pytest.approx(1 / 3, abs=0.05)
    assert np.nanmax(heights) < 0.1
    assert not np.isnan(heights[[0, -1]]).any()


def test_every_curve_of_the_overview_has_its_own_color() -> None:
    """Colors once repeated from the seventh on."""
    ends = np.array([[0.0, 0.0, 0.0], [0.1, 0.1, 0.1]])
    paths = {f"object_part{number}": ends + 0.01 * number for number in range(40)}
    figure: Figure = plots.overview(paths, {})
    for axes in figure.axes:
        curves = [line.get_color() for line in axes.lines if line.get_marker() == "None"]
        assert len({*map(str, curves)}) == len(curves) == 40
        assert curves[:6] == list(plots.COLORS)
    sixteen = plots.distinct_colors(16)
    rgb = [[int(color[at : at + 2], 16) for at in (1, 3, 5)] for color in sixteen]
    gaps = [np.abs(np.subtract(a, b)).max() for n, a in enumerate(rgb) for b in rgb[:n]]
    assert min(gaps) >= 20, "sixteen colors can be distinguished"


FIXED = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 1" group="0"/>
    <geom name="table" type="box" size="0.5 0.3 0.2" pos="0.1 0.2 0.2" group="0"/>
    <body name="post" pos="0.4 0 1"><geom type="cylinder" size="0.05 0.2" group="1"/>
      <geom name="mark" type="box" size="0.01 0.01 0.01" contype="0" conaffinity="0" group="1"/>
    </body>
    <body name="ball" pos="-0.2 0.1 1"><geom size="0.06" group="1"/></body>
    <body name="cube" pos="0.5 0 1"><freejoint/><geom size="0.02" mass="1" group="1"/></body>
  </worldbody>
</mujoco>
"""


def test_the_overview_shows_fixed_objects() -> None:
    """Table and fixed objects as outlines with their names; neither floor, nor marks, nor cubes."""
    model = mujoco.MjModel.from_xml_string(FIXED)
    fixed = StillRenderer(model, mujoco.MjData(model).qpos.copy(), 0.0).fixed_outlines()
    assert set(fixed) == {"table", "post", "ball"}
    figure: Figure = plots.overview({}, {}, fixed)
    above, beside = figure.axes
    outlines = [np.array(patch.get_path().vertices) for patch in above.patches]
    sizes = [np.ptp(outline, axis=0) for outline in outlines]
    assert np.allclose(sizes, [[1.0, 0.6], [0.12, 0.12], [0.1, 0.1]], atol=1e-3)
    radii = np.linalg.norm(outlines[2] - [0.4, 0.0], axis=1)
    assert np.allclose(radii, 0.05, atol=1e-9), "a round post is round"
    sides = [np.ptp(np.array(patch.get_path().vertices), axis=0) for patch in beside.patches]
    assert np.allclose(sides, [[0.6, 0.4], [0.1, 0.4], [0.12, 0.12]], atol=1e-3)
    assert {text.get_text() for text in above.texts} == {"table", "post", "ball"}
    left, right = above.get_xlim()
    fixed["wall"] = [np.array([[0, 0, 0], [90, 0, 0], [90, 0.1, 2], [0, 0.1, 2]], float)]
    assert plots.overview({}, {}, fixed).axes[0].get_xlim() == (left, right), (
        "a large object does not shrink the rest"
    )


def test_labels_at_one_point_are_one_label() -> None:
    bases = {"left": np.array([0.0, 0.3, 0.7]), "right": np.array([0.9, 0.3, 0.7])}
    above, beside = plots.overview({}, bases).axes
    assert [text.get_text() for text in above.texts] == ["left", "right"]
    assert [text.get_text() for text in beside.texts] == ["left, right"]


def test_an_error_that_a_leaf_reports_is_not_computed_again() -> None:
    """Tracking is evaluated in its plane; the distance in space was half as large again."""
    series = curve("track")
    series.add("arm1", "track", "error_in_plane_m", [0.0, 1.0], [0.001, 0.002])
    figure: Figure = plots.over_time(series.of("arm1"), "arm1")
    assert [axes.get_ylabel() for axes in figure.axes] == [
        "x [m]",
        "y [m]",
        "error in plane [mm]",
    ]


def test_a_series_keeps_its_shape() -> None:
    series = SeriesLog()
    series.add("arm1", "circle", "planned", 0.0, [0, 0, 0])
    with pytest.raises(SkillError, match=r"'planned'.*numbers; they must be points"):
        series.add("arm1", "circle", "planned", 0.1, 7.0)
    with pytest.raises(SkillError, match=r"'other'.*shape"):
        series.add("arm1", "circle", "other", 0.1, [1.0, 2.0])


def test_a_failed_write_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "file"
    write_text(path, "old")

    def fail(_file: object) -> None:
        raise OSError("no space left")

    with pytest.raises(OSError, match="no space"):
        write_atomically(path, fail)
    assert [p.name for p in tmp_path.iterdir()] == ["file"]
    assert path.read_text() == "old"


def test_the_log_keeps_tracebacks(tmp_path: Path) -> None:
    logger = logging.getLogger("bt_dualarm.test")
    world: Any = FallingWorld()
    log = LogCapture()
    recorder = Recorder(tmp_path, world, StateLog(world), log.take)
    with log.during():
        try:
            raise RuntimeError("boom")
        except RuntimeError:
            logger.exception("arm1: the tree raised")
    logger.warning("too late")
    recorder.write(result(), StopRequest())
    text = (tmp_path / "run.log").read_text()
    assert "arm1: the tree raised" in text
    assert "RuntimeError: boom" in text
    assert "too late" not in text


def test_a_full_disk_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    world: Any = FallingWorld()
    recorder = Recorder(tmp_path, world, StateLog(world), list)

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("bt_dualarm.runtime.recorder.write_text", full)
    with pytest.raises(RecordError, match="not complete: No space left"):
        recorder.write(result(), StopRequest())


def test_a_plot_that_cannot_be_drawn_is_left_out_and_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Everything else is written: no data are lost because of a plot."""
    record(tmp_path / "whole")

    def broken(*_: object) -> None:
        raise ZeroDivisionError("in a plot")

    monkeypatch.setattr(plots, "overview", broken)
    with pytest.raises(RecordError, match=r"overview\.png could not be written: ZeroDivisionError"):
        record(tmp_path / "torn")
    written = {path.name for path in (tmp_path / "torn").iterdir()}
    assert written == {path.name for path in (tmp_path / "whole").iterdir()} - {"overview.png"}
    assert "Traceback" in caplog.text


def test_json_has_no_numpy_types_and_no_infinity() -> None:
    assert json_ready({"a": np.float64(0.5), "b": (np.int64(3), float("inf")), "c": True}) == {
        "a": 0.5,
        "b": [3, None],
        "c": True,
    }
