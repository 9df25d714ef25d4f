"""A skill on trial: played in its scenario, with an eye on how fast its arm moves."""

from __future__ import annotations

import json
import tempfile
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from bt_dualarm.registry import Registry
from bt_dualarm.run.outcome import ArmResult
from bt_dualarm.run.parts import RunView
from bt_dualarm.run.session import Session, Wishes
from bt_dualarm.skill import Skill
from bt_dualarm.spec.load import load_tree_file
from bt_dualarm.testing.scenario import Scenario, Tree, node_of
from bt_dualarm.tree.report import LeafReport, StatusChange
from bt_dualarm.world.world import World


def registry_with(*skills: type[Skill]) -> Registry:
    """The installed skills, and these.

    Raises:
        RegistryError: A skill is badly made, or its name is taken.
    """
    known = Registry.load()
    installed = [(known.kinds[name].origin, skill) for name, skill in known.skills.items()]
    return Registry.of([*installed, *((skill.__module__, skill) for skill in skills)])


@dataclass
class Performance:
    """One run to its end.

    Attributes:
        world: Of the run.
        speeds: Times in s and the arm's largest joint speed in rad/s, at every step.
        arm: What the arm did, once the run is over.
    """

    world: World
    speeds: list[tuple[float, float]] = field(default_factory=list)
    arm: ArmResult | None = None

    def on_event(self, change: StatusChange) -> None:
        """Nothing to keep: the leaves' records are in the result."""

    def after_ticks(self, run: RunView) -> None:
        """Nothing to see."""

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
        return [leaf for leaf in self.result.leaves if leaf.skill == skill]

    def speed_after(self, time: float) -> float:
        """Largest joint speed in rad/s at any step from ``time`` in s on."""
        return max((speed for at, speed in self.speeds if at >= time), default=0.0)


@dataclass
class Candidate:
    """A skill on trial.

    Attributes:
        name: In YAML.
        registry: Has the skill, and those that the scenario uses.
        scenario: Where its example succeeds.
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
        # JSON is YAML, and has no aliases, which the reader refuses.
        content = json.dumps({"bt_dualarm": 1, **self.scenario.file(*leaves)})
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"{self.name}.yaml"
            path.write_text(content, encoding="utf-8")
            file = load_tree_file(path, self.registry.kinds)
        with Session(file, self.registry, Wishes(seed=0, renderer="ray")) as session:
            performance = Performance(session.assembly.world)
            result = session.run([performance], lambda: 0.0)
        performance.arm = next(arm for arm in result.arms if arm.name == "arm1")
        return performance
