"""Conformance tests for authors of skills: the laws that every skill must obey.

Input: a `Candidate`, which is a skill with the `Scenario` in which its example succeeds.
Output: nothing, or a `BrokenLawError` that names the violated law and the violation.

Run the laws with pytest, or any other test runner, on a skill in a small world::

    import pytest
    from bt_dualarm.testing import LAWS, Candidate, Scenario, registry_with

    from my_skills.nod import Nod

    @pytest.mark.parametrize("law", LAWS)
    def test_nod_keeps_to(law):
        LAWS[law](Candidate("nod", registry_with(Nod), Scenario()))
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from types import MappingProxyType
from typing import Final, TypeAlias

import numpy as np
import yaml
from pydantic.fields import FieldInfo

from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.behaviors.report import LeafReport
from bt_dualarm.core.pose import Vector
from bt_dualarm.robots.robot_description import load_robot
from bt_dualarm.runtime.api import registry_of
from bt_dualarm.runtime.arm_runtime import IdleObserver
from bt_dualarm.runtime.options import RunOptions
from bt_dualarm.runtime.outcome import ArmResult
from bt_dualarm.runtime.run import Run
from bt_dualarm.sim.world import World
from bt_dualarm.skill.registry import Registry, faults
from bt_dualarm.skill.skill import Skill
from bt_dualarm.spec.node_types import Unit, counted, metadata_of
from bt_dualarm.spec.yaml_reader import Data

# Small worlds in which the examples of skills succeed.


Tree: TypeAlias = dict[str, Data]
"""A node, or another part of a tree file, as read from YAML."""


@dataclass(frozen=True)
class Scenario:
    """A world with one arm or more, and the leaves that run before the skill.

    Attributes:
        objects: Section ``objects`` of a tree file.
        arm: Fields of the arm, except its tree.
        before: Leaves that establish the preconditions of the skill.
        scene: Name of the scene.
        again: Status of a second run of the same leaf after a success.
        others: Further arms with their trees, as in section ``arms``; the skill runs on ``arm1``.
    """

    objects: Tree = field(default_factory=dict)
    arm: Tree = field(default_factory=lambda: {"robot": "ur5", "base": {"xyz": [0, 0, 0.40]}})
    before: tuple[Tree, ...] = ()
    scene: str = "empty"
    again: str = "SUCCESS"
    others: Tree = field(default_factory=dict)

    def file(self, *leaves: Tree) -> Tree:
        """Content of a tree file with these leaves after the preparatory ones."""
        tree = {"sequence": [*copy.deepcopy(self.before), *leaves]}
        return {
            "world": {"scene": self.scene, "time_limit": 30.0},
            "objects": copy.deepcopy(self.objects),
            "arms": {"arm1": {**self.arm, "tree": tree}, **copy.deepcopy(self.others)},
        }


def node_of(example: str) -> Tree:
    """Node of a skill's example; a bare word is a node as well."""
    node: Tree | str = yaml.safe_load(example)
    return {node: {}} if isinstance(node, str) else node


def after(seconds: float, node: Tree) -> Tree:
    """Tree that halts a node after some simulated seconds, and succeeds whatever its status."""
    return {"force_success": {"child": {"timeout": {"seconds": seconds, "child": node}}}}


def twice(node: Tree, name: str) -> Tree:
    """Tree that runs a node, and again after a success, below a node of this name."""
    return {"repeat": {"times": 2, "name": name, "child": node}}


# A skill under test: runs in its scenario, with the joint speeds of its arm.


_TWICE: Final = "example twice"


def registry_with(*skills: type[Skill]) -> Registry:
    """Registry of the installed skills and the given ones.

    Raises:
        RegistryError: A skill is invalid, or its name is in use.
    """
    return registry_of(skills)


@dataclass
class Performance(IdleObserver):
    """One complete run.

    Attributes:
        world: World of the run.
        arm: Result of the arm, once the run has ended.
    """

    world: World
    arm: ArmResult | None = None
    _seen: list[tuple[float, Vector]] = field(default_factory=list)

    def after_step(self, time: float) -> None:
        """Record the joint speeds of the arm."""
        if "arm1" in self.world.arms:
            self._seen.append((time, self.world.arms["arm1"].v))

    @property
    def speeds(self) -> list[tuple[float, float]]:
        """Time in s and largest joint speed of the arm in rad/s, for every step."""
        return [(time, float(np.abs(v).max())) for time, v in self._seen]

    @property
    def result(self) -> ArmResult:
        """Result of the arm.

        Raises:
            RuntimeError: The run is not over.
        """
        if self.arm is None:
            raise RuntimeError("the run has not ended yet")
        return self.arm

    def leaves(self, skill: str) -> list[LeafReport]:
        """All runs of the leaves of one skill."""
        return [leaf for leaf in self.result.runs if leaf.skill == skill]

    def speed_after(self, time: float) -> float:
        """Largest joint speed in rad/s at or after ``time``, s."""
        later = [v for at, v in self._seen if at >= time]
        return float(np.abs(later).max()) if later else 0.0


