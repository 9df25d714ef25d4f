"""A compliant arm presses a suction cup on: no control effort builds up while it is in contact."""

from __future__ import annotations

import pytest

import bt_dualarm
from tests.matrix.columns import taking


@pytest.mark.parametrize(
    ("robot", "reality", "seed"),
    [("xarm7", "ideal", 2), ("xarm7", "ideal", 3), ("panda", "rough", 0)],
)
def test_pressed_suction_cup_lifts_without_sliding(robot: str, reality: str, seed: int) -> None:
    """The controller compensated ever more for the contact, until the rim slid and a joint spun."""
    file = taking(robot, "suction_cup", seed)
    file["world"]["reality"] = reality
    result = bt_dualarm.run(file)
    assert result.outcome == "SUCCESS", result.arms["arm1"].runs
