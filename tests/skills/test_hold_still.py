"""`hold_still` holds the tool against pushes, stiffly or like a spring."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

import bt_dualarm as bt
from bt_dualarm.behaviors.report import LeafReport
from bt_dualarm.core.pose import Vector
from bt_dualarm.sim.world import World
from tests.plays import Play, Stage
from tests.skills.scenarios import Tree
from tests.skills.trials import pushes

HAND = "arm1/tool0"
PUSH_S = (2.0, 3.6)
NEWTON = 20.0


class Tool:
    """True position of the tool at each step."""

    def __init__(self) -> None:
        self._seen: list[tuple[float, Vector]] = []

    def record(self, world: World) -> None:
        self._seen.append((world.time, world.arms["arm1"].tool_pose.position.copy()))

    def at(self, time: float) -> Vector:
        return min(self._seen, key=lambda one: abs(one[0] - time))[1]

    def moved_m(self, since: float, until: float) -> float:
        return float(np.linalg.norm(self.at(until) - self.at(since)))


def pushed(stage: Stage, hold: Tree, reality: str = "ideal", *more: Tree) -> tuple[Play, Tool]:
    file: dict[str, Any] = {
        "name": "held",
        "world": {"scene": "empty", "reality": reality, "seed": 0, "time_limit": 20.0},
        "arms": {"arm1": {"robot": "ur5", "tree": {"sequence": [{"hold_still": hold}, *more]}}},
    }
    begin, end = PUSH_S
    play = stage.play(file, interventions=((begin, pushes(HAND, NEWTON)), (end, pushes(HAND, 0.0))))
    tool = Tool()
    play.watchers.append(tool.record)
    play.run()
    return play, tool


@pytest.mark.parametrize("compliance", [3e-4, 1e-3])
def test_compliant_tool_yields_like_a_spring_and_returns(compliance: float, stage: Stage) -> None:
    """It yields by no more than the compliance allows, which is that of the softest direction."""
    play, tool = pushed(stage, {"compliance": compliance, "duration": 4.0, "max_displacement": 0.1})
    leaf = play.leaf("hold_still")
    assert leaf.status == "SUCCESS", leaf.reason
    moved = tool.moved_m(PUSH_S[0] - 0.05, PUSH_S[1] - 0.05)
    assert 0.05 * compliance * NEWTON < moved < 1.1 * compliance * NEWTON
    assert tool.moved_m(PUSH_S[0] - 0.05, leaf.ended_s or 0.0) < 5e-4
    assert leaf.metrics["held_force_n"] == pytest.approx(NEWTON, rel=0.2)


@pytest.mark.parametrize("robot", ["ur5", "z1", "jaco2", "panda"])
def test_compliance_that_a_refusal_allows_is_possible(robot: str, stage: Stage) -> None:
    """Rounded to the nearest, every second one would be refused in turn."""

    def held(compliance: float) -> LeafReport:
        file = {
            "name": "held",
            "world": {"scene": "empty", "time_limit": 5.0},
            "arms": {
                "arm1": {
                    "robot": robot,
                    "base": {"xyz": [0, 0, 0.4]},
                    "tree": {"hold_still": {"compliance": compliance, "duration": 0.1}},
                }
            },
        }
        return stage.run(file).leaf("hold_still")

    refused = held(1e-6)
    assert refused.code == "INVALID_TARGET"
    allowed = re.search(r"allows (\S+) to (\S+) mm/N", refused.reason)
    assert allowed is not None
    for bound in allowed.groups():
        if float(bound) <= 20.0:  # the largest value of the port
            assert held(1e-3 * float(bound)).status == "SUCCESS"


def test_stiff_arm_does_not_move(stage: Stage) -> None:
    play, _ = pushed(stage, {"duration": 4.0, "max_displacement": 1e-3}, "lab")
    assert play.leaf("hold_still").status == "SUCCESS"


def test_arm_halted_under_a_push_returns_without_a_jump(stage: Stage) -> None:
    """The next motion begins while the arm is 20 mm away, and no joint exceeds its speed limit."""
    halted = {"timeout": {"seconds": 3.0, "child": {"hold_still": {"compliance": 1e-3}}}}
    file: dict[str, Any] = {
        "name": "held",
        "world": {"scene": "empty", "reality": "lab", "seed": 0, "time_limit": 20.0},
        "arms": {
            "arm1": {
                "robot": "panda",
                "tree": {
                    "sequence": [
                        {"force_success": {"child": halted}},
                        {"wait": {"seconds": 2.0}},
                        {"move_linear": {"offset": {"xyz": [0, 0, 0.05]}, "speed": 0.1}},
                    ]
                },
            }
        },
    }
    push = ((2.0, pushes("arm1/panda_hand", NEWTON)), (4.5, pushes("arm1/panda_hand", 0.0)))
    play = stage.run(file, interventions=push)
    assert play.leaf("move_linear").status == "SUCCESS", play.leaf("move_linear").reason


@pytest.mark.parametrize("order", [1, -1])
def test_last_signal_of_the_partner_ends_it_before_the_end_of_the_partner(order: int) -> None:
    """Both are visible in the same tick; it failed with `PARTNER_GONE`."""
    both = [{"hold_still": {"partner": "works"}}, {"await": "done"}]
    holds = {"parallel": {"policy": "any", "children": both[::order]}}
    works = {"sequence": [{"wait": 0.5}, {"signal": "done"}]}
    tree = {
        "bt_dualarm": 1,
        "world": {"scene": "empty", "time_limit": 5},
        "cell": {"signals": {"done": {"type": "boolean", "written_by": ["works"]}}},
        "arms": {
            "holds": {"robot": "ur3", "tree": holds},
            "works": {"robot": "ur3", "base": {"xyz": [0, 2, 0]}, "tree": works},
        },
    }
    assert bt.run(tree).outcome == "SUCCESS"
