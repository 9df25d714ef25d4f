"""Relative paths start from the directory in which an object was made, wherever it is used."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

import bt_dualarm as bt
from bt_dualarm.core.share import share_dir

TREE = """
bt_dualarm: 1
name: elsewhere
world: {scene: empty}
objects:
  thing:
    {shape: mesh, file: parts/thing.obj, mass: 0.1, pose: {xyz: [1, 1, 0.05]}, spawned: false}
arms:
  arm1:
    robot: parts/own.yaml
    tree: {sequence: [{wait: 0.02}, {spawn: {object: thing}}, {spawn: {arm: arm2}}, {wait: 0.02}]}
  arm2: {robot: parts/own.yaml, base: {xyz: [0, 2, 0]}, spawned: false, tree: {wait: 0.02}}
"""
TETRAHEDRON = """\
v 0 0 0
v 0.05 0 0
v 0 0.05 0
v 0 0 0.05
f 1 3 2
f 1 2 4
f 1 4 3
f 2 3 4
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    parts = tmp_path / "cell" / "parts"
    parts.mkdir(parents=True)
    ur5 = (share_dir("assets") / "robots" / "ur5.yaml").read_text(encoding="utf-8")
    (parts / "own.yaml").write_text(ur5, encoding="utf-8")
    (parts / "thing.obj").write_text(TETRAHEDRON, encoding="utf-8")
    (tmp_path / "cell" / "tree.yaml").write_text(TREE, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_what_is_spawned_is_found() -> None:
    with bt.open("cell/tree.yaml") as run:
        os.chdir("/")
        assert run.finish().outcome == "SUCCESS"
        run.reset()
        assert run.finish().outcome == "SUCCESS"


def test_a_record_names_the_file(folder: Path) -> None:
    with bt.open("cell/tree.yaml", record="out") as run:
        os.chdir("/")
        run.finish()
    os.chdir(folder)
    record = bt.load("out")
    assert record._record.start["path"] == str(folder / "cell" / "tree.yaml")


def test_a_record_is_read_later(folder: Path) -> None:
    eye = "robot: parts/own.yaml\n    camera: {mount: wrist}"
    tree = TREE.replace("robot: parts/own.yaml\n", f"{eye}\n", 1).replace(
        "{wait: 0.02}]", "{locate: {color: red, shape: box, size: [0.1, 0.1, 0.1]}}]"
    )
    (folder / "cell" / "tree.yaml").write_text(tree, encoding="utf-8")
    bt.run("cell/tree.yaml", record="out", frames=True)
    record = bt.load("out")
    os.chdir("/")
    assert [*record.frames("arm1")]
    assert record.arms.keys() == {"arm1", "arm2"}


@pytest.mark.slow
def test_a_sweep_knows_its_folder(folder: Path) -> None:
    result = bt.sweep("cell/tree.yaml", out="out", seeds=1, jobs=1)
    os.chdir("/")
    assert result.folder == folder / "out"
    assert [row["outcome"] for row in result.table.to_pylist()] == ["SUCCESS"]
