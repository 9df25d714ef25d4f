"""Base of all nodes: ports and blackboard, status reports, halting, children to be swapped."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Final, Protocol, Self, TypeAlias, cast

from py_trees.behaviour import Behaviour
from py_trees.common import Status
from pydantic import ValidationError
from pydantic_core import PydanticSerializationError

from bt_dualarm.behaviors.report import StatusChange, StatusName
from bt_dualarm.core.errors import Failure, Number
from bt_dualarm.skill.cell import CellAccess
from bt_dualarm.spec.explain import explain, valid_in_units
from bt_dualarm.spec.expressions import ExpressionError, parse, resolved, substituted
from bt_dualarm.spec.node_types import (
    REFERENCE,
    LanguageNode,
    PortModel,
    as_text,
    dynamic_ports,
    is_expression,
    key_name,
    only,
    port,
    shown,
    templates_of,
    validated,
)
from bt_dualarm.spec.yaml_reader import Data


class Blackboard:
    """Blackboard of one arm: values by key, in YAML notation.

    py_trees' blackboard is one for the whole process: two trees that write ``target`` would
    overwrite each other.
    """

    def __init__(self) -> None:
        self._values: dict[str, Data] = {}

    def read(self, key: str) -> Data:
        """Returns the value of a key.

        Raises:
            Failure: ``NO_VALUE``: the key was not written yet.
        """
        if key not in self._values:
            raise Failure("NO_VALUE", f"no node has written '{key_name(key)}' yet")
        return self._values[key]

    def write(self, key: str, value: Data) -> None:
        """Set a key."""
        self._values[key] = value

    def write_out(self, text: str) -> str:
        """Returns text with each ``{key}`` replaced by its value, if it has one."""
        return REFERENCE.sub(self._written, text)

    def _written(self, match: re.Match[str]) -> str:
        key = match[1]
        return as_text(self._values[key]) if key in self._values else shown(match[0])


class BoundPorts:
    """Ports of one node, bound to a blackboard: references are resolved at each start of the node.

    Args:
        model: Model of the ports.
        ports: Checked ports, as in the file.
        blackboard: Blackboard with the values of references.
    """

    def __init__(
        self, model: type[PortModel], ports: Mapping[str, Data], blackboard: Blackboard
    ) -> None:
        self._model = model
        self._ports = ports
        self._blackboard = blackboard
        self._references = dynamic_ports(model, ports)
        self._templates = {
            name for name in templates_of(model) if REFERENCE.search(str(ports.get(name, "")))
        }
        dynamic = self._references or self._templates
        self._known = None if dynamic else validated(model, ports)

    def now(self) -> PortModel:
        """Returns the ports with the current values of the blackboard.

        Raises:
            Failure: ``NO_VALUE``: a key or an expression has no value, or one that its port does
                not allow.
        """
        if self._known is not None:
            return self._known
        values = dict(self._ports)
        for name in self._references:
            try:
                values[name] = resolved(values[name], self._blackboard.read)
            except ExpressionError as error:
                raise Failure("NO_VALUE", f"{name}: {error}") from error
        values |= {name: self._blackboard.write_out(values[name]) for name in self._templates}
        try:
            return valid_in_units(self._model, values)
        except ValidationError as error:
            found = next(explain(error, self._model, values, "port"))
            raise Failure(
                "NO_VALUE", f"a key has a value that is not allowed: {found.message}"
            ) from error

    def worded(self, name: str) -> tuple[str, str]:
        """Returns a port's expression as its author wrote it, and with values in place of keys.

        Either is empty if there is none: a constant, or a value that has no notation.
        """
        text = self._ports[name]
        if name not in self._references or not isinstance(text, str):
            return "", ""
        if not is_expression(text):
            return shown(text), ""
        try:
            return shown(text), substituted(parse(text), self._blackboard.read)
        except ExpressionError:
            return shown(text), ""


class OutputWriter:
    """Outputs of one leaf, bound to a blackboard.

    Args:
        model: Model of the outputs.
        keys: Key of each output to which the file gives one; the others are discarded.
        blackboard: Blackboard to which they are written, in YAML notation.
        on_write: Receiver of key and value after each write.
    """

    def __init__(
        self,
        model: type[PortModel],
        keys: Mapping[str, str],
        blackboard: Blackboard,
        on_write: Callable[[str, Data], None] = lambda _key, _value: None,
    ) -> None:
        self._model = model
        self._keys = keys
        self._blackboard = blackboard
        self._on_write = on_write

    def write(self, name: str, value: object) -> None:
        """Write one output to the blackboard.

        Raises:
            KeyError: The skill declares no such output.
            TypeError: The value is not of the declared type.
            pydantic.ValidationError: It is not within the declared range.
        """
        if name not in self._model.model_fields:
            raise KeyError(f"the skill declares no output '{name}'")
        if name not in self._keys:
            return
        model = only(self._model, name)
        given = model.model_construct(None, **{name: value})
        try:
            data = given.model_dump(mode="json", warnings="error")
        except PydanticSerializationError:
            declared = model.model_fields[name].annotation
            kind = getattr(declared, "__name__", "") or str(declared)
            raise TypeError(f"output {name!r} is {value!r:.80}: it is declared as {kind}") from None
        validated(model, data)
        self._blackboard.write(self._keys[name], data[name])
        self._on_write(self._keys[name], data[name])


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
        write: Function that writes a key of the arm's blackboard.
    """

    name: str
    children: tuple[Behaviour, ...]
    slots: tuple[str, ...]
    ports: BoundPorts
    cell: CellAccess = field(default_factory=CellAccess.alone)
    write: Callable[[str, Data], None] = lambda _key, _value: None


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
