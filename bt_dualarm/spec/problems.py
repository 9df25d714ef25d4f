"""What is wrong with a file: where, what, what was expected, and how that is shown to a person."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, TypeAlias

from bt_dualarm.errors import DualArmError

Severity: TypeAlias = Literal["error", "warning"]

_WIDEST_EXCERPT = 100


@dataclass(frozen=True, order=True)
class Place:
    """A stretch of one line of a file; line and column count from 1, as editors do.

    Attributes:
        file: Path as the user wrote it.
        line: Number of the line; 0 where the whole file is meant.
        column: Number of the first character.
        width: Characters to underline, at least 1.
        text: The line itself, for the excerpt.
        rank: Number in the order of a tree that was given as Python data, which has no lines.
        keys: Keys that lead to the place in such a tree: ``arms.arm1.tree.sequence[0]``.
    """

    file: str
    line: int = 0
    column: int = 0
    width: int = 1
    text: str = ""
    rank: int = 0
    keys: str = ""

    def __str__(self) -> str:
        if self.keys:
            return f"{self.file} at {self.keys}"
        return f"{self.file}:{self.line}:{self.column}" if self.line else self.file

    @property
    def excerpt(self) -> str:
        """The line with this stretch underlined, empty where the whole file is meant."""
        if not self.line:
            return ""
        first = max(0, min(self.column - 1, self.column - 1 + self.width - _WIDEST_EXCERPT))
        shown = self.text[first : first + _WIDEST_EXCERPT]
        shown = "".join(c if c.isprintable() else " " for c in shown)
        start = self.column - 1 - first
        marks = "^" * max(1, min(self.width, len(shown) - start))
        return f"{self.line:5d} | {shown}\n      | {' ' * start}{marks}"


@dataclass(frozen=True, order=True)
class Problem:
    """One finding of the check.

    Attributes:
        place: Place in the file.
        message: Sentence that says what is wrong, naming what was given.
        hint: Words for what was expected, or the nearest valid name; may be empty.
        severity: Weight; only errors keep a file from running.
    """

    place: Place
    message: str
    hint: str = ""
    severity: Severity = "error"

    def __str__(self) -> str:
        lines = [f"{self.place}: {self.severity}: {self.message}"]
        if self.place.line:
            lines.append(self.place.excerpt)
        if self.hint:
            lines.append(f"      = {self.hint}")
        return "\n".join(lines)

    def as_dict(self) -> dict[str, str | int]:
        """For tools: JSON-ready."""
        return {
            "file": self.place.file,
            "line": self.place.line,
            "column": self.place.column,
            "width": self.place.width,
            "keys": self.place.keys,
            "severity": self.severity,
            "message": self.message,
            "hint": self.hint,
        }


class SpecError(DualArmError):
    """A file cannot be used. Carries everything that is wrong with it, in the file's order."""

    def __init__(self, problems: Iterable[Problem]) -> None:
        self.problems: tuple[Problem, ...] = in_order(problems)
        super().__init__("\n".join(str(problem) for problem in self.problems))


def in_order(problems: Iterable[Problem]) -> tuple[Problem, ...]:
    """Sorted by place, each once: a subtree used twice reports its mistake once."""
    return tuple(sorted(set(problems)))


def errors(problems: Iterable[Problem]) -> tuple[Problem, ...]:
    """Those that keep a file from running."""
    return tuple(problem for problem in problems if problem.severity == "error")


def nearest(given: str, valid: Iterable[str]) -> str | None:
    """The valid name that a person most likely meant, if one is near enough, case aside."""
    return _nearest(given[:64].lower(), tuple(sorted(valid, reverse=True)))


@lru_cache(maxsize=4096)
def _nearest(given: str, valid: tuple[str, ...]) -> str | None:
    names = {name.lower(): name for name in valid}
    close = difflib.get_close_matches(given, sorted(names), n=1, cutoff=0.6)
    return names[close[0]] if close else None


def suggestion(given: str, valid: Iterable[str], noun: str) -> str:
    """A hint for an unknown name: the nearest valid one, else all of them."""
    names: Sequence[str] = sorted(valid)
    close = nearest(given, names)
    if close:
        return f"did you mean '{close}'?"
    return f"known here: {', '.join(names)}" if names else f"no {noun} is known here"
