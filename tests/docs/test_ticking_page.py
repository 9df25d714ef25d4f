"""The tree on the page about ticking ticks as in the table below it."""

from __future__ import annotations

import inspect
import re
from pathlib import Path

from bt_dualarm.behaviors import composites, decorators, leaf
from tests.behaviors.ticking import Stage, rows

PAGE = Path(__file__).parents[2] / "docs" / "ticking.md"


def test_tick_table_of_the_page_is_true(tmp_path: Path) -> None:
    text = PAGE.read_text(encoding="utf-8")
    found = re.search(r"```yaml\n(.*?)```\n\n```text\n(.*?)```", text, re.DOTALL)
    assert found is not None
    stage = Stage(tmp_path, found[1])
    expected = rows(found[2])[1:]  # after the heading
    assert [stage.tick() for _ in expected] == expected


def test_page_has_every_failure_code_of_the_node_types() -> None:
    text = PAGE.read_text(encoding="utf-8")
    sources = [inspect.getsource(module) for module in (composites, decorators, leaf)]
    codes = re.findall(r'raise Failure\(\s*"([A-Z_]+)"', "".join(sources))
    assert len(codes) >= 8
    assert [code for code in codes if f"`{code}`" not in text] == []
