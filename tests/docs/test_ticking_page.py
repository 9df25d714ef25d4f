"""The tree on the page about ticking is ticked as the table below it says."""

from __future__ import annotations

import inspect
import re
from pathlib import Path

from bt_dualarm.behaviors import composites, decorators, leaf
from tests.behaviors.ticking import Stage, rows

PAGE = Path(__file__).parents[2] / "docs" / "ticking.md"


def test_the_table_of_the_page(tmp_path: Path) -> None:
    text = PAGE.read_text(encoding="utf-8")
    found = re.search(r"```yaml\n(.*?)```\n\n```text\n(.*?)```", text, re.DOTALL)
    assert found is not None
    stage = Stage(tmp_path, found[1])
    expected = rows(found[2])[1:]  # after the heading
    assert [stage.tick() for _ in expected] == expected


def test_the_page_has_every_code_that_the_words_fail_with() -> None:
    text = PAGE.read_text(encoding="utf-8")
    sources = [inspect.getsource(module) for module in (composites, decorators, leaf)]
    codes = re.findall(r'raise Failure\(\s*"([A-Z_]+)"', "".join(sources))
    assert len(codes) >= 8
    assert [code for code in codes if f"`{code}`" not in text] == []
