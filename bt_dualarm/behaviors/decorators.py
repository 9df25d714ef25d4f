"""Decorators: node types with one child; their times are simulated, py_trees' are wall clocks."""

from __future__ import annotations

import math
from typing import Annotated, Final, Literal, Self, TypeAlias

from py_trees import decorators
from py_trees.behaviour import Behaviour
from py_trees.common import OneShotPolicy, Status
from pydantic import Field, WithJsonSchema

from bt_dualarm.behaviors.composites import Node, Ticks
from bt_dualarm.behaviors.node import Became, Children, NodeParts, ReportingNode, reached
from bt_dualarm.core.errors import Failure
from bt_dualarm.spec.node_types import (
    FAILURE,
    KEY,
    SUCCESS,
    ChildOutcomes,
    LanguageNode,
    NodeSpec,
    NoEffectRule,
    Outcomes,
    PortModel,
    Slot,
    WrittenKey,
    always,
    as_child,
    counted,
    port,
)
from bt_dualarm.spec.values import Duration
from bt_dualarm.spec.yaml_reader import Data

_CHILD: Final = (Slot("child"),)
_Count: TypeAlias = Annotated[int, Field(ge=1, le=1_000_000)]

_ROUNDING: Final = 1e-6
"""Tolerance as a fraction of a period: times are sums of time steps."""


def _unless(needed: Literal["fail", "succeed"]) -> NoEffectRule:
    """Rule of a node that has an effect only if its child fails, or only if it succeeds."""

    def why(node: NodeSpec, children: ChildOutcomes) -> str:
        if node.ports.get("times") == 1:
            return f"{node.kind} with times: 1 has no effect"
        if children[0].fails if needed == "fail" else children[0].succeeds:
            return ""
        return f"{node.kind} has no effect: '{node.children[0].name}' cannot {needed}"

    return why


class Decorator(ReportingNode, decorators.Decorator):
    """Base of the decorators that are py_trees'."""

    @classmethod
    def of(cls, parts: NodeParts) -> Self:
        """Returns a decorator of the only child."""
        return cls(parts.name, parts.children[0])

    def swap_children(self, children: Children, slots: tuple[str, ...], became: Became) -> bool:
        """Continue with another child."""
        self.decorated = children[0]
        return super().swap_children(children, slots, became)


class Retry(Node):
    """Repeats its child until it succeeds. py_trees' has no pause between attempts."""

    class Ports(PortModel):
        """Ports of retry."""

        times: _Count = port(..., "Total number of attempts")
        delay: Duration = port(0.0, "Pause between two attempts", le=3600.0)

    node_type = LanguageNode(
        "retry",
        "Repeats its child until it succeeds",
        Ports,
        slots=_CHILD,
        example="retry: {times: 3, delay: 0.5, child: {compare: {value: 1, to: 2}}}",
        outcomes=as_child,
        revisits=always,
        no_effect=_unless("fail"),
        synonyms={"RetryUntilSuccessful": "times"},
    )
    ports: Ports

    def initialise(self) -> None:
        """Start counting attempts."""
        self._failures = 0
        self._resume: float | None = None

    def tick_children(self) -> Ticks:
        """Start the child at most once per tick; wait between attempts."""
        if self._resume is not None and not reached(self.time, self._resume):
            return Status.RUNNING
        self._resume = None
        child = self.children[0]
        if child.status is Status.FAILURE:
            child.stop(Status.INVALID)  # makes a failure in its first tick a status change
        yield from child.tick()
        if child.status is not Status.FAILURE:
            return child.status
        self._failures += 1
        if self._failures >= self.ports.times:
            raise Failure("RETRIES_USED_UP", f"failed {counted(self._failures, 'time')}")
        if self.ports.delay > 0.0:
            self._resume = self.time + self.ports.delay
        return Status.RUNNING


def _repeat_outcomes(node: NodeSpec, children: ChildOutcomes) -> Outcomes:
    forever = node.ports.get("times") == "forever"
    return Outcomes(children[0].succeeds and not forever, children[0].fails)


class Repeat(Node):
    """Repeats its child while it succeeds. py_trees' cannot take its count from a key."""

    class Ports(PortModel):
        """Ports of repeat."""

        times: _Count | Literal["forever"] = port(..., "Number of successes, or `forever`")

    node_type = LanguageNode(
        "repeat",
        "Repeats its child while it succeeds",
        Ports,
        slots=_CHILD,
        example="repeat: {times: 3, child: {wait: 1}}",
        outcomes=_repeat_outcomes,
        revisits=always,
        repeats=lambda node: node.ports.get("times") != 1,
        no_effect=_unless("succeed"),
        synonyms={"KeepRunningUntilFailure": "times: forever"},
    )
    ports: Ports

    def initialise(self) -> None:
        """Start counting successes."""
        self._successes = 0

    def tick_children(self) -> Ticks:
        """Start the child at most once per tick."""
        yield from self.children[0].tick()
        if self.children[0].status is not Status.SUCCESS:
            return self.children[0].status
        self._successes += 1
        return Status.SUCCESS if self._successes == self.ports.times else Status.RUNNING


