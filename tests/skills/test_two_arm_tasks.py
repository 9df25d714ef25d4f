"""The benchmark tasks for two arms are valid files, and feasible."""

from __future__ import annotations

import pytest

import bt_dualarm as bt
from benchmarks.two_arm_tasks import ROBOTS, TASKS, played, task
from tests.families import some


@pytest.mark.parametrize(
    ("name", "robot"), some([(name, robot) for robot in ROBOTS for name in TASKS], 4)
)
def test_task_is_a_valid_file_and_depends_on_the_seed(name: str, robot: str) -> None:
    files = [task(name, robot, seed, "lab") for seed in (0, 1)]
    assert files[0]["objects"] != files[1]["objects"]
    problems = bt.check(files[0])
    assert not [one for one in problems if one.severity == "error"]


def test_one_task_succeeds() -> None:
    found = played("two_arm_lift", "panda", 0, "lab", speed=1.0)
    assert found["outcome"] == "SUCCESS", found["why"]
    assert not found["false_success"]


def test_peg_is_put_into_a_hole_that_another_arm_holds() -> None:
    """Without `into` of `move_linear`, the arms kept what they hold 45 mm apart."""
    found = played("two_arm_peg_in_hole", "panda", 200, "lab", speed=1.0)
    assert found["outcome"] == "SUCCESS", found["why"]


@pytest.mark.parametrize("name", ["join_blocks", "ball_maze"])
def test_task_of_duobench_succeeds(name: str) -> None:
    found = played(name, "panda", 0, "lab", speed=1.0)
    assert found["outcome"] == "SUCCESS", found["why"]
