"""The leaves that belong to the language. They are skills that leave the arm alone."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping
from typing import ClassVar, Final

from bt_dualarm.errors import Failure
from bt_dualarm.skill import Skill
from bt_dualarm.spec import word_ports
from bt_dualarm.spec.explain import describe
from bt_dualarm.spec.kind import NoPorts
from bt_dualarm.spec.ports import PortModel
from bt_dualarm.spec.source import Data
from bt_dualarm.tree.time import reached


class Wait(Skill):
    """Succeeds after a time."""

    Ports = word_ports.Seconds
    ports: word_ports.Seconds

    def run(self) -> Iterator[None]:
        """Until the time is over."""
        began = self.time
        while not reached(self.time, began + self.ports.seconds):
            self.progress = (self.time - began) / self.ports.seconds
            yield


class Set(Skill):
    """Writes a key of the blackboard."""

    Ports = word_ports.Set
    Outputs: ClassVar[type[PortModel]] = word_ports.SetOutputs
    ports: word_ports.Set

    def run(self) -> Iterator[None]:
        """At once."""
        self.output("value", self.ports.value)
        yield from ()


class Compare(Skill):
    """Succeeds if a comparison holds."""

    Ports = word_ports.Compare
    ports: word_ports.Compare

    def run(self) -> Iterator[None]:
        """At once."""
        value, relation, to = self.ports.value, self.ports.relation, self.ports.to
        if relation in _ORDER and not (_is_number(value) and _is_number(to)):
            raise Failure(
                "NOT_COMPARABLE",
                f"{describe(value)} and {describe(to)} have no order, only numbers have",
            )
        if relation == "near":
            holds = near(value, to, self.ports.tolerance)
        elif relation in _ORDER:
            holds = _ORDER[relation](value, to)
        else:
            holds = same(value, to) == (relation == "equal")
        if not holds:
            raise Failure("FALSE", f"{describe(value)} {_NOT[relation]} {describe(to)}")
        yield from ()


class Log(Skill):
    """Writes a line to the log."""

    Ports = word_ports.Log
    ports: word_ports.Log

    def run(self) -> Iterator[None]:
        """At once."""
        level = logging.getLevelNamesMapping()[self.ports.level.upper()]
        self.context.log.log(level, "%s", self.ports.message)
        yield from ()


class Fail(Skill):
    """Fails at once."""

    Ports = word_ports.Fail
    ports: word_ports.Fail

    def run(self) -> Iterator[None]:
        """At once."""
        yield from ()
        raise Failure(self.ports.code, self.ports.reason)


class Succeed(Skill):
    """Succeeds at once."""

    Ports = NoPorts

    def run(self) -> Iterator[None]:
        """At once."""
        yield from ()


WORDS: Final[Mapping[str, type[Skill]]] = {
    "wait": Wait,
    "set": Set,
    "compare": Compare,
    "log": Log,
    "fail": Fail,
    "succeed": Succeed,
}
"""The language's leaves by name."""

_NOT: Final[Mapping[str, str]] = {
    "equal": "does not equal",
    "not_equal": "equals",
    "less": "is not less than",
    "less_or_equal": "is greater than",
    "greater": "is not greater than",
    "greater_or_equal": "is less than",
    "near": "is not near",
}
_ORDER: Final[Mapping[str, Callable[[float, float], bool]]] = {
    "less": lambda a, b: a < b,
    "less_or_equal": lambda a, b: a <= b,
    "greater": lambda a, b: a > b,
    "greater_or_equal": lambda a, b: a >= b,
}


def same(a: Data, b: Data) -> bool:
    """Equality of YAML data; true is not 1, as it is in Python."""
    if isinstance(a, bool) or isinstance(b, bool):
        return a is b
    if isinstance(a, list) and isinstance(b, list):
        return len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    return bool(a == b)


def near(a: Data, b: Data, tolerance: float) -> bool:
    """Whether two numbers, or two lists of numbers item by item, differ by at most this."""
    if isinstance(a, list) and isinstance(b, list):
        return len(a) == len(b) and all(near(x, y, tolerance) for x, y in zip(a, b, strict=True))
    if not (_is_number(a) and _is_number(b)):
        raise Failure("NOT_COMPARABLE", f"{describe(a)} and {describe(b)} are not both numbers")
    return bool(abs(a - b) <= tolerance)


def _is_number(value: Data) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)
