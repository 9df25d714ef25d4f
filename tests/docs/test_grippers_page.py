"""docs/grippers.md has the grippers of the catalogue."""

from __future__ import annotations

import runpy
from pathlib import Path

from bt_dualarm.world.grippers.named import gripper_names

DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "grippers.md").read_text(encoding="utf-8")


def test_the_page_is_up_to_date() -> None:
    fresh = runpy.run_path(str(DOCS / "grippers.py"))["grippers_page"]()
    assert fresh == PAGE, "docs/grippers.md is stale: run `make docs`"


def test_every_gripper_is_there() -> None:
    assert all(f"| `{name}` |" in PAGE for name in gripper_names())
