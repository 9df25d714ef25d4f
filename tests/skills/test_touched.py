"""What falls on an arm, or is run into, is among the metrics of whatever leaf moved it."""

from __future__ import annotations

import pytest

from bt_dualarm.pose import Pose
from bt_dualarm.world.world import World
from tests.plays import Stage
from tests.skills.scenarios import Tree

BALL: Tree = {"shape": "sphere", "size": [0.04], "mass": 0.1, "spawned": False}


def drop(world: World) -> None:
    """A ball onto the tool, from a hand's breadth above the hand that carries it."""
    x, y, z = world.arms["arm1"].tool_pose.position.tolist()
    world.spawn_object("ball", Pose.from_rpy((x, y, z + 0.35)))


@pytest.mark.parametrize(
    ("robot", "node"),
    [
        ("ur5", {"circle": {"plane": "yz", "radius": 0.05, "speed": 0.2}}),
        ("panda", {"move_joints": {"by": {"panda_joint1": 20}, "speed": 0.1}}),
        ("xarm7", {"move_linear": {"offset": {"xyz": [0, 0.15, 0]}, "speed": 0.1}}),
    ],
)
def test_a_ball_that_falls_on_the_arm_is_felt_by_the_score(
    robot: str, node: Tree, stage: Stage
) -> None:
    """Whether the motion goes on or is given up; in an empty world nothing is touched."""
    file: Tree = {
        "world": {"scene": "empty", "time_limit": 20},
        "objects": {"ball": BALL},
        "arms": {"arm1": {"robot": robot, "base": {"xyz": [0, 0, 0.4]}, "tree": node}},
    }
    (name,) = node
    leaf = stage.run(file, deeds=[(0.6, drop)]).leaf(name)
    assert leaf.metrics["touched"] == "ball"
    assert 0.0 < float(leaf.metrics["touch_force_n"]) < 1e4
    clear = stage.run(file).leaf(name)
    assert clear.status == "SUCCESS", clear.reason
    assert "touched" not in clear.metrics
