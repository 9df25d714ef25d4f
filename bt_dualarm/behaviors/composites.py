"""Composites: node types whose children follow each other, or depend on a choice or a condition."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Mapping
from typing import Annotated, ClassVar, Final, Literal, Self, TypeAlias, cast

from py_trees import composites
from py_trees.behaviour import Behaviour
from py_trees.common import Status
from pydantic import Field

from bt_dualarm.behaviors.node import (
    Became,
    BoundPorts,
    Children,
    ChildSwap,
    MemoryPorts,
    NodeParts,
    ReportingNode,
    halt_running,
    reset,
)
from bt_dualarm.core.errors import Failure
from bt_dualarm.spec.cell import AWAIT, MEET
from bt_dualarm.spec.node_types import (
    FAILURE,
    ONLY_IF,
    SKIP_IF,
    SUCCESS,
    UNTIL,
    ChildOutcomes,
    LanguageNode,
    NodeSpec,
    NoPorts,
    Outcomes,
    PortModel,
    Slot,
    always,
    counted,
    one_line,
    port,
)
from bt_dualarm.spec.problems import Problem

Ticks: TypeAlias = Generator[Behaviour, None, Status]
"""Yields the nodes that are ticked, as py_trees expects, and returns the new status."""


def _in_order(
    name: str,
    summary: str,
    example: str,
    synonyms: Mapping[str, str],
    *,
    advances_on: bool,
    is_reactive: bool = False,
) -> LanguageNode:
    """Node type whose children follow each other: after a success (``advances_on``) or failure.

    Args:
        name: Name in the file.
        summary: One-line description.
        example: A node in YAML.
        synonyms: Names in other libraries.
        advances_on: Result of a child that leads to the next.
        is_reactive: Whether it never has a memory, instead of by its port.
    """

    def outcomes(_: NodeSpec, children: ChildOutcomes) -> Outcomes:
        through = True
        stopped = False
        for child in children:
            passes, stops = (child.succeeds, child.fails)[:: 1 if advances_on else -1]
            stopped |= through and stops
            through &= passes
        return Outcomes(through, stopped) if advances_on else Outcomes(stopped, through)

    return LanguageNode(
        name,
        summary,
        NoPorts if is_reactive else MemoryPorts,
        many=True,
        fixed=frozenset() if is_reactive else frozenset({"memory"}),
        example=example,
        outcomes=outcomes,
        advances_on=advances_on,
        revisits=lambda node: is_reactive or node.ports.get("memory") is False,
        runs_all=lambda node: (
            advances_on and not is_reactive and node.ports.get("memory", True) is True
        ),
        synonyms=synonyms,
    )


class Sequence(ChildSwap, composites.Sequence):
    """py_trees' sequence."""

    node_type = _in_order(
        "sequence",
        "Runs its children in sequence until one fails",
        "sequence: [{wait: 1}, {log: a second is over}]",
        {"SequenceWithMemory": ""},
        advances_on=True,
    )

    @classmethod
    def of(cls, parts: NodeParts) -> Self:
        """Returns a sequence with or without memory, according to its ports."""
        return cls(parts.name, _memory(parts), parts.children)


class Selector(ChildSwap, composites.Selector):
    """py_trees' selector; a new start also resets the children."""

    node_type = _in_order(
        "selector",
        "Runs its children in sequence until one succeeds",
        "selector: [{compare: {value: 1, to: 2}}, {log: they differ}]",
        {"Fallback": "", "FallbackWithMemory": ""},
        advances_on=False,
    )

    @classmethod
    def of(cls, parts: NodeParts) -> Self:
        """Returns a selector with or without memory, according to its ports."""
        return cls(parts.name, _memory(parts), parts.children)

    def initialise(self) -> None:
        """Reset the children, as py_trees' Sequence and Parallel do."""
        reset(self.children)


class ReactiveSequence(Sequence):
    """py_trees' sequence without memory, which ticks as BehaviorTree.CPP's ReactiveSequence."""

    node_type = _in_order(
        "reactive_sequence",
        "Ticks its children in sequence, the earlier ones again at each tick, until one fails",
        "reactive_sequence: [{compare: {value: 1, to: 1}}, {wait: 1}]",
        {},
        advances_on=True,
        is_reactive=True,
    )

    @classmethod
    def of(cls, parts: NodeParts) -> Self:
        """Returns a sequence without memory."""
        return cls(parts.name, False, parts.children)

    def swap_ports(self, ports: BoundPorts) -> bool:  # noqa: ARG002 - it has none
        """Continue: it has no ports."""
        return True


