"""Every failure of a motion, from a tree file: its code, reason and metrics.

A refused motion has not moved the arm; an aborted one leaves it at rest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import pytest
import yaml

from bt_dualarm.arm.arm import Arm
from bt_dualarm.arm.motions import WAIT_S
from bt_dualarm.spec.problems import SpecError
from bt_dualarm.trajectory.set_points import TrajectorySource
from tests.plays import STOPPED, Intervention, Stage
from tests.skills.scenarios import CUBE, PRESENTING, SCENARIOS, Scenario, Tree
from tests.skills.searches import give_up_soon
from tests.skills.trials import BESIDE, HALVES, HAND, MIRRORED, PANDA, SPLIT, knocks

STILL_RAD = 2e-3
"""Limit above servo noise and the initial sag, well below any motion."""

FRACTION = (1e-3, 0.999)

SOON_S = 6.0
"""Shortened time for which an arm waits for another one, instead of a minute, s."""

IN_THE_WAY = {
    "robot": "ur3",
    "base": {"xyz": [0.68, 0.46, 0.35]},
    "spawned": False,
    "tree": {"wait": {"seconds": 10}},
}


@dataclass(frozen=True)
class Case:
    """One failure.

    Attributes:
        code: Code of the failure.
        leaf: Leaf that fails, in YAML.
        says: Part of the reason.
        numbers: Smallest and largest value of each required numeric metric.
        names: Prefix of each required text metric.
        scenario: World, arm and leaves before.
        beside: Another node that runs at the same time, in YAML.
        interventions: Timed changes of the world.
        other: Another arm.
        moves: Whether the arm may have moved when it fails.
    """

    code: str
    leaf: str
    says: str
    numbers: dict[str, tuple[float, float]]
    names: dict[str, str] = field(default_factory=dict)
    scenario: Scenario = field(default_factory=lambda: Scenario(arm=PRESENTING))
    beside: str = ""
    interventions: tuple[tuple[float, Intervention], ...] = ()
    other: Tree | None = None
    moves: bool = False

    @property
    def file(self) -> Tree:
        """The content of the tree file."""
        nodes = [yaml.safe_load(text) for text in (self.leaf, self.beside) if text]
        file = self.scenario.file({"parallel": {"on_failure": "continue", "children": nodes}})
        if self.other is not None:
            file["arms"]["arm2"] = self.other
        return file


CASES = {
    "outside the workspace": Case(
        "INVALID_TARGET",
        "reach_to_pose: {to: {xyz: [3, 0, 0.5]}}",
        "(3.000, 0.000, 0.500) m is outside the workspace",
        {"distance_m": (2.9, 3.1), "reach_m": (0.94, 0.96)},
    ),
    "a line out of the workspace": Case(
        "INVALID_TARGET",
        "move_linear: {offset: {xyz: [2, 0, 0]}}",
        "is outside the workspace",
        {"distance_m": (2.5, 2.8), "reach_m": (0.94, 0.96)},
    ),
    "beyond a joint's limit": Case(
        "JOINT_LIMIT",
        "move_joints: {by: {elbow_joint: 300}}",
        "elbow_joint would be 209.7° beyond its limit of 180.0°",
        {"beyond_rad": (3.65, 3.67)},
        {"joint": "elbow_joint"},
    ),
    "too far": Case(
        "UNREACHABLE",
        "reach_to_pose: {to: {xyz: [1.15, 0, 0.5], rpy: [0, 90, 0]}}",
        " mm and ",
        {"residual_m": (0.1, 0.3), "residual_rad": (0.0, math.pi)},
    ),
    "something is there": Case(
        "IN_COLLISION",
        "move_linear: {offset: {xyz: [0, 0.12, 0]}}",
        " mm deep in slab",
        {"depth_m": (0.0, 0.1)},
        {"first": "arm1/", "second": "slab"},
        Scenario(BESIDE, arm=PRESENTING),
    ),
    "through a stretched elbow": Case(
        "SINGULAR",
        "move_linear: {offset: {xyz: [0.5, 0, 0]}}",
        "% of the path, to (",
        {"fraction": FRACTION, "condition": (50.0, math.inf)},
    ),
    "heavier than the payload": Case(
        "OVERLOADED",
        "approach_and_attach: {object: cube}",
        "arm1 would hold 5.1 kg; the payload of ur5 is 5 kg",
        {"mass_kg": (5.1, 5.1), "payload_kg": (5.0, 5.0)},
        scenario=Scenario({"cube": CUBE | {"mass": 5.1, "pose": {"xyz": [0.40, -0.45, 0.425]}}}),
    ),
    "around too much": Case(
        "NO_PLAN",
        "go_home: {}",
        "no collision-free path was found",
        {"states": (1000, math.inf)},
        {"planner": "RRTConnect"},
        Scenario(HALVES, SCENARIOS["reach_to_pose"].arm, (MIRRORED, *SPLIT)),
        moves=True,  # before, to a posture without a path home
    ),
    "half of a circle": Case(
        "PATH_BROKEN",
        "circle: {radius: 0.25, plane: xz}",
        "% of the path, to (",
        {"fraction": FRACTION, "branches": (1, 100)},
        scenario=Scenario(arm=PANDA),
    ),
    "another arm stays in the way": Case(
        "TIMED_OUT",
        "move_linear: {offset: {xyz: [0, 0.35, 0]}, speed: 0.1}",
        "would come to within 30 mm of arm2/",
        {"progress": (0.3, 0.95), "waited_s": (SOON_S, SOON_S + 0.1)},
        beside="delay: {seconds: 0.6, child: {spawn: {arm: arm2}}}",
        other=IN_THE_WAY,
        moves=True,
    ),
    "knocked": Case(
        "TRACKING_ERROR",
        "move_linear: {offset: {xyz: [0, 0.1, 0]}}",
        " mm from its planned position",
        {"path_error_m": (0.005, 0.1), "progress": FRACTION},
        interventions=knocks(HAND, 0.4),
        moves=True,
    ),
    "stopped": Case(
        "INTERRUPTED",
        "circle: {turns: 5}",
        "the motion of arm1 was stopped externally",
        {"progress": FRACTION},
        beside="delay: {seconds: 2.0, child: {stop: {}}}",
        moves=True,
    ),
}


def wait_shortly(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make motions that would wait for a minute wait for some seconds."""
    refuse = Arm.refuse_when_held_up

    def sooner(self: Arm, motion: TrajectorySource, wait_s: float = WAIT_S) -> None:
        assert wait_s == 60.0
        refuse(self, motion, SOON_S)

    monkeypatch.setattr(Arm, "refuse_when_held_up", sooner)


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_motion_fails_with_its_reason_and_metrics(
    case: Case, stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    if case.code == "NO_PLAN":
        give_up_soon(monkeypatch)
    if case.code == "TIMED_OUT":
        wait_shortly(monkeypatch)
    play = stage.run(case.file, interventions=case.interventions)
    (leaf,) = play.leaves(case.leaf.partition(":")[0])
    assert (leaf.status, leaf.code) == ("FAILURE", case.code), leaf.reason
    assert case.says in leaf.reason
    for name, (least, most) in case.numbers.items():
        assert least <= float(leaf.metrics[name]) <= most, name
    for name, beginning in case.names.items():
        assert str(leaf.metrics[name]).startswith(beginning)
    assert leaf.ended_s is not None
    if not case.moves:
        assert play.joint_travel["arm1"] < STILL_RAD
        assert play.speed_after(0.0) < STOPPED
    assert play.speeds["arm1"][-1][1] < STOPPED


@pytest.mark.parametrize(
    ("pose", "reason"),
    [
        ("{xyz: [0.5, 0, 0.5], quat: [2, 0, 0, 0]}", "quat has length 2; a rotation has length 1"),
        ("{xyz: [0.5, 0, 0.5], quat: [0, 0, 0, 0]}", "quat has length 0; a rotation has length 1"),
        ("{xyz: [.nan, 0, 0.5]}", "nan"),
        ("{xyz: [0.5, 0, 0.5], rpy: [.inf, 0, 0]}", "inf"),
        ("{xyz: [500, 0, 0.5]}", "100"),
    ],
)
@pytest.mark.parametrize("skill", ["reach_to_pose: {to: POSE}", "move_through: {poses: [POSE]}"])
def test_invalid_pose_is_refused_before_anything_is_built(
    skill: str, pose: str, reason: str, stage: Stage
) -> None:
    leaf = yaml.safe_load(skill.replace("POSE", pose))
    with pytest.raises(SpecError, match=reason):
        stage.play(Scenario().file(leaf))


def test_invalid_pose_on_the_blackboard_is_refused(stage: Stage) -> None:
    """The value of the key is known from the file."""
    no_pose = {"xyz": [0.5, 0.0, 0.5], "quat": [2.0, 0.0, 0.0, 0.0]}
    reach = {"reach_to_pose": {"to": "{goal}"}}
    with pytest.raises(SpecError, match="quat has length 2"):
        stage.play(Scenario().file({"set": {"key": "goal", "value": no_pose}}, reach))


@pytest.mark.parametrize(
    ("ports", "reason"),
    [
        ({"plane": "free"}, "a free plane needs target_size"),
        (
            {"plane": "free", "target_size": 0.05, "controller": "proportional"},
            "a free plane needs controller: predictive",
        ),
        ({"plane": "fre"}, "there is no plane 'fre' .did you mean 'free'"),
        ({"plane": {}}, "its normal is missing"),
    ],
)
def test_tracking_in_a_free_plane_needs_a_depth_source(
    ports: dict[str, Any], reason: str, stage: Stage
) -> None:
    with pytest.raises(SpecError, match=reason):
        stage.play(Scenario().file({"track": ports}))
