"""Branches of the inverse kinematics in which something is grasped."""

from __future__ import annotations

from pathlib import Path

import bt_dualarm as bt
from bt_dualarm.behaviors.report import StatusChange
from bt_dualarm.runtime.arm_runtime import IdleObserver

COOKBOOK = Path(__file__).parents[2] / "docs" / "cookbook"


class Grasps(IdleObserver):
    """How the attempts to grasp something have ended."""

    def __init__(self) -> None:
        self.ended: list[str] = []

    def on_event(self, change: StatusChange) -> None:
        """Note the end of a grasp."""
        if change.kind == "grasp" and change.new in ("SUCCESS", "FAILURE"):
            self.ended.append(change.new)


def test_another_branch_is_tried_if_the_first_one_is_blocked() -> None:
    """Whether the handle counted as out of reach depended on the branch that the seed found."""
    grasps = Grasps()
    with bt.open(COOKBOOK / "toolbox.yaml", seed=9) as run:
        run.watch(grasps)
        while not grasps.ended:
            run.step(0.2)
    assert grasps.ended == ["SUCCESS"]
