"""Mounted grippers: given by name, or by the value of a parameter of the file."""

from __future__ import annotations

from pathlib import Path

import pytest

from bt_dualarm.behaviors.load import check_file, load_tree_file
from tests.spec.writing import SKILLS, write

FILE = """
    bt_dualarm: 1
    params: {grasp: {type: text, default: attach}}
    arms:
      arm1:
        robot: ur5
        gripper: GRIPPER
        tree: {log: "{grasp}"}
"""
BY_CASES = '{value: "{grasp}", cases: {attach: none, fingers: robotiq_2f85}}'


@pytest.mark.parametrize(
    ("gripper", "grasp", "mounted"),
    [
        ("robotiq_2f85", "attach", "robotiq_2f85"),
        ("none", "attach", None),
        ('"{grasp}"', "panda_hand", "panda_hand"),
        ('"{grasp}"', "none", None),
        (BY_CASES, "attach", None),
        (BY_CASES, "fingers", "robotiq_2f85"),
    ],
)
def test_gripper_is_selected_by_the_parameter(
    gripper: str, grasp: str, mounted: str | None, tmp_path: Path
) -> None:
    path = write(tmp_path, FILE.replace("GRIPPER", gripper))
    assert load_tree_file(path, SKILLS, {"grasp": grasp}).arms["arm1"].gripper == mounted


@pytest.mark.parametrize(
    ("gripper", "message"),
    [
        (BY_CASES, "no case for 'welded'; cases: attach, fingers"),
        ('{value: "{grasp}"}', "expected a gripper, or a value and cases"),
        ('{value: "{grasp}", cases: {welded: 3}}', "case 'welded': expected the name of a gripper"),
        ('{value: "{grasp}", cases: {welded: ""}}', "gripper"),
        ("3", "gripper"),
        ('""', "gripper"),
    ],
)
def test_mistakes_are_reported_at_their_line(gripper: str, message: str, tmp_path: Path) -> None:
    path = write(tmp_path, FILE.replace("GRIPPER", gripper))
    (problem,) = check_file(path, SKILLS, {"grasp": "welded"})
    assert problem.severity == "error"
    assert message in problem.message
    assert problem.place.line == 6
