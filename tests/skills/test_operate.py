"""`operate`: drawers and doors, with and without a joint sensor; conditions and records of them."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bt_dualarm as bt
from bt_dualarm.replay.record import Record
from bt_dualarm.replay.rerun import check_record
from bt_dualarm.skill.registry import Registry
from tests.plays import Stage
from tests.skills.scenarios import CABINET, CUBE, GRIPPING, PULLS, Tree

PULL: Tree = {"operate": {"object": "cabinet", "joint": "slide", "to": 0.12}}
OPEN: Tree = {"joint_at": {"object": "cabinet", "joint": "slide", "between": [0.115, 0.125]}}


def file_of(*leaves: Any, objects: Tree | None = None, **arm: Any) -> dict[str, Any]:
    return {
        "world": {"scene": "table", "reality": "lab", "time_limit": 60},
        "objects": copy.deepcopy(CABINET) | (objects or {}),
        "arms": {"arm1": GRIPPING | arm | {"tree": {"sequence": list(leaves)}}},
    }


@pytest.mark.usefixtures("without_plots")
def test_opened_drawer_is_recorded_replayed_and_resumed(tmp_path: Path) -> None:
    """A cube inside moves along; the record contains the drawer as a moving object."""
    cube = CUBE | {"size": [0.04, 0.04, 0.04], "pose": {"xyz": [0.45, -0.65, 0.467]}}
    file = file_of(PULLS, PULL, OPEN, "release", objects={"cube": cube})
    file |= {
        "bt_dualarm": 1,
        "goal": {
            "open": {"object": "cabinet", "joint": "slide", "between": [0.115, 0.125]},
            "along": {"object": "cube", "on": "cabinet.slide"},
        },
        "name": "drawer",
    }
    result = bt.run(file, record=tmp_path / "out")
    assert result.outcome == "SUCCESS", result
    record = Record.read(tmp_path / "out")
    assert check_record(record, Registry.load()).agrees
    data = bt.load(tmp_path / "out")
    moved = data.objects["cabinet.slide"].position[:, 1]
    assert moved[-1] - moved[0] == pytest.approx(0.12, abs=0.005)
    carried = data.objects["cube"].position[:, 1]
    assert carried[-1] - carried[0] == pytest.approx(0.12, abs=0.03)


@pytest.mark.parametrize("named", ["cabinet", "cabinet.slide"])
def test_attached_part_is_detached_by_the_name_of_its_object(named: str, stage: Stage) -> None:
    """Fingers that open leave it attached, and the refusal of other motions says so."""
    take: Tree = {
        "approach_and_attach": {"object": "cabinet", "part": "handle", "direction": [0, -1, 0]}
    }
    away: Tree = {"move_linear": {"offset": {"xyz": [0, 0.05, 0]}}}
    tree = [take, "release", {"force_success": {"child": away}}, {"detach": {"object": named}}]
    play = stage.run(file_of(*tree, away))
    refused, later = play.leaves("move_linear")
    assert refused.code == "INVALID_TARGET"
    assert "`detach` it first" in refused.reason
    assert later.status == "SUCCESS", later.reason


def test_held_drawer_moves_by_operate_only(stage: Stage) -> None:
    """Other motions are refused before anything moves, and possible after a release."""
    away: Tree = {"reach_to_pose": {"offset": {"xyz": [0, 0.05, 0.05]}}}
    play = stage.run(file_of(PULLS, {"force_success": {"child": away}}, "release", away))
    refused, later = play.leaves("reach_to_pose")
    assert (refused.code, later.status) == ("INVALID_TARGET", "SUCCESS")
    assert "`operate` it" in refused.reason
    assert play.opened.world.joint_position("cabinet.slide") == pytest.approx(0.0, abs=1e-3)


def test_drawer_without_a_sensor_is_tracked_by_the_hand(stage: Stage) -> None:
    """Its position is as declared before, from encoders while held, and the last one afterwards.

    A pose in the frame of a part follows the part.

    Fingers sense the handle between them, and nothing before.
    """
    there: Tree = {"reach_to_pose": {"to": {"in_frame": "cabinet.handle", "xyz": [0, 0.1, 0.1]}}}
    feels: Tree = {"touching": {"by": "fingers"}}
    drawer = copy.deepcopy(CABINET)
    drawer["cabinet"]["joints"]["slide"] |= {"sensor": False, "at": 0.02}
    at_start: Tree = {
        "joint_at": {"object": "cabinet", "joint": "slide", "between": [0.019, 0.021]}
    }
    tree: tuple[Any, ...] = (
        at_start,
        {"not": {"touching": {}}},
        PULLS,
        feels,
        PULL,
        OPEN,
        "release",
        OPEN,
        there,
    )
    play = stage.run(file_of(*tree, objects=drawer))
    assert play.result is not None
    assert play.result.outcome == "SUCCESS", play.result
    world = play.opened.world
    assert world.joint_position("cabinet.slide") == pytest.approx(0.12, abs=5e-3)
    handle = world.object_pose("cabinet.slide").apply(np.array((0.0, 0.155, 0.0)))
    tool = world.arms["arm1"].tool_pose.position
    assert np.allclose(tool, handle + np.array((0, 0.1, 0.1)), atol=5e-3)


def test_attached_part_can_be_operated(stage: Stage) -> None:
    """`approach_and_attach` accepts a part; without fingertips, joint torques show the pull."""
    tree: list[Tree] = [
        {
            "approach_and_attach": {
                "object": "cabinet",
                "part": "handle",
                "direction": [0, -1, 0],
            }
        },
        PULL,
        OPEN,
        {"detach": {"object": "cabinet.slide"}},
    ]
    play = stage.run(file_of(*tree, gripper="none"))
    assert play.result is not None
    assert play.result.outcome == "SUCCESS", play.leaves("operate")


def test_names_of_parts_and_joints_are_checked() -> None:
    wrong = file_of(
        {"grasp": {"object": "cabinet", "part": "handel"}},
        {"operate": {"object": "cabinet", "joint": "slid", "to": 0.1}},
        {"reach_to_pose": {"to": {"in_frame": "cabinet.handel", "xyz": [0, 0, 0]}}},
        {"grasp": {"object": "cabinet.slide", "part": "top"}},
    )
    found = [str(one) for one in bt.check({"bt_dualarm": 1, "name": "x", **wrong})]
    assert len(found) == 4, found
    assert "did you mean 'handle'" in found[0]
    assert "did you mean 'slide'" in found[1]
    assert "did you mean 'cabinet.handle'" in found[2]
    assert "no part of cabinet.slide 'top'" in found[3]


def test_target_beyond_the_range_of_the_joint_is_refused(stage: Stage) -> None:
    play = stage.run(file_of({"operate": {"object": "cabinet", "joint": "slide", "to": 1.0}}))
    (leaf,) = play.leaves("operate")
    assert leaf.code == "INVALID_TARGET"
    assert "0 to 0.18 m" in leaf.reason


def test_hand_keeps_a_distance_from_the_door_that_it_moves(stage: Stage) -> None:
    """The grasp at the center of the handle left 5 mm, and the retreat began in collision."""
    stems: Tree = {
        name: {"shape": "box", "size": [0.01, 0.055, 0.01]}
        | {"pose": {"xyz": [-0.1475, -0.0275, z]}}
        for name, z in (("stem1", -0.032), ("stem2", 0.032))
    }
    bar: Tree = {"shape": "box", "size": [0.01289, 0.01289, 0.09], "color": "red"}
    door: Tree = {
        "shape": "compound",
        "mass": 5.0,
        "fixed": True,
        "pose": {"xyz": [0.7155, -0.6347, 0.7007], "rpy": [0, 0, -130.556]},
        "parts": {
            "back": {"shape": "box", "size": [0.355, 0.01, 0.4488], "pose": {"xyz": [0, 0.12, 0]}},
            "panel": {"shape": "box", "size": [0.355, 0.012, 0.4488]},
            "handle": bar | {"pose": {"xyz": [-0.1475, -0.055, 0]}},
            **stems,
        },
        "joints": {
            "hinge": {"type": "hinge", "axis": [0, 0, 1], "anchor": [0.1775, 0, 0]}
            | {"range": [0, 110], "friction": 0.5, "damping": 0.1, "mass": 0.2}
            | {"parts": ["panel", "handle", "stem1", "stem2"]}
        },
    }
    arm = {"robot": "ur10", "gripper": "robotiq_2f85", "base": {"xyz": [0, 0, 0.4]}}
    moved = {"object": "door", "joint": "hinge"}
    leaves = [
        {"grasp": {"object": "door", "part": "handle", "then_to": 66.8}},
        {"operate": moved | {"to": 66.8}},
        {"operate": moved | {"to": 0}},
    ]
    play = stage.run(
        {
            "world": {"scene": "empty", "reality": "lab", "time_limit": 60},
            "objects": {"door": door},
            "arms": {"arm1": arm | {"tree": {"sequence": leaves}}},
        }
    )
    assert [leaf.status for leaf in play.leaves("operate")] == ["SUCCESS", "SUCCESS"]
