"""The reference agrees with the code's declarations, and its links are valid."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

from bt_dualarm.behaviors.language import LANGUAGE
from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.core.share import share_dir
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.reference import FILE_NAMES, OUTLINE

DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "reference.md").read_text(encoding="utf-8")


def test_reference_is_up_to_date() -> None:
    fresh = runpy.run_path(str(DOCS / "reference.py"))["shipped_reference"]()
    assert fresh == PAGE, "docs/reference.md is stale: run `make docs`"


def test_reference_has_every_node_type_and_every_shipped_skill() -> None:
    skills = {path.stem for path in share_dir("skills").glob("*.py")}
    headings = set(re.findall(r"^### `(\w+)`$", PAGE, re.MULTILINE))
    assert headings == skills | set(LANGUAGE)


def test_links_within_the_page_lead_to_one_heading_each() -> None:
    titles = re.findall(r"^#+ (.*)$", PAGE, re.MULTILINE)
    anchors = [title.replace("`", "").lower().replace(" ", "-") for title in titles]
    assert len(set(anchors)) == len(anchors)
    assert set(re.findall(r"\]\(#([^)]*)\)", PAGE)) <= set(anchors)


def test_outline_is_a_valid_file(tmp_path: Path) -> None:
    (tmp_path / "outline.yaml").write_text(OUTLINE, encoding="utf-8")
    file = load_tree_file(tmp_path / "outline.yaml", Registry.load().kinds)
    assert file.name == "carry"
    assert f"```yaml\n{OUTLINE}```" in PAGE


def test_reference_has_every_part_of_a_file_and_explains_each_field() -> None:
    page, _, _ = PAGE.partition("## Nodes with children")
    assert re.findall(r"^### (.*)$", page, re.MULTILINE) == list(FILE_NAMES)
    rows = re.findall(r"^\| `(\w+)` \| (.*) \|$", page, re.MULTILINE)
    assert len(rows) > 30
    for name, row in rows:
        assert re.search(r"\| [A-Z`][^|]+$", row), f"{name} is not explained"
