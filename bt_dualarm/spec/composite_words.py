"""Words with several children: what may be written for each, and the rules that follow from it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Final, Literal

from pydantic import Field

from bt_dualarm.spec.ends import SUCCESS, Ends, EndsRule
from bt_dualarm.spec.kind import Slot
from bt_dualarm.spec.node import NodeSpec
from bt_dualarm.spec.ports import PortModel, port
from bt_dualarm.spec.problems import Problem
from bt_dualarm.spec.word import Word


class Memory(PortModel):
    """Ports of sequence and selector."""

    memory: bool = port(
        True, "Whether a tick resumes at the running child; false asks those before it again"
    )


def _always(_: NodeSpec) -> bool:
    return True


def _in_turn(
    name: str, summary: str, example: str, synonyms: Mapping[str, str], *, goes_on: bool
) -> Word:
    """A word whose children follow each other: after a success (``goes_on``), or a failure."""

    def ends(_: NodeSpec, children: Sequence[Ends]) -> Ends:
        through, stopped = True, False
        for child in children:
            passes, stops = (child.succeeds, child.fails)[:: 1 if goes_on else -1]
            stopped |= through and stops
            through &= passes
        return Ends(through, stopped) if goes_on else Ends(stopped, through)

    return Word(
        name,
        summary,
        Memory,
        many=True,
        fixed=frozenset({"memory"}),
        example=example,
        ends=ends,
        goes_on=goes_on,
        revisits=lambda node: node.ports.get("memory") is False,
        synonyms=synonyms,
    )


SEQUENCE: Final = _in_turn(
    "sequence",
    "Children one after the other until one fails",
    "sequence: [{wait: 1}, {log: a second is over}]",
    {"ReactiveSequence": "memory: false", "SequenceWithMemory": ""},
    goes_on=True,
)
SELECTOR: Final = _in_turn(
    "selector",
    "Children one after the other until one succeeds",
    "selector: [{compare: {value: 1, to: 2}}, {log: they differ}]",
    {"Fallback": "", "ReactiveFallback": "memory: false"},
    goes_on=False,
)


class Parallel(PortModel):
    """Ports of parallel."""

    policy: Literal["all", "any"] | Annotated[int, Field(ge=1, le=1_000_000)] = port(
        "all", "How many children must succeed: all, any, or a number"
    )
    on_failure: Literal["fail", "continue"] = port(
        "fail", "Whether one failed child fails it, or only that enough can no longer succeed"
    )


def _parallel_ends(node: NodeSpec, ends: Sequence[Ends]) -> Ends:
    policy = node.ports.get("policy", "all")
    needed: int = {"all": len(ends), "any": 1}.get(policy) or policy
    succeed = sum(child.succeeds for child in ends)
    fail = sum(child.fails for child in ends)
    tolerated = len(ends) - needed if node.ports.get("on_failure") == "continue" else 0
    return Ends(succeed >= needed, fail > tolerated)


def _too_many_needed(node: NodeSpec) -> Iterator[Problem]:
    policy = node.ports.get("policy")
    if isinstance(policy, int) and policy > len(node.children):
        message = f"{node.kind}: policy: {policy} of {len(node.children)} cannot succeed"
        hint = "all, any, or at most as many as children"
        yield node.port_problem(("policy",), message, hint)


def _alone(node: NodeSpec, ends: Sequence[Ends]) -> str:
    return f"a {node.kind} of one child does nothing" if len(ends) == 1 else ""


PARALLEL: Final = Word(
    "parallel",
    "All children at once",
    Parallel,
    many=True,
    fixed=frozenset({"policy", "on_failure"}),
    example="parallel: {policy: any, children: [{wait: 1}, {wait: 2}]}",
    ends=_parallel_ends,
    revisits=_always,
    complaint=_too_many_needed,
    pointless=_alone,
    synonyms={"ParallelAll": "policy: all"},
)


class Switch(PortModel):
    """Ports of switch."""

    value: str | int | bool = port(..., "What to compare with the names of the cases")


def _switch_ends(node: NodeSpec, ends: Sequence[Ends]) -> Ends:
    fails = "default" not in node.slots or any(child.fails for child in ends)
    return Ends(any(child.succeeds for child in ends), fails)


SWITCH: Final = Word(
    "switch",
    "The child whose case equals a value",
    Switch,
    cases=True,
    slots=(Slot("default", required=False),),
    example="switch: {value: red, cases: {red: {log: stop}, green: {log: go}}, default: fail}",
    ends=_switch_ends,
    synonyms={"Switch2": "", "Switch3": ""},
)


def _if_ends(_: NodeSpec, ends: Sequence[Ends]) -> Ends:
    condition, then, *other = ends
    reached = [then] * condition.succeeds + (other or [SUCCESS]) * condition.fails
    return Ends(any(child.succeeds for child in reached), any(child.fails for child in reached))


IF: Final = Word(
    "if",
    "One child or the other, as a condition says once at the start",
    slots=(
        Slot("condition"),
        Slot("then", after=True),
        Slot("else", required=False, after=False),
    ),
    example="if: {condition: {compare: {value: 1, to: 2}}, then: succeed, else: fail}",
    ends=_if_ends,
    synonyms={"IfThenElse": ""},
)


def _conditioned(
    name: str, summary: str, example: str, ends: EndsRule, synonyms: Mapping[str, str]
) -> Word:
    """A word whose child depends on a condition that is asked again and again."""
    slots = (Slot("condition"), Slot("child", after=True))
    return Word(
        name,
        summary,
        slots=slots,
        example=example,
        ends=ends,
        revisits=_always,
        synonyms=synonyms,
    )


def _while_ends(_: NodeSpec, ends: Sequence[Ends]) -> Ends:
    condition, child = ends
    return Ends(condition.fails, condition.succeeds and child.fails)


def _guard_ends(_: NodeSpec, ends: Sequence[Ends]) -> Ends:
    condition, child = ends
    return Ends(condition.succeeds and child.succeeds, condition.fails or child.fails)


WHILE: Final = _conditioned(
    "while",
    "Starts its child again and again as long as a condition holds",
    "while: {condition: {compare: {value: 1, to: 2}}, child: {wait: 1}}",
    _while_ends,
    {},
)
GUARD: Final = _conditioned(
    "guard",
    "Halts its child and fails once a condition no longer holds",
    "guard: {condition: {compare: {value: 1, to: 1}}, child: {wait: 5}}",
    _guard_ends,
    {"EternalGuard": ""},
)
