"""A skill on trial: played in its scenario, with an eye on how fast its arm moves."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Final

import numpy as np

from bt_dualarm.pose import Vector
from bt_dualarm.runtime.api import registry_of
from bt_dualarm.runtime.options import RunOptions
from bt_dualarm.runtime.parts import IdleObserver
from bt_dualarm.runtime.result import ArmResult
from bt_dualarm.runtime.run import Run
from bt_dualarm.skill.registry import Registry
from bt_dualarm.skill.skill import Skill
from bt_dualarm.spec.load import load_tree_file
from bt_dualarm.testing.scenario import Scenario, Tree, node_of, twice
from bt_dualarm.tree.report import LeafReport
from bt_dualarm.world.world import World

_TWICE: Final = "example twice"


def registry_with(*skills: type[Skill]) -> Registry:
    """The installed skills, and these.

    Raises:
        RegistryError: A skill is badly made, or its name is taken.
    """
    return registry_of(skills)


@dataclass
class Performance(IdleObserver):
    """One run to its end.

    Attributes:
        world: World of the run.
        arm: Result of the arm, once the run is over.
    """

    world: World
    arm: ArmResult | None = None
    _seen: list[tuple[float, Vector]] = field(default_factory=list)

    def after_step(self, time: float) -> None:
        """Note how fast the arm is."""
        if "arm1" in self.world.arms:
            self._seen.append((time, self.world.arms["arm1"].v))

    @property
    def speeds(self) -> list[tuple[float, float]]:
        """Times in s and the arm's largest joint speed in rad/s, at every step."""
        return [(time, float(np.abs(v).max())) for time, v in self._seen]

    @property
    def result(self) -> ArmResult:
        """What the arm did.

        Raises:
            RuntimeError: The run is not over.
        """
        if self.arm is None:
            raise RuntimeError("the run has not ended yet")
        return self.arm

    def leaves(self, skill: str) -> list[LeafReport]:
        """All runs of the leaves of one kind."""
        return [leaf for leaf in self.result.runs if leaf.skill == skill]

    def speed_after(self, time: float) -> float:
        """Largest joint speed in rad/s at any step from ``time`` in s on."""
        later = [v for at, v in self._seen if at >= time]
        return float(np.abs(later).max()) if later else 0.0


@dataclass
class Candidate:
    """A skill on trial.

    Attributes:
        name: Name of the skill in YAML.
        registry: Skills with the one on trial and those that the scenario uses.
        scenario: World in which its example succeeds.
    """

    name: str
    registry: Registry
    scenario: Scenario = field(default_factory=Scenario)

    @property
    def skill(self) -> type[Skill]:
        """The class."""
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
        """What its example does in its scenario."""
        return self.examples[0]

    @property
    def examples(self) -> list[LeafReport]:
        """What its example does, and what it does once more if it has succeeded."""
        runs = self.run_twice.runs
        return [leaf for leaf in runs if leaf.skill == self.name and _TWICE in leaf.path]

    @cached_property
    def run_twice(self) -> ArmResult:
        """What the arm does where the same leaf is run twice; it is played once for all laws."""
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
