"""A motion that another arm blocks in the period in which it begins is planned again."""

from __future__ import annotations

from typing import Any

import pytest

import bt_dualarm as bt
from bt_dualarm.core.errors import BlockedFailure
from bt_dualarm.safety.guard import TrajectoryGuard

LEAVES = (
    {"reach_to_pose": {"offset": {"xyz": [0, 0, -0.1]}}},
    {"grasp": {"object": "cube"}},
    {"transport": {"to": {"xyz": [0.3, -0.4, 0.6]}}},
    {"place": {"at": {"xyz": [0.3, -0.5, 0.425], "rpy": [0, 0, 0]}}},
    "go_home",
)


@pytest.mark.parametrize("number", range(7))
def test_each_skill_goes_on_after_it(number: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The failure was raised past the code that waits and plans again, and ended the leaf."""
    advance = TrajectoryGuard.advance
    motions = list[TrajectoryGuard]()

    def blocked(self: TrajectoryGuard, *args: Any) -> Any:
        if self not in motions:
            motions.append(self)
            if len(motions) == number + 1:
                failure = BlockedFailure("IN_COLLISION", "another arm is near", progress=0.0)
                return 0.1, failure
        return advance(self, *args)

    monkeypatch.setattr(TrajectoryGuard, "advance", blocked)
    cube = {"shape": "box", "size": [0.05, 0.05, 0.05], "mass": 0.1}
    result = bt.run(
        {
            "bt_dualarm": 1,
            "name": "blocked",
            "world": {"scene": "table", "time_limit": 40},
            "objects": {"cube": cube | {"pose": {"xyz": [0.4, -0.4, 0.425]}}},
            "arms": {
                "arm1": {
                    "robot": "ur5",
                    "gripper": "robotiq_2f85",
                    "base": {"xyz": [0, 0, 0.4]},
                    "tree": {"sequence": list(LEAVES)},
                }
            },
        }
    )
    assert len(motions) > number
    assert result.outcome == "SUCCESS", [run.reason for run in result.arms["arm1"].runs]
