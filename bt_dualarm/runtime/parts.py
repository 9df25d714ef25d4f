"""What the runner asks of the things it advances: small protocols, met by the real ones."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Protocol

from bt_dualarm.errors import Number
from bt_dualarm.motion.setpoints.set_point import SetPoint
from bt_dualarm.runtime.outcome import Outcome
from bt_dualarm.spec.node import NodeSpec
from bt_dualarm.tree.report import LeafReport, NodeView, StatusChange, StatusName


class SteppedWorld(Protocol):
    """The physics. ``arms`` holds the arms that are present now, by name."""

    @property
    def time(self) -> float:
        """Simulated time in seconds."""

    @property
    def timestep(self) -> float:
        """Seconds of one step."""

    @property
    def arms(self) -> Mapping[str, object]:
        """Arms that are present, by name."""

    @property
    def before_removal(self) -> list[Callable[[str], None]]:
        """Functions that are told the name of an arm that is about to be taken away."""

    def step(self) -> None:
        """Advance by one step.

        Raises:
            DivergenceError: The state is no longer one of numbers.
        """


class Controller(Protocol):
    """One arm's controller."""

    @property
    def at_rest(self) -> bool:
        """No motion is commanded any more and the arm stands still."""

    @property
    def setpoint(self) -> SetPoint:
        """The last set-point that was sent."""

    @property
    def clipped(self) -> int:
        """Set-points that had to be clipped so far."""

    @property
    def guard(self) -> Mapping[str, Number]:
        """Smallest distances while the arm moved, and what its guard did."""

    def update(self, time: float) -> None:
        """Compute the actuators' commands for the step that begins at ``time``."""

    def stop(self) -> None:
        """Begin a jerk-limited stop, whatever was commanded."""


class Eye(Protocol):
    """One arm's camera."""

    def due(self, time: float) -> bool:
        """Whether a picture is to be taken now."""

    def capture(self) -> object:
        """Take it."""

    @property
    def has_seen(self) -> bool:
        """Whether there are pictures that have not been handed out."""

    def deliver(self, time: float) -> object:
        """Hand the pictures whose latency is over to those who listen."""


class Reports(Protocol):
    """Runs of leaves, in the order in which they began."""

    @property
    def left_out(self) -> int:
        """Number of runs that were dropped, of leaves that run over and over."""

    def __iter__(self) -> Iterator[LeafReport]:
        """Those that are kept."""


class Tree(Protocol):
    """One arm's behaviour tree."""

    @property
    def status(self) -> StatusName:
        """Of its root."""

    @property
    def leaves(self) -> Reports:
        """Every run of every leaf so far."""

    def tick(self) -> object:
        """Tick the root once."""

    def halt(self) -> None:
        """Halt whatever is running; nothing if nothing is."""

    def change(self, spec: NodeSpec) -> None:
        """Be another tree from now on; what is unchanged goes on."""

    def view(self) -> NodeView:
        """As it stands now, to be drawn."""


@dataclass(frozen=True)
class ArmView:
    """One arm as it stands now: what a display shows.

    Attributes:
        name: Name of the arm in the file.
        robot: Name of its robot in the catalogue, or the title of a page beside the tree file.
        outcome: How its tree ended, None while it runs.
        tree: Its tree as it stands; None as long as the arm is not in the world.
        fault: Sentence on what broke its tree, as in `ArmResult`.
    """

    name: str
    robot: str
    outcome: Outcome | None
    tree: NodeView | None
    fault: str = ""


class RunView(Protocol):
    """The run as it stands now; looking at it costs only those who look."""

    @property
    def time(self) -> float:
        """Simulated time in seconds."""

    def views(self) -> tuple[ArmView, ...]:
        """All arms of the file, in its order."""


class Observer(Protocol):
    """Looks on: a display, the recorder. One that raises is dropped, the run goes on."""

    def on_event(self, change: StatusChange) -> None:
        """A node took another status."""

    def after_ticks(self, run: RunView) -> None:
        """Trees were ticked; all their changes have been told."""

    def after_step(self, time: float) -> None:
        """The physics advanced to ``time``."""


class IdleObserver:
    """An observer that sees nothing: the base of those that look at some things only."""

    def on_event(self, change: StatusChange) -> None:
        """Look away."""

    def after_ticks(self, run: RunView) -> None:
        """Look away."""

    def after_step(self, time: float) -> None:
        """Look away."""
