"""Suggestions for a tree file that does not exist."""

from __future__ import annotations

from pathlib import Path

import pytest

from bt_dualarm.runtime.options import NoSuchTree, find_tree


def test_a_file_of_a_similar_name_is_suggested(tmp_path: Path) -> None:
    (tmp_path / "cell.yaml").write_text("bt_dualarm: 1\n")
    with pytest.raises(NoSuchTree) as refused:
        find_tree(str(tmp_path / "cell.yml"))
    assert f"did you mean '{tmp_path / 'cell.yaml'}'?" in str(refused.value)


def test_a_file_with_only_the_ending_in_common_is_not_suggested(tmp_path: Path) -> None:
    """'lk.yaml' was suggested for 'nofile.yaml'."""
    (tmp_path / "lk.yaml").write_text("bt_dualarm: 1\n")
    with pytest.raises(NoSuchTree) as refused:
        find_tree(str(tmp_path / "nofile.yaml"))
    assert "lk" not in str(refused.value).replace(str(tmp_path), "")


def test_a_file_named_without_its_ending_is_suggested(tmp_path: Path) -> None:
    """Shipped trees have none, and only these were listed."""
    (tmp_path / "circlet.yaml").write_text("bt_dualarm: 1\n")
    with pytest.raises(NoSuchTree) as refused:
        find_tree(str(tmp_path / "circlet"))
    assert f"did you mean '{tmp_path / 'circlet.yaml'}'?" in str(refused.value)


def test_otherwise_a_shipped_tree_is_suggested() -> None:
    with pytest.raises(NoSuchTree, match="did you mean 'circle'"):
        find_tree("cirle")