@dataclass
class Candidate:
    """A skill under test.

    Attributes:
        name: Name of the skill in YAML.
        registry: Registry with this skill and those that the scenario uses.
        scenario: World in which its example succeeds.
    """

    name: str
    registry: Registry
    scenario: Scenario = field(default_factory=Scenario)

    @property
    def skill(self) -> type[Skill]:
        """Class of the skill."""
        return self.registry.skills[self.name]

    @property
    def node(self) -> Tree:
        """Its example, as a node."""
        return node_of(self.skill.example)

    @cached_property
    def duration(self) -> float:
        """Simulated seconds that its example takes."""
        leaf = self.example_run
        return (leaf.ended_s or 0.0) - leaf.started_s

    @property
    def example_run(self) -> LeafReport:
        """Run of its example in its scenario."""
        return self.examples[0]

    @property
    def examples(self) -> list[LeafReport]:
        """Run of its example, and the repeated run if that succeeded."""
        runs = self.run_twice.runs
        return [leaf for leaf in runs if leaf.skill == self.name and _TWICE in leaf.path]

    @cached_property
    def run_twice(self) -> ArmResult:
        """Result of the arm with the same leaf run twice; executed once for all laws."""
        return self.perform(twice(self.node, _TWICE)).result

    def perform(self, *leaves: Tree) -> Performance:
        """Run these leaves in its scenario."""
        content = {"bt_dualarm": 1, "name": self.name, **self.scenario.file(*leaves)}
        file = load_tree_file(content, self.registry.kinds)
        with Run(file, self.registry, RunOptions(seed=0, renderer="ray")) as run:
            performance = Performance(run.world)
            run.watch(performance)
            performance.arm = run.finish().arms["arm1"]
        return performance


# The laws; each raises `BrokenLawError` for a skill that violates it.


Law: TypeAlias = Callable[[Candidate], None]

STOPPED: Final = 0.02
"""Joint speed in rad/s below which an arm is at rest."""

STOPPING_S: Final = 1.0
"""Simulated seconds that an arm has to come to rest."""

_PHASES: Final = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 0.98)
_BRAKES_AFTER_S: Final = 0.2
_SHORTEST_S: Final = 0.01  # halts at the second tick
_UNITLESS: Final = ("share", "fraction", "number of", "image error")


class BrokenLawError(AssertionError):
    """A skill violates a law; test runners treat it as a failed assertion."""


def author_forgot_nothing(candidate: Candidate) -> None:
    """Descriptions, docstring, failure codes and an example are complete."""
    found = list(faults(candidate.skill))
    _hold(not found, "; ".join(found))
    began = candidate.skill.example.startswith(candidate.name)
    _hold(began, f"its example does not begin with '{candidate.name}'")


def numbers_of_ports_say_their_unit(candidate: Candidate) -> None:
    """Numbers have a unit, of the port or of its type, unless they are counts or fractions."""
    fields = candidate.skill.Ports.model_fields.items()
    lacking = [name for name, field in fields if _lacks_unit(field)]
    _hold(not lacking, f"ports without a unit: {', '.join(lacking)}")


def example_succeeds(candidate: Candidate) -> None:
    """The example succeeds in its scenario, within the limits of the arm."""
    leaf = candidate.example_run
    _hold(leaf.status == "SUCCESS", f"its example fails: {leaf.code}: {leaf.reason}")
    clipped = candidate.run_twice.clipped_setpoints
    _hold(clipped == 0, f"{clipped} set-points were beyond the limits of the arm")


def halted_skill_leaves_the_arm_stopped(candidate: Candidate, phase: float) -> None:
    """After a halt in any phase, the arm is at rest within a simulated second, and remains so."""
    seconds = max(_SHORTEST_S, phase * candidate.duration)
    performance = candidate.perform(after(seconds, candidate.node), {"wait": {"seconds": 1.5}})
    (leaf,) = performance.leaves(candidate.name)
    if leaf.status == "INVALID":
        _hold(leaf.code == "HALTED", f"its code is {leaf.code}, not HALTED")
        _hold(leaf.reason == "", leaf.reason)
    speed = performance.speed_after((leaf.ended_s or 0.0) + STOPPING_S)
    _hold(speed < STOPPED, f"{STOPPING_S:g} s after the halt a joint moves by {speed:.3f} rad/s")
    _hold_outcome(performance)


