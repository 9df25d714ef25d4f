"""Gripper ports in a file are checked against the grippers' descriptions, with line and column."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import pytest

from bt_dualarm.robots.gripper import gripper_names
from bt_dualarm.robots.robot_description import robot_names
from bt_dualarm.runtime.file_check import check
from bt_dualarm.skill.registry import Registry
from tests.families import some

KINDS = Registry.load().kinds

MISTAKEN = """\
bt_dualarm: 1
name: gripper_mistakes
world: {scene: empty}
arms:
  arm1:
    robot: ur5
    gripper: robotiq_2f58
    tree: open_gripper
  arm2:
    robot: panda
    base: {xyz: [2, 0, 0]}
    gripper: panda_hand
    tree:
      sequence:
        - open_gripper: {width: 0.09, speed: 0.2}
        - close_gripper: {force: 100, speed: 0.001}
  arm3:
    robot: ur3
    base: {xyz: [4, 0, 0]}
    tree:
      guard: {condition: holding, child: {wait: 1}}
  arm4:
    robot: ur3
    base: {xyz: [6, 0, 0]}
    gripper: suction_cup
    tree: {sequence: [{close_gripper: {force: 61}}, {close_gripper: {width: 0.3}}]}
"""

EXPECTED = (
    (7, 14, "there is no gripper 'robotiq_2f58'", "did you mean 'robotiq_2f85'?"),
    (15, 33, "open_gripper: width: panda_hand cannot do 0.09 m", "its width is 0 to 0.08 m"),
    (15, 46, "open_gripper: speed: panda_hand cannot do 0.2 m/s", "its speed is 0.005 to 0.1 m/s"),
    (16, 34, "close_gripper: force: panda_hand cannot do 100 N", "its force is 5 to 70 N"),
    (16, 46, "close_gripper: speed: panda_hand cannot do 0.001 m/s", "its speed is 0.005 to 0.1"),
    (21, 15, "holding: arm3 has no gripper", "give arm3 one: gripper: NAME"),
    (26, 47, "close_gripper: force: suction_cup cannot do 61 N", "its force is 5 to 60 N"),
)
"""Line, column, message, and beginning of the hint of every problem."""


def test_every_mistake_is_reported_at_its_position() -> None:
    problems = check(MISTAKEN, KINDS).problems
    found = [(p.place.line, p.place.column, p.message, p.hint) for p in problems]
    assert [(*row[:3], row[3][: len(EXPECTED[i][3])]) for i, row in enumerate(found)] == list(
        EXPECTED
    )


@pytest.mark.parametrize(
    ("leaf", "message", "hint"),
    [
        ("open_gripper: {width: 85}", "must be at most 1 m, not 85", "in meters: 0.085, if 85 mm"),
        ("open_gripper: {speed: 50}", "must be at most 2 m/s, not 50", ""),
        ("close_gripper: {force: -3}", "must be greater than 0 N, not -3", ""),
    ],
)
def test_value_that_no_gripper_could_have_is_one_mistake(
    leaf: str, message: str, hint: str
) -> None:
    text = MISTAKEN[: MISTAKEN.index("    tree")].replace("f58", "f85") + f"    tree: {{{leaf}}}\n"
    (problem,) = check(text, KINDS).problems
    assert problem.message.endswith(message)
    assert problem.hint.startswith(hint)


@pytest.mark.parametrize(("gripper", "robot"), some(product(gripper_names(), robot_names()), 3))
def test_any_gripper_fits_any_robot_of_the_catalog(gripper: str, robot: str) -> None:
    text = f"""\
bt_dualarm: 1
name: fits
world: {{scene: empty}}
arms:
  arm1:
    robot: {robot}
    gripper: {gripper}
    base: {{xyz: [0, 0, 0.2]}}   # a gripper may be longer than the tool that it replaces
    tree: {{sequence: [open_gripper, {{close_gripper: {{empty: true}}}}, go_home]}}
