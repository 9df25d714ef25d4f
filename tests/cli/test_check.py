"""``bt-check`` as a user types it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from bt_dualarm import cli

GOOD = """\
bt_dualarm: 1
name: good
world: {scene: empty}
arms:
  arm1: {robot: ur5, tree: {wait: {seconds: 1}}}
"""
BAD = GOOD.replace("ur5", "ur55").replace("empty", "emty")
WARNED = GOOD.replace("wait: {seconds: 1}", "reach_to_pose: {to: {xyz: [5, 0, 0]}}")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, text in (("good", GOOD), ("bad", BAD), ("warned", WARNED)):
        (tmp_path / f"{name}.yaml").write_text(text, encoding="utf-8")
    return tmp_path


def test_good_file_is_code_0(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.check([str(folder / "good.yaml")]) == 0
    assert capsys.readouterr().out == f"{folder / 'good.yaml'}: fine\n"


def test_all_errors_of_all_files_are_reported(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = [str(folder / f"{name}.yaml") for name in ("bad", "good", "warned")]
    assert cli.check(files) == 1
    out = capsys.readouterr().out
    assert f"{files[0]}:3:16: error: there is no scene 'emty'" in out
    assert f"{files[0]}:5:17: error: there is no robot 'ur55'" in out
    assert f"{files[0]}: 2 errors\n" in out
    assert f"{files[1]}: fine\n" in out
    assert f"{files[2]}: 1 warning\n" in out


def test_warning_alone_is_code_0(folder: Path) -> None:
    assert cli.check([str(folder / "warned.yaml")]) == 0


def test_json_output_lists_the_problems(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.check(["--json", str(folder / "bad.yaml")]) == 1
    first, second = json.loads(capsys.readouterr().out)
    assert (first["line"], first["column"], first["severity"]) == (3, 16, "error")
    assert "ur55" in second["message"]


def test_missing_file_is_code_2(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.check([str(tmp_path / "nothing.yaml")]) == 2
    assert "bt-check: error:" in capsys.readouterr().err


def test_missing_files_keep_no_others_from_being_checked(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = [str(folder / f"{name}.yaml") for name in ("missing", "bad", "gone", "good")]
    assert cli.check(files) == 2
    shown = capsys.readouterr()
    assert f"{files[1]}: 2 errors\n" in shown.out
    assert f"{files[3]}: fine\n" in shown.out
    assert f"{files[0]}: there is no such file" in shown.err
    assert f"{files[2]}: there is no such file" in shown.err


def test_shipped_tree_is_found_by_its_name(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.check(["circle"]) == 0
    assert capsys.readouterr().out.endswith("circle.yaml: fine\n")


def test_help_imports_nothing_heavy() -> None:
    program = (
        "import sys, bt_dualarm.cli as c\n"
        "try:\n  c.check(['--help'])\nexcept SystemExit: pass\n"
        "print(sorted({'numpy', 'mujoco', 'placo', 'rich'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.stdout.splitlines()[-1] == "[]", done.stderr


def test_bt_run_warns_before_it_runs(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run([str(folder / "warned.yaml")]) == 1
    assert "warning: reach_to_pose: to: out of reach of arm1" in capsys.readouterr().err


def test_dry_run_draws_arms_that_are_never_present_together(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A run of the file succeeds; the second arm stands where the first one has been removed."""
    path = folder / "replaced.yaml"
    path.write_text(
        """\
bt_dualarm: 1
world: {scene: empty}
arms:
  boss:
    robot: ur3
    base: {xyz: [0, 3, 0]}
    tree: {sequence: [{remove: {arm: old}}, {spawn: {arm: new}}]}
  old: {robot: ur3, removable: true, tree: {wait: 1}}
  new: {robot: ur5, spawned: false, tree: {log: "a new arm"}}
"""
    )
    assert cli.run([str(path), "--dry-run", "--ascii"]) == 0
    out, err = capsys.readouterr()
    assert "log" in out
    assert "arm 'new' would be" in err


def test_dry_run_draws_all_trees_and_ticks_none(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["spawn_and_command", "--dry-run", "--ascii"]) == 0
    out, _ = capsys.readouterr()
    for arm in ("arm1", "arm2", "arm3", "arm4"):
        assert arm in out
    assert out.count("reach_to_pose") == 6
    assert "RUNNING" not in out
