"""Tree files that are varied without a change of their task end like the original."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.variations import vary

TREES = Path(__file__).parents[1] / "trees"


@pytest.mark.parametrize(
    ("tree", "kind"),
    [("grasp_and_place", "halts"), ("carry_together", "frames"), ("carry_together", "halts")],
)
def test_variation_ends_like_the_original(tree: str, kind: str) -> None:
    found = vary(str(TREES / f"{tree}.yaml"), kind, 0)
    assert found["outcome"] == "SUCCESS", found["rows"]
    assert len(found["rows"]) > 1
