"""docs/robots.md agrees with the catalog and the scenes."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest

from bt_dualarm.robots.robot_description import load_robot, robot_names
from bt_dualarm.sim.composition import scene_names

DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "robots.md").read_text(encoding="utf-8")


def test_page_is_up_to_date() -> None:
    fresh = runpy.run_path(str(DOCS / "robots.py"))["robots_page"]()
    assert fresh == PAGE, "docs/robots.md is stale: run `make docs`"


def section(title: str) -> str:
    found = re.search(rf"^##+ {title}\n(.*?)(?=^##|\Z)", PAGE, re.MULTILINE | re.DOTALL)
    assert found is not None
    return found[1]


@pytest.mark.parametrize("name", robot_names())
def test_section_of_a_robot_has_all_names_that_a_file_may_use(name: str) -> None:
    robot = load_robot(name)
    text = section(name)
    for word in (*robot.joints, *robot.postures, *robot.cameras):
        assert f"| `{word}` |" in text
    assert f"](#{name})" in PAGE


def test_section_of_a_scene_has_the_positions_of_its_bodies() -> None:
    """The table is 0.60 m by 0.50 m with its top at 0.40 m, as in its file."""
    assert all(section(name) for name in scene_names())
    top = "| `table_top` | box | 0.05 to 0.65 | -0.75 to -0.25 | 0.37 to 0.4 |"
    assert top in section("table")
