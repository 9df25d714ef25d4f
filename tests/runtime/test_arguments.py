"""Arguments of the wrong kind: an error of the project names the argument and its value."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import bt_dualarm as bt
from bt_dualarm import cli

TREE = """
bt_dualarm: 1
name: short
world: {scene: empty}
arms:
  arm1: {robot: ur5, tree: {wait: 0.02}}
"""
NO_PATHS = ["", " ", 3, b"out", [], "no\0path"]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A current folder with what an empty path must not lead to: a skill, and nothing else."""
    (tmp_path / "alarm.py").write_text("raise SystemExit('imported')\n", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("value", NO_PATHS)
@pytest.mark.parametrize(
    ("what", "call"),
    [
        ("folder", lambda given: bt.load(given)),
        ("record", lambda given: bt.run(TREE, record=given)),
        ("faults", lambda given: bt.run(TREE, faults=given)),
        ("skills", lambda given: bt.check(TREE, skills=[given])),
        ("out", lambda given: bt.sweep(TREE, out=given)),
        ("skills", lambda given: bt.sweep(TREE, out="out", skills=[given])),
        ("a", lambda given: bt.compare(given, "b")),
    ],
)
def test_of_paths(folder: Path, what: str, call: Callable[[Any], object], value: object) -> None:
    message = rf"{what}: {re.escape(repr(value))} is not a path|skills are classes"
    with pytest.raises(bt.DualArmError, match=message):
        call(value)
    assert [path.name for path in folder.iterdir() if path.name != "__pycache__"] == ["alarm.py"]


@pytest.mark.parametrize(
    "call",
    [
        bt.run,
        bt.check,
        bt.load,
        lambda long: bt.run(TREE, record=long),
        lambda long: bt.run(TREE, skills=[long]),
        lambda long: bt.run(TREE, faults=long),
        lambda long: bt.sweep(long, out="out"),
        lambda long: bt.compare(long, long),
    ],
)
def test_of_names_that_no_file_can_have(call: Callable[[str], object]) -> None:
    """A system that looks them up reports an error instead of their absence."""
    with pytest.raises(bt.DualArmError):
        call("x" * 300)


@pytest.mark.parametrize("call", [bt.run, bt.check, lambda tree: bt.sweep(tree, out="out")])
@pytest.mark.parametrize("value", ["", " ", None, 3, b"circle", []])
def test_of_trees(call: Callable[[Any], object], value: object) -> None:
    with pytest.raises(
        bt.DualArmError, match=r"^tree: '.*' is not a path|a tree is a path, .* not"
    ):
        call(value)


@pytest.mark.parametrize("value", ["", 3, []])
def test_of_parameters(value: Any) -> None:
    message = rf"params: {re.escape(repr(value))} is not a mapping"
    for call in (bt.run, bt.check):
        with pytest.raises(bt.DualArmError, match=message):
            call(TREE, params=value)
    with pytest.raises(bt.DualArmError, match=message):
        bt.sweep(TREE, out="out", params=value)


@pytest.mark.parametrize(
    "given",
    [
        {"seeds": 1.5}, {"seeds": []}, {"seeds": [0.5]}, {"reality": 3}, {"reality": []},
        {"jobs": ""}, {"jobs": 1.5}, {"keep": ""}, {"keep": "some"}, {"until": 3}, {"audit": ""},
        {"shard": 3}, {"sample": "random"}, {"samples": "x"}, {"sampling_seed": ""},
        {"search": "x"}, {"duration": ""}, {"duration": 0}, {"watchdog": ""}, {"timeout": ""},
        {"dask": 3}, {"stop": 3}, {"progress": 3},
    ],
)  # fmt: skip
def test_of_sweeps(given: dict[str, Any]) -> None:
    (name,) = given
    about = {"seeds": "seed", "dask": "Dask"}.get(name, name)
    with pytest.raises(bt.DualArmError, match=about):
        bt.sweep(TREE, out="out", **given)


@pytest.mark.parametrize("name", ["real_time", "frames"])
@pytest.mark.parametrize("value", ["yes", "", 1, None])
def test_of_flags(name: str, value: Any) -> None:
    with pytest.raises(bt.DualArmError, match=f"{name}: {value!r} is not True or False"):
        bt.run(TREE, **{name: value})


def test_of_records() -> None:
    bt.run(TREE, record="out")
    record = bt.load("out")
    for value in ("", 3):
        with pytest.raises(bt.DualArmError, match=f"there is no arm '{value}'"):
            record.frames(value)  # type: ignore[arg-type]  # as is tested
    for most in ("", None, 0, -1):
        with pytest.raises(bt.DualArmError, match=r"most_memory: .* is not a number of bytes"):
            bt.load("out", most_memory=most)  # type: ignore[arg-type]  # as is tested


def test_of_worlds() -> None:
    with bt.open(TREE) as run:
        for value in ("", None, 3):
            with pytest.raises(bt.WorldError, match=r"no object .* in the world"):
                run.world.object_pose(value)  # type: ignore[arg-type]  # as is tested


@pytest.mark.parametrize(
    ("command", "arguments"),
    [
        (cli.run, ["--record", ""]),
        (cli.run, ["--skills", ""]),
        (cli.run, ["--faults", ""]),
        (cli.check, ["--skills", ""]),
        (cli.sweep, ["--out", ""]),
        (cli.why, [""]),
        (cli.replay, [""]),
        (cli.record, ["export", "", "--html", "a.html"]),
        (cli.record, ["export", "out", "--csv", ""]),
    ],
)
def test_of_commands(
    folder: Path,
    command: Callable[[list[str]], int],
    arguments: list[str],
    capsys: pytest.CaptureFixture[str],
) -> None:
    """An empty path, as of a variable of the shell that is not set, is not the current folder."""
    tree = [] if command in (cli.why, cli.replay, cli.record) else ["circle"]
    with pytest.raises(SystemExit) as ended:
        command([*tree, *arguments])
    assert ended.value.code == 2
    assert "empty path" in capsys.readouterr().err
    assert [path.name for path in folder.iterdir()] == ["alarm.py"]
