"""Problems in files: location, message, hint; and names with suggestions for misspelled ones."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, Final, Literal, TypeAlias, TypeVar

from pydantic import StringConstraints

from bt_dualarm.core.errors import DualArmError, NameUnknownError

Severity: TypeAlias = Literal["error", "warning"]

_WIDEST_EXCERPT = 100


@dataclass(frozen=True, order=True)
class Location:
    """A range in one line of a file; line and column count from 1, as in editors.

    Attributes:
        file: Path as the user wrote it.
        line: Line number; 0 for the whole file.
        column: Number of the first character.
        width: Number of characters to underline, at least 1.
        text: Text of the line, for the excerpt.
        rank: Number in the order of a tree that was given as Python data, which has no lines.
        keys: Path in such a tree: ``arms.arm1.tree.sequence[0]``.
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
        """The line with this range underlined, empty for the whole file."""
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
    """An error or a warning of the check.

    Attributes:
        place: Location in the file.
        message: Sentence that states the problem, with what was given.
        hint: What was expected, or the nearest valid name; may be empty.
        severity: ``error`` or ``warning``; only errors keep a file from running.
    """

    place: Location
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
        """Returns the problem as JSON-ready data."""
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
    """A file cannot be used; carries all of its problems in the file's order."""

    def __init__(self, problems: Iterable[Problem]) -> None:
        self.problems: tuple[Problem, ...] = in_order(problems)
        super().__init__("\n".join(str(problem) for problem in self.problems))


def in_order(problems: Iterable[Problem]) -> tuple[Problem, ...]:
    """Returns problems sorted by location, each once, as a subtree may be used several times."""
    return tuple(sorted(set(problems)))


def errors(problems: Iterable[Problem]) -> tuple[Problem, ...]:
    """Returns the problems that keep a file from running."""
    return tuple(problem for problem in problems if problem.severity == "error")


def nearest(given: str, valid: Iterable[str]) -> str | None:
    """Returns the most similar valid name regardless of case, None if none is similar enough."""
    return _nearest(given[:64].lower(), tuple(sorted(valid, reverse=True)))


@lru_cache(maxsize=4096)
def _nearest(given: str, valid: tuple[str, ...]) -> str | None:
    names = {name.lower(): name for name in valid}
    close = difflib.get_close_matches(given, sorted(names), n=1, cutoff=0.6)
    return names[close[0]] if close else None


def suggestion(given: object, valid: Iterable[str], noun: str) -> str:
    """Returns a hint for an unknown name: the nearest valid name, otherwise all of them."""
    names: Sequence[str] = sorted(valid)
    meant = meant_by(str(given), names)
    if meant:
        return f"here it is '{meant}'"
    if str(given).lower() in _FIXED:
        return _FIXED[str(given).lower()]
    close = nearest(str(given), names)
    if close:
        return f"did you mean '{close}'?"
    return f"available: {', '.join(names)}" if names else f"no {noun} is available"


_FIXED: Final[Mapping[str, str]] = {
    "gravity": "it is always 9.81 m/s² downward: turn the `base` of an arm instead",
}
"""What other formats let one choose, and what holds here."""

_SYNONYMS: Final[Mapping[str, str]] = {
    "pos": "xyz pose", "position": "xyz pose", "translation": "xyz",
    "x": "xyz", "y": "xyz", "z": "xyz",
    "orientation": "rpy", "rotation": "rpy", "euler": "rpy", "roll": "rpy", "pitch": "rpy",
    "yaw": "rpy", "quaternion": "quat",
    "count": "times", "attempts": "times", "num_attempts": "times", "num_cycles": "times",
    "n": "times", "duration": "seconds", "time": "seconds", "sec": "seconds", "msec": "seconds",
    "dimensions": "size", "dims": "size", "type": "shape", "weight": "mass", "colour": "color",
    "model": "robot", "tool": "gripper", "hand": "gripper", "end_effector": "gripper",
    "target": "to at", "goal": "to at", "destination": "to at", "pose": "to at",
    "velocity": "speed", "vel": "speed", "file": "scene",
    "body": "child", "node": "child", "do": "child then", "elif": "else", "else_if": "else",
    "if": "condition", "cond": "condition",
    "frame": "in_frame", "frame_id": "in_frame", "relative_to": "in_frame", "parent": "in_frame",
    "reference": "in_frame", "over": "above", "onto": "on", "on_top_of": "on", "next_to": "beside",
    "object": "color",
    "message": "reason", "text": "message reason",
    ">": "greater", ">=": "greater_or_equal", "<": "less", "<=": "less_or_equal",
    "==": "equal", "=": "equal", "!=": "not_equal",
    "cube": "box", "cuboid": "box", "ball": "sphere", "plate": "tray", "pipe": "tube",
    "mug": "cup", "franka": "panda", "kinova": "jaco2",
    "grey": "gray", "none": "ideal", "real": "lab",
    "float": "number", "double": "number", "int": "integer", "bool": "boolean", "string": "text",
    "str": "text", "array": "vector",
    "static": "fixed", "revolute": "hinge", "continuous": "hinge", "prismatic": "slide",
    "speed": "velocity limits", "limit": "range", "limits": "range",
    "as": "item", "var": "item", "variable": "item", "in": "items", "list": "items",
}  # fmt: skip
"""Names and values of other libraries and formats, each with those that stand for it here."""


def meant_by(given: str, valid: Iterable[str]) -> str:
    """Returns the valid name that a name of other libraries stands for, or nothing."""
    names = frozenset(valid)
    return next((name for name in _SYNONYMS.get(given.lower(), "").split() if name in names), "")


NAME_PATTERN: Final = r"^[A-Za-z][A-Za-z0-9_-]{0,47}$"
"""Pattern of names in a tree file; they become part of MuJoCo's names (``arm1/wrist``), file names
and paths of nodes."""

Name: TypeAlias = Annotated[str, StringConstraints(pattern=NAME_PATTERN)]
BodyName: TypeAlias = Annotated[
    str, StringConstraints(pattern=f"{NAME_PATTERN[:-1]}([.]{NAME_PATTERN[1:-1]})?$")
]
"""Name of an object, or of what moves on a joint of it: ``OBJECT.JOINT``."""


def is_name(text: str) -> bool:
    """Returns whether a text is a valid name in a tree file."""
    return re.fullmatch(NAME_PATTERN[1:-1], text) is not None


def written_as(value: object) -> str:
    """Returns the discriminator of a field that takes a name or a value: ``name`` or ``value``."""
    return "name" if isinstance(value, str) else "value"


T = TypeVar("T")


class Named(Mapping[str, T]):
    """An immutable mapping that suggests the nearest name for an unknown one.

    Args:
        noun: Noun for the items.
        items: Items by name, in the order of iteration.
    """

    def __init__(self, noun: str, items: Mapping[str, T]) -> None:
        self._noun = noun
        self._items = dict(items)

    def __getitem__(self, name: str) -> T:
        try:
            return self._items[name]
        except KeyError:
            hint = suggestion(str(name), self._items, self._noun)
            raise NameUnknownError(f"there is no {self._noun} '{name}'; {hint}") from None

    def __iter__(self) -> Iterator[str]:
        return iter(self._items)

    def __len__(self) -> int:
        return len(self._items)

    def __repr__(self) -> str:
        return repr(self._items)
