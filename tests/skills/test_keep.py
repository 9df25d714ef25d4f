"""Path constraints of skills hold in the true world, are measured, and refused if infeasible."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from bt_dualarm.core.pose import Vector
from bt_dualarm.sim.world import World
from bt_dualarm.spec.node_types import validated
from bt_dualarm.spec.path_keep import Keep
from tests.plays import Stage
from tests.skills.scenarios import Scenario, Tree

UP = np.array((0.0, 0.0, 1.0))
WALL = {
    "shape": "box", "size": [0.02, 0.3, 0.35], "mass": 1, "fixed": True,
    "pose": {"xyz": [0.1, -0.5, 0.575]},
}  # fmt: skip
CUP = {"shape": "cylinder", "size": [0.02, 0.1], "mass": 0.2, "pose": {"xyz": [0.3, -0.4, 0.45]}}


@dataclass
class Tilts:
    """Largest true tilt of the cup, or of the tool from its start."""

    most: float = 0.0
    heights: list[float] = field(default_factory=list)
    first: Vector | None = None

    def record_tool(self, world: World) -> None:
        tool = world.arms["arm1"].tool_pose
        if self.first is None:
            self.first = tool.inverse.turn(UP)
        self.most = max(self.most, float(np.arccos(min(1.0, tool.turn(self.first) @ UP))))
        self.heights.append(float(tool.position[2]))

    def record_cup(self, world: World) -> None:
        z = world.object_pose("cup").rotation_matrix[2, 2]
        self.most = max(self.most, float(np.arccos(min(1.0, z))))


TURNED = {"xyz": [-0.1, -0.25, -0.1], "rpy": [0, 0, 90]}
"""A step with a rotation about the vertical: linear in joint space it tilts a Panda's tool by
2.7°."""


@pytest.mark.parametrize(
    ("robot", "posture"), [("ur5", "present"), ("panda", "home"), ("xarm7", "home")]
)
def test_tool_stays_upright_where_the_fastest_motion_would_tilt_it(
    robot: str, posture: str, stage: Stage
) -> None:
    leaf: Tree = {"reach_to_pose": {"offset": TURNED, "keep": {"upright": "1 deg"}}}
    arm: Tree = {"robot": robot, "posture": posture, "base": {"xyz": [0, 0, 0.4]}}
    play = stage.play(Scenario(arm=arm).file(leaf))
    tilts = Tilts()
    play.watchers.append(tilts.record_tool)
    play.run()
    report = play.leaf("reach_to_pose")
    assert report.status == "SUCCESS", report.reason
    assert tilts.most < np.radians(1.0)
    assert float(report.metrics["upright_max_rad"]) == pytest.approx(tilts.most, abs=2e-3)
    assert report.metrics["keep_violation_rad"] == 0.0


@pytest.mark.parametrize("gripper", ["robotiq_2f85", "suction_cup"])
def test_cup_is_carried_upright_over_a_wall(gripper: str, stage: Stage) -> None:
    tree: Tree = {
        "world": {"scene": "table", "reality": "lab"},
        "objects": {"cup": CUP, "wall": WALL},
        "arms": {
            "arm1": {
                "robot": "ur5",
                "gripper": gripper,
                "base": {"xyz": [0, 0, 0.4]},
                "tree": {
                    "sequence": [
                        {"grasp": {"object": "cup"}},
                        {
                            "transport": {
                                "to": {"xyz": [-0.15, -0.45, 0.55]},
                                "keep": {"upright": 5, "height": [0.47, 1.1]},
                            }
                        },
                    ]
                },
            }
        },
    }
    play = stage.play(tree)
    tilts = Tilts()
    play.watchers.append(tilts.record_cup)
    play.run()
    report = play.leaf("transport")
    assert report.status == "SUCCESS", report.reason
    assert tilts.most < np.radians(5.5)
    assert 0.47 <= float(report.metrics["height_min_m"]) < float(report.metrics["height_max_m"])
    assert float(report.metrics["height_max_m"]) <= 1.1


@pytest.mark.parametrize(
    ("node", "reason"),
    [
        (
            {"reach_to_pose": {"to": {"xyz": [0.4, 0.2, 0.6], "rpy": [90, 0, 0]},
                               "keep": {"upright": 5}}},
            "at the goal upright",
        ),
        (
            {"reach_to_pose": {"to": {"xyz": [0.4, 0.2, 0.6]}, "keep": {"height": [1.5, 2]}}},
            "at the start height",
        ),
        (
            {"move_linear": {"offset": {"xyz": [0, 0, -0.1]}, "keep": {"facing": {
                "direction": [1, 0, 0], "axis": "-x", "within": 1}}}},
            "at the start facing",
        ),
        (
            {"move_linear": {"offset": {"xyz": [0, 0.1, 0], "rpy": [40, 0, 0]},
                             "keep": {"upright": 10}}},
            "at the goal upright",
        ),
    ],
)  # fmt: skip
def test_infeasible_limit_is_refused_before_any_motion(
    node: Tree, reason: str, stage: Stage
) -> None:
    play = stage.play(Scenario().file(node))
    tilts = Tilts()
    play.watchers.append(tilts.record_tool)
    play.run()
    report = play.leaf(next(iter(node)))
    assert (report.status, report.code) == ("FAILURE", "KEEP_VIOLATED")
    assert report.reason.startswith(reason)
    assert np.ptp(tilts.heights) < 1e-3


def test_violation_stops_the_motion(stage: Stage, monkeypatch: pytest.MonkeyPatch) -> None:
    """The encoders reveal that a plan violates the limit."""
    from bt_dualarm.planning.path_constraints import ConstrainedProblem

    monkeypatch.setattr(ConstrainedProblem, "keeps", lambda self, motion: True)
    node: Tree = {"reach_to_pose": {"offset": TURNED, "keep": {"upright": 1}}}
    play = stage.play(Scenario(arm={"robot": "panda"}).file(node))
    play.run()
    report = play.leaf("reach_to_pose")
    assert (report.status, report.code) == ("FAILURE", "KEEP_VIOLATED")
    assert report.reason.startswith("during the motion upright")
    assert float(report.metrics["keep_violation_rad"]) > 0.0
    assert float(report.metrics["upright_max_rad"]) > np.radians(1.0)


def test_move_linear_keeps_a_point_in_front_of_the_tool(stage: Stage) -> None:
    node: Tree = {
        "move_linear": {
            "offset": {"xyz": [0, 0, -0.1], "frame": "world"},
            "keep": {"facing": {"toward": {"in_frame": "tool", "xyz": [0, 0, 1]}, "within": 10}},
        }
    }
    play = stage.play(Scenario().file(node))
    play.run()
    report = play.leaf("move_linear")
    assert report.status == "SUCCESS", report.reason
    assert 0.0 < float(report.metrics["facing_max_rad"]) < np.radians(10)


@pytest.mark.parametrize(
    "given",
    [
        {},
        {"upright": 0.1},
        {"upright": "5 m"},
        {"height": [0.5, 0.5]},
        {"height": [0.6, 0.5]},
        {"facing": {}},
        {"facing": {"direction": [0, 0, 0]}},
        {"facing": {"direction": [0, 0, 1], "toward": {"xyz": [0, 0, 1]}}},
        {"facing": {"direction": [0, 0, 1], "axis": "z"}},
    ],
)
def test_invalid_limits_are_refused(given: Any) -> None:
    with pytest.raises(ValueError, match="validation error"):
        validated(Keep, given)


@pytest.mark.parametrize(
    ("robot", "start", "yaw", "end", "code"),
    [
        ("panda", (0.507, -0.367, 0.612), 168.1, (0.227, -0.215, 0.148), ""),
        ("fr3", (0.522, 0.289, 0.401), -1.1, (0.25, -0.081, 0.46), ""),
        ("fr3", (0.192, -0.382, 0.519), 162.4, (0.593, 0.075, 0.54), "PATH_BROKEN"),
    ],
)
def test_constrained_line_is_not_preceded_by_an_unconstrained_motion(
    robot: str,
    start: tuple[float, float, float],
    yaw: float,
    end: tuple[float, float, float],
    code: str,
    stage: Stage,
) -> None:
    """The line is easier from another posture, but the motion to that would be unconstrained."""
    keep = {"upright": 5}
    file: Tree = {
        "world": {"scene": "empty", "reality": "lab", "time_limit": 30},
        "arms": {
            "arm1": {
                "robot": robot,
                "base": {"xyz": [0, 0, 0.1]},
                "tree": {
                    "sequence": [
                        {"reach_to_pose": {"to": {"xyz": [*start], "rpy": [180, 0, yaw]}}},
                        {"move_linear": {"to": {"xyz": [*end]}, "keep": keep}},
                    ]
                },
            }
        },
    }
    report = stage.run(file).leaf("move_linear")
    assert report.code == code, report.reason
    if not code:
        assert float(report.metrics["upright_max_rad"]) < np.radians(1.0)
