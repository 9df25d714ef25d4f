"""docs/objects.md shows the textures."""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import get_args

import cv2
import numpy as np

from bt_dualarm.spec.texture import Pattern

DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "objects.md").read_text(encoding="utf-8")


def test_every_pattern_is_on_the_page() -> None:
    assert all(f"`{pattern}`" in PAGE for pattern in get_args(Pattern))


def test_image_of_the_textures_is_up_to_date() -> None:
    """A new image is the same except for rounding on another processor."""
    script = runpy.run_path(str(DOCS / "images" / "textures.py"))
    assert f"images/{script['TARGET'].name}" in PAGE
    drawn = cv2.imread(str(script["TARGET"]))
    assert drawn is not None
    fresh = script["picture"]()[..., ::-1]
    assert drawn.shape == fresh.shape
    assert np.abs(drawn.astype(float) - fresh.astype(float)).mean() < 0.5, "draw it again"
