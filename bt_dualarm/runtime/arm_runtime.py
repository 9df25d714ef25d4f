"""Arms on the runner's clock: camera, tree and controller, each at its own period."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, replace
from fractions import Fraction
from time import perf_counter
from types import MappingProxyType
from typing import Protocol, runtime_checkable

from bt_dualarm.behaviors.load import ArmTree
from bt_dualarm.behaviors.report import (
    BoundedLog,
    NodeView,
    StatusChange,
)
from bt_dualarm.control.controller import JointController
from bt_dualarm.core.errors import RAISED_BY_SKILLS
from bt_dualarm.core.share import weakly
from bt_dualarm.runtime.clock import Periodic, exact
from bt_dualarm.runtime.outcome import STRICT, ArmLife, ArmResult, Leniency, Outcome, SlowTicks
from bt_dualarm.sim.world import World
from bt_dualarm.skill.cell import ActiveNode, CellState
from bt_dualarm.spec.faults import FaultEvent
from bt_dualarm.spec.node_types import NodeSpec

_log = logging.getLogger(__name__)


class CameraLike(Protocol):
    """One arm's camera."""

    def due(self, time: float) -> bool:
        """Whether a frame is due at ``time``, s."""

    def capture(self) -> object:
        """Capture a frame."""

    def has_arrived(self, time: float) -> bool:
        """Whether frames are to be delivered at ``time``, s."""

    def deliver(self, time: float) -> object:
        """Deliver the frames whose latency has elapsed to their subscribers."""


@dataclass(frozen=True)
class ArmView:
    """Current state of one arm, for displays.

    Attributes:
        name: Name of the arm in the file.
        robot: Name of its robot in the catalog, or title of its own description file.
        outcome: Outcome of its tree, None while it runs.
        tree: Current state of its tree; None until the arm is spawned.
        fault: Sentence on the error that ended its tree, as in `ArmResult`.
    """

    name: str
    robot: str
    outcome: Outcome | None
    tree: NodeView | None
    fault: str = ""


class RunView(Protocol):
    """Current state of the run; computed only when read."""

    @property
    def time(self) -> float:
        """Simulated time in seconds."""

    def views(self) -> tuple[ArmView, ...]:
        """Current state of every arm of the file, in its order."""


@runtime_checkable
class Observer(Protocol):
    """Observer of a run, such as a display; one that raises is dropped, and the run continues."""

    def on_event(self, change: StatusChange) -> None:
        """React to a status change of a node."""

    def after_ticks(self, run: RunView) -> None:
        """React to ticked trees; all their status changes have been reported."""

    def after_step(self, time: float) -> None:
        """React to a physics step that ended at ``time``, s."""


@runtime_checkable
class FaultObserver(Protocol):
    """Observer that is also notified of injected faults."""

    def on_fault(self, event: FaultEvent) -> None:
        """React to the start or the end of an injected fault."""


class IdleObserver:
    """Observer that ignores everything: base of those that need only some of the methods."""

    def on_event(self, change: StatusChange) -> None:
        """Do nothing."""

    def after_ticks(self, run: RunView) -> None:
        """Do nothing."""

    def after_step(self, time: float) -> None:
        """Do nothing."""


@dataclass(frozen=True)
class ArmParts:
    """Parts of one arm.

    Attributes:
        robot: Name of the robot in the catalog, or title of its own description file.
        tree: Behavior tree of the arm, not ticked yet.
        controller: Controller that holds the arm in position until commanded otherwise.
        camera: Camera of the arm, None if it has none.
        tick_period: Seconds between two ticks of the tree.
        control_period: Seconds between two updates of the controller.
        monitor: Called after each update, for example to detect slip of a held object.
        is_absent: Whether an injected fault keeps the tree from ticking.
    """

    robot: str
    tree: ArmTree
    controller: JointController
    camera: CameraLike | None
    tick_period: Fraction
    control_period: Fraction
    monitor: Callable[[], None]
    is_absent: Callable[[], bool] = bool


