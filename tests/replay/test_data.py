"""A record as arrays: the simulation's values at each recorded time, and helpful errors."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import bt_dualarm as bt
from bt_dualarm.core.errors import DualArmError
from bt_dualarm.core.pose import Pose

TREE = """\
bt_dualarm: 1
name: comings
world: {scene: empty, reality: lab, time_limit: 20}
objects:
  post: {shape: box, size: [0.1, 0.1, 0.4], mass: 1, fixed: true, pose: {xyz: [1, 1, 0.2]}}
  ball:
    {shape: sphere, size: [0.04], mass: 0.2, color: red, pose: {xyz: [-0.6, -0.6, 0.04]},
     spawned: false}
arms:
  arm1:
    robot: panda
    gripper: panda_hand
    camera: {mount: wrist, resolution: [48, 36], fps: 20}
    tree:
      sequence:
        - spawn: {object: ball}
        - set: {key: goal, value: 3}
        - force_success: {child: {wait_for: {object: ball, wait: 0.3}}}
        - open_gripper: {width: 0.02}
        - spawn: {arm: arm2}
        - move_joints: {by: [5, 0, 0, 0, 0, 0, 0]}
        - remove: {object: ball}
        - wait: {seconds: 0.2}
  arm2:
    robot: ur5
    base: {xyz: [0, 1.5, 0]}
    spawned: false
    tree: {wait: {seconds: 0.1}}
"""


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("data") / "out"
    assert bt.run(TREE, record=folder, frames=True).outcome is bt.Outcome.SUCCESS
    return folder


@pytest.fixture(scope="module")
def data(record: Path) -> bt.RunData:
    return bt.load(record)


def test_arrays_have_the_values_of_the_simulation(data: bt.RunData, record: Path) -> None:
    """Tools and objects are where `samples.npz`, which the run writes itself, has them."""
    samples = np.load(record / "samples.npz")
    for name, positions in (
        ("tool_arm1", data.arms["arm1"].tool_position),
        ("tool_arm2", data.arms["arm2"].tool_position),
        ("object_post", data.objects["post"].position),
    ):
        known = ~np.isnan(positions[:, 0]) & (data.time < samples["time"][-1])
        sampled = ~np.isnan(samples[name][:, 0])
        assert known.sum() > 5, "there are states to compare"
        spline = CubicSpline(samples["time"][sampled], samples[name][sampled])
        errors = np.linalg.norm(positions[known] - spline(data.time[known]), axis=1)
        assert np.median(errors) < 1e-5, "they are samples of the same motion"
        assert errors.max() < 2e-4, "where a motion begins, 10 ms apart"


def test_arrays_have_one_row_for_each_state(data: bt.RunData) -> None:
    count = len(data.time)
    assert np.allclose(np.diff(data.time), 0.02)
    for arm, dof in (("arm1", 7), ("arm2", 6)):
        track = data.arms[arm]
        assert len(track.joints) == dof
        for values in (track.q, track.v, track.setpoint_q, track.torque):
            assert values.shape == (count, dof)
        assert track.tool_quaternion.shape == (count, 4)
        present = ~np.isnan(track.q[:, 0])
        assert np.abs(track.q - track.setpoint_q)[present].max() < 0.02, "rad, well controlled"
        assert np.allclose(np.linalg.norm(track.tool_quaternion[present], axis=1), 1.0)
    assert {len(column) for column in data.signals.values()} == {count}


def test_absent_arms_and_objects_are_nan(data: bt.RunData) -> None:
    arm = np.isnan(data.arms["arm2"].q[:, 0])
    assert arm[0]
    assert not arm[-1]
    ball = np.isnan(data.objects["ball"].position[:, 0])
    assert not ball[5]
    assert ball[-1], "it was removed"
    assert data.arms["arm2"].gripper is None


def test_the_gripper_width_is_recorded(data: bt.RunData) -> None:
    gripper = data.arms["arm1"].gripper
    assert gripper is not None
    assert gripper.kind == "fingers"
    assert gripper.width[0] == pytest.approx(0.08, abs=2e-3)
    assert gripper.width[-1] == pytest.approx(0.02, abs=2e-3)
    assert gripper.commanded_width[-1] == pytest.approx(0.02, abs=1e-6)
    assert data.signals["arm1.gripper.width_m"] is gripper.width


def test_events_and_blackboard_are_those_of_the_run(data: bt.RunData) -> None:
    assert (data.name, data.seed, data.outcome, data.torn) == ("comings", 0, "SUCCESS", "")
    assert [value for _, value in data.blackboard("arm1")["goal"]] == [3]
    assert data.blackboard("arm2") == {}
    assert data.events[-1]["new"] == "SUCCESS"
    assert data.summary is not None
    assert data.summary["outcome"] == "SUCCESS"


def test_frames_are_images(data: bt.RunData) -> None:
    frames = [*data.frames("arm1")]
    assert len(frames) >= 4
    assert {frame.image.shape for frame in frames} == {(36, 48, 3)}
    assert [frame.time for frame in frames] == sorted(frame.time for frame in frames)
    assert len([*data.frames()]) == len(frames)
    assert [*data.frames("arm2")] == [], "it has no camera"


def test_a_table_has_all_signals(data: bt.RunData) -> None:
    table = data.table()
    assert table.column_names == [*data.signals]
    assert table.num_rows == len(data.time)
    np.testing.assert_array_equal(
        table["arm1.q_rad.panda_joint1"].to_numpy(), data.arms["arm1"].q[:, 0]
    )


def test_a_missing_pyarrow_is_reported(data: bt.RunData, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(DualArmError, match=r"needs pyarrow: pip install 'bt_dualarm\[export\]'"):
        data.table()


def test_a_killed_run_has_all_but_its_end(record: Path, tmp_path: Path) -> None:
    copy = tmp_path / "killed"
    shutil.copytree(record, copy)
    (copy / "summary.json").unlink()
    history = (copy / "run.history").read_bytes()
    (copy / "run.history").write_bytes(history[: int(0.8 * len(history))])
    data = bt.load(copy)
    assert data.outcome is None
    assert data.summary is None
    assert data.torn
    assert len(data.arms["arm1"].q) == len(data.time) > 10
    assert "killed" in repr(data)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("arms", "there is no arm 'amr1'; did you mean 'arm1'"),
        ("blackboard", "there is no arm 'amr1'; did you mean 'arm1'"),
        ("frames", "there is no arm 'amr1'; did you mean 'arm1'"),
    ],
)
def test_unknown_names_get_a_suggestion(data: bt.RunData, name: str, message: str) -> None:
    with pytest.raises(DualArmError, match=message):
        data.arms["amr1"] if name == "arms" else getattr(data, name)("amr1")


def test_a_folder_without_a_record_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DualArmError, match="there is no folder"):
        bt.load(tmp_path / "nowhere")
    with pytest.raises(DualArmError, match=r"contains no record: there is no run\.history"):
        bt.load(tmp_path)


def test_rotations_match_the_poses_of_a_run(tmp_path: Path) -> None:
    """Quaternions are those of the run's own tool pose, up to their sign."""
    tree = {"bt_dualarm": 1, "arms": {"arm1": {"robot": "ur5", "tree": {"wait": {"seconds": 0.1}}}}}
    with bt.open(tree, record=tmp_path / "out") as run:
        run.finish()
        pose = run.arms["arm1"].tool_pose
    arm = bt.load(tmp_path / "out").arms["arm1"]
    found = Pose(arm.tool_position[-1], arm.tool_quaternion[-1])
    assert found.distance(pose) < 1e-4
    assert found.angle(pose) < 1e-4