class ReactiveFallback(Selector):
    """py_trees' selector without memory, which ticks as BehaviorTree.CPP's ReactiveFallback."""

    node_type = _in_order(
        "reactive_fallback",
        "Ticks its children in sequence, the earlier ones again at each tick, until one succeeds",
        "reactive_fallback: [{compare: {value: 1, to: 2}}, {wait: 1}]",
        {"ReactiveSelector": ""},
        advances_on=False,
        is_reactive=True,
    )

    @classmethod
    def of(cls, parts: NodeParts) -> Self:
        """Returns a selector without memory."""
        return cls(parts.name, False, parts.children)

    def swap_ports(self, ports: BoundPorts) -> bool:  # noqa: ARG002 - it has none
        """Continue: it has no ports."""
        return True


def _memory(parts: NodeParts) -> bool:
    return cast("MemoryPorts", parts.ports.now()).memory


class Node(ReportingNode, composites.Composite):
    """Base of the node types with children that py_trees does not have, or has differently.

    Args:
        parts: Name, children and ports.

    Attributes:
        ports: Ports with the blackboard's values of the last start.
        restarts_children: Whether a new start sets the children back, too.
    """

    restarts_children: ClassVar[bool] = True
    ports: PortModel

    def __init__(self, parts: NodeParts) -> None:
        super().__init__(parts.name, parts.children)
        self._bound = parts.ports

    @classmethod
    def of(cls, parts: NodeParts) -> Self:
        """Returns a node of this class."""
        return cls(parts)

    def tick(self) -> Iterator[Behaviour]:
        """Tick the children that are due, and take the status that follows from theirs."""
        try:
            if self.status is not Status.RUNNING:
                self.code = self.reason = ""
                if self.restarts_children:
                    reset(self.children)
                self.ports = self._bound.now()
                self.initialise()
            new_status = yield from self.tick_children()
        except Failure as failure:
            self.code = failure.code
            self.reason = one_line(failure.reason)
            new_status = Status.FAILURE
        if new_status is Status.RUNNING:
            self.status = new_status
        else:
            halt_running(self.children)
            self.stop(new_status)
        yield self

    def swap_ports(self, ports: BoundPorts) -> bool:
        """Take other ports; a running node starts counting, or waiting, again."""
        self._bound = ports
        if self.status is Status.RUNNING:
            try:
                self.ports = ports.now()
                self.initialise()
            except Failure:
                return False
        return True

    def tick_children(self) -> Ticks:
        """Tick children and return the new status.

        Raises:
            Failure: The node fails, with this code and reason.
        """
        raise NotImplementedError


def _parallel_outcomes(node: NodeSpec, children: ChildOutcomes) -> Outcomes:
    policy = node.ports.get("policy", "all")
    needed: int = {"all": len(children), "any": 1}.get(policy) or policy
    succeed = sum(child.succeeds for child in children)
    fail = sum(child.fails for child in children)
    tolerated = len(children) - needed if node.ports.get("on_failure") == "continue" else 0
    return Outcomes(succeed >= needed, fail > tolerated)


def _too_many_needed(node: NodeSpec) -> Iterator[Problem]:
    policy = node.ports.get("policy")
    if isinstance(policy, int) and policy > len(node.children):
        message = f"{node.kind}: policy: {policy} of {len(node.children)} cannot succeed"
        hint = "all, any, or a number no larger than that of the children"
        yield node.port_problem(("policy",), message, hint)


def _only_child(node: NodeSpec, children: ChildOutcomes) -> str:
    return f"a {node.kind} of one child has no effect" if len(children) == 1 else ""


