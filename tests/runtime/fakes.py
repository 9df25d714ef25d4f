"""Fakes of world, tree, controller and camera that log the order in which they act."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from fractions import Fraction
from typing import Any

import numpy as np

from bt_dualarm.behaviors.report import LeafReport, LeafReports, NodeView, StatusChange, StatusName
from bt_dualarm.core.errors import DivergenceError
from bt_dualarm.runtime.arm_runtime import ArmParts, Arms, Observer, RunView
from bt_dualarm.runtime.interruption import StopRequest
from bt_dualarm.runtime.observations import StatusFeed
from bt_dualarm.runtime.outcome import Leniency, RunResult
from bt_dualarm.runtime.runner import Conditions, Limit, Runner
from bt_dualarm.skill.cell import ActiveNode
from bt_dualarm.spec.node_types import NodeSpec
from bt_dualarm.trajectory.set_points import SetPoint

ActionLog = list[str]
"""Actions in order: ``"2 tick arm1"`` is a tick in the third physics step."""


class FakeWorld:
    """Counts steps of 10 ms; diverges at step ``diverges_at``, if it is set."""

    def __init__(self, log: ActionLog, arms: tuple[str, ...] = ("arm1",)) -> None:
        self.log = log
        self.timestep = 0.01
        self.steps = 0
        self.arms: dict[str, Any] = dict.fromkeys(arms)
        self.diverges_at: int | None = None
        self.before_removal: list[Callable[[str], None]] = []

    @property
    def time(self) -> float:
        return self.steps * self.timestep

    def write(self, what: str) -> None:
        self.log.append(f"{self.steps} {what}")

    def look_for_passengers(self) -> None:
        """Nothing is held here."""

    def remove_arm(self, name: str) -> None:
        for notify in self.before_removal:
            notify(name)
        del self.arms[name]

    def step(self) -> None:
        self.write("step")
        if self.steps == self.diverges_at:
            raise DivergenceError(f"the simulation diverged at {self.time:.3f} s")
        self.steps += 1


class FakeController:
    """Moves until it is stopped, and for some updates after that."""

    def __init__(self, name: str, world: FakeWorld, updates_to_stop: int = 3) -> None:
        self.name = name
        self.clipped = 7
        self.guard = {"stopped": 0}
        self.updates_to_stop = updates_to_stop
        self.stops = 0
        self.breaks_at: int | None = None
        self._world = world

    @property
    def setpoint(self) -> SetPoint:
        return SetPoint(np.zeros(6), np.zeros(6), np.zeros(6))

    @property
    def at_rest(self) -> bool:
        return self.stops > 0 and self.updates_to_stop == 0

    @property
    def is_still(self) -> bool:
        return self.at_rest

    def update(self, time: float) -> None:
        self._world.write(f"control {self.name}")
        if self._world.steps == self.breaks_at:
            raise ZeroDivisionError("in the controller")
        if self.stops:
            self.updates_to_stop = max(0, self.updates_to_stop - 1)

    def stop(self) -> None:
        self.stops += 1


class FakeTree:
    """One leaf that runs a generator: a yield is a tick, its end is SUCCESS, an error escapes."""

    def __init__(
        self, name: str, world: FakeWorld, feed: StatusFeed, script: Iterator[object]
    ) -> None:
        self.name = name
        self.status: StatusName = "INVALID"
        self.leaves = LeafReports()
        self._leaf: LeafReport | None = None
        self.halts = 0
        self._world = world
        self._feed = feed
        self._script = script

    def tick(self) -> None:
        self._world.write(f"tick {self.name}")
        if self._leaf is None:
            self._leaf = LeafReport("work", "work", "RUNNING", self._world.time)
            self.leaves.add(self._leaf)
        verdict = next(self._script, "SUCCESS")
        self._become("FAILURE" if verdict == "FAILURE" else "RUNNING" if not verdict else "SUCCESS")

    def change(self, spec: NodeSpec) -> None:
        """Do nothing."""

    def active(self) -> Iterator[ActiveNode]:
        """The leaf, which waits for no other arm."""
        yield ActiveNode("work", may_be_halted=False)

    def halt(self) -> None:
        self.halts += 1
        if self.status == "RUNNING":
            self._become("INVALID", "HALTED")

    def view(self) -> NodeView:
        return NodeView("work", "work", self.status, 0.0)

    def _become(self, status: StatusName, code: str = "") -> None:
        if status == self.status:
            return
        change = StatusChange(
            self._world.time, self.name, "work", "work", self.status, status, code
        )
        self._feed.add(change)
        self.status = status
        if self._leaf is not None:
            self._leaf.status = status
            if status != "RUNNING":
                self._leaf.ended_s = self._world.time


class FakeCamera:
    """An image every 20 ms, delivered 10 ms later."""

    def __init__(self, name: str, world: FakeWorld) -> None:
        self.name = name
        self.on_frame: Callable[[], None] = lambda: None
        self._world = world
        self._pending: list[int] = []

    def due(self, time: float) -> bool:
        return round(time / 0.01) % 2 == 0

    def capture(self) -> None:
        self._world.write(f"capture {self.name}")
        self._pending.append(self._world.steps)

    def has_arrived(self, time: float) -> bool:
        return bool(self._pending) and self._pending[0] < self._world.steps

    def deliver(self, time: float) -> None:
        while self._pending and self._pending[0] < self._world.steps:
            self._world.write(f"deliver {self.name}")
            self._pending.pop(0)
            self.on_frame()


class StatusRecorder:
    """An observer that records status changes."""

    def __init__(self) -> None:
        self.changes: list[str] = []
        self.steps = 0
        self.ticks = 0

    def on_event(self, change: StatusChange) -> None:
        self.changes.append(f"{change.time:.2f} {change.arm} {change.old}>{change.new}")

    def after_ticks(self, run: RunView) -> None:
        self.ticks += 1

    def after_step(self, time: float) -> None:
        self.steps += 1


class Stage:
    """A world with fakes for two arms, and a runner over them.

    Args:
        scripts: Scripts by arm; see `FakeTree`.
        present: Arms in the world from the start; by default all.
    """

    def __init__(
        self, scripts: dict[str, Iterator[object]], present: tuple[str, ...] | None = None
    ) -> None:
        self.log: ActionLog = []
        self.world: Any = FakeWorld(self.log, tuple(scripts) if present is None else present)
        self.stop = StopRequest()
        self.recorder = StatusRecorder()
        self.observers: list[Observer] = [self.recorder]
        self.feed = StatusFeed()
        self.trees: dict[str, Any] = {}
        self.controllers: dict[str, Any] = {}
        self.cameras: dict[str, FakeCamera] = {}
        self.scripts = scripts
        self.limit = Limit(10.0)
        self.leniency: dict[str, Leniency] = {}

    def equip(self, name: str) -> ArmParts:
        world = self.world
        self.trees[name] = FakeTree(name, world, self.feed, self.scripts[name])
        controller = self.controllers.setdefault(name, FakeController(name, world))
        return ArmParts(
            robot="fake",
            tree=self.trees[name],
            controller=controller,
            camera=self.cameras.get(name),
            tick_period=Fraction(2, 100),
            control_period=Fraction(1, 100),
            monitor=lambda: None,
        )

    def run(self) -> RunResult:
        self.feed.watch(*self.observers)
        declared = dict.fromkeys(self.scripts, "fake")
        arms = Arms(declared, self.equip, self.world, self.leniency)
        clock = iter(range(0, 1000, 2))
        conditions = Conditions(self.limit, lambda: next(clock), self.stop)
        runner = Runner(self.world, arms, self.feed, conditions)
        runner.advance()
        assert runner.result is not None
        return runner.result


def ticks(count: int, verdict: str = "SUCCESS") -> Iterator[object]:
    """RUNNING for ``count`` ticks, then the verdict."""
    for _ in range(count):
        yield None
    yield verdict
