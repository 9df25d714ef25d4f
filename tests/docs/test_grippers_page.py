"""docs/grippers.md has the grippers of the catalog."""

from __future__ import annotations

import runpy
from pathlib import Path

import cv2
import numpy as np

from bt_dualarm.robots.gripper import gripper_names

DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "grippers.md").read_text(encoding="utf-8")


def test_page_is_up_to_date() -> None:
    fresh = runpy.run_path(str(DOCS / "grippers.py"))["grippers_page"]()
    assert fresh == PAGE, "docs/grippers.md is stale: run `make docs`"


def test_every_gripper_is_on_the_page() -> None:
    assert all(f"| `{name}` |" in PAGE for name in gripper_names())


def test_image_of_the_grippers_is_up_to_date() -> None:
    """A new image is the same except for rounding on another processor."""
    script = runpy.run_path(str(DOCS / "images" / "grippers.py"))
    assert f"images/{script['TARGET'].name}" in PAGE
    drawn = cv2.imread(str(script["TARGET"]))
    assert drawn is not None
    fresh = script["pictures"]()
    assert drawn.shape == fresh.shape
    assert np.abs(drawn.astype(float) - fresh.astype(float)).mean() < 0.5, "draw it again"
