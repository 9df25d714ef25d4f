"""Branches of the inverse kinematics in which an object is grasped."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

import bt_dualarm as bt
from bt_dualarm.behaviors.report import StatusChange
from bt_dualarm.runtime.arm_runtime import IdleObserver
from tests.families import some

COOKBOOK = Path(__file__).parents[2] / "docs" / "cookbook"


class Grasps(IdleObserver):
    """Records the outcomes of grasp attempts."""

    def __init__(self) -> None:
        self.ended: list[str] = []

    def on_event(self, change: StatusChange) -> None:
        """Note the end of a grasp."""
        if change.kind == "grasp" and change.new in ("SUCCESS", "FAILURE"):
            self.ended.append(change.new)


def test_another_ik_branch_is_tried_if_the_first_is_blocked() -> None:
    """Whether the handle counted as out of reach depended on the branch found with the seed."""
    grasps = Grasps()
    with bt.open(COOKBOOK / "toolbox.yaml", seed=9) as run:
        run.watch(grasps)
        while not grasps.ended:
            run.step(0.2)
    assert grasps.ended == ["SUCCESS"]


PLATES = [
    ("ur5e", (0.2, 0.07)),  # in another branch
    ("ur5e", (0.0, -0.21)),  # in none
    *(
        (robot, (round(distance * math.cos(bearing), 3), round(distance * math.sin(bearing), 3)))
        for robot in ("ur10", "xarm7", "panda")
        for distance in (0.21, 0.25)
        for bearing in (-1.57, 0.0, 0.34)
    ),
]


@pytest.mark.parametrize(("robot", "at"), [*PLATES[:2], *some(PLATES[2:], 6)])
def test_lifted_object_does_not_touch_the_arm(robot: str, at: tuple[float, float]) -> None:
    """A wide plate next to the base is grasped only where its lift is collision-free."""
    plate = {"shape": "box", "size": [0.22, 0.22, 0.01], "pose": {"xyz": [0, 0, 0.005]}}
    grip = {"shape": "box", "size": [0.02, 0.08, 0.03], "pose": {"xyz": [0, 0, 0.025]}}
    lid = {"shape": "compound", "mass": 0.25, "parts": {"plate": plate, "grip": grip}}
    stand = {"shape": "box", "size": [0.1, 0.1, 0.1], "fixed": True}
    grasp = {"object": "lid", "part": "grip", "lift": 0.06}
    file = {
        "bt_dualarm": 1,
        "name": "plate",
        "world": {"scene": "empty", "time_limit": 30},
        "objects": {
            "lid": lid | {"pose": {"xyz": [*at, 0.1]}},
            "stand": stand | {"pose": {"xyz": [*at, 0.05]}},
        },
        "arms": {
            "arm1": {"robot": robot, "gripper": "robotiq_2f85", "tree": {"grasp": grasp}},
        },
    }
    (run,) = bt.run(file).arms["arm1"].runs
    assert run.code in ("", "OUT_OF_REACH"), run.reason
    if run.code:
        assert "deep in lid" in run.reason
        assert "lifted_m" not in run.metrics
