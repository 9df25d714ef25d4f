"""A tool keeps its transform to the tool of another arm, which slows down for the follower."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from bt_dualarm.core.pose import Pose
from bt_dualarm.sim.world import World
from tests.plays import Play, Stage
from tests.skills.scenarios import Tree

BEGIN_S = 0.6
"""Time at which the other arm begins to move, s."""

FAST: tuple[Tree, ...] = (
    {"wait": {"seconds": BEGIN_S}},
    {"move_linear": {"offset": {"xyz": [0.0, 0.1, 0.1]}, "speed": 1.0}},
    {"reach_to_pose": {"offset": {"xyz": [0.05, -0.15, 0.0], "rpy": [10, 0, 15]}, "speed": 1.0}},
)


class Transform:
    """True pose of the second tool in the frame of the first one at each step."""

    def __init__(self) -> None:
        self.poses: list[tuple[float, Pose]] = []

    def record(self, world: World) -> None:
        arms = world.arms
        if {"arm1", "arm2"} <= arms.keys():
            seen = arms["arm1"].tool_pose.inverse @ arms["arm2"].tool_pose
            self.poses.append((world.time, seen))

    def error_m(self, since: float, until: float) -> float:
        """Largest distance from the transform at the beginning of an interval."""
        positions = np.array([one.position for time, one in self.poses if since <= time <= until])
        return float(np.linalg.norm(positions - positions[0], axis=1).max())


def pair(leader: str, follower: str, *leaves: Tree, follow: Tree | None = None) -> dict[str, Any]:
    """Two arms that face each other, the second of which follows the first."""
    arms: Tree = {
        "arm1": {"robot": leader, "tree": {"sequence": [*leaves]}},
        "arm2": {
            "robot": follower,
            "base": {"xyz": [1.25, 0, 0], "rpy": [0, 0, 180]},
            "tree": {"sequence": [{"follow_tool": {"arm": "arm1"} | (follow or {})}]},
        },
    }
    world = {"scene": "empty", "reality": "lab", "seed": 3, "time_limit": 30.0}
    return {"name": "pair", "world": world, "arms": arms}


def followed(stage: Stage, file: dict[str, Any]) -> tuple[Play, Transform]:
    play = stage.play(file)
    transform = Transform()
    play.watchers.append(transform.record)
    play.run()
    return play, transform


@pytest.mark.parametrize(("leader", "follower"), [("ur5", "panda"), ("panda", "ur5")])
def test_tool_follows_within_a_millimeter_at_full_speed(
    leader: str, follower: str, stage: Stage
) -> None:
    """Even if the leader has 75 times the jerk limit of the follower."""
    play, transform = followed(stage, pair(leader, follower, *FAST))
    leaf = play.leaf("follow_tool", arm="arm2")
    assert (leaf.status, leaf.code) == ("SUCCESS", ""), leaf.reason
    assert transform.error_m(BEGIN_S - 0.1, leaf.ended_s or 0.0) < 1e-3
    assert leaf.metrics["follow_max_m"] < 1e-3


def test_result_does_not_depend_on_the_order_of_the_arms(stage: Stage) -> None:
    file = pair("ur5", "xarm7", *FAST)
    backwards = {**file, "arms": dict(reversed(file["arms"].items()))}
    ends = []
    for one in (file, backwards):
        play, transform = followed(stage, one)
        leaf = play.leaf("follow_tool", arm="arm2")
        assert leaf.status == "SUCCESS"
        ends.append((leaf.ended_s, transform.error_m(BEGIN_S - 0.1, leaf.ended_s or 0.0)))
    assert ends[0][0] == pytest.approx(ends[1][0], abs=0.1)
    assert max(error for _, error in ends) < 1e-3


def test_motion_that_cannot_be_followed_fails_at_its_start(stage: Stage) -> None:
    """The follower stays where it is instead of being dragged to the limit of its workspace."""
    far = {"move_joints": {"by": {"shoulder_pan_joint": 120}, "speed": 0.5}}
    play, _ = followed(stage, pair("ur5", "ur3", {"wait": {"seconds": BEGIN_S}}, far))
    leaf = play.leaf("follow_tool", arm="arm2")
    assert leaf.code in ("UNREACHABLE", "SINGULAR", "IN_COLLISION")
    assert leaf.ended_s == pytest.approx(BEGIN_S, abs=0.05)
    assert leaf.metrics["follow_max_m"] < 1e-3


def test_arms_do_not_follow_each_other(stage: Stage) -> None:
    file = pair("ur5", "ur5", {"wait": {"seconds": 0.3}}, {"follow_tool": {"arm": "arm2"}})
    play, _ = followed(stage, file)
    assert play.leaf("follow_tool", arm="arm1").code == "INVALID_TARGET"


def test_halted_follower_does_not_slow_the_leader(stage: Stage) -> None:
    """The leader then moves as fast as if it were alone."""
    file = pair("panda", "ur5", *FAST)
    alone = {**file, "arms": {"arm1": file["arms"]["arm1"]}}
    (follow,) = file["arms"]["arm2"]["tree"]["sequence"]
    halted = {"force_success": {"child": {"timeout": {"seconds": 0.3, "child": follow}}}}
    file["arms"]["arm2"]["tree"] = {"sequence": [halted]}
    play, _ = followed(stage, file)
    free = stage.run(alone)
    assert play.leaf("follow_tool", arm="arm2").code == "HALTED"
    assert play.leaf("move_linear").ended_s == free.leaf("move_linear").ended_s


def test_leader_is_as_fast_as_alone_once_its_follower_has_ended(stage: Stage) -> None:
    """It remained as slow as the follower had needed until the end of its motion."""
    slow = {"speed": 0.05, "max_error": 0.5, "duration": 1.0}
    play, _ = followed(stage, pair("panda", "ur5", *FAST[:2], follow=slow))
    follow, move = play.leaf("follow_tool", arm="arm2"), play.leaf("move_linear")
    assert follow.status == "SUCCESS", follow.reason
    assert follow.ended_s is not None
    assert move.ended_s is not None
    assert follow.ended_s < move.ended_s < follow.ended_s + 1.0


@pytest.mark.parametrize("moves", [True, False])
def test_following_ends_when_the_leader_waits_at_rest(moves: bool, stage: Stage) -> None:
    """With `until_still`, following ends by itself once the other arm has moved: no deadlock."""
    leaves = (*FAST[: 2 if moves else 1], {"await": "near"})
    file = pair("ur5", "ur5", *leaves, follow={"until_still": 0.5})
    file["cell"] = {"signals": {"near": {"type": "boolean", "written_by": ["arm2"]}}}
    file["arms"]["arm2"]["tree"]["sequence"].append({"signal": "near"})
    play = stage.run(file)
    ends = (play.leaf("await"), play.leaf("follow_tool", arm="arm2"))
    assert [leaf.code for leaf in ends].count("DEADLOCK") == (0 if moves else 1)
    assert all(leaf.status == "SUCCESS" for leaf in ends) == moves
