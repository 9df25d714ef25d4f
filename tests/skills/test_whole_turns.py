"""Joints with more than one turn rotate the other way around where the nearer way is blocked."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from bt_dualarm.core.share import share_dir
from tests.plays import Stage, joints
from tests.skills.scenarios import Tree

BESIDE: Tree = {"reach_to_pose": {"to": {"xyz": [0.4, -0.2, 0.3], "rpy": [180, 0, 0]}}}

TASKS: dict[str, tuple[Tree, Tree]] = {
    "reach_to_pose": (BESIDE, {"to": {"xyz": [0.4, 0.2, 0.3], "rpy": [180, 0, 0]}}),
    "grasp": (BESIDE, {"object": "cube"}),
    "approach_and_attach": (BESIDE, {"object": "cube"}),
    "draw": (
        BESIDE,
        {"plane": "xy", "points": [[0, 0.4], [0.05, 0.4], [0.05, 0.45]], "closed": False},
    ),
    "place": (
        {"grasp": {"object": "cube"}},
        {"object": "cube", "at": {"xyz": [0.45, -0.25, 0.02]}},
    ),
}
"""What brings the arm to one side of the wall, and a leaf that takes it to the other."""


def box(*size: float, at: tuple[float, float, float]) -> dict[str, object]:
    """Fixed obstacle that appears later."""
    pose = {"xyz": list(at)}
    return {"shape": "box", "size": list(size), "fixed": True, "spawned": False, "pose": pose}


@pytest.mark.parametrize("skill", TASKS)
def test_it_goes_around_the_back(skill: str, stage: Stage, tmp_path: Path) -> None:
    """A wall in front and a roof leave no path to the other side but that of more than half a turn.

    Shoulder, elbow and wrist of this UR5 keep their branch, so that it cannot fold to pass.
    """
    description = yaml.safe_load(
        (share_dir("assets") / "robots/ur5.yaml").read_text(encoding="utf-8")
    )
    description["limits"]["position"] = {
        "lower": [-6.2832, -2.0, 1.2, -6.2832, -3.1, -6.2832],
        "upper": [6.2832, 0.3, 2.1, 6.2832, -0.05, 6.2832],
        "source": "this test",
    }
    description["postures"] = {"home": description["postures"]["home"]}
    (tmp_path / "one_branch.yaml").write_text(yaml.safe_dump(description), encoding="utf-8")
    first, second = TASKS[skill]
    walls = {
        "wall": box(2, 0.01, 0.69, at=(1.24, 0, 0.345)),
        "roof": box(3, 3, 0.01, at=(0, 0, 0.7)),
    }
    cube = {"shape": "box", "size": [0.04] * 3, "mass": 0.1, "pose": {"xyz": [0.45, 0.25, 0.02]}}
    tool = {} if skill in ("approach_and_attach", "draw") else {"gripper": "robotiq_2f85"}
    tree = [first, {"spawn": {"object": "wall"}}, {"spawn": {"object": "roof"}}, {skill: second}]
    arm = {"robot": str(tmp_path / "one_branch.yaml"), "tree": {"sequence": tree}} | tool
    file = {"world": {"scene": "empty"}, "objects": walls | {"cube": cube}, "arms": {"arm1": arm}}
    play = stage.run({"name": "around"} | file)
    leaf = play.leaves(skill)[-1]
    assert leaf.status == "SUCCESS", leaf.reason
    assert abs(joints(play.world)[0]) > 5.0
