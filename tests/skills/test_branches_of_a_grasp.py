"""Branches of the inverse kinematics in which something is grasped."""

from __future__ import annotations

from pathlib import Path

import pytest

import bt_dualarm as bt

COOKBOOK = Path(__file__).parents[2] / "docs" / "cookbook"


@pytest.mark.parametrize(("name", "seed"), [("lid", 5), ("toolbox", 9)])
def test_another_branch_is_tried_if_the_first_one_is_blocked(name: str, seed: int) -> None:
    """Whether the handle counted as out of reach depended on the branch that the seed found."""
    with bt.open(COOKBOOK / f"{name}.yaml", seed=seed) as run:
        while not (done := [leaf for leaf in run.result().arms["arm1"].runs if leaf.ended_s]):
            run.step()
    assert (done[0].skill, done[0].status) == ("grasp", "SUCCESS"), done[0].reason
