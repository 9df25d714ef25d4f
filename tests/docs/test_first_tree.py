"""Files of the tutorial do what it says."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.docs.test_docs import blocks_of
from tests.plays import Stage

PAGE = Path(__file__).parents[2] / "docs" / "first_tree.md"


def test_tree_with_two_rings_ends_where_it_began(stage: Stage) -> None:
    """``twice.yaml`` traces two rings beside the initial pose and returns to it."""
    text = next(block.text for block in blocks_of(PAGE) if block.file_name == "twice.yaml")
    play = stage.run(text.replace("bt_dualarm: 1\n", ""))
    arm = play.world.arms["artist"]
    assert play.arm("artist").outcome == "SUCCESS"
    assert arm.q == pytest.approx(play.world.robots["artist"].postures["present"], abs=2e-3)