class ArmRuntime:
    """One stay of an arm in the world: its camera, tree and controller at their periods.

    Errors raised by the arm's skills end here, as a fault of this arm: its tree is halted, its
    controller stops it, and the other arms are not affected.

    Args:
        name: The arm's name in the file.
        parts: Parts of the arm.
        held_from: Physics step at which its controller is updated first.
        ticked_from: Physics step at which its tree is ticked first.
        timestep: Seconds of one physics step.
    """

    def __init__(
        self,
        name: str,
        parts: ArmParts,
        timestep: Fraction,
        *,
        held_from: int,
        ticked_from: int,
    ) -> None:
        self.name = name
        self.robot = parts.robot
        self.outcome: Outcome | None = None
        self.ended_s: float | None = None
        self.fault = ""
        self._before_halt: NodeView | None = None
        self._is_ticking = False
        self._is_leaving = False
        self._slow_ticks = SlowTicks(name)
        self._tree = parts.tree
        self._controller = parts.controller
        self._camera = parts.camera
        self._monitor = parts.monitor
        self._is_absent = parts.is_absent
        self._ticks = Periodic(parts.tick_period, timestep, ticked_from)
        self._control = Periodic(parts.control_period, timestep, held_from)

    @property
    def controller(self) -> JointController:
        """Controller of the arm, to be read only."""
        return self._controller

    @property
    def at_rest(self) -> bool:
        """Whether no motion is commanded and the arm has come to rest."""
        return self._controller.is_still

    @property
    def running(self) -> tuple[str, ...]:
        """Paths of the running leaves."""
        return tuple(leaf.path for leaf in self._tree.leaves if leaf.status == "RUNNING")

    @property
    def controlled_next(self) -> int:
        """Step at which its controller is due next."""
        return self._control.next

    def due(self, step: int, time: float) -> bool:
        """Whether its camera or its tree is due; has no side effect."""
        if step >= self._ticks.next:
            return True
        camera = self._camera
        return camera is not None and (camera.due(time) or camera.has_arrived(time))

    def capture(self, time: float) -> None:
        """Capture a frame if one is due and the tree still runs."""
        camera = self._camera
        if camera is not None and self.outcome is None and camera.due(time):
            self._guarded("camera", camera.capture, time)

    def deliver(self, time: float) -> None:
        """Deliver the frames whose latency has elapsed."""
        camera = self._camera
        if camera is not None and self.outcome is None and camera.has_arrived(time):
            self._guarded("camera", lambda: camera.deliver(time), time)

    def tick(self, step: int, time: float) -> bool:
        """Tick the tree if that is due; returns whether it was."""
        if self.outcome is not None or not self._ticks.due(step) or self._is_absent():
            return False
        self._is_ticking = True
        began = perf_counter()
        self._guarded("tree", self._tree.tick, time)
        self._slow_ticks.check(time, perf_counter() - began, self._tree.leaves)
        self._is_ticking = False
        if self._is_leaving:
            self.halt(Outcome.REMOVED, time)
        if self.outcome is None and self._tree.status in ("SUCCESS", "FAILURE"):
            self._end(Outcome(self._tree.status), time)
        return True

    def control(self, step: int, time: float) -> None:
        """Update the controller and call the monitor, if they are due."""
        if self._control.due(step):
            self._controller.update(time)
            self._monitor()

    def halt(self, outcome: Outcome, time: float) -> None:
        """Halt a tree that is still running; its outcome becomes ``outcome``."""
        if self.outcome is None:
            self._before_halt = halted(self._tree.view(), time)
            self._end(outcome, time)
            self._guarded("tree", self._tree.halt, time)

    def change(self, spec: NodeSpec, time: float) -> bool:
        """Replace the tree between two ticks; returns False if the tree has ended."""
        if self.outcome is None:
            self._guarded("tree", lambda: self._tree.change(spec), time)
            return True
        return False

    def leave(self, time: float) -> None:
        """End as removed; an arm that is removed by its own leaf ends after the current tick."""
        self._is_leaving = True
        if not self._is_ticking:
            self.halt(Outcome.REMOVED, time)

    def active(self) -> Iterable[ActiveNode]:
        """Yields the running nodes of the tree without running children."""
        return self._tree.active()

    def stop(self) -> None:
        """Begin a jerk-limited stop."""
        self._controller.stop()

    def view(self) -> ArmView:
        """Current state; for a halted tree, its state just before the halt."""
        tree = self._before_halt or self._tree.view()
        return ArmView(self.name, self.robot, self.outcome, tree, self.fault)

    def result(self) -> ArmResult:
        """Result of this stay in the world, complete at its end."""
        return ArmResult(
            name=self.name,
            robot=self.robot,
            outcome=self.outcome or Outcome.UNFINISHED,
            ended_s=self.ended_s,
            clipped_setpoints=self._controller.clipped,
            guard=self._controller.guard,
            runs=tuple(self._tree.leaves),
            runs_left_out=self._tree.leaves.left_out,
            fault=self.fault,
            slow_ticks=self._slow_ticks.slowest,
        )

    def _end(self, outcome: Outcome, time: float) -> None:
        self.outcome = outcome
        if outcome is not Outcome.UNFINISHED:
            self.ended_s = time

    def _guarded(self, what: str, act: Callable[[], object], time: float) -> None:
        try:
            act()
        except RAISED_BY_SKILLS as error:
            self.fault = f"{what} raised {type(error).__name__}: {error}"
            _log.exception("%s: the %s raised an exception at %.3f s", self.name, what, time)
            self._controller.stop()
            self.halt(Outcome.FAILURE, time)