_KEY_NAME: Final = WithJsonSchema({"type": "string", "pattern": f"^{KEY.pattern}$"})


def _for_each_outcomes(node: NodeSpec, children: ChildOutcomes) -> Outcomes:
    items = node.ports.get("items")
    may_be_empty = not isinstance(items, list) or not items
    if_empty = node.ports.get("if_empty", "succeed")
    return Outcomes(
        children[0].succeeds or (may_be_empty and if_empty != "fail"),
        children[0].fails or (may_be_empty and if_empty != "succeed"),
    )


class ForEach(Node):
    """Runs its child for each item of a list, and fails with it; one item at most per tick."""

    class Ports(PortModel):
        """Ports of for_each."""

        items: Annotated[tuple[Data, ...], Field(max_length=1000)] = port(
            ..., "The list: literal, a key, or with keys in it"
        )
        item: Annotated[str, WrittenKey("items", "items"), _KEY_NAME] = port(
            ..., "Blackboard key for the current item"
        )
        index: Annotated[str | None, WrittenKey("items", "indices"), _KEY_NAME] = port(
            None, "Blackboard key for its number, from 0"
        )
        if_empty: Literal["succeed", "fail"] = port("succeed", "Result for an empty list")

    node_type = LanguageNode(
        "for_each",
        "Runs its child for each item of a list",
        Ports,
        slots=_CHILD,
        fixed=frozenset({"if_empty"}),
        example="for_each: {items: [0.1, 0.2], item: height, child: {log: 'to {height}'}}",
        outcomes=_for_each_outcomes,
        revisits=always,
        synonyms={"LoopDouble": "items", "LoopString": "items", "LoopInt": "items"},
    )
    ports: Ports

    def __init__(self, parts: NodeParts) -> None:
        super().__init__(parts)
        self._write = parts.write

    def initialise(self) -> None:
        """Begin with the first item.

        Raises:
            Failure: ``EMPTY``: there is none, and ``if_empty`` is ``fail``.
        """
        self._number = 0
        if not self.ports.items and self.ports.if_empty == "fail":
            raise Failure("EMPTY", "the list has no items")

    def tick_children(self) -> Ticks:
        """Write the item before each start of the child; start it at most once per tick."""
        items = self.ports.items
        if self._number >= len(items):
            return Status.SUCCESS
        child = self.children[0]
        if child.status is not Status.RUNNING:
            self._write(self.ports.item, items[self._number])
            if self.ports.index is not None:
                self._write(self.ports.index, self._number)
        yield from child.tick()
        if child.status is not Status.SUCCESS:
            return child.status
        self._number += 1
        return Status.SUCCESS if self._number == len(items) else Status.RUNNING


class SecondsPorts(PortModel):
    """Ports of timeout and delay."""

    seconds: Duration = port(..., "Simulated time", gt=0.0)


class Timeout(Node):
    """Halts its child and fails when it has not ended in time; an end at the deadline counts."""

    node_type = LanguageNode(
        "timeout",
        "Halts its child and fails after a time",
        SecondsPorts,
        slots=_CHILD,
        example="timeout: {seconds: 5, child: {wait: 1}}",
        outcomes=lambda _, children: Outcomes(children[0].succeeds, True),
    )
    ports: SecondsPorts

    def initialise(self) -> None:
        """Set the deadline."""
        self._deadline = self.time + self.ports.seconds

    def tick_children(self) -> Ticks:
        """Tick the child, then check the deadline."""
        yield from self.children[0].tick()
        status = self.children[0].status
        if status is Status.RUNNING and reached(self.time, self._deadline):
            raise Failure("TIMEOUT", f"not finished within {self.ports.seconds:g} s")
        return status


class Delay(Node):
    """Waits before its child starts."""

    node_type = LanguageNode(
        "delay",
        "Waits before its child starts",
        SecondsPorts,
        slots=_CHILD,
        example="delay: {seconds: 500 ms, child: {log: now}}",
        outcomes=as_child,
    )
    ports: SecondsPorts

    def initialise(self) -> None:
        """Set the time at which the child starts."""
        self._due = self.time + self.ports.seconds

    def tick_children(self) -> Ticks:
        """Tick the child once the time has elapsed."""
        if not reached(self.time, self._due):
            return Status.RUNNING
        yield from self.children[0].tick()
        return self.children[0].status


