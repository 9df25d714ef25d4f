"""The command ``bt-skills``."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from bt_dualarm import cli
from bt_dualarm.behaviors.language import LANGUAGE
from bt_dualarm.core.share import share_dir
from bt_dualarm.robots.gripper import gripper_names, load_gripper
from bt_dualarm.robots.robot_description import load_robot, robot_names
from bt_dualarm.skill.registry import Registry
from tests.sim.worlds import WORLD


def test_all_skills_and_node_types_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.skills([]) == 0
    out = capsys.readouterr().out
    for name in {**Registry.load().kinds, **LANGUAGE}:
        assert f"  {name} " in out


def test_all_properties_of_a_skill_are_shown(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "160")
    assert cli.skills(["circle"]) == 0
    out = capsys.readouterr().out
    assert "circle  Trace a circle with the tool" in out
    assert "radius" in out
    assert "≥ 0.005, ≤ 2" in out
    assert "PATH_BROKEN" in out
    assert "circle: {plane: yz, radius: 0.10, turns: 2, speed: 0.5}" in out


def test_node_type_of_the_language_is_shown_with_its_children(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert cli.skills(["retry"]) == 0
    assert "children:" in capsys.readouterr().out


@pytest.mark.parametrize("name", sorted({**Registry.load().kinds, **LANGUAGE}))
def test_every_skill_and_node_type_is_shown_as_text_and_json(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.skills([name]) == 0
    capsys.readouterr()
    assert cli.skills([name, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["name"] == name


def test_unknown_name_is_code_2_with_the_nearest_one(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.skills(["circel"]) == 2
    assert "did you mean 'circle'?" in capsys.readouterr().err


@pytest.mark.parametrize("width", [80, 100])
def test_robots_fit_the_terminal(
    width: int, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """No row of the catalog or of a robot is folded or cut."""
    monkeypatch.setenv("COLUMNS", str(width))
    assert cli.skills(["robots"]) == 0
    out = capsys.readouterr().out
    for name in robot_names():
        robot = load_robot(name)
        (row,) = (line for line in out.splitlines() if line.startswith(f"  {name} "))
        assert ", ".join(robot.postures) in row
        assert row.rstrip().endswith(", ".join(robot.cameras))
        assert cli.skills([name]) == 0
        lines = capsys.readouterr().out.splitlines()
        for word in (*robot.joints, *robot.postures, *robot.cameras, *robot.locked):
            assert sum(line.startswith(f"  {word} ") for line in lines) == 1
        heads = 4 if robot.locked else 3
        assert sum(line.startswith(" ") for line in lines) == heads + sum(
            map(len, (robot.joints, robot.postures, robot.cameras, robot.locked))
        )
        assert max(map(len, lines)) <= width


def test_robot_of_the_user_is_shown_by_its_description(capsys: pytest.CaptureFixture[str]) -> None:
    """The file may be anywhere, and may have no camera mounts."""
    assert cli.skills([str(WORLD / "robots" / "jaco.yaml")]) == 0
    out = capsys.readouterr().out
    assert "jaco  Kinova Jaco 2 (j2s6s200)" in out
    assert "  home     180, 180, 90, 0, 90, 0 " in out
    assert "camera mounts" not in out


def test_robots_are_shown_as_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.skills(["robots", "--json"]) == 0
    everything = json.loads(capsys.readouterr().out)
    assert set(everything) == set(robot_names())
    assert cli.skills(["ur5", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == everything["ur5"]


@pytest.mark.parametrize("width", [80, 100])
def test_grippers_fit_the_terminal(
    width: int, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rows of the catalog and the view of one gripper are not folded or cut."""
    monkeypatch.setenv("COLUMNS", str(width))
    assert cli.skills(["grippers"]) == 0
    out = capsys.readouterr().out
    for name in gripper_names():
        gripper = load_gripper(name)
        (row,) = (line for line in out.splitlines() if line.startswith(f"  {name} "))
        assert f" {gripper.force.most:g} N " in row
        assert row.rstrip().endswith(f"{gripper.mass:.3g} kg")
        assert cli.skills([name]) == 0
        details = capsys.readouterr().out
        assert f"payload: {gripper.payload:g} kg" in details
        assert ("stroke: " in details) == bool(gripper.fingers)
        assert max(map(len, (*out.splitlines(), *details.splitlines()))) <= width


def test_gripper_of_the_user_is_shown_by_its_description(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The content, not the name, distinguishes it from a robot description."""
    description = tmp_path / "claw.yaml"
    description.write_bytes((share_dir("assets") / "grippers" / "robotiq_2f85.yaml").read_bytes())
    assert cli.skills([str(description)]) == 0
    assert "claw  Robotiq 2F-85" in capsys.readouterr().out


def test_grippers_are_shown_as_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.skills(["grippers", "--json"]) == 0
    everything = json.loads(capsys.readouterr().out)
    assert set(everything) == set(gripper_names())
    assert cli.skills(["suction_cup", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == everything["suction_cup"]


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("pnada", "did you mean 'panda'?"),
        ("robot", "did you mean"),
        ("suction", "did you mean 'suction_cup'?"),
        ("no.yaml", "no robot file"),
    ],
)
def test_unknown_robot_is_code_2(
    name: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.skills([name]) == 2
    assert message in capsys.readouterr().err


def test_schema_goes_to_a_file_or_to_the_output(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    target = tmp_path / "schema.json"
    assert cli.skills(["--schema", str(target)]) == 0
    assert cli.skills(["--schema"]) == 0
    assert capsys.readouterr().out == target.read_text(encoding="utf-8")
    assert "2020-12" in json.loads(target.read_text(encoding="utf-8"))["$schema"]


@pytest.mark.parametrize("columns", [80, 140])
def test_description_of_a_port_is_not_broken_word_by_word(
    columns: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """In a narrow terminal it is below the type of the port instead of beside it."""
    monkeypatch.setenv("COLUMNS", str(columns))
    assert cli.skills(["circle"]) == 0
    out = capsys.readouterr().out
    ports = Registry.load().kinds["circle"].ports.model_fields
    short = [str(port.description) for port in ports.values() if len(str(port.description)) < 50]
    assert len(short) > 3
    for description in short:
        assert description in out
    assert max(map(len, out.splitlines())) <= columns
