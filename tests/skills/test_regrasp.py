"""`regrasp` changes the grasp of a held object."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import bt_dualarm as bt
from tests.skills.test_grasp_from import TALL
from tests.skills.test_unnamed_objects import task


def test_regrasp_from_another_side_holds_the_object() -> None:
    """The object is grasped in the default direction, then from the side, and lifted."""
    leaves: list[dict[str, Any]] = [
        {"grasp": {"object": "cube"}},
        {"regrasp": {"approach": [0, -1, 0]}},
    ]
    with bt.open(task(*leaves, **TALL)) as run:
        result = run.finish()
        world = run.world
        tool = world.arms["arm1"].tool_pose
        assert world.object_pose("cube").position[2] > 0.53
        assert world.attachments.find("arm1", "cube") is not None
    assert result.outcome == "SUCCESS"
    assert tool.rotation_matrix[:, 2] @ (0.0, -1.0, 0.0) > np.cos(np.radians(30.0))


def test_default_regrasp_rotates_the_hand() -> None:
    leaves: list[dict[str, Any]] = [
        {"grasp": {"object": "cube"}},
        {"regrasp": {"at": {"xyz": [0.30, -0.45, 0.425]}}},
        {"place": {"at": {"xyz": [0.25, -0.50, 0.425]}}},
    ]
    result = bt.run(task(*leaves))
    ran = result.arms["arm1"].leaves
    assert result.outcome == "SUCCESS"
    turned = float(ran["sequence/regrasp"].metrics["turned_rad"])
    assert np.radians(45.0) <= turned <= np.pi
    assert float(ran["sequence/place"].metrics["placed_error_m"]) < 0.003


def test_regrasp_of_an_object_that_is_not_held_is_a_grasp() -> None:
    result = bt.run(task({"regrasp": {"object": "cube"}}))
    assert result.outcome == "SUCCESS"
    assert "turned_rad" not in result.arms["arm1"].leaves["sequence/regrasp"].metrics


@pytest.mark.parametrize("rpy", [[10, 0, 0], [0, -20, 30], [25, 15, -60]])
def test_regrasp_levels_an_object_that_is_held_tilted(rpy: list[float]) -> None:
    """Without an orientation in `at`, as `place` does: a halted leaf may leave it so."""
    tilted = {"xyz": [0.35, -0.45, 0.55], "rpy": rpy}
    leaves: list[dict[str, Any]] = [
        {"grasp": {"object": "cube"}},
        {"transport": {"object": "cube", "to": tilted}},
        {"regrasp": {"at": {"xyz": [0.30, -0.45, 0.425]}}},
        {"place": {"at": {"xyz": [0.25, -0.50, 0.425]}}},
    ]
    result = bt.run(task(*leaves))
    assert result.outcome == "SUCCESS", result.arms["arm1"].runs
    turned = result.arms["arm1"].leaves["sequence/place"].metrics["placed_turned_rad"]
    assert float(turned) < np.radians(2.0)
