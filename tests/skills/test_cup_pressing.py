"""A suction cup is pressed on by an arm that gives way: nothing builds up while it stands there."""

from __future__ import annotations

import pytest

import bt_dualarm
from tests.matrix.columns import taking


@pytest.mark.parametrize(
    ("robot", "reality", "seed"),
    [("xarm7", "ideal", 2), ("xarm7", "ideal", 3), ("panda", "rough", 0)],
)
def test_a_cup_that_is_pressed_on_lifts_and_does_not_slide(
    robot: str, reality: str, seed: int
) -> None:
    """The controller made up for the contact ever more, until the rim slid and a joint spun."""
    file = taking(robot, "suction_cup", seed)
    file["world"]["reality"] = reality
    result = bt_dualarm.run(file)
    assert result.outcome == "SUCCESS", result.arms["arm1"].runs
