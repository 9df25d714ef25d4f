"""What the tutorial says of its files is what they do."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.docs.test_docs import blocks_of
from tests.plays import Stage

PAGE = Path(__file__).parents[2] / "docs" / "first_tree.md"


def test_a_circle_beside_and_back_ends_where_it_began(stage: Stage) -> None:
    """The two rings of ``twice.yaml``, each around a place beside the present one, and back."""
    text = next(block.text for block in blocks_of(PAGE) if block.file_name == "twice.yaml")
    play = stage.run(text.replace("bt_dualarm: 1\n", ""))
    arm = play.world.arms["artist"]
    assert play.arm("artist").outcome == "SUCCESS"
    assert arm.q == pytest.approx(play.world.robots["artist"].postures["present"], abs=2e-3)
