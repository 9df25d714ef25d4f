"""Drawings of trees: every node once, no text that breaks the format."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from bt_dualarm import cli
from bt_dualarm.registry import Registry
from bt_dualarm.spec.load import load_tree_file
from bt_dualarm.tree.graph import Item, dot, items, mermaid, svg

FILE = """\
bt_dualarm: 1
name: drawn
world: {scene: empty}
arms:
  arm1:
    robot: ur5
    tree:
      retry:
        times: 2
        child:
          sequence:
            - log: {name: 'a "name" <b>', message: hello}
            - circle: {radius: 0.1}
"""


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> list[Item]:
    path = tmp_path_factory.mktemp("graph") / "drawn.yaml"
    path.write_text(FILE, encoding="utf-8")
    kinds = Registry.load().kinds
    return items(load_tree_file(path, kinds), kinds)


def test_items_are_the_arms_and_their_nodes_top_down(drawn: list[Item]) -> None:
    assert [(item.depth, item.parent, item.family) for item in drawn] == [
        (0, -1, "arm"),
        (1, 0, "decorator"),
        (2, 1, "composite"),
        (3, 2, "leaf"),
        (3, 2, "skill"),
    ]
    assert drawn[3].title == 'a "name" <b> (log)'
    assert drawn[4].detail == "radius: 0.1"


def test_svg_is_xml_with_every_text_and_the_same_each_time(drawn: list[Item]) -> None:
    text = svg(drawn)
    words = "".join(ET.fromstring(text).itertext())  # noqa: S314 - our own text
    assert all(item.title in words for item in drawn)
    assert svg(drawn) == text


def test_dot_quotes_what_would_end_a_text(drawn: list[Item]) -> None:
    assert r'n3 [label="a \"name\" <b> (log)\nmessage: hello"' in dot(drawn)
    assert "  n2 -> n4;" in dot(drawn)


def test_mermaid_escapes_what_would_end_a_text(drawn: list[Item]) -> None:
    written = mermaid(drawn)
    assert '  n3("a #quot;name#quot; #lt;b#gt; (log)<br>message: hello"):::leaf' in written
    assert "  n2 --> n4" in written


def test_bt_check_draws_to_the_ending_that_is_asked_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for ending, begin in (("svg", "<?xml"), ("dot", "digraph"), ("mmd", "flowchart")):
        target = tmp_path / f"out.{ending}"
        assert cli.check(["pick_and_track", "--graph", str(target)]) == 0
        assert target.read_text(encoding="utf-8").startswith(begin)
    assert cli.check(["pick_and_track", "--graph", str(tmp_path / "out.png")]) == 2
    assert "must end with one of .svg, .dot, .mmd" in capsys.readouterr().err
