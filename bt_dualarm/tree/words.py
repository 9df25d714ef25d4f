"""The leaves that belong to the language. They are skills that leave the arm alone."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping
from typing import ClassVar, Final

from bt_dualarm.errors import Failure
from bt_dualarm.skill.skill import Skill
from bt_dualarm.spec import leaf_words
from bt_dualarm.spec.ports import PortModel
from bt_dualarm.spec.source import Data
from bt_dualarm.spec.word import Word
from bt_dualarm.spec.wording import in_words, one_line
from bt_dualarm.tree.time import reached


class WordSkill(Skill):
    """Base of the language's leaves.

    Attributes:
        word: Word of the language that a class runs; `build` finds the class by it.
    """

    word: ClassVar[Word]

    def __init_subclass__(cls) -> None:
        cls.Ports = cls.word.ports

    @classmethod
    def declares(cls, code: str) -> bool:  # noqa: ARG003 - the file may say any
        """Any code: what a word says is up to the file."""
        return True


class Wait(WordSkill):
    """Succeeds after a time."""

    word = leaf_words.WAIT
    ports: leaf_words.Wait

    def run(self) -> Iterator[None]:
        """Until the time is over."""
        began = self.time
        while not reached(self.time, began + self.ports.seconds):
            self.progress = (self.time - began) / self.ports.seconds
            yield


class Set(WordSkill):
    """Writes a key of the blackboard."""

    word = leaf_words.SET
    Outputs: ClassVar[type[PortModel]] = leaf_words.Set
    ports: leaf_words.Set

    def run(self) -> Iterator[None]:
        """At once."""
        self.output("value", self.ports.value)
        yield from ()


class Compare(WordSkill):
    """Succeeds if a comparison holds."""

    word = leaf_words.COMPARE
    ports: leaf_words.Compare

    def run(self) -> Iterator[None]:
        """At once."""
        value, relation, to = self.ports.value, self.ports.relation, self.ports.to
        if relation in _ORDER and not (_is_number(value) and _is_number(to)):
            raise Failure(
                "NOT_COMPARABLE",
                f"{in_words(value)} and {in_words(to)} have no order, only numbers have",
            )
        if relation == "near":
            holds = near(value, to, self.ports.tolerance)
        elif relation in _ORDER:
            holds = _ORDER[relation](value, to)
        else:
            holds = same(value, to) == (relation == "equal")
        if not holds:
            raise Failure("FALSE", f"{in_words(value)} {_NOT[relation]} {in_words(to)}")
        yield from ()


class Log(WordSkill):
    """Writes a line to the log."""

    word = leaf_words.LOG
    ports: leaf_words.Log

    def run(self) -> Iterator[None]:
        """At once."""
        level = logging.getLevelNamesMapping()[self.ports.level.upper()]
        self.context.log.log(level, "%s", one_line(self.ports.message))
        yield from ()


class Fail(WordSkill):
    """Fails at once."""

    word = leaf_words.FAIL
    ports: leaf_words.Fail

    def run(self) -> Iterator[None]:
        """At once."""
        yield from ()
        raise Failure(self.ports.code, self.ports.reason)


class Succeed(WordSkill):
    """Succeeds at once."""

    word = leaf_words.SUCCEED

    def run(self) -> Iterator[None]:
        """At once."""
        yield from ()


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
        raise Failure("NOT_COMPARABLE", f"{in_words(a)} and {in_words(b)} are not both numbers")
    return bool(abs(a - b) <= tolerance)


def _is_number(value: Data) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)
