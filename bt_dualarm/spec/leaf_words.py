"""Words without children: what may be written for each, and the rules that follow from it."""

from __future__ import annotations

from typing import Annotated, Final, Literal, TypeAlias

from pydantic import Field, WithJsonSchema

from bt_dualarm.spec.ends import failure, success
from bt_dualarm.spec.ports import KEY, PortModel, Template, WrittenKey, port
from bt_dualarm.spec.source import Data
from bt_dualarm.spec.values import Duration
from bt_dualarm.spec.word import Word

_KeyOfValue: TypeAlias = Annotated[
    str, WrittenKey("value"), WithJsonSchema({"type": "string", "pattern": f"^{KEY.pattern}$"})
]
_Message: TypeAlias = Annotated[str, Field(max_length=500), Template()]


class Wait(PortModel):
    """Ports of wait."""

    seconds: Duration = port(..., "Simulated time", gt=0.0)


WAIT: Final = Word(
    "wait",
    "Succeeds after a time",
    Wait,
    shorthand="seconds",
    example="wait: 500 ms",
    ends=success,
    synonyms={"Sleep": "seconds", "Timer": "seconds"},
)


class Set(PortModel):
    """Ports of set."""

    key: _KeyOfValue = port(..., "Key of the blackboard to write")
    value: Data = port(..., "What to write: a value, or another key")


SET: Final = Word(
    "set",
    "Writes a key of the blackboard",
    Set,
    example="set: {key: height, value: 0.2}",
    ends=success,
    synonyms={"SetBlackboard": ""},
)


class Compare(PortModel):
    """Ports of compare."""

    value: Data = port(..., "Left side, usually a key")
    relation: Literal[
        "equal", "not_equal", "less", "less_or_equal", "greater", "greater_or_equal", "near"
    ] = port("equal", "The comparison")
    to: Data = port(..., "Right side")
    tolerance: float = port(1e-6, "Largest difference of two numbers that are near", ge=0.0, le=1e9)


COMPARE: Final = Word(
    "compare",
    "Succeeds if a comparison holds",
    Compare,
    example="compare: {value: 1, relation: less, to: 2}",
    synonyms={"ScriptCondition": ""},
)


class Log(PortModel):
    """Ports of log."""

    message: _Message = port(..., "Text; {key} in it is replaced by the key's value")
    level: Literal["info", "warning", "error"] = port("info", "How important it is")


LOG: Final = Word(
    "log",
    "Writes a line to the log",
    Log,
    shorthand="message",
    example="log: the cube is there",
    ends=success,
)


class Fail(PortModel):
    """Ports of fail."""

    code: str = port("FAIL", "Code for programs", pattern="^[A-Z][A-Z0-9_]{0,31}$")
    reason: _Message = port("the tree says so", "Sentence for people")


FAIL: Final = Word(
    "fail",
    "Fails at once",
    Fail,
    shorthand="reason",
    example="fail: {code: NO_CUBE, reason: the table is empty}",
    ends=failure,
    synonyms={"AlwaysFailure": "", "Failure": ""},
)
SUCCEED: Final = Word(
    "succeed",
    "Succeeds at once",
    example="succeed",
    ends=success,
    synonyms={"AlwaysSuccess": "", "Success": ""},
)