class Rate(Node):
    """Ticks its child at a lower rate; between those ticks it keeps running."""

    class Ports(PortModel):
        """Ports of rate."""

        hz: float = port(
            ..., "Largest number of child ticks per simulated second", unit="Hz", ge=0.001, le=1000
        )

    node_type = LanguageNode(
        "rate",
        "Ticks its child at a lower rate",
        Ports,
        slots=_CHILD,
        example="rate: {hz: 2, child: {wait: 5}}",
        outcomes=as_child,
    )
    ports: Ports

    def initialise(self) -> None:
        """Tick the child at once for the first time."""
        self._due = self.time

    def tick_children(self) -> Ticks:
        """Tick the child when it is due; a late tick does not shift those that follow."""
        if not reached(self.time, self._due):
            return Status.RUNNING
        periods = math.floor((self.time - self._due) * self.ports.hz + _ROUNDING) + 1
        self._due += periods / self.ports.hz
        yield from self.children[0].tick()
        return self.children[0].status


def _inverted_twice(node: NodeSpec, _: ChildOutcomes) -> str:
    twice = bool(node.children) and node.children[0].kind == node.kind
    return f"two nested {node.kind}s have no effect" if twice else ""


class Inverter(Decorator, decorators.Inverter):
    """py_trees' inverter."""

    node_type = LanguageNode(
        "inverter",
        "Inverts the result of its child",
        slots=_CHILD,
        example="inverter: {child: {compare: {value: 1, to: 2}}}",
        outcomes=lambda _, children: Outcomes(children[0].fails, children[0].succeeds),
        no_effect=_inverted_twice,
        runs_all=always,
    )


class ForceSuccess(Decorator, decorators.FailureIsSuccess):
    """py_trees' FailureIsSuccess, under a name that states its purpose."""

    node_type = LanguageNode(
        "force_success",
        "Succeeds, whatever its child's result",
        slots=_CHILD,
        example="force_success: {child: {compare: {value: 1, to: 2}}}",
        outcomes=lambda _, children: children[0] if children[0].never else SUCCESS,
        no_effect=_unless("fail"),
        synonyms={"FailureIsSuccess": ""},
        runs_all=always,
    )


class ForceFailure(Decorator, decorators.SuccessIsFailure):
    """py_trees' SuccessIsFailure, under a name that states its purpose."""

    node_type = LanguageNode(
        "force_failure",
        "Fails, whatever its child's result",
        slots=_CHILD,
        example="force_failure: {child: {log: on to the next branch}}",
        outcomes=lambda _, children: children[0] if children[0].never else FAILURE,
        no_effect=_unless("succeed"),
        synonyms={"SuccessIsFailure": ""},
        runs_all=always,
    )


class RunOnce(Decorator, decorators.OneShot):
    """py_trees' OneShot with the policy that a success or failure counts, and a halt does not."""

    node_type = LanguageNode(
        "run_once",
        "Runs its child to completion once, then repeats that result",
        slots=_CHILD,
        example="run_once: {child: {log: said only once}}",
        outcomes=as_child,
        synonyms={"OneShot": ""},
    )

    def __init__(self, name: str, child: Behaviour) -> None:
        super().__init__(name, child, OneShotPolicy.ON_COMPLETION)


class OnHalt(Node):
    """Ticks a cleanup node once when its child is halted; a halt cannot wait for a longer one."""

    node_type = LanguageNode(
        "on_halt",
        "Ticks a cleanup node once when its child is halted",
        slots=(Slot("child"), Slot("cleanup")),
        example="on_halt: {child: {wait: 5}, cleanup: {log: interrupted}}",
        outcomes=as_child,
    )

    def tick_children(self) -> Ticks:
        """Tick the child."""
        yield from self.children[0].tick()
        return self.children[0].status

    def stop(self, new_status: Status = Status.INVALID) -> None:
        """Stop; a halt of the running child is followed by the cleanup."""
        child, cleanup = self.children
        if new_status is Status.INVALID and child.status is Status.RUNNING:
            child.stop(Status.INVALID)
            cleanup.tick_once()
        super().stop(new_status)


class Subtree(Node):
    """A use of a subtree, with the status of its root."""

    class Ports(PortModel):
        """Ports of subtree."""

        use: str = port(..., "Name of a subtree of this file or of one that it includes")
        params: dict[str, Data] = port({}, "Values of the subtree's parameters")

    node_type = LanguageNode(
        "subtree",
        "Runs a subtree by name, with values for its parameters",
        Ports,
        uses="use",
        example="subtree: {use: pause, params: {time: 2}}",
        outcomes=as_child,
        runs_all=always,
    )

    def tick_children(self) -> Ticks:
        """Tick the root."""
        yield from self.children[0].tick()
        return self.children[0].status
