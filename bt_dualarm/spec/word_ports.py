"""The ports of the language's own words; what each word does stands in ``language``."""

from __future__ import annotations

from typing import Annotated, Any, Literal, TypeAlias

from pydantic import Field, WithJsonSchema

from bt_dualarm.spec.ports import KEY, PortModel, Template, WrittenKey, port
from bt_dualarm.spec.values import Duration

_KeyName: TypeAlias = Annotated[
    str, WrittenKey(), WithJsonSchema({"type": "string", "pattern": f"^{KEY.pattern}$"})
]
_Message: TypeAlias = Annotated[str, Field(max_length=500), Template()]
_Count: TypeAlias = Annotated[int, Field(ge=1, le=1_000_000)]


class Memory(PortModel):
    """Ports of sequence and selector."""

    memory: bool = port(
        True, "Whether a tick resumes at the running child; false asks those before it again"
    )


class Parallel(PortModel):
    """Ports of parallel."""

    policy: Literal["all", "any"] | _Count = port(
        "all", "How many children must succeed: all, any, or a number"
    )
    on_failure: Literal["fail", "continue"] = port(
        "fail", "Whether one failed child fails it, or only that enough can no longer succeed"
    )


class Switch(PortModel):
    """Ports of switch."""

    value: str | int | bool = port(..., "What to compare with the names of the cases")


class Retry(PortModel):
    """Ports of retry."""

    times: _Count = port(..., "Attempts in all")
    delay: Duration = port(0.0, "Pause between two attempts", le=3600.0)


class Repeat(PortModel):
    """Ports of repeat."""

    times: _Count | Literal["forever"] = port(..., "Successes in a row, or forever")


class Seconds(PortModel):
    """Ports of wait, timeout and delay."""

    seconds: Duration = port(..., "Simulated time", gt=0.0, le=86400.0)


class Rate(PortModel):
    """Ports of rate."""

    hz: float = port(
        ..., "Ticks of the child per simulated second at most", unit="Hz", gt=0, le=1000
    )


class Set(PortModel):
    """Ports of set."""

    key: _KeyName = port(..., "Key of the blackboard to write")
    value: Any = port(..., "What to write: a value, or another key")


class SetOutputs(PortModel):
    """What set writes."""

    value: Any = port(None, "The value")


class Compare(PortModel):
    """Ports of compare."""

    value: Any = port(..., "Left side, usually a key")
    relation: Literal[
        "equal", "not_equal", "less", "less_or_equal", "greater", "greater_or_equal", "near"
    ] = port("equal", "The comparison")
    to: Any = port(..., "Right side")
    tolerance: float = port(1e-6, "Largest difference of two numbers that are near", ge=0.0)


class Log(PortModel):
    """Ports of log."""

    message: _Message = port(..., "Text; {key} in it is replaced by the key's value")
    level: Literal["info", "warning", "error"] = port("info", "How important it is")


class Fail(PortModel):
    """Ports of fail."""

    code: str = port("FAIL", "Code for programs", pattern="^[A-Z][A-Z0-9_]{0,31}$")
    reason: _Message = port("the tree says so", "Sentence for people")


class Subtree(PortModel):
    """Ports of subtree."""

    use: str = port(..., "Name of a subtree of this file or of one that it includes")
    params: dict[str, Any] = port({}, "Values of the subtree's parameters")
