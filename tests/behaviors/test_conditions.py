"""Conditions read only sensors and estimates: the arm of these tests has nothing else."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bt_dualarm.core.errors import DualArmError
from bt_dualarm.core.pose import Pose
from bt_dualarm.skill.cell import CellAccess, CellState
from bt_dualarm.skill.condition import Condition
from bt_dualarm.skill.skill import SkillContext
from bt_dualarm.spec.cell import CellSpec
from bt_dualarm.spec.document import ObjectSpec
from bt_dualarm.spec.node_types import PortModel, port
from bt_dualarm.spec.shapes import PartSpec
from bt_dualarm.spec.values import PoseSpec
from bt_dualarm.testing import registry_with
from tests.behaviors.ticking import Stage, rows

CELL = CellSpec.model_validate(
    {"zones": {"work": {"size": (0.4, 0.4, 0.4), "pose": {"xyz": (0.5, 0.0, 0.5)}}}}
)


class ArmStage(Stage):
    """A tree whose arm has encoders, a force estimate and an estimate of the held object."""

    def __init__(self, folder: Path, tree: str, *more: type[Condition], **sensed: Any) -> None:
        # Its center is 0.2 m above its frame.
        estimate = SimpleNamespace(pose=Pose.from_rpy((0.5, 0, 0.4)))
        ball = PartSpec(shape="sphere", size=(0.02,), pose=PoseSpec(xyz=(0, 0, 0.2)))
        held = ObjectSpec(shape="compound", parts={"ball": ball}, mass=0.1)
        self.sensed = {
            "tool_pose": Pose.from_rpy((0.5, 0, 0.5)),
            "q": np.array([0.0, 0.1]),
            "external_wrench": np.array([0.0, 3.0, 4.0, 0, 0, 0]),
            "held": ("cube",),
            "name": "arm1",
            "posture": {"home": np.array([0.0, 0.0])}.__getitem__,
            "tool_pose_of": lambda _: Pose.from_rpy((0.5, 0.2, 0.5)),
            "controller": SimpleNamespace(at_rest=False),
            "known": SimpleNamespace(pose={"cube": estimate}.__getitem__),
            "world": SimpleNamespace(arms=("arm1", "arm2"), declared_objects={"cube": held}),
            **sensed,
        }
        super().__init__(folder, tree, *more)

    def context(self, path: str) -> SkillContext:
        context = super().context(path)
        arm: Any = SimpleNamespace(**{**vars(context.arm), **self.sensed})
        cell = CellAccess(CellState(CELL, lambda: self.now), "arm1")
        return replace(context, arm=arm, cell=cell)

    def head(self) -> str:
        """Sections of the file before its arms."""
        return (
            "objects: {cube: {shape: box, size: [0.1, 0.1, 0.1], mass: 1,"
            " pose: {xyz: [9, 9, 9]}}}\n"
            "cell: {zones: {work: {size: [0.4, 0.4, 0.4], pose: {xyz: [0.5, 0, 0.5]}}}}\n"
        )

    def other_arms(self) -> str:
        return "  arm2:\n    robot: ur5\n    tree: succeed\n"


@pytest.mark.parametrize(
    ("condition", "holds"),
    [
        ("arm_at: {at: {xyz: [0.5, 0, 0.505]}}", True),
        ("arm_at: {at: {xyz: [0.5, 0, 0.52]}}", False),
        ("arm_at: {at: {xyz: [0.5, 0, 0.52]}, within: 0.03}", True),
        ("arm_at: {at: {xyz: [0.5, 0, 0.5], rpy: [0, 0, 10]}}", False),
        ("arm_at: {at: {xyz: [0.5, 0, 0.5], rpy: [0, 0, 10]}, angle: 11}", True),
        ("arm_at: {posture: home}", False),
        ("arm_at: {posture: home, angle: 0.11 rad}", True),
        ("arm_near: {arm: arm2}", True),
        ("arm_near: {arm: arm2, within: 0.1}", False),
        ("in_zone: work", True),
        ("moving", True),
        ("force_above: 4.9", True),
        ("force_above: 5.1", False),
        ("force_above: {force: 3.9, direction: [0, 0, 2]}", True),
        ("force_above: {force: 3.9, direction: [0, 0, -2]}", False),
        ("object_at: {object: cube, at: [0.5, 0, 0.6]}", True),
        ("object_at: {object: cube, at: [9, 9, 9]}", False),
        ("object_at: {object: cube, at: [0.5, 0.05, 0.6], within: 0.06}", True),
        ("not: {in_zone: work}", False),
        ("not: {child: {force_above: 6}}", True),
        ("all: [moving, {in_zone: work}, {force_above: 4}]", True),
        ("all: [moving, {in_zone: work}, {force_above: 6}]", False),
        ("any: [{force_above: 6}, moving]", True),
        ("any: [{force_above: 6}, {not: moving}]", False),
    ],
)
def test_condition(condition: str, holds: bool, tmp_path: Path) -> None:
    stage = ArmStage(tmp_path, condition)
    assert stage.tick()[0] == ("S" if holds else "F"), stage.tree.view().reason
    if not holds:
        assert stage.tree.view().reason.startswith("FALSE: ") or condition.startswith("not")


def test_conditions_without_a_bound_fail_for_a_distant_arm_at_rest(tmp_path: Path) -> None:
    """Conditions without a bound fail, with the reason, for an arm elsewhere and at rest."""
    away: dict[str, Any] = {
        "tool_pose": Pose.from_rpy((0.5, 0, 0.75)),
        "controller": SimpleNamespace(at_rest=True),
        "world": SimpleNamespace(arms=("arm1",)),
    }
    reasons = {
        "in_zone: work": "FALSE: the tool is 50 mm outside work",
        "moving": "FALSE: the arm is at rest",
        "arm_near: {arm: arm2}": "FALSE: arm2 is not in the world",
    }
    for condition, reason in reasons.items():
        stage = ArmStage(tmp_path, condition, **away)
        assert stage.tick() == "F"
        assert stage.tree.view().reason == reason


TABLES = {
    "elapsed counts from the start of the node around it, in each of its runs": (
        "repeat: {times: 2, child: {act: {script: RRRR, until: {elapsed: 2}}}}",
        """
        tick | repeat, until, elapsed, act
        1    | R R F R
        2    | R R F R
        3    | R S S -
        4    | R R F R
        5    | R R F R
        6    | S S S -
        """,
    ),
    "elapsed within a combination, too": (
        "act: {script: RRRR, until: {any: [{force_above: 50}, {all: [moving, {elapsed: 2}]}]}}",
        """
        tick | until, any, force_above, all, moving, elapsed, act
        1    | R F F F S F R
        2    | R F F F S F R
        3    | S S F S S S -
        """,
    ),
    "all: a slow condition is awaited, the others keep their result": (
        "all: [{act: {script: S|F}}, {act: {script: RRS}}, {act: {script: S|F}}]",
        """
        tick | all, its three conditions
        1    | R S R S
        2    | R S R S
        3    | S S S S
        """,
    ),
    "all: a failure decides, and halts what runs": (
        "all: [{act: {script: RR}}, {act: {script: F}}, {act: {script: S}}]",
        """
        tick | all, its three conditions
        1    | F - F -
        """,
    ),
    "any: the first that holds decides": (
        "any: [{act: {script: RR}}, {act: {script: F}}, {act: {script: S}}, {act: {script: S}}]",
        """
        tick | any, its four conditions
        1    | S - F S -
        """,
    ),
    "a combination is evaluated anew at each tick of a guard": (
        "guard: {condition: {all: [{act: {script: S|S|S}}, {act: {script: S|S|F}}]},"
        " child: {act: {script: RRRR}}}",
        """
        tick | guard, all, its two conditions, child
        1    | R S S S R
        2    | R S S S R
        3    | F F S F -
        """,
    ),
}


@pytest.mark.parametrize("name", TABLES)
def test_tick_table(name: str, tmp_path: Path) -> None:
    tree, table = TABLES[name]
    expected = rows(table)[1:]
    assert ArmStage(tmp_path, tree).table(len(expected)) == expected


class High(Condition):
    """Holds if the tool is high."""

    class Ports(PortModel):
        above: float = port(..., "Height", unit="m")

    example = "high: {above: 0.5}"
    ports: Ports

    def check(self) -> bool:
        height = float(self.arm.tool_pose.position[2])
        self.reason = f"the tool is at {height:g} m"
        return height > self.ports.above


def test_condition_class_of_a_user_works(tmp_path: Path) -> None:
    stage = ArmStage(tmp_path, "selector: [{high: {above: 0.6}}, {high: {above: 0.4}}]", High)
    assert stage.tick() == "S F S"
    stage = ArmStage(tmp_path, "high: {above: 0.6}", High)
    stage.tick()
    assert stage.tree.view().reason == "FALSE: the tool is at 0.5 m"


def test_check_must_return_a_truth_value(tmp_path: Path) -> None:
    class High(Condition):
        """Returns the height."""

        def check(self) -> bool:
            return 0.5  # type: ignore[return-value]

    stage = ArmStage(tmp_path, "high", High)
    stage.tick()
    reason = stage.tree.view().reason
    assert "check() of High returns 0.5: return True or False" in reason
    assert "test_conditions.py:" in reason  # the file of the author, not of the library


def test_check_may_return_the_truth_value_of_a_comparison_of_arrays(tmp_path: Path) -> None:
    class High(Condition):
        """Compares an element of an array."""

        def check(self) -> bool:
            return self.arm.tool_pose.position[2] > 0.4  # type: ignore[no-any-return]

    assert ArmStage(tmp_path, "high", High).tick() == "S"


def test_condition_without_check_is_refused() -> None:
    class Empty(Condition):
        """Does nothing."""

        example = "empty"

    with pytest.raises(DualArmError, match=r"does not implement check\(\)"):
        registry_with(Empty)
