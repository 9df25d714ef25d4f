"""docs/motion.md has the program's figure, limits and failures."""

from __future__ import annotations

import html
import importlib.util
import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

from bt_dualarm.skill.skill import STANDARD_FAILURES
from tests.skills.test_refusals import CASES, Case

DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "motion.md").read_text(encoding="utf-8")


@pytest.fixture
def script(request: pytest.FixtureRequest) -> Iterator[ModuleType]:
    """A program of the documentation, imported."""
    path = DOCS / str(request.param)
    name = f"docs_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look there
    spec.loader.exec_module(module)
    yield module
    del sys.modules[name]


@pytest.mark.parametrize("script", ["images/motion.py"], indirect=True)
def test_figure_shows_the_results_of_the_program(script: ModuleType) -> None:
    """The numbers in the figure are those of a new run, and as good as the page says."""
    figure = script.TARGET.read_text(encoding="utf-8")
    described = re.search(r"<dc:description>(.*?)</dc:description>", figure, re.DOTALL)
    assert described is not None
    facts = script.run().facts
    assert json.loads(html.unescape(described[1])) == pytest.approx(facts, rel=0.05)
    for quantity in ("velocity", "acceleration", "jerk"):
        assert facts[f"{quantity}_share"] <= 1.0 + 1e-9
    assert facts["duration_s"] < 1.15 * facts["shortest_s"]
    assert f"images/{script.TARGET.name}" in PAGE


@pytest.mark.parametrize("script", ["limits.py"], indirect=True)
def test_table_of_limits_agrees_with_the_catalog(script: ModuleType) -> None:
    """If this fails after a change of a robot description, run `make docs`."""
    assert script.renewed(PAGE) == PAGE
    assert "| `ur5` | acceleration | 5.0 rad/s² |" in PAGE


def rows() -> dict[str, str]:
    """The row of each failure on the page."""
    table = PAGE.partition("## Failures")[2].partition("## ")[0]
    return {row.split("`")[1]: row for row in table.splitlines() if row.startswith("| `")}


def test_every_failure_of_a_motion_is_explained() -> None:
    assert rows().keys() == STANDARD_FAILURES.keys() - {"NO_VALUE", "OVERRUN", "EXCEPTION"}


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_numbers_of_a_failure_are_explained(case: Case) -> None:
    row = rows()[case.code]
    for name in (*case.numbers, *case.names):
        assert f"`{name}`" in row
