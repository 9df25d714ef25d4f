"""`calibrate` corrects the camera mount from views of a still mark from several sides."""

from __future__ import annotations

from itertools import product
from typing import Any

import pytest

import bt_dualarm as bt
from benchmarks.hand_eye import calibrated, error_of
from tests.families import some


@pytest.mark.parametrize(("reality", "seed"), [("lab", 1), ("rough", 0)])
def test_calibration_reduces_the_mount_error(reality: str, seed: int) -> None:
    """Compared with the simulator: errors of aim and rotation fall to a fifth at most."""
    before, after, leaf = calibrated("panda", reality, seed)
    assert leaf.status == "SUCCESS", leaf.reason
    assert before.aim_mm > 1.0
    assert after.aim_mm < 0.2 * before.aim_mm
    assert after.turn_deg < 0.2 * before.turn_deg
    assert float(leaf.metrics["residual_px"]) < 0.2 < float(leaf.metrics["residual_before_px"])
    assert leaf.metrics["views"] == 10


@pytest.mark.parametrize(("robot", "reality"), some(product(["xarm7", "ur3"], ["lab", "rough"]), 4))
def test_unreachable_viewpoints_are_replaced(robot: str, reality: str) -> None:
    """From a tilted base, a mark near the limit of the workspace has only five reachable views."""
    near = 0.45 if robot == "xarm7" else 0.38
    mark = {"xyz": [near, 0.1, 0.5]}
    ball = {"shape": "sphere", "size": [0.02], "mass": 0.1, "color": "orange", "fixed": True}
    look: dict[str, Any] = {"look_at": {"at": mark, "distance": 0.35}}
    leaves = [look, {"calibrate": {"color": "orange", "distance": 0.35}}]
    base = {"xyz": [0, 0, 0.2], "rpy": [0, -15, 0]}
    arm = {"robot": robot, "base": base, "camera": {"fps": 45}, "tree": {"sequence": leaves}}
    world = {"scene": "empty", "reality": reality}
    objects = {"mark": ball | {"pose": mark}}
    tree = {"bt_dualarm": 1, "name": "rim", "world": world, "objects": objects}
    with bt.open(tree | {"arms": {"arm1": arm}}) as run:
        before = error_of(run.world)
        leaf = run.finish().arms["arm1"].leaves["sequence/calibrate"]
        after = error_of(run.world)
    assert leaf.status == "SUCCESS", leaf.reason
    assert float(leaf.metrics["views"]) >= 6
    assert after.aim_mm < 0.3 * before.aim_mm
