"""docs/skills.md lists what the code has."""

from __future__ import annotations

import runpy
from pathlib import Path

DOCS = Path(__file__).parent.parent / "docs"


def test_the_lists_are_up_to_date() -> None:
    """After a change of a docstring of the façade: make docs."""
    page = (DOCS / "skills.md").read_text(encoding="utf-8")
    assert runpy.run_path(str(DOCS / "skills.py"))["renewed"](page) == page
    for member in ("`arm.follow(trajectory, ignore={})`", "`self.metrics`", "`check_arrival`"):
        assert f"| {member} |" in page
