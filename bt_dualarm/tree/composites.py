"""Nodes with children: py_trees' own where they are right, and a base for ours."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from typing import Self, TypeAlias, cast

from py_trees import composites
from py_trees.behaviour import Behaviour
from py_trees.common import Status

from bt_dualarm.errors import Failure
from bt_dualarm.spec import composite_words
from bt_dualarm.spec.ports import PortModel
from bt_dualarm.spec.wording import one_line
from bt_dualarm.tree.binding import BoundPorts
from bt_dualarm.tree.exchanging import Became, Remembering, Siblings
from bt_dualarm.tree.halting import halt_running, reset
from bt_dualarm.tree.parts import Parts
from bt_dualarm.tree.watched import Watched

Ticks: TypeAlias = Generator[Behaviour, None, Status]
"""Yields nodes as py_trees wants it, returns the new status."""


class Sequence(Remembering, composites.Sequence):
    """py_trees' own."""

    word = composite_words.SEQUENCE

    @classmethod
    def of(cls, parts: Parts) -> Self:
        """One with its memory."""
        return cls(parts.name, _memory(parts), parts.children)


class Selector(Remembering, composites.Selector):
    """py_trees' own, but a new start forgets what the children said the last time."""

    word = composite_words.SELECTOR

    @classmethod
    def of(cls, parts: Parts) -> Self:
        """One with its memory."""
        return cls(parts.name, _memory(parts), parts.children)

    def initialise(self) -> None:
        """Reset the children, as py_trees' Sequence and Parallel do."""
        reset(self.children)


def _memory(parts: Parts) -> bool:
    return cast("composite_words.Memory", parts.ports.now()).memory


class Node(Watched, composites.Composite):
    """Base of nodes of ours, with one child or several.

    Args:
        parts: Name, children and ports.

    Attributes:
        ports: The ports, with the blackboard's values of the last start.
    """

    ports: PortModel

    def __init__(self, parts: Parts) -> None:
        super().__init__(parts.name, parts.children)
        self._bound = parts.ports

    @classmethod
    def of(cls, parts: Parts) -> Self:
        """A node of this class."""
        return cls(parts)

    def tick(self) -> Iterator[Behaviour]:
        """Tick those children that are due, and become what they make of it."""
        try:
            if self.status is not Status.RUNNING:
                self.code = self.reason = ""
                reset(self.children)
                self.ports = self._bound.now()
                self.initialise()
            new_status = yield from self.tick_children()
        except Failure as failure:
            self.code, self.reason = failure.code, one_line(failure.reason)
            new_status = Status.FAILURE
        if new_status is Status.RUNNING:
            self.status = new_status
        else:
            halt_running(self.children)
            self.stop(new_status)
        yield self

    def redefine(self, ports: BoundPorts) -> bool:
        """Begin to count, or to wait, anew, if it runs."""
        self._bound = ports
        if self.status is Status.RUNNING:
            try:
                self.ports = ports.now()
                self.initialise()
            except Failure:
                return False
        return True

    def tick_children(self) -> Ticks:
        """Tick children; may raise `Failure` to fail with a reason."""
        raise NotImplementedError


class Parallel(Node):
    """Ticks all children until enough have succeeded.

    Not py_trees' own: that has no "N of M", and fails with any child whatever its policy says.
    """

    word = composite_words.PARALLEL
    ports: composite_words.Parallel

    def tick_children(self) -> Ticks:
        """Tick the children that have not ended; they are not started again."""
        for child in self.children:
            if child.status is Status.RUNNING or child.status is Status.INVALID:
                yield from child.tick()
        statuses = [child.status for child in self.children]
        succeeded = statuses.count(Status.SUCCESS)
        failed = statuses.count(Status.FAILURE)
        policy = self.ports.policy
        needed = {"all": len(statuses), "any": 1}[policy] if isinstance(policy, str) else policy
        if failed and self.ports.on_failure != "continue":
            raise Failure("CHILD_FAILED", self._failed_child())
        if succeeded >= needed:
            return Status.SUCCESS
        if len(statuses) - failed < needed:
            raise Failure("TOO_MANY_FAILED", f"{failed} of {len(statuses)} failed, {needed} needed")
        return Status.RUNNING

    def _failed_child(self) -> str:
        child = next(child for child in self.children if child.status is Status.FAILURE)
        return f"'{child.name}' failed"