def ended_as(outcome: Outcome, time: float) -> str:
    """Clause on the end of an arm's tree: ``has ended with FAILURE at 1.20 s``."""
    return f"has ended with {outcome.value} at {time:.2f} s"


def halted(node: NodeView, time: float) -> NodeView:
    """The tree with running nodes marked as halted; a real halt would also reset ended nodes."""
    node = replace(node, children=tuple(halted(child, time) for child in node.children))
    if node.status != "RUNNING":
        return node
    return replace(node, status="INVALID", since=time, halted=True)


MOST_LIVES = 50
"""Stays whose results are kept from the start of a run, and as many of the latest."""


class ArmLifecycles:
    """All stays of one arm in the world; keeps only the results of finished stays.

    Args:
        name: Name of the arm in the file.
        robot: Name of its robot in the catalog, or title of its own description file.
        leniency: Exceptions that the file grants to the arm.

    Attributes:
        begun: Number of stays that have begun.
    """

    def __init__(self, name: str, robot: str, leniency: Leniency) -> None:
        self._name = name
        self._robot = robot
        self._leniency = leniency
        self._over: BoundedLog[ArmResult] = BoundedLog(MOST_LIVES)
        self._outcomes: set[Outcome] = set()
        self._clipped = 0
        self._runs = 0
        self._fault = ""
        self._latest: ArmRuntime | None = None
        self.begun = 0

    def begin(self, arm: ArmRuntime) -> None:
        """Begin the next stay; the previous one has ended."""
        self.begun += 1
        if self._latest is not None:
            over = self._latest.result()
            self._over.add(over)
            self._outcomes.add(over.outcome)
            self._clipped += over.clipped_setpoints
            self._runs += len(over.runs) + over.runs_left_out
            self._fault = over.fault or self._fault
        self._latest = arm

    def view(self) -> ArmView:
        """Current state of the arm, or its last state after its removal."""
        if self._latest is None:
            return ArmView(self._name, self._robot, None, None)
        return self._latest.view()

    def result(self) -> ArmResult:
        """Result of all stays of the arm together."""
        if self._latest is None:
            return ArmResult(self._name, self._robot, Outcome.NOT_SPAWNED)
        last = self._latest.result()
        kept = [*self._over, last]
        runs = tuple(run for life in kept for run in life.runs)
        return replace(
            last,
            outcome=self._leniency.outcome_of([*self._outcomes, last.outcome]),
            clipped_setpoints=self._clipped + last.clipped_setpoints,
            runs=runs,
            runs_left_out=self._runs + len(last.runs) + last.runs_left_out - len(runs),
            fault=last.fault or self._fault,
            lives=tuple(ArmLife(life.outcome, life.ended_s, life.fault) for life in kept),
            lives_left_out=self._over.left_out,
            removable=self._leniency.removable,
            slow_ticks=tuple(tick for life in kept for tick in life.slow_ticks),
        )