class Parallel(Node):
    """Ticks all children until enough have succeeded.

    Replaces py_trees' parallel, which has no "N of M" and fails with any child whatever its policy.
    """

    class Ports(PortModel):
        """Ports of parallel."""

        policy: Literal["all", "any"] | Annotated[int, Field(ge=1, le=1_000_000)] = port(
            "all", "Number of children that must succeed: all, any, or a number"
        )
        on_failure: Literal["fail", "continue"] = port(
            "fail", "Whether one failed child fails it, or only when too few can still succeed"
        )

    node_type = LanguageNode(
        "parallel",
        "Runs all children concurrently",
        Ports,
        many=True,
        fixed=frozenset({"policy", "on_failure"}),
        example="parallel: {policy: any, children: [{wait: 1}, {wait: 2}]}",
        outcomes=_parallel_outcomes,
        revisits=always,
        problems=_too_many_needed,
        no_effect=_only_child,
        synonyms={"ParallelAll": "policy: all"},
    )
    ports: Ports

    def tick_children(self) -> Ticks:
        """Tick the children that have not ended; none is started a second time."""
        for child in self.children:
            if child.status is Status.RUNNING or child.status is Status.INVALID:
                yield from child.tick()
        statuses = [child.status for child in self.children]
        succeeded = statuses.count(Status.SUCCESS)
        failed = statuses.count(Status.FAILURE)
        policy = self.ports.policy
        needed = {"all": len(statuses), "any": 1}[policy] if isinstance(policy, str) else policy
        if failed and self.ports.on_failure != "continue":
            child = next(child for child in self.children if child.status is Status.FAILURE)
            raise Failure("CHILD_FAILED", f"'{child.name}' failed")
        if succeeded >= needed:
            return Status.SUCCESS
        if len(statuses) - failed < needed:
            raise Failure("TOO_MANY_FAILED", f"{failed} of {len(statuses)} failed, {needed} needed")
        return Status.RUNNING


def _switch_outcomes(node: NodeSpec, children: ChildOutcomes) -> Outcomes:
    fails = "default" not in node.slots or any(child.fails for child in children)
    return Outcomes(any(child.succeeds for child in children), fails)


class Switch(Node):
    """Runs the child whose case equals the value at the start."""

    class Ports(PortModel):
        """Ports of switch."""

        value: str | int | bool = port(..., "Value to compare with the names of the cases")

    node_type = LanguageNode(
        "switch",
        "Runs the child whose case equals a value",
        Ports,
        cases=True,
        slots=(Slot("default", required=False),),
        example="switch: {value: red, cases: {red: {log: stop}, green: {log: go}}, default: fail}",
        outcomes=_switch_outcomes,
        synonyms={"Switch2": "", "Switch3": ""},
    )
    ports: Ports

    def __init__(self, parts: NodeParts) -> None:
        super().__init__(parts)
        self._by_case = dict(zip(parts.slots, self.children, strict=True))
        self._chosen: Behaviour | None = None

    def initialise(self) -> None:
        """Choose the child whose case equals the value.

        Raises:
            Failure: ``NO_CASE``: no case equals it, and there is no default.
        """
        value = self.ports.value
        case = str(value).lower() if isinstance(value, bool) else str(value)
        self._chosen = self._by_case.get(case, self._by_case.get("default"))
        if self._chosen is None:
            raise Failure("NO_CASE", f"no case for '{case}' and no default")

    def swap_children(self, children: Children, slots: tuple[str, ...], became: Became) -> bool:
        """Continue with the chosen child; False if it is gone."""
        super().swap_children(children, slots, became)
        self._by_case = dict(zip(slots, self.children, strict=True))
        self._chosen = became.get(self._chosen) if self._chosen else None
        return self._chosen is not None or self.status is not Status.RUNNING

    def tick_children(self) -> Ticks:
        """Tick the chosen child."""
        assert self._chosen is not None  # noqa: S101 - `initialise` has chosen or failed
        yield from self._chosen.tick()
        return self._chosen.status


def _if_outcomes(_: NodeSpec, children: ChildOutcomes) -> Outcomes:
    condition, then, *other = children
    reached = [then] * condition.succeeds + (other or [SUCCESS]) * condition.fails
    return Outcomes(any(child.succeeds for child in reached), any(child.fails for child in reached))


class If(Node):
    """Evaluates a condition once, then runs one child or the other; without "else", succeeds."""

    node_type = LanguageNode(
        "if",
        "Runs one of two children, by a condition evaluated once at the start",
        slots=(
            Slot("condition"),
            Slot("then", after=True),
            Slot("else", required=False, after=False),
        ),
        example="if: {condition: {compare: {value: 1, to: 2}}, then: succeed, else: fail}",
        outcomes=_if_outcomes,
    )
    _chosen: Behaviour | None = None
    has_default: ClassVar[bool] = True

    def initialise(self) -> None:
        """Evaluate the condition again."""
        self._chosen = None

    def swap_children(self, children: Children, slots: tuple[str, ...], became: Became) -> bool:
        """Continue with the chosen child; evaluate the condition again if it is gone."""
        super().swap_children(children, slots, became)
        self._chosen = became.get(self._chosen) if self._chosen else None
        return True

    def tick_children(self) -> Ticks:
        """Tick the condition until it ends, then the child that follows from its result."""
        condition, *branches = self.children
        if self._chosen is None:
            yield from condition.tick()
            if condition.status is Status.RUNNING:
                return Status.RUNNING
            chosen = branches[0:1] if condition.status is Status.SUCCESS else branches[1:2]
            if not chosen and not self.has_default:
                raise Failure("FALSE", f"'{condition.name}' failed, and there is no other child")
            if not chosen:
                return Status.SUCCESS
            self._chosen = chosen[0]
        yield from self._chosen.tick()
        return self._chosen.status


