"""Base of all nodes: status reports, halting, and children that hot reload may swap."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Final, Protocol, Self, TypeAlias, cast

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from bt_dualarm.behaviors.blackboard import BoundPorts
from bt_dualarm.behaviors.report import StatusChange, StatusName
from bt_dualarm.core.errors import Number
from bt_dualarm.skill.cell import CellAccess
from bt_dualarm.spec.node_types import LanguageNode
from bt_dualarm.spec.ports import PortModel, port

Children: TypeAlias = Sequence[Behaviour]
"""Children of one node, in the order of the file."""

Became: TypeAlias = Mapping[Behaviour, Behaviour]
"""New child in the position of each old child of a node; removed children are missing."""

_ROUNDING_S: Final = 1e-9
"""Tolerance for the rounding of summed time steps."""


def reached(time: float, deadline: float) -> bool:
    """Returns whether a deadline has come; both in seconds of simulated time."""
    return time >= deadline - _ROUNDING_S


class AcyclicNode(Behaviour):
    """Mixin for nodes, without the reference to itself that py_trees keeps in each node.

    py_trees stores an iterator over the node's own tick, which nothing uses. This cycle would keep
    the tree, and with it the world, in memory until the next garbage collection.
    """

    @property
    def iterator(self) -> Iterator[Behaviour]:
        """Iterator over one tick of the node, as in py_trees."""
        return self.tick()

    @iterator.setter
    def iterator(self, _: Iterator[Behaviour]) -> None:
        """Discard the iterator that py_trees sets."""


def detach_parent(node: Behaviour) -> None:
    """Remove a node's reference to its parent, which is a cycle, too, and is not needed."""
    node.parent = None


def reset(nodes: Iterable[Behaviour]) -> None:
    """Halt nodes, and discard the results of those that have ended."""
    for node in nodes:
        if node.status is not Status.INVALID:
            node.stop(Status.INVALID)


def halt_running(nodes: Iterable[Behaviour]) -> None:
    """Halt the nodes that are running."""
    for node in nodes:
        if node.status is Status.RUNNING:
            node.stop(Status.INVALID)


@dataclass(frozen=True)
class NodeParts:
    """Arguments for making a node with children.

    Attributes:
        name: Name for display.
        children: Children, at least one, in the order of the file.
        slots: Role of each child: ``child``, ``condition``, a case, …
        ports: Ports, bound to the arm's blackboard.
        cell: What the trees of the file share.
    """

    name: str
    children: tuple[Behaviour, ...]
    slots: tuple[str, ...]
    ports: BoundPorts
    cell: CellAccess = field(default_factory=CellAccess.alone)


NAMES: Final[Mapping[Status, StatusName]] = {
    Status.INVALID: "INVALID",
    Status.RUNNING: "RUNNING",
    Status.SUCCESS: "SUCCESS",
    Status.FAILURE: "FAILURE",
}
"""Names of py_trees' statuses."""


class ReportedNode(Protocol):
    """A node whose status changes are reported."""

    path: str
    kind: str
    code: str
    reason: str


class StatusReporter:
    """Reports the status changes of one arm's tree.

    Args:
        arm: Name of the arm.
        clock: Simulated time in seconds.
        on_event: Receiver of every change, in the order in which they happen.
    """

    def __init__(
        self, arm: str, clock: Callable[[], float], on_event: Callable[[StatusChange], None]
    ) -> None:
        self.arm = arm
        self.clock = clock
        self.on_event = on_event

    def report(
        self,
        node: ReportedNode,
        old: Status,
        new: Status,
        metrics: Mapping[str, Number],
    ) -> None:
        """Report that ``node`` has changed from ``old`` to ``new`` now."""
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


class ReportingNode(AcyclicNode):
    """Mixin for py_trees' composites and decorators that reports every change of status.

    `attach` comes before the first tick.

    Attributes:
        node_type: Declaration of the node type that a class implements.
    """

    node_type: ClassVar[LanguageNode]
    path = ""
    kind = ""
    since = 0.0
    code = ""
    reason = ""
    halted = False
    _status = Status.INVALID
    _reporter: StatusReporter | None = None

    @classmethod
    def of(cls, parts: NodeParts) -> Self:
        """Returns a node of this class."""
        raise NotImplementedError

    def attach(self, reporter: StatusReporter, path: str, kind: str) -> None:
        """Make the node part of an arm's tree.

        Args:
            reporter: Reporter of the arm's tree.
            path: Names from the root down, joined by ``/``.
            kind: Name of the node type.
        """
        self._reporter = reporter
        self.path = path
        self.kind = kind

    def swap_children(
        self,
        children: Children,
        slots: tuple[str, ...],  # noqa: ARG002 - used by nodes that know children by their role
        became: Became,  # noqa: ARG002 - used by nodes that remember a child
    ) -> bool:
        """Replace the children between two ticks; returns whether the node can continue with them.

        Args:
            children: New children.
            slots: Role of each.
            became: New child in the position of each old one.
        """
        self.children = [*children]
        return True

    def swap_ports(self, ports: BoundPorts) -> bool:  # noqa: ARG002 - most of py_trees' have none
        """Replace the ports between two ticks; returns whether the node can continue with them."""
        return True

    @property
    def time(self) -> float:
        """Simulated time in seconds."""
        return self._reporter.clock() if self._reporter else 0.0

    @property
    def status(self) -> Status:
        """Status as in py_trees; setting it reports the change."""
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
        if self._reporter:
            self._reporter.report(self, old, new, {})


class MemoryPorts(PortModel):
    """Ports of sequence and selector."""

    memory: bool = port(
        True, "Whether a tick resumes at the running child; false ticks the earlier ones again"
    )


class ChildSwap(ReportingNode):
    """Mixin for py_trees' sequence and selector, which remember the child that is running."""

    current_child: Behaviour | None
    memory: bool

    def swap_children(self, children: Children, slots: tuple[str, ...], became: Became) -> bool:
        """Continue with the child in the position of the running one.

        If that is gone, continue after the last of the children that came before it.
        """
        before = [*self.children]
        super().swap_children(children, slots, became)
        now = self.current_child
        if now is None or self.status is not Status.RUNNING:
            self.current_child = None if now is None else children[0]
            return True
        if now in became:
            self.current_child = became[now]
            return True
        earlier = [became[child] for child in before[: before.index(now)] if child in became]
        index = 1 + max((children.index(child) for child in earlier), default=-1)
        if index < len(children):
            self.current_child = children[index]
        return index < len(children)

    def swap_ports(self, ports: BoundPorts) -> bool:
        """Take over the ``memory`` port."""
        self.memory = cast("MemoryPorts", ports.now()).memory
        return True
