"""Tree files run in this process, with interventions in the running world."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.behaviors.report import LeafReport, StatusChange
from bt_dualarm.core.pose import Vector
from bt_dualarm.runtime.arm_runtime import IdleObserver
from bt_dualarm.runtime.options import RunOptions
from bt_dualarm.runtime.outcome import ArmResult, RunResult
from bt_dualarm.runtime.run import Run
from bt_dualarm.sim.world import World
from bt_dualarm.skill.registry import Registry

Intervention = Callable[[World], None]
"""Intervention in the running world."""

STOPPED = 0.02
"""Joint speed below which an arm counts as at rest, rad/s."""


@dataclass
class Play(IdleObserver):
    """One run of one file, observed step by step.

    Attributes:
        opened: The run, not started yet, or finished.
        interventions: Interventions, each at the first step at or after its simulated time in s.
        changes: Status changes of all nodes.
        errors: Exceptions of interventions and watchers.
    """

    opened: Run
    interventions: list[tuple[float, Intervention]] = field(default_factory=list)
    watchers: list[Callable[[World], None]] = field(default_factory=list)
    changes: list[StatusChange] = field(default_factory=list)
    _seen: dict[str, list[tuple[float, Vector, Vector]]] = field(default_factory=dict)
    result: RunResult | None = None
    errors: list[Exception] = field(default_factory=list)

    @property
    def world(self) -> World:
        """The current world."""
        return self.opened.world

    def run(self) -> RunResult:
        """Run to the end."""
        self.opened.watch(self)
        with self.opened:
            self.result = self.opened.finish()
        if self.errors:
            raise self.errors[0]
        return self.result

    def on_event(self, change: StatusChange) -> None:
        """Record a status change."""
        self.changes.append(change)

    def after_step(self, time: float) -> None:
        """Run due interventions and record the arms; an observer that raises would be dropped."""
        try:
            self._look(time)
        except Exception as error:  # noqa: BLE001 - raised again when the run is over
            self.errors.append(error)

    def _look(self, time: float) -> None:
        while self.interventions and time >= self.interventions[0][0] - 1e-9:
            self.interventions.pop(0)[1](self.world)
        for name, body in self.world.arms.items():
            self._seen.setdefault(name, []).append((time, body.q, body.v))
        for watch in self.watchers:
            watch(self.world)

    @property
    def speeds(self) -> dict[str, list[tuple[float, float]]]:
        """Time and largest joint speed in rad/s at every step, by arm."""
        speeds = {}
        for name, seen in self._seen.items():
            times, _, velocities = zip(*seen, strict=True)
            speeds[name] = list(zip(times, np.abs(velocities).max(axis=1).tolist(), strict=True))
        return speeds

    @property
    def joint_travel(self) -> dict[str, float]:
        """Largest distance of a joint from its start in rad, by arm."""
        return {
            name: float(np.abs(np.array([q for _, q, _ in seen]) - seen[0][1]).max())
            for name, seen in self._seen.items()
        }

    def arm(self, name: str = "arm1") -> ArmResult:
        """Result of an arm."""
        assert self.result is not None
        return self.result.arms[name]

    def leaves(self, skill: str, arm: str = "arm1") -> list[LeafReport]:
        """All runs of the leaves with a skill."""
        return [leaf for leaf in self.arm(arm).runs if leaf.skill == skill]

    def leaf(self, skill: str, arm: str = "arm1") -> LeafReport:
        """The only run of the only leaf with a skill."""
        (leaf,) = self.leaves(skill, arm)
        return leaf

    def speed_after(self, time: float, arm: str = "arm1") -> float:
        """Largest joint speed in rad/s at any step from ``time`` on, or 0 without one."""
        return max((speed for at, speed in self.speeds[arm] if at >= time), default=0.0)


class Stage:
    """Factory of plays from tree files.

    Args:
        folder: Folder for the files.
        registry: The skills.
    """

    def __init__(self, folder: Path, registry: Registry) -> None:
        self._folder = folder
        self.registry = registry
        self._count = 0

    def play(
        self,
        content: str | dict[str, Any],
        *,
        seed: int = 0,
        duration: float | None = None,
        interventions: Iterable[tuple[float, Intervention]] = (),
    ) -> Play:
        """Check the file and assemble its world, without running it.

        Args:
            content: YAML, which may be indented; or the parsed content.
            seed: Seed of the run.
            duration: Simulated seconds after which the run ends.
            interventions: As in `Play`, in the order of their times.
        """
        self._count += 1
        path = self._folder / f"play{self._count}.yaml"
        text = textwrap.dedent(content) if isinstance(content, str) else _as_yaml(content)
        path.write_text("bt_dualarm: 1\n" + text, encoding="utf-8")
        file = load_tree_file(path, self.registry.kinds)
        options = RunOptions(seed=seed, duration=duration, renderer="ray")
        return Play(Run(file, self.registry, options), list(interventions))

    def run(self, content: str | dict[str, Any], **options: Any) -> Play:
        """Like ``play``, but run to the end."""
        play = self.play(content, **options)
        play.run()
        return play


def _as_yaml(content: dict[str, Any]) -> str:
    """Dump YAML without aliases for identical parts."""
    return yaml.safe_dump(json.loads(json.dumps(content)), sort_keys=False)


def joints(world: World, arm: str = "arm1") -> Vector:
    """Measured joint angles, of shape (dof,)."""
    return world.arms[arm].q
