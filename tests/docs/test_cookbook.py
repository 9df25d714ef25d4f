"""Trees of the cookbook are as rich as described, and succeed."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import bt_dualarm as bt
from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.skill.registry import Registry
from tests.families import WHOLE, some

ROOT = Path(__file__).parents[2]
TREES = sorted((ROOT / "docs" / "cookbook").glob("*.yaml"))
PAGE = (ROOT / "docs" / "cookbook.md").read_text(encoding="utf-8")
IMAGES = ROOT / "docs" / "images" / "cookbook"

NEWER = (
    r"\bfor_each:",
    r"\breactive_(sequence|fallback):",
    r"\b(skip_if|only_if|until):",
    r"\b(joint_at|in_zone|sees|touching|force_above|elapsed|arm_at|moving)\b",
    r"\bif_then_else:",
    r"\bkeep:",
    r"\bmany:",
    r"\bparts?:",
    r"\boperate:",
    r"\bregion:",
    r"\bfollow_path:",
    r"\b(point|open_to|then_to):",
    r"\b(above|on|beside|in_frame): [a-z]",
    r"\"[^\"]*\{\w+\}[^\"]* [-+*/%<=>]",
    r"scene: scenes/",
)
"""Features of the language of which each tree has at least five."""


@pytest.mark.parametrize("path", TREES, ids=lambda path: path.stem)
def test_tree_is_valid_and_as_rich_as_the_page_says(path: Path, registry: Registry) -> None:
    """No problems, 15 nodes, five newer features, its own scene, and no UR5 or Panda."""
    assert [str(one) for one in bt.check(path)] == []
    file = load_tree_file(path, registry.kinds)
    nodes = sum(1 for arm in file.arms.values() for _ in arm.tree.walk())
    assert nodes >= 15, nodes
    text = path.read_text(encoding="utf-8")
    assert sum(re.search(one, text) is not None for one in NEWER) >= 5
    assert f"scene: scenes/{path.stem}." in text
    assert not {arm.robot for arm in file.arms.values()} & {"ur5", "panda"}


def test_every_tree_is_on_the_page_with_its_animation() -> None:
    assert len(TREES) >= 12
    for path in TREES:
        assert f"cookbook/{path.name}\n" in PAGE
        image = IMAGES / f"{path.stem}.webp"
        assert f"(images/cookbook/{image.name})" in PAGE
        assert image.stat().st_size < 400_000


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3) if WHOLE else [1])
@pytest.mark.parametrize("path", some(TREES, 7), ids=lambda path: path.stem)
def test_tree_succeeds_and_meets_its_goals(path: Path, seed: int) -> None:
    """All trees succeed in `lab`, and the goals are met in the true world."""
    result = bt.run(path, seed=seed)
    assert result.outcome == "SUCCESS", [
        (leaf.path, leaf.code, leaf.reason)
        for arm in result.arms.values()
        for leaf in arm.runs
        if leaf.status == "FAILURE"
    ]
    assert result.goals_met
