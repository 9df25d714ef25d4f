"""The words of the tree language: every node that is not a skill, with its ports and places."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Annotated, Any, Final, Literal, TypeAlias

from pydantic import Field, WithJsonSchema

from bt_dualarm.spec.ports import KEY, PortModel, Template, WrittenKey, port
from bt_dualarm.spec.values import Duration


class NoPorts(PortModel):
    """Nothing to set."""


@dataclass(frozen=True)
class Slot:
    """A place for one child, by name."""

    name: str
    required: bool = True


@dataclass(frozen=True)
class Kind:
    """What may be written for one kind of node, a word of the language or a skill.

    Attributes:
        name: As in the file.
        summary: One line for people.
        ports: Inputs.
        outputs: Values that it writes to the blackboard where the file names a key.
        slots: Places for one child each.
        many: Whether it takes a list of children.
        cases: Whether it takes a mapping of children, ``cases``.
        fixed: Ports that must be written out; no key of the blackboard can give them.
        shorthand: The port that a bare value stands for: ``wait: 2``.
        failures: Codes of its failures with their meaning.
        example: YAML of one node.
        origin: Where it comes from: a file for skills.
    """

    name: str
    summary: str
    ports: type[PortModel] = NoPorts
    outputs: type[PortModel] = NoPorts
    slots: tuple[Slot, ...] = ()
    many: bool = False
    cases: bool = False
    fixed: frozenset[str] = frozenset()
    shorthand: str = ""
    failures: Mapping[str, str] = field(default_factory=dict)
    example: str = ""
    origin: str = "the language"

    @property
    def is_leaf(self) -> bool:
        """Whether it has no children."""
        return not (self.slots or self.many or self.cases)

    @property
    def places(self) -> frozenset[str]:
        """What may stand beside the ports: the name, outputs and the places of children."""
        lists = ["children"] * self.many + ["cases"] * self.cases
        slots = (slot.name for slot in self.slots)
        return frozenset({"name", *lists, *slots, *self.outputs.model_fields})


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

    hz: float = port(..., "Ticks of the child per simulated second at most", unit="Hz", gt=0.0)


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


_MEMORY: Final = frozenset({"memory"})
_CHILD: Final = (Slot("child"),)
_CONDITIONED: Final = (Slot("condition"), Slot("child"))

_KINDS: Final = (
    Kind("sequence", "Children one after the other until one fails", Memory,
         many=True, fixed=_MEMORY),
    Kind("selector", "Children one after the other until one succeeds", Memory,
         many=True, fixed=_MEMORY),
    Kind("parallel", "All children at once", Parallel, many=True,
         fixed=frozenset({"policy", "on_failure"})),
    Kind("switch", "The child whose case equals a value", Switch, cases=True,
         slots=(Slot("default", required=False),)),
    Kind("if", "One child or the other, as a condition says once at the start",
         slots=(Slot("condition"), Slot("then"), Slot("else", required=False))),
    Kind("while", "Repeats its child as long as the condition holds", slots=_CONDITIONED),
    Kind("retry", "Starts its child again when it fails", Retry, slots=_CHILD),
    Kind("repeat", "Starts its child again when it succeeds", Repeat, slots=_CHILD),
    Kind("timeout", "Fails and halts its child after a time", Seconds, slots=_CHILD),
    Kind("delay", "Waits before its child starts", Seconds, slots=_CHILD),
    Kind("rate", "Ticks its child less often", Rate, slots=_CHILD),
    Kind("inverter", "Success for failure and failure for success", slots=_CHILD),
    Kind("force_success", "Success, however its child ends", slots=_CHILD),
    Kind("force_failure", "Failure, however its child ends", slots=_CHILD),
    Kind("run_once", "Runs its child to an end once, then repeats that result", slots=_CHILD),
    Kind("guard", "Halts its child and fails once a condition no longer holds",
         slots=_CONDITIONED),
    Kind("on_halt", "Runs a clean-up when its child is halted",
         slots=(Slot("child"), Slot("cleanup"))),
    Kind("subtree", "A subtree by name, with values for its parameters", Subtree),
    Kind("wait", "Succeeds after a time", Seconds, shorthand="seconds"),
    Kind("set", "Writes a key of the blackboard", Set),
    Kind("compare", "Succeeds if a comparison holds", Compare),
    Kind("log", "Writes a line to the log", Log, shorthand="message"),
    Kind("fail", "Fails at once", Fail, shorthand="reason"),
    Kind("succeed", "Succeeds at once"),
)  # fmt: skip

LANGUAGE: Final[Mapping[str, Kind]] = MappingProxyType({kind.name: kind for kind in _KINDS})
"""Every word of the language by name."""
