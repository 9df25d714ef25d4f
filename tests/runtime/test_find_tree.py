"""What is said of a tree file that is not there."""

from __future__ import annotations

from pathlib import Path

import pytest

from bt_dualarm.runtime.options import NoSuchTree, find_tree


def test_a_file_of_a_similar_name_is_named(tmp_path: Path) -> None:
    (tmp_path / "cell.yaml").write_text("bt_dualarm: 1\n")
    with pytest.raises(NoSuchTree) as refused:
        find_tree(str(tmp_path / "cell.yml"))
    assert f"did you mean '{tmp_path / 'cell.yaml'}'?" in str(refused.value)


def test_without_one_shipped_trees_are_named() -> None:
    with pytest.raises(NoSuchTree, match="did you mean 'circle'"):
        find_tree("cirle")