"""
    assert check(text, KINDS).problems == ()


def test_an_error_in_a_description_is_reported_at_its_own_line(tmp_path: Path) -> None:
    (tmp_path / "claw.yaml").write_text(
        "title: Claw\n"
        "tool: {xyz: [0, 0, 0.1]}\n"
        "palm: {mass: 0.2, shapes: [{shape: box, size: [0.1, 0.1]}]}\n"
        "force: {value: [20, 10], source: my own claw}\n"
        "payload: {value: 1, source: my own claw}\n",
        encoding="utf-8",
    )
    text = (
        "bt_dualarm: 1\nname: claw\nworld: {scene: empty}\n"
        "arms: {arm1: {robot: ur5, gripper: claw.yaml, tree: open_gripper}}\n"
    )
    problems = check(text, KINDS, folder=tmp_path).problems
    lines = [str(problem) for problem in problems]
    assert any("gripper 'claw.yaml' cannot be used" in line for line in lines)
    assert any("claw.yaml:3:" in line and "a box has 3 sizes" in line for line in lines)
    assert any("claw.yaml:4:" in line and "the smaller value comes first" in line for line in lines)


@pytest.mark.parametrize(("mass", "is_heavy"), [(2.5, False), (3.5, True)])
def test_a_gripper_heavier_than_the_payload_is_a_warning(
    mass: float, is_heavy: bool, tmp_path: Path
) -> None:
    (tmp_path / "block.yaml").write_text(
        "title: Block\n"
        "tool: {xyz: [0, 0, 0.1]}\n"
        f"palm: {{mass: {mass}, shapes: [{{shape: sphere, size: [0.05], xyz: [0, 0, 0.05]}}]}}\n"
        "cup: {radius: 0.020, depth: 0.008, seal: 0.9}\n"
        "force: {value: [5, 60], source: my own cup}\n"
        "payload: {value: 1, source: my own cup}\n",
        encoding="utf-8",
    )
    text = (
        "bt_dualarm: 1\nname: heavy\nworld: {scene: empty}\n"
        "arms: {arm1: {robot: ur3, gripper: block.yaml, tree: go_home}}\n"
    )
    checked = check(text, KINDS, folder=tmp_path)
    assert checked.file is not None, checked.problems
    assert [(p.severity, p.place.line, p.message) for p in checked.problems] == (
        [("warning", 4, "gripper 'block' weighs 3.5 kg")] if is_heavy else []
    )


BOX = "{shape: box, size: [0.05, 0.05, 0.05], mass: 0.2, pose: {xyz: [0.45, -0.4, 0.425]}}"
SMALL = BOX.replace("0.05, 0.05, 0.05", "0.03, 0.03, 0.03")


@pytest.mark.parametrize(
    ("gripper", "cube", "leaf", "reality", "words"),
    [
        ("robotiq_2f85", BOX, "{object: cube}", "lab", ""),
        ("robotiq_2f85", BOX.replace("0.05", "0.09"), "{object: cube}", "lab", "90 mm wide"),
        ("robotiq_2f85", BOX.replace("0.2", "6"), "{object: cube}", "lab", "weighs 6 kg"),
        ("robotiq_2f85", BOX.replace("0.2", "6"), "{object: cube}", "rough", ""),
        ("robotiq_2f85", BOX, "{object: cube, mass: 6}", "rough", "weighs 6 kg"),
        (
            "robotiq_2f85",
            BOX.replace("mass", "fixed: true, mass"),
            "{object: cube}",
            "lab",
            "fixed",
        ),
        ("suction_cup", BOX, "{object: cube}", "lab", ""),
        ("suction_cup", SMALL, "{object: cube}", "lab", "no face on which suction_cup seals"),
    ],
)
def test_an_object_that_the_gripper_cannot_hold_is_a_warning(
    gripper: str, cube: str, leaf: str, reality: str, words: str
) -> None:
    """The file was valid without a warning, and the run failed at once."""
    text = (
        "bt_dualarm: 1\nname: unfit\n"
        f"world: {{scene: table, reality: {reality}}}\nobjects: {{cube: {cube}}}\n"
        f"arms: {{arm1: {{robot: ur10, gripper: {gripper}, base: {{xyz: [0, 0, 0.4]}},\n"
        f"  tree: {{grasp: {leaf}}}}}}}\n"
    )
    checked = check(text, KINDS, build=False)
    assert checked.file is not None
    unfit = [one for one in checked.problems if "payload" not in one.hint]  # that of the arm
    assert [(one.severity, one.place.line) for one in unfit] == [("warning", 6)] * bool(words)
    assert all(words in one.message for one in unfit)


def test_a_mass_that_is_assumed_beyond_the_payload_is_a_warning(tmp_path: Path) -> None:
    (tmp_path / "cup.yaml").write_text(CUP, encoding="utf-8")
    text = (
        "bt_dualarm: 1\nname: assumed\nworld: {scene: table, reality: REALITY}\n"
        f"objects: {{cube: {BOX}}}\n"
        "arms: {arm1: {robot: ur5, gripper: cup.yaml, base: {xyz: [0, 0, 0.4]}, tree: LEAF}}\n"
    )

    def found(reality: str, leaf: str) -> list[str]:
        written = text.replace("REALITY", reality).replace("LEAF", leaf)
        problems = check(written, KINDS, folder=tmp_path, build=False).problems
        return [f"{one.message}; {one.hint}" for one in problems]

    (warning,) = found("rough", "{grasp: {object: cube}}")
    assert "1 kg is assumed; cup may hold 0.5 kg: give the leaf `mass`" in warning
    assert found("rough", "{grasp: {object: cube, mass: 0.25}}") == []
    assert found("lab", "{grasp: {object: cube}}") == []


CUP = """\
title: Cup
tool: {xyz: [0, 0, 0.1]}
palm: {mass: 0.2, shapes: [{shape: box, size: [WIDE, WIDE, 0.02], xyz: [0, 0, 0.01]}]}
cup: {radius: 0.020, depth: 0.008, seal: 0.9}
force: {value: [5, 30], source: my own cup}
payload: {value: 0.5, source: my own cup}
""".replace("WIDE", "0.05")


@pytest.mark.parametrize(("width", "is_blind"), [("0.05", False), ("0.30", True)])
def test_a_hand_before_the_center_of_its_camera_is_a_warning(
    width: str, is_blind: bool, tmp_path: Path
) -> None:
    """Skills turn the camera so that what they look for is there: it was lost at once."""
    (tmp_path / "cup.yaml").write_text(CUP.replace("0.05, 0.05", f"{width}, {width}"))
    text = (
        "bt_dualarm: 1\nname: blind\nworld: {scene: empty}\n"
        "arms: {arm1: {robot: jaco2, gripper: cup.yaml, base: {xyz: [0, 0, 0.8]},\n"
        "  camera: {mount: wrist}, tree: go_home}}\n"
    )
    problems = check(text, KINDS, folder=tmp_path).problems
    assert [(one.severity, one.place.line) for one in problems] == [("warning", 5)] * is_blind
    for one in problems:
        assert "arm1/gripper/palm hides the center of the camera's image" in one.message
