"""One is not many: messages with a count of one."""

from __future__ import annotations

from pathlib import Path

import pytest

import bt_dualarm as bt
from bt_dualarm import cli

TREE = """
bt_dualarm: 1
name: one
world: {scene: empty}
arms:
  arm1: {robot: ur5, tree: %s}
"""


def problems(tree: str) -> str:
    return "\n".join(str(problem) for problem in bt.check(TREE % tree))


def test_in_errors_of_a_tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert "1 value for the 6 joints of ur5" in problems("{move_joints: {to: [0]}}")
    keys = '{sequence: [{set: {key: n, value: 1}}, {wait: "sin({n}, 2)"}]}'
    assert "sin takes 1 value, not 2" in problems(keys)


def test_in_the_reason_of_a_node(tmp_path: Path) -> None:
    bt.run(TREE % "{retry: {times: 1, child: {fail: {}}}}", record=tmp_path)
    reasons = [event["reason"] for event in bt.load(tmp_path).events]
    assert reasons[-1] == "failed 1 time"


@pytest.mark.slow
def test_in_the_results_of_commands(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tree = tmp_path / "one.yaml"
    tree.write_text(TREE % "{wait: 0.02}", encoding="utf-8")
    sweeps = [str(tmp_path / name) for name in ("a", "b")]
    for folder in sweeps:
        command = [str(tree), "--seeds", "0:1", "--jobs", "1", "--quiet", "--out", folder]
        assert cli.sweep(command) == 0
        assert capsys.readouterr().out.startswith("1 trial: ")
    assert "of 1 trial succeeded" in Path(sweeps[0], "report.md").read_text(encoding="utf-8")
    assert cli.compare(sweeps) == 0
    assert capsys.readouterr().out.startswith("1 pair of trials, 1 of them with equal states")
    bt.run(tree, record=tmp_path / "out", duration=0.02)
    data = str(tmp_path / "data")
    assert cli.record(["export", str(tmp_path / "out"), "--lerobot", data]) == 0
    assert "(1 episode, 1 failed (success is false), 1 frame)" in capsys.readouterr().out