def starts_again_after_success(candidate: Candidate) -> None:
    """The same leaf runs twice: the second run does not depend on the first."""
    first, *more = candidate.examples
    _hold(bool(more), f"the first run fails: {first.code}: {first.reason}")
    (second,) = more
    again = candidate.scenario.again
    _hold(second.status == again, f"the second is {second.status}, not {again}: {second.reason}")
    known = ("", *candidate.skill.failures)
    _hold(second.code in known, f"the second fails with {second.code}, which is not declared")


def starts_again_after_it_was_halted(candidate: Candidate) -> None:
    """A leaf that was halted halfway succeeds when it is run again."""
    timeout = {"timeout": {"seconds": "{limit}", "child": candidate.node}}
    forgiven: Tree = {"force_success": {"child": timeout}}
    lengthen: Tree = {"set": {"key": "limit", "value": 60.0}}
    half = max(_SHORTEST_S, 0.5 * candidate.duration)
    performance = candidate.perform(
        {"set": {"key": "limit", "value": half}},
        {"repeat": {"times": 2, "child": {"sequence": [forgiven, lengthen]}}},
    )
    first, second = _last_two(candidate, performance)
    begins = [("INVALID", "HALTED"), ("SUCCESS", "")]
    _hold((first.status, first.code) in begins, f"when halted: {first.code}: {first.reason}")
    if first.status == "INVALID" and candidate.scenario.again == "SUCCESS":
        _hold(second.status == "SUCCESS", f"after a halt: {second.code}: {second.reason}")


def starts_while_the_arm_brakes(candidate: Candidate) -> None:
    """It may begin while the motion of a leaf that was halted before it still brakes.

    All motions are planned from rest: one that begins earlier leaves the path that was checked.
    """
    joints = load_robot(str(candidate.scenario.arm["robot"]), Path(), None).joints
    fast: Tree = {"move_joints": {"by": dict.fromkeys(joints[-2:], 20), "speed": 1.0}}
    performance = candidate.perform(after(_BRAKES_AFTER_S, fast), candidate.node)
    leaf = performance.leaves(candidate.name)[-1]
    _hold(leaf.code != "TRACKING_ERROR", f"after a halted motion: {leaf.reason}")
    clipped = performance.result.clipped_setpoints
    _hold(clipped == 0, f"after a halted motion, {clipped} set-points were beyond the limits")


def never_started_and_never_heard_of(candidate: Candidate) -> None:
    """A leaf that is never ticked has no effect when its tree is halted."""
    performance = candidate.perform({"selector": [{"succeed": {}}, candidate.node]})
    found = [leaf for leaf in performance.leaves(candidate.name) if "selector" in leaf.path]
    _hold(not found, "it was started although no tick reached it")
    _hold_outcome(performance)


def _lacks_unit(field: FieldInfo) -> bool:
    if field.annotation not in (float, float | None):
        return False
    extra = field.json_schema_extra
    if (isinstance(extra, dict) and extra.get("unit")) or metadata_of(field, Unit):
        return False
    return not any(word in (field.description or "") for word in _UNITLESS)


def _last_two(candidate: Candidate, performance: Performance) -> tuple[LeafReport, LeafReport]:
    """Runs of the leaf under test; those of the scenario's own leaves come first."""
    runs = performance.leaves(candidate.name)
    _hold(len(runs) >= 2, f"it was run {counted(len(runs), 'time')}, not twice")
    return runs[-2], runs[-1]


def _hold_outcome(performance: Performance) -> None:
    outcome = performance.result.outcome
    _hold(outcome == "SUCCESS", f"its arm's tree ends with {outcome}")


def _hold(truth: bool, otherwise: str) -> None:
    if not truth:
        raise BrokenLawError(otherwise)


LAWS: Final[Mapping[str, Law]] = MappingProxyType(
    {
        "declaration is complete": author_forgot_nothing,
        "numeric ports declare a unit": numbers_of_ports_say_their_unit,
        "example succeeds": example_succeeds,
        **{
            f"leaves the arm stopped when halted at {phase:.0%}": partial(
                halted_skill_leaves_the_arm_stopped, phase=phase
            )
            for phase in _PHASES
        },
        "starts again after success": starts_again_after_success,
        "starts again after it was halted": starts_again_after_it_was_halted,
        "starts while the arm brakes": starts_while_the_arm_brakes,
        "has no effect if never ticked": never_started_and_never_heard_of,
    }
)
"""All laws by name."""


__all__ = ["LAWS", "BrokenLawError", "Candidate", "Scenario", "registry_with"]
