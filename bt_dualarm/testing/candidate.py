"""A skill on trial: played in its scenario, with an eye on how fast its arm moves."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from bt_dualarm.runtime.api import registry_of
from bt_dualarm.runtime.options import RunOptions
from bt_dualarm.runtime.parts import IdleObserver
from bt_dualarm.runtime.result import ArmResult
from bt_dualarm.runtime.run import Run
from bt_dualarm.skill.registry import Registry
from bt_dualarm.skill.skill import Skill
from bt_dualarm.spec.load import load_tree_file
from bt_dualarm.testing.scenario import Scenario, Tree, node_of
from bt_dualarm.tree.report import LeafReport
from bt_dualarm.world.world import World


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
        speeds: Times in s and the arm's largest joint speed in rad/s, at every step.
        arm: Result of the arm, once the run is over.
    """

    world: World
    speeds: list[tuple[float, float]] = field(default_factory=list)
    arm: ArmResult | None = None

    def after_step(self, time: float) -> None:
        """Note how fast the arm is."""
        if "arm1" in self.world.arms:
            speed = float(np.abs(self.world.arms["arm1"].v).max())
            self.speeds.append((time, speed))

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
        return max((speed for at, speed in self.speeds if at >= time), default=0.0)


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
        leaf = self.perform(self.node).leaves(self.name)[-1]
        return (leaf.ended_s or 0.0) - leaf.started_s

    def perform(self, *leaves: Tree) -> Performance:
        """Run these leaves in its scenario."""
        content = {"bt_dualarm": 1, "name": self.name, **self.scenario.file(*leaves)}
        file = load_tree_file(content, self.registry.kinds)
        with Run(file, self.registry, RunOptions(seed=0, renderer="ray")) as run:
            performance = Performance(run.world)
            run.watch(performance)
            performance.arm = run.finish().arms["arm1"]
        return performance
