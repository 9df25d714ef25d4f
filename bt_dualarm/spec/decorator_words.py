"""Words with one child: what may be written for each, and the rules that follow from it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Final, Literal, TypeAlias

from pydantic import Field

from bt_dualarm.spec.ends import FAILURE, SUCCESS, Ends, as_child
from bt_dualarm.spec.kind import Slot
from bt_dualarm.spec.node import NodeSpec
from bt_dualarm.spec.ports import PortModel, port
from bt_dualarm.spec.source import Data
from bt_dualarm.spec.values import Duration
from bt_dualarm.spec.word import Pointless, Word

_CHILD: Final = (Slot("child"),)
_Count: TypeAlias = Annotated[int, Field(ge=1, le=1_000_000)]


def _waits_for(verb: Literal["fail", "succeed"]) -> Pointless:
    """The rule of a node that does something when its child fails, or when it succeeds."""

    def why(node: NodeSpec, ends: Sequence[Ends]) -> str:
        if node.ports.get("times") == 1:
            return f"{node.kind} with times: 1 does nothing"
        if ends[0].fails if verb == "fail" else ends[0].succeeds:
            return ""
        return f"{node.kind} does nothing: '{node.children[0].name}' cannot {verb}"

    return why


def _always(_: NodeSpec) -> bool:
    return True


class Retry(PortModel):
    """Ports of retry."""

    times: _Count = port(..., "Attempts in all")
    delay: Duration = port(0.0, "Pause between two attempts", le=3600.0)


RETRY: Final = Word(
    "retry",
    "Starts its child again when it fails",
    Retry,
    slots=_CHILD,
    example="retry: {times: 3, delay: 0.5, child: {compare: {value: 1, to: 2}}}",
    ends=as_child,
    revisits=_always,
    pointless=_waits_for("fail"),
    synonyms={"RetryUntilSuccessful": "times"},
)


class Repeat(PortModel):
    """Ports of repeat."""

    times: _Count | Literal["forever"] = port(..., "Successes in a row, or forever")


def _repeat_ends(node: NodeSpec, ends: Sequence[Ends]) -> Ends:
    forever = node.ports.get("times") == "forever"
    return Ends(ends[0].succeeds and not forever, ends[0].fails)


REPEAT: Final = Word(
    "repeat",
    "Starts its child again when it succeeds",
    Repeat,
    slots=_CHILD,
    example="repeat: {times: 3, child: {wait: 1}}",
    ends=_repeat_ends,
    revisits=_always,
    pointless=_waits_for("succeed"),
    synonyms={"KeepRunningUntilFailure": "times: forever"},
)


class Seconds(PortModel):
    """Ports of timeout and delay."""

    seconds: Duration = port(..., "Simulated time", gt=0.0)


def _timeout_ends(_: NodeSpec, ends: Sequence[Ends]) -> Ends:
    return Ends(ends[0].succeeds, True)


TIMEOUT: Final = Word(
    "timeout",
    "Halts its child and fails after a time",
    Seconds,
    slots=_CHILD,
    example="timeout: {seconds: 5, child: {wait: 1}}",
    ends=_timeout_ends,
)
DELAY: Final = Word(
    "delay",
    "Waits before its child starts",
    Seconds,
    slots=_CHILD,
    example="delay: {seconds: 500 ms, child: {log: now}}",
    ends=as_child,
)


class Rate(PortModel):
    """Ports of rate."""

    hz: float = port(
        ..., "Ticks of the child per simulated second at most", unit="Hz", ge=0.001, le=1000
    )


RATE: Final = Word(
    "rate",
    "Ticks its child less often",
    Rate,
    slots=_CHILD,
    example="rate: {hz: 2, child: {wait: 5}}",
    ends=as_child,
)


def _inverter_ends(_: NodeSpec, ends: Sequence[Ends]) -> Ends:
    return Ends(ends[0].fails, ends[0].succeeds)


def _twice(node: NodeSpec, _: Sequence[Ends]) -> str:
    twice = bool(node.children) and node.children[0].kind == node.kind
    return f"two {node.kind}s, one in the other, do nothing" if twice else ""


INVERTER: Final = Word(
    "inverter",
    "Success for failure and failure for success",
    slots=_CHILD,
    example="inverter: {child: {compare: {value: 1, to: 2}}}",
    ends=_inverter_ends,
    pointless=_twice,
)


def _force(name: str, summary: str, child: str, end: Ends, synonym: str) -> Word:
    """A word that ends in one way once its child ends in either."""
    return Word(
        name,
        summary,
        slots=_CHILD,
        example=f"{name}: {{child: {{{child}}}}}",
        ends=lambda _, ends: ends[0] if ends[0].never else end,
        pointless=_waits_for("fail" if end is SUCCESS else "succeed"),
        synonyms={synonym: ""},
    )


FORCE_SUCCESS: Final = _force(
    "force_success",
    "Success, however its child ends",
    "compare: {value: 1, to: 2}",
    SUCCESS,
    "FailureIsSuccess",
)
FORCE_FAILURE: Final = _force(
    "force_failure",
    "Failure, however its child ends",
    "log: on to the next branch",
    FAILURE,
    "SuccessIsFailure",
)
RUN_ONCE: Final = Word(
    "run_once",
    "Runs its child to an end once, then repeats that result",
    slots=_CHILD,
    example="run_once: {child: {log: said only once}}",
    ends=as_child,
    synonyms={"OneShot": ""},
)
ON_HALT: Final = Word(
    "on_halt",
    "Ticks a clean-up once when its child is halted",
    slots=(Slot("child"), Slot("cleanup")),
    example="on_halt: {child: {wait: 5}, cleanup: {log: interrupted}}",
    ends=as_child,
)


class Subtree(PortModel):
    """Ports of subtree."""

    use: str = port(..., "Name of a subtree of this file or of one that it includes")
    params: dict[str, Data] = port({}, "Values of the subtree's parameters")


SUBTREE: Final = Word(
    "subtree",
    "A subtree by name, with values for its parameters",
    Subtree,
    uses="use",
    example="subtree: {use: pause, params: {time: 2}}",
    ends=as_child,
)
