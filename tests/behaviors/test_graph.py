"""Drawings of trees show every node once and escape text that would break the format."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from bt_dualarm import cli
from bt_dualarm.behaviors.graph import FORMATS, Item, dot, items, mermaid
from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.skill.registry import Registry

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
    node_types = Registry.load().kinds
    return items(load_tree_file(path, node_types), node_types)


def test_items_are_the_arms_and_their_nodes_top_down(drawn: list[Item]) -> None:
    assert [(item.parent, item.family) for item in drawn] == [
        (-1, "arm"),
        (0, "decorator"),
        (1, "composite"),
        (2, "leaf"),
        (2, "skill"),
    ]
    assert drawn[3].title == 'a "name" <b> (log)'
    assert drawn[4].detail == "radius: 0.1"


@pytest.mark.parametrize("ending", FORMATS)
def test_every_node_is_drawn_once_and_joined_to_its_parent(ending: str, drawn: list[Item]) -> None:
    lines = FORMATS[ending](drawn).splitlines()
    made = [line for line in lines if re.match(r" +n\d+ ?[\[(]", line)]
    joined = [line for line in lines if re.match(r" +n\d+ --?> n\d+", line)]
    assert len(made) == len(drawn)
    assert len(joined) == len(drawn) - 1


def test_dot_escapes_quotes(drawn: list[Item]) -> None:
    assert r'n3 [label="a \"name\" <b> (log)\nmessage: hello"' in dot(drawn)
    assert "  n2 -> n4;" in dot(drawn)


def test_mermaid_escapes_quotes_and_brackets(drawn: list[Item]) -> None:
    written = mermaid(drawn)
    assert '  n3("a #quot;name#quot; #lt;b#gt; (log)<br>message: hello"):::leaf' in written
    assert "  n2 --> n4" in written


def test_bt_check_draws_in_the_format_of_the_file_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for ending, begin in (("dot", "digraph"), ("mmd", "flowchart")):
        target = tmp_path / f"out.{ending}"
        assert cli.check(["pick_and_track", "--graph", str(target)]) == 0
        assert target.read_text(encoding="utf-8").startswith(begin)


@pytest.mark.parametrize("ending", ["svg", "png", "pdf", "DOT"])
def test_bt_check_names_the_command_that_renders_an_image(
    ending: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    target = tmp_path / f"my tree.{ending}"
    assert cli.check(["pick_and_track", "--graph", str(target)]) == 2
    reported = capsys.readouterr().err
    assert "must end with one of .dot, .mmd" in reported
    assert f"dot -Tsvg -O '{tmp_path / 'my tree.dot'}'" in reported
    assert not target.exists()