class Switch(Node):
    """Runs the child whose case is the value at the start."""

    word = composite_words.SWITCH
    ports: composite_words.Switch

    def __init__(self, parts: Parts) -> None:
        super().__init__(parts)
        self._by_case = dict(zip(parts.slots, self.children, strict=True))
        self._chosen: Behaviour | None = None

    def initialise(self) -> None:
        """Choose the case that the value names."""
        value = self.ports.value
        case = str(value).lower() if isinstance(value, bool) else str(value)
        self._chosen = self._by_case.get(case, self._by_case.get("default"))
        if self._chosen is None:
            raise Failure("NO_CASE", f"no case for '{case}' and no default")

    def exchange(self, children: Siblings, slots: tuple[str, ...], became: Became) -> bool:
        """Go on with the chosen one, if it is there still."""
        super().exchange(children, slots, became)
        self._by_case = dict(zip(slots, self.children, strict=True))
        self._chosen = became.get(self._chosen) if self._chosen else None
        return self._chosen is not None or self.status is not Status.RUNNING

    def tick_children(self) -> Ticks:
        """The chosen one."""
        assert self._chosen is not None  # noqa: S101 - `initialise` has chosen or failed
        yield from self._chosen.tick()
        return self._chosen.status


class If(Node):
    """Asks a condition once, then runs one child or the other; without "else", succeeds."""

    word = composite_words.IF

    _chosen: Behaviour | None = None

    def initialise(self) -> None:
        """Nothing is chosen yet."""
        self._chosen = None

    def exchange(self, children: Siblings, slots: tuple[str, ...], became: Became) -> bool:
        """Go on with the chosen one; where it is gone, ask again."""
        super().exchange(children, slots, became)
        self._chosen = became.get(self._chosen) if self._chosen else None
        return True

    def tick_children(self) -> Ticks:
        """The condition until it says yes or no, then what follows from that."""
        condition, *branches = self.children
        if self._chosen is None:
            yield from condition.tick()
            if condition.status is Status.RUNNING:
                return Status.RUNNING
            chosen = branches[0:1] if condition.status is Status.SUCCESS else branches[1:2]
            if not chosen:
                return Status.SUCCESS
            self._chosen = chosen[0]
        yield from self._chosen.tick()
        return self._chosen.status


class While(Node):
    """Asks a condition before each start of its child; ends with SUCCESS once that says no."""

    word = composite_words.WHILE

    def tick_children(self) -> Ticks:
        """At most one start of the child a tick, so that an endless loop cannot block."""
        condition, child = self.children
        if child.status is not Status.RUNNING:
            yield from condition.tick()
            if condition.status is Status.FAILURE:
                return Status.SUCCESS
            if condition.status is Status.RUNNING:
                return Status.RUNNING
        yield from child.tick()
        return Status.FAILURE if child.status is Status.FAILURE else Status.RUNNING


class Guard(Node):
    """Asks a condition before each tick of its child; halts it and fails once that says no.

    While the condition is still at it, the child is not started, but goes on if it runs.
    py_trees' EternalGuard takes a Python function only, which YAML must not name.
    """

    word = composite_words.GUARD

    def tick_children(self) -> Ticks:
        """The condition, then the child."""
        condition, child = self.children
        yield from condition.tick()
        if condition.status is Status.FAILURE:
            raise Failure("GUARD", f"'{condition.name}' no longer holds")
        if condition.status is Status.RUNNING and child.status is not Status.RUNNING:
            return Status.RUNNING
        yield from child.tick()
        return child.status
