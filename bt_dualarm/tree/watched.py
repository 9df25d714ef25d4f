"""Nodes that tell each change of their status, and know when and why it came."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar, Protocol, Self

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from bt_dualarm.errors import Number
from bt_dualarm.spec.word import Word
from bt_dualarm.tree.binding import BoundPorts
from bt_dualarm.tree.forgetful import Forgetful
from bt_dualarm.tree.parts import Parts
from bt_dualarm.tree.report import StatusChange, StatusName

NAMES: Mapping[Status, StatusName] = {
    Status.INVALID: "INVALID",
    Status.RUNNING: "RUNNING",
    Status.SUCCESS: "SUCCESS",
    Status.FAILURE: "FAILURE",
}


class Placed(Protocol):
    """A node that knows who it is."""

    path: str
    kind: str
    code: str
    reason: str


class Teller:
    """Tells the changes of one arm's tree.

    Args:
        arm: Name of the arm whose tree it is.
        clock: Simulated time in seconds.
        on_event: Receiver of every change, in the order in which they happen.
    """

    def __init__(
        self, arm: str, clock: Callable[[], float], on_event: Callable[[StatusChange], None]
    ) -> None:
        self.arm = arm
        self.clock = clock
        self.on_event = on_event

    def tell(
        self,
        node: Placed,
        old: Status,
        new: Status,
        metrics: Mapping[str, Number],
    ) -> None:
        """Tell that ``node`` went from ``old`` to ``new`` just now."""
        self.on_event(
            StatusChange(
                self.clock(),
                self.arm,
                node.path,
                node.kind,
                NAMES[old],
                NAMES[new],
                node.code,
                node.reason,
                metrics,
            )
        )


class Watched(Forgetful):
    """Mixed into py_trees' composites and decorators, whose every change of status it sees.

    Nodes are told who they are by `place` before the first tick.

    Attributes:
        word: Word of the language that a class ticks; `build` finds the class by it.
    """

    word: ClassVar[Word]
    path = ""
    kind = ""
    since = 0.0
    code = ""
    reason = ""
    halted = False
    _status = Status.INVALID
    _teller: Teller | None = None

    @classmethod
    def of(cls, parts: Parts) -> Self:
        """A node of this class."""
        raise NotImplementedError

    def place(self, teller: Teller, path: str, kind: str) -> None:
        """Take a place in an arm's tree."""
        self._teller = teller
        self.path = path
        self.kind = kind

    def exchange(
        self,
        children: Sequence[Behaviour],
        slots: tuple[str, ...],  # noqa: ARG002 - for those that know their children by these
        became: Mapping[Behaviour, Behaviour],  # noqa: ARG002 - for those that remember one
    ) -> bool:
        """Take other children between two ticks; whether it can go on with them.

        Args:
            children: Those that it has from now on.
            slots: Role of each.
            became: What became of those that it had: themselves, or others in their places.
        """
        self.children = [*children]
        return True

    def redefine(self, ports: BoundPorts) -> bool:  # noqa: ARG002 - most of py_trees' have none
        """Take other ports between two ticks; whether it can go on with them."""
        return True

    @property
    def time(self) -> float:
        """Simulated time in seconds."""
        return self._teller.clock() if self._teller else 0.0

    @property
    def status(self) -> Status:
        """As py_trees has it."""
        return self._status

    @status.setter
    def status(self, new: Status) -> None:
        old = self._status
        if new is old:
            return
        self._status = new
        self.since = self.time
        self.halted = old is Status.RUNNING and new is Status.INVALID
        if new is not Status.FAILURE:
            self.code = self.reason = ""
        if self._teller:
            self._teller.tell(self, old, new, {})
