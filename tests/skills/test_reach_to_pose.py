"""`reach_to_pose` moves the tool to its goal, around obstacles, with every arm."""

from __future__ import annotations

import numpy as np
import pytest

import bt_dualarm as bt
from bt_dualarm.core.pose import Pose
from bt_dualarm.planning.problem import PlanningProblem
from bt_dualarm.planning.process import PendingMotion, PlanningProcess
from bt_dualarm.robots.robot_description import load_robot
from bt_dualarm.sim.world import World
from tests.plays import Play, Stage, joints
from tests.skills.scenarios import ABOVE, Scenario, Tree

SCENARIO = Scenario()


def reached(stage: Stage, node: Tree, scenario: Scenario = SCENARIO) -> tuple[Play, Pose, Pose]:
    """The play, and the tool's true pose before and after the motion."""
    play = stage.play(scenario.file({"reach_to_pose": node}))
    start = play.world.arms["arm1"].tool_pose
    play.run()
    assert play.leaf("reach_to_pose").status == "SUCCESS", play.leaf("reach_to_pose").reason
    return play, start, play.world.arms["arm1"].tool_pose


@pytest.mark.parametrize("speed", [0.1, 1.0])
def test_absolute_pose(speed: float, stage: Stage) -> None:
    node = {"to": {"xyz": [0.4, 0.2, 0.6], "rpy": [180, 0, 30]}, "speed": speed}
    play, _, end = reached(stage, node)
    expected = Pose.from_rpy((0.4, 0.2, 0.6), (np.pi, 0.0, np.pi / 6))
    assert end.distance(expected) < 1e-3
    assert end.angle(expected) < np.deg2rad(0.5)
    metrics = play.leaf("reach_to_pose").metrics
    assert float(metrics["position_error_m"]) == pytest.approx(end.distance(expected), abs=2e-4)


def test_goal_without_orientation_keeps_it(stage: Stage) -> None:
    _, start, end = reached(stage, {"to": {"xyz": [0.4, 0.1, 0.7]}})
    assert end.angle(start) < np.deg2rad(0.5)
    assert end.position == pytest.approx((0.4, 0.1, 0.7), abs=1e-3)


def test_offset_in_the_world(stage: Stage) -> None:
    _, start, end = reached(stage, {"offset": {"xyz": [0.0, 0.1, -0.05], "rpy": [0, 0, 20]}})
    assert end.position - start.position == pytest.approx((0.0, 0.1, -0.05), abs=1e-3)
    turn = (end.rotation * start.rotation.inv()).as_rotvec(degrees=True)
    assert turn == pytest.approx((0, 0, 20), abs=0.5)


def test_offset_in_the_tool(stage: Stage) -> None:
    node = {"offset": {"xyz": [0, 0, -0.1], "rpy": [0, 0, 20], "frame": "tool"}}
    _, start, end = reached(stage, node)
    step = start.inverse @ end
    assert step.position == pytest.approx((0, 0, -0.1), abs=1e-3)
    assert step.rotation.as_rotvec(degrees=True) == pytest.approx((0, 0, 20), abs=0.5)


def test_posture(stage: Stage) -> None:
    play, _, _ = reached(stage, {"posture": "up"})
    assert joints(play.world) == pytest.approx(load_robot("ur5").postures["up"], abs=1e-3)


@pytest.mark.parametrize("planner", ["RRTConnect", "BITstar"])
def test_motion_avoids_an_obstacle_with_the_requested_planner(
    planner: str, stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A wall is spawned between start and goal; the arm does not touch it."""
    planners = []

    def record_planner(self: PlanningProcess, problem: PlanningProblem) -> PendingMotion:
        planners.append(problem.planner)
        return solve(self, problem)

    solve = PlanningProcess.solve
    monkeypatch.setattr(PlanningProcess, "solve", record_planner)
    wall = {
        "shape": "box",
        "size": [0.3, 0.02, 0.5],
        "mass": 5,
        "fixed": True,
        "spawned": False,
        "pose": {"xyz": [0.55, 0.0, 0.65]},
    }
    scenario = Scenario({"wall": wall}, arm={"robot": "ur5", "base": ABOVE})
    play = stage.play(
        scenario.file(
            {"reach_to_pose": {"to": {"xyz": [0.5, 0.3, 0.6], "rpy": [180, 0, 0]}}},
            {"spawn": {"object": "wall"}},
            {
                "reach_to_pose": {
                    "to": {"xyz": [0.5, -0.3, 0.6], "rpy": [180, 0, 0]},
                    "planner": planner,
                }
            },
        )
    )
    touched = []

    def record_contact(world: World) -> None:
        if "wall" in world.objects:
            touched.append((world.data.contact.geom == world.object_geom("wall")).any())

    play.watchers.append(record_contact)
    play.run()
    assert [leaf.status for leaf in play.arm().runs] == ["SUCCESS"] * 3, play.arm()
    assert not any(touched)
    assert planners == [planner]


@pytest.mark.parametrize("robot", ["ur3", "ur10", "panda", "xarm7"])
def test_every_arm_of_the_catalog(robot: str, stage: Stage) -> None:
    """A step down and to the side from the home posture."""
    scenario = Scenario(arm={"robot": robot, "base": ABOVE})
    _, start, end = reached(stage, {"offset": {"xyz": [0, 0.08, -0.05]}}, scenario)
    assert end.position - start.position == pytest.approx((0, 0.08, -0.05), abs=1e-3)


@pytest.mark.parametrize(
    ("block", "to"),
    [
        ((0.22, 0.17, 0.42), (0.46, -0.22, 0.36)),
        ((0.30, -0.03, 0.38), (0.58, -0.29, 0.32)),
        ((0.17, -0.08, 0.34), (0.50, -0.14, 0.31)),
        ((0.19, 0.17, 0.41), (0.58, 0.01, 0.32)),
    ],
)
def test_far_ik_branch_is_used_if_the_near_ones_collide(
    block: tuple[float, ...], to: tuple[float, ...]
) -> None:
    """The three nearest branches of this UR5 are inside the block."""
    box: Tree = {"shape": "box", "size": [0.1, 0.5, 0.1], "mass": 1, "fixed": True}
    tree: Tree = {
        "bt_dualarm": 1,
        "world": {"scene": "empty"},
        "objects": {"block": {**box, "pose": {"xyz": list(block)}}},
        "arms": {
            "arm": {
                "robot": "ur5",
                "tree": {"reach_to_pose": {"to": {"xyz": list(to), "rpy": [180, 0, 0]}}},
            }
        },
    }
    leaf = next(iter(bt.run(tree).arms["arm"].runs))
    assert str(leaf.status) == "SUCCESS", leaf.reason
