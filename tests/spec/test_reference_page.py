"""The reference is what the code declares, and its links lead somewhere."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

from bt_dualarm.share import share_dir
from bt_dualarm.spec.language import LANGUAGE

DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "reference.md").read_text(encoding="utf-8")


def test_reference_is_up_to_date() -> None:
    fresh = runpy.run_path(str(DOCS / "reference.py"))["shipped_reference"]()
    assert fresh == PAGE, "docs/reference.md is stale: run `make docs`"


def test_reference_has_every_word_and_every_shipped_skill() -> None:
    skills = {path.stem for path in share_dir("skills").glob("*.py")}
    headings = set(re.findall(r"^### `(\w+)`$", PAGE, re.MULTILINE))
    assert headings == skills | set(LANGUAGE)


def test_links_within_the_page_lead_to_one_heading_each() -> None:
    titles = re.findall(r"^#+ (.*)$", PAGE, re.MULTILINE)
    anchors = [title.replace("`", "").lower().replace(" ", "-") for title in titles]
    assert len(set(anchors)) == len(anchors)
    assert set(re.findall(r"\]\(#([^)]*)\)", PAGE)) <= set(anchors)