class Arms:
    """Every arm of the file, whether not spawned yet, present, or removed.

    Args:
        declared: Robot of each arm of the file, by the arm's name; its order is the order in
            which arms act, whatever the order in which they were spawned.
        equip: Makes the parts of an arm once it is in the world.
        world: World of the arms.
        leniency: Exceptions that the file grants, by the arm's name; none by default.
        cell: What the trees of the arms share; None if they share nothing.
    """

    def __init__(
        self,
        declared: Mapping[str, str],
        equip: Callable[[str], ArmParts],
        world: World,
        leniency: Mapping[str, Leniency] = MappingProxyType({}),
        cell: CellState | None = None,
    ) -> None:
        self._cell = cell
        self._declared = declared
        self._equip = equip
        self._world = world
        self._timestep = exact(world.timestep)
        self._lifecycles = {
            name: ArmLifecycles(name, robot, leniency.get(name, STRICT))
            for name, robot in declared.items()
        }
        self.present: tuple[ArmRuntime, ...] = ()
        world.before_removal.append(weakly(self._remove))

    @property
    def ended(self) -> bool:
        """Whether no arm in the world has a running tree."""
        # A plain loop, as in the two methods below: they are called at every step, and a generator
        # expression costs more than the test itself.
        for arm in self.present:  # noqa: SIM110 - see above
            if arm.outcome is None:
                return False
        return True

    @property
    def at_rest(self) -> bool:
        """Whether every arm in the world is at rest."""
        return all(arm.at_rest for arm in self.present)

    def follow(self, step: int, ticked_from: int) -> None:
        """Equip and begin to run arms that have been spawned.

        Args:
            step: Current physics step.
            ticked_from: Physics step at which a new arm is ticked first.
        """
        if len(self._world.arms) == len(self.present):
            return
        present = {arm.name: arm for arm in self.present}
        for name in self._declared:
            if name in self._world.arms and name not in present:
                present[name] = ArmRuntime(
                    name,
                    self._equip(name),
                    self._timestep,
                    held_from=step,
                    ticked_from=ticked_from,
                )
                self._lifecycles[name].begin(present[name])
                if self._cell is not None:
                    self._cell.arm_back(name)
        self.present = tuple(present[name] for name in self._declared if name in present)

    def _remove(self, name: str) -> None:
        """Halt the tree of an arm that is about to be removed from the world.

        Cleanup code of its leaves still finds the arm; no part of it is called afterwards.
        """
        leaving = [arm for arm in self.present if arm.name == name]
        self.present = tuple(arm for arm in self.present if arm.name != name)
        for arm in leaving:
            arm.leave(self._world.time)
            if self._cell is not None:
                self._cell.arm_gone(name, f"was removed at {self._world.time:.2f} s")

    def due(self, step: int, time: float) -> bool:
        """Whether a camera or a tree of any arm is due; cheap, called at every step."""
        for arm in self.present:  # noqa: SIM110 - see `ended`
            if arm.outcome is None and arm.due(step, time):
                return True
        return False

    def controls(self, step: int) -> bool:
        """Whether a controller of any arm is due."""
        for arm in self.present:  # noqa: SIM110 - see `ended`
            if step >= arm.controlled_next:
                return True
        return False

    def capture(self, time: float) -> None:
        """Capture a frame with every camera that is due."""
        for arm in self.present:
            arm.capture(time)

    def deliver(self, time: float) -> None:
        """Deliver every frame whose latency has elapsed."""
        for arm in self.present:
            arm.deliver(time)

    def tick(self, step: int, time: float) -> bool:
        """Tick every tree that is due; returns whether there was one."""
        ticked = False
        cell = self._cell
        for arm in self.present:
            if arm.tick(step, time):
                ticked = True
                if cell is not None and arm.outcome is not None:
                    cell.arm_gone(arm.name, ended_as(arm.outcome, time))
        if ticked and cell is not None:
            cell.commit({arm.name: arm for arm in self.present if arm.outcome is None})
        return ticked

    def control(self, step: int, time: float) -> None:
        """Update every controller that is due."""
        for arm in self.present:
            arm.control(step, time)

    def halt(self, time: float) -> None:
        """Halt every tree and begin to stop every arm."""
        with ExitStack() as callbacks:  # calls all of them, even if some raise
            for arm in reversed(self.present):
                callbacks.callback(arm.stop)
                callbacks.callback(arm.halt, Outcome.UNFINISHED, time)

    def views(self) -> tuple[ArmView, ...]:
        """Current state of every arm of the file."""
        return tuple(self.view(name) for name in self._declared)

    def view(self, name: str) -> ArmView:
        """Current state of one arm of the file, or its last state after its removal."""
        return self._lifecycles[name].view()

    def lives_of(self, name: str) -> int:
        """Number of stays in the world that an arm of the file has begun."""
        return self._lifecycles[name].begun

    def results(self) -> dict[str, ArmResult]:
        """Results of all arms of the file, by name."""
        return {name: lifecycles.result() for name, lifecycles in self._lifecycles.items()}
