"""docs/skills.md and docs/python.md list the members of the code's classes."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"


@pytest.mark.parametrize(
    ("page", "members"),
    [
        (
            "skills.md",
            (
                "`arm.follow(trajectory, ignore={}, wait_s=60.0)`",
                "`self.metrics`",
                "`check_arrival`",
            ),
        ),
        ("python.md", ("`run.step(seconds)`", "`result.state_sha256`", "`arm.tool_pose`")),
    ],
)
def test_lists_of_members_are_up_to_date(page: str, members: tuple[str, ...]) -> None:
    """If this fails after a change of a docstring of the façade, run `make docs`."""
    text = (DOCS / page).read_text(encoding="utf-8")
    assert runpy.run_path(str(DOCS / "members.py"))["renewed"](page) == text
    for member in members:
        assert f"| {member} |" in text
