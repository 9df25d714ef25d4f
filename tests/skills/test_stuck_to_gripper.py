"""An object that sticks to the hand as it retreats in `place` is detected and placed again."""

from __future__ import annotations

import pytest

import bt_dualarm as bt
from benchmarks.false_success_cases import Hand, cases, file_of


@pytest.mark.parametrize("name", ["sticks to a finger for 2.2 s", "sticks to the cup for 1.3 s"])
def test_object_stuck_to_the_gripper_counts_as_held_again(name: str) -> None:
    """The gripper reports it before the referee checks; the next `place` sets it down."""
    case = next(case for case in cases() if (case.skill, case.name) == ("place", name))
    file = file_of(case)
    grasp, place = case.leaves
    tree = {"sequence": [grasp, {"retry": {"times": 2, "child": place}}]}
    file["arms"]["arm1"]["tree"] = tree
    with bt.open(file) as opened:
        hand = Hand(opened.world, case)
        opened.watch(hand)
        result = opened.finish()
    first, second = (leaf for leaf in result.arms["arm1"].runs if leaf.skill == "place")
    assert first.code == "NOT_PLACED"
    assert "stuck to the gripper" in first.reason
    assert second.status == "SUCCESS", second.reason
    assert not hand.deviations