def _if_then_else_outcomes(_: NodeSpec, children: ChildOutcomes) -> Outcomes:
    condition, *branches = children[:3]
    then = branches[0] if branches else FAILURE
    other = branches[1] if len(branches) > 1 else FAILURE
    reached = [then] * condition.succeeds + [other] * condition.fails
    return Outcomes(any(child.succeeds for child in reached), any(child.fails for child in reached))


def _two_or_three(node: NodeSpec) -> Iterator[Problem]:
    if node.children and len(node.children) not in (2, 3):
        message = f"{node.kind}: has {counted(len(node.children), 'child')}, not 2 or 3"
        yield node.problem(message.replace("childs", "children"), "[condition, then, else]")


class IfThenElse(If):
    """BehaviorTree.CPP's node of that name: without a third child, it fails where `if` succeeds."""

    node_type = LanguageNode(
        "if_then_else",
        "Runs its second child if the first succeeds, otherwise the third; without one, it fails",
        many=True,
        example="if_then_else: [{compare: {value: 1, to: 2}}, succeed, {log: they differ}]",
        outcomes=_if_then_else_outcomes,
        problems=_two_or_three,
    )
    has_default = False


_CONDITION_AND_CHILD: Final = (Slot("condition"), Slot("child", after=True))


def _while_outcomes(_: NodeSpec, children: ChildOutcomes) -> Outcomes:
    condition, child = children
    return Outcomes(condition.fails, condition.succeeds and child.fails)


class While(Node):
    """Evaluates a condition before each start of its child; succeeds once the condition fails."""

    node_type = LanguageNode(
        "while",
        "Repeats its child as long as a condition holds",
        slots=_CONDITION_AND_CHILD,
        example="while: {condition: {compare: {value: 1, to: 2}}, child: {wait: 1}}",
        outcomes=_while_outcomes,
        revisits=always,
        repeats=always,
    )

    def tick_children(self) -> Ticks:
        """Start the child at most once per tick, so that an endless loop cannot block."""
        condition, child = self.children
        if child.status is not Status.RUNNING:
            yield from condition.tick()
            if condition.status is Status.FAILURE:
                return Status.SUCCESS
            if condition.status is Status.RUNNING:
                return Status.RUNNING
        yield from child.tick()
        return Status.FAILURE if child.status is Status.FAILURE else Status.RUNNING


class _Precondition(Node):
    """Base of nodes that evaluate a condition once, before their child starts."""

    _decided = False

    def initialise(self) -> None:
        """Evaluate the condition again."""
        self._decided = False

    def tick_children(self) -> Ticks:
        """Tick the condition until it ends, then the child unless the condition forbids it."""
        condition, child = self.children
        if not self._decided:
            yield from condition.tick()
            if condition.status is Status.RUNNING:
                return Status.RUNNING
            if self.skips(holds=condition.status is Status.SUCCESS):
                return Status.SUCCESS
            self._decided = True
        yield from child.tick()
        return child.status

    def skips(self, *, holds: bool) -> bool:
        """Returns whether the node succeeds without its child.

        Raises:
            Failure: The node fails without its child.
        """
        raise NotImplementedError


def _only_if_outcomes(_: NodeSpec, children: ChildOutcomes) -> Outcomes:
    condition, child = children
    return Outcomes(condition.succeeds and child.succeeds, condition.fails or child.fails)


class OnlyIf(_Precondition):
    """Fails without starting its child if a condition does not hold."""

    node_type = LanguageNode(
        ONLY_IF,
        "Fails without starting its child unless a condition holds",
        slots=_CONDITION_AND_CHILD,
        example="only_if: {condition: {compare: {value: 1, to: 1}}, child: {wait: 1}}",
        outcomes=_only_if_outcomes,
    )

    def skips(self, *, holds: bool) -> bool:
        """Returns False.

        Raises:
            Failure: ``PRECONDITION``: the condition does not hold.
        """
        if not holds:
            raise Failure("PRECONDITION", f"'{self.children[0].name}' does not hold")
        return False


