"""One arm on the runner's clock: its camera, tree and controller, each at its own period."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from fractions import Fraction
from time import perf_counter

from bt_dualarm.errors import RAISED_BY_SKILLS
from bt_dualarm.runtime.outcome import Outcome
from bt_dualarm.runtime.parts import ArmView, Controller, Eye, Tree
from bt_dualarm.runtime.result import ArmResult
from bt_dualarm.runtime.schedule import Periodic
from bt_dualarm.runtime.slow_ticks import SlowTicks
from bt_dualarm.spec.node import NodeSpec
from bt_dualarm.tree.report import NodeView

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class ArmParts:
    """What makes up one arm, as the runner needs it.

    Attributes:
        robot: Name in the catalogue, or the title of a page beside the tree file.
        tree: Behaviour tree of the arm, not ticked yet.
        controller: Controller that holds the arm where it is until told otherwise.
        eye: Camera of the arm, None where it has none.
        tick_period: Seconds between two ticks of the tree.
        control_period: Seconds between two updates of the controller.
        watch: What looks after the arm at each of them, such as after what its gripper holds.
    """

    robot: str
    tree: Tree
    controller: Controller
    eye: Eye | None
    tick_period: Fraction
    control_period: Fraction
    watch: Callable[[], None]


class ArmRuntime:
    """The life of one arm from the step at which it is in the world.

    What one arm's skills raise ends here, as a fault of this arm: its tree is halted, its
    controller stops it, and the other arms never notice.

    Args:
        name: The arm's name in the file.
        parts: What the arm consists of.
        held_from: The physics step from which its controller holds it.
        ticked_from: The physics step at which its tree is ticked first.
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
        self._eye = parts.eye
        self._watch = parts.watch
        self._ticks = Periodic(parts.tick_period, timestep, ticked_from)
        self._control = Periodic(parts.control_period, timestep, held_from)

    @property
    def controller(self) -> Controller:
        """What moves the arm, to be looked at."""
        return self._controller

    @property
    def at_rest(self) -> bool:
        """No motion is commanded and the arm stands still."""
        return self._controller.at_rest

    @property
    def running(self) -> tuple[str, ...]:
        """Paths of the leaves that run."""
        return tuple(leaf.path for leaf in self._tree.leaves if leaf.status == "RUNNING")

    @property
    def controlled_next(self) -> int:
        """Step at which its controller is due next."""
        return self._control.next

    def due(self, step: int, time: float) -> bool:
        """Whether its camera or its tree has something to do; asking changes nothing."""
        if step >= self._ticks.next:
            return True
        eye = self._eye
        return eye is not None and (eye.due(time) or eye.has_seen)

    def capture(self, time: float) -> None:
        """Take a picture if one is due; nobody looks once the tree has ended."""
        eye = self._eye
        if eye is not None and self.outcome is None and eye.due(time):
            self._guarded("camera", eye.capture, time)

    def deliver(self, time: float) -> None:
        """Hand out the pictures whose latency is over."""
        eye = self._eye
        if eye is not None and eye.has_seen and self.outcome is None:
            self._guarded("camera", lambda: eye.deliver(time), time)

    def tick(self, step: int, time: float) -> bool:
        """Tick the tree if that is due; whether it was."""
        if self.outcome is not None or not self._ticks.due(step):
            return False
        self._is_ticking = True
        began = perf_counter()
        self._guarded("tree", self._tree.tick, time)
        self._slow_ticks.note(time, perf_counter() - began, self._tree.leaves)
        self._is_ticking = False
        if self._is_leaving:
            self.halt(Outcome.REMOVED, time)
        if self.outcome is None and self._tree.status in ("SUCCESS", "FAILURE"):
            self._end(Outcome(self._tree.status), time)
        return True

    def control(self, step: int, time: float) -> None:
        """Update the controller if that is due, and look after the arm."""
        if self._control.due(step):
            self._controller.update(time)
            self._watch()

    def halt(self, outcome: Outcome, time: float) -> None:
        """End a tree that is still running with this outcome, leaf by leaf."""
        if self.outcome is None:
            self._before_halt = halted(self._tree.view(), time)
            self._end(outcome, time)
            self._guarded("tree", self._tree.halt, time)

    def change(self, spec: NodeSpec, time: float) -> bool:
        """Take up another tree between two ticks; False where the tree has ended."""
        if self.outcome is None:
            self._guarded("tree", lambda: self._tree.change(spec), time)
            return True
        return False

    def leave(self, time: float) -> None:
        """End as removed; one whose own leaf takes it away does so after its tick."""
        self._is_leaving = True
        if not self._is_ticking:
            self.halt(Outcome.REMOVED, time)

    def stop(self) -> None:
        """Begin a jerk-limited stop."""
        self._controller.stop()

    def view(self) -> ArmView:
        """As it stands now; of a halted tree, what it had achieved until then."""
        tree = self._before_halt or self._tree.view()
        return ArmView(self.name, self.robot, self.outcome, tree, self.fault)

    def result(self) -> ArmResult:
        """What it did, at the end of the run or of its life."""
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


def halted(node: NodeView, time: float) -> NodeView:
    """The same tree, what runs halted: halting itself would wipe out what has ended, too."""
    node = replace(node, children=tuple(halted(child, time) for child in node.children))
    if node.status != "RUNNING":
        return node
    return replace(node, status="INVALID", since=time, halted=True)
