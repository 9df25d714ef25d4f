"""Skills with free axes of the tool, for arms with five joints and with six."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bt_dualarm
from bt_dualarm import Run
from tests.families import some

ALL = ["rx", "ry", "rz"]


def file_with(robot: str, *leaves: Any, **arm: Any) -> dict[str, Any]:
    return {
        "bt_dualarm": 1,
        "name": "free",
        "world": {"scene": "empty", "time_limit": 60, "reality": "lab"},
        "arms": {"arm1": {"robot": robot, "tree": {"sequence": [*leaves]}, **arm}},
    }


def played(file: dict[str, Any], **options: Any) -> Run:
    with bt_dualarm.open(file, **options) as run:
        run.finish()
    return run


TARGETS: dict[str, Any] = {
    "so100": {"plane": "xz", "step": [0.03, -0.03, 0.05], "there": [0.10, -0.18, 0.05]},
    "so101": {"plane": "yz", "step": [0.03, 0.03, 0.05], "there": [0.17, 0.10, 0.05]},
}


@pytest.mark.usefixtures("without_plots")
@pytest.mark.parametrize("robot", some(TARGETS, 2))
def test_five_joints_execute_motions_with_enough_free_axes(robot: str, tmp_path: Path) -> None:
    """Lines, curves and poses outside the vertical plane of the arm."""
    target = TARGETS[robot]
    x, y, z = target["there"]
    file = file_with(
        robot,
        {"reach_to_pose": {"to": {"xyz": [x, y, z], "rpy": [180, 0, 70]}, "free": ["rz"]}},
        "go_home",
        {"move_linear": {"offset": {"xyz": target["step"]}, "free": ALL}},
        {"circle": {"plane": target["plane"], "radius": 0.03, "free": ALL, "end": "center"}},
        {"move_through": {"poses": [{"xyz": [x, y, z + 0.05]}, {"xyz": [x, y, z]}], "free": ALL}},
        {"follow_path": {"points": [[0, 0], [20, 0], [20, 20]], "plane": "xy", "free": ALL}},
        "go_home",
    )
    run = played(file, record=tmp_path / "out")
    assert run.result.outcome == "SUCCESS", run.result.arms["arm1"].runs
    arm = run.result.arms["arm1"]
    assert arm.clipped_setpoints == 0
    turned = arm.runs[0].metrics
    assert turned["position_error_m"] < 1e-3
    assert turned["angle_error_rad"] < 0.01
    for leaf in arm.runs:
        assert leaf.metrics.get("path_max_m", 0.0) < 1e-3, leaf.skill


@pytest.mark.parametrize("robot", ["ur5", "panda"])
def test_free_axis_avoids_a_rotation_of_the_tool(robot: str) -> None:
    """The nearest of the allowed orientations is used: the tool does not turn about its axis."""
    moved = []
    for free in (None, ["rz"]):
        leaf: dict[str, Any] = {"offset": {"xyz": [0, 0.05, 0], "rpy": [0, 0, 120]}}
        file = file_with(robot, {"reach_to_pose": leaf | ({"free": free} if free else {})})
        run = played(file, seed=0)
        assert run.result.outcome == "SUCCESS"
        arm = run.world.arms["arm1"]
        moved.append(float(np.abs(arm.q - arm.robot.postures["home"]).max()))
    turned, spared = moved
    assert turned > 1.5
    assert spared < 0.5


def test_missing_free_axis_fails_without_motion_and_is_suggested() -> None:
    file = file_with(
        "so101", {"move_linear": {"offset": {"xyz": [0, 0.05, 0], "rpy": [20, 30, 0]}}}
    )
    (leaf,) = played(file).result.arms["arm1"].runs
    assert leaf.status == "FAILURE"
    assert "free: [rz]" in leaf.reason


TO = {"xyz": [0.2, 0.1, 0.1], "rpy": [90, 0, 0]}
"""A point that the tool of an SO-101 reaches, with an orientation that is impossible there."""


@pytest.mark.parametrize(
    ("free", "message"),
    [
        (["rx", "rz"], "leave one of rx and rz free, or all of rx, ry, rz"),
        (["rz", "rz"], "names rz, rz: each once"),
        (["z"], "expected one of rx, ry, rz, not text 'z'"),
        ("rz", "expected a list, not text 'rz'"),
    ],
)
@pytest.mark.parametrize("kind", ["reach_to_pose", "move_linear"])
def test_invalid_free_axes_are_refused(kind: str, free: Any, message: str) -> None:
    (problem,) = bt_dualarm.check(file_with("so101", {kind: {"to": TO, "free": free}}))
    assert problem.severity == "error"
    assert message in str(problem)


def test_free_axes_and_keep_exclude_each_other() -> None:
    leaf = {"to": TO, "free": ["rz"], "keep": {"upright": 5}}
    (problem,) = bt_dualarm.check(file_with("so101", {"move_linear": leaf}))
    assert "give at most one of: free, keep" in str(problem)


@pytest.mark.parametrize("robot", ["so101", "ur5"])
def test_check_warns_of_poses_that_five_joints_cannot_reach(robot: str) -> None:
    """It suggests a free axis. With free rotation, or with six joints, there is no warning."""
    problems = bt_dualarm.check(file_with(robot, {"reach_to_pose": {"to": TO}}))
    assert bool(problems) == (robot == "so101")
    for problem in problems:
        assert problem.severity == "warning"
        assert "not in this orientation" in problem.message
        assert "free: [rz]" in problem.hint
    assert not bt_dualarm.check(file_with(robot, {"reach_to_pose": {"to": TO, "free": ALL}}))