def _skip_if_outcomes(_: NodeSpec, children: ChildOutcomes) -> Outcomes:
    condition, child = children
    return Outcomes(condition.succeeds or child.succeeds, condition.fails and child.fails)


class SkipIf(_Precondition):
    """Succeeds without starting its child if a condition holds."""

    node_type = LanguageNode(
        SKIP_IF,
        "Succeeds without starting its child if a condition holds",
        slots=(Slot("condition"), Slot("child", after=False)),
        example="skip_if: {condition: {compare: {value: 1, to: 2}}, child: {wait: 1}}",
        outcomes=_skip_if_outcomes,
    )

    def skips(self, *, holds: bool) -> bool:
        """Returns whether the condition holds."""
        return holds


def _until_outcomes(_: NodeSpec, children: ChildOutcomes) -> Outcomes:
    condition, child = children
    return Outcomes(condition.succeeds, child.fails or (child.succeeds and condition.fails))


_WAITING: Final = frozenset({AWAIT, MEET})
"""Leaves that run until something has happened, instead of telling whether it has."""


def _waits_first(node: NodeSpec, _: ChildOutcomes) -> str:
    condition = next(iter(node.children), None)
    if condition is None or condition.kind not in _WAITING:
        return ""
    return (
        f"unreachable: the child does not start while '{condition.name}' waits; "
        "to run both, write a parallel with policy: any"
    )


class Until(Node):
    """Evaluates a condition before each tick of its child; halts it and succeeds once that holds.

    If the child succeeds first, the condition must hold at that moment: a postcondition.
    """

    node_type = LanguageNode(
        UNTIL,
        "Halts its child and succeeds once a condition holds; fails if the child ends without it",
        slots=(Slot("condition"), Slot("child", after=False)),
        example="until: {condition: {compare: {value: 1, to: 1}}, child: {wait: 5}}",
        outcomes=_until_outcomes,
        revisits=always,
        no_effect=_waits_first,
    )

    def tick_children(self) -> Ticks:
        """Tick the condition, then the child, and after its success the condition once more."""
        condition, child = self.children
        yield from condition.tick()
        if condition.status is Status.SUCCESS:
            return Status.SUCCESS
        if child.status is Status.SUCCESS:
            return self._after_the_child()
        if condition.status is Status.RUNNING and child.status is not Status.RUNNING:
            return Status.RUNNING
        yield from child.tick()
        if child.status is Status.RUNNING or child.status is Status.FAILURE:
            return child.status
        if condition.status is not Status.RUNNING:
            yield from condition.tick()
        return self._after_the_child()

    def _after_the_child(self) -> Status:
        """Returns the result after the child's success.

        Raises:
            Failure: ``POSTCONDITION``: the condition does not hold.
        """
        condition, child = self.children
        if condition.status is Status.FAILURE:
            reason = f"'{child.name}' has ended, and '{condition.name}' does not hold"
            raise Failure("POSTCONDITION", reason)
        return condition.status


def _guard_outcomes(_: NodeSpec, children: ChildOutcomes) -> Outcomes:
    condition, child = children
    return Outcomes(condition.succeeds and child.succeeds, condition.fails or child.fails)


class Guard(Node):
    """Evaluates a condition before each tick of its child; halts it and fails once that fails.

    While the condition is running, the child is not started, but continues if it already runs.
    py_trees' EternalGuard takes a Python function, which YAML must not name.
    """

    node_type = LanguageNode(
        "guard",
        "Halts its child and fails once a condition no longer holds",
        slots=_CONDITION_AND_CHILD,
        example="guard: {condition: {compare: {value: 1, to: 1}}, child: {wait: 5}}",
        outcomes=_guard_outcomes,
        revisits=always,
        synonyms={"EternalGuard": ""},
    )

    def tick_children(self) -> Ticks:
        """Tick the condition, then the child."""
        condition, child = self.children
        yield from condition.tick()
        if condition.status is Status.FAILURE:
            raise Failure("GUARD", f"'{condition.name}' no longer holds")
        if condition.status is Status.RUNNING and child.status is not Status.RUNNING:
            return Status.RUNNING
        yield from child.tick()
        return child.status
