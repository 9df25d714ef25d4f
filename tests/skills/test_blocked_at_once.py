"""A motion that another arm blocks in its first control period is planned again."""

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


def test_each_skill_continues_after_its_motion_is_blocked(monkeypatch: pytest.MonkeyPatch) -> None:
    """The failure bypassed the code that waits and replans, and ended the leaf.

    Every other motion is blocked; the replanned motion is not.
    """
    advance = TrajectoryGuard.advance
    motions = list[TrajectoryGuard]()
    blocked = list[float]()

    def every_other(self: TrajectoryGuard, *args: Any) -> Any:
        if self not in motions:
            motions.append(self)
            if len(motions) % 2 == 1:
                blocked.append(run.time)
                return 0.1, BlockedFailure("IN_COLLISION", "another arm is near", progress=0.0)
        return advance(self, *args)

    monkeypatch.setattr(TrajectoryGuard, "advance", every_other)
    cube = {"shape": "box", "size": [0.05, 0.05, 0.05], "mass": 0.1}
    file = {
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
    with bt.open(file) as run:
        result = run.finish()
    runs = result.arms["arm1"].runs
    assert result.outcome == "SUCCESS", [one.reason for one in runs]
    times = [sum(one.started_s <= at < (one.ended_s or 0.0) for at in blocked) for one in runs]
    assert times == [1, 2, 1, 2, 1], "one of each motion of every leaf"
