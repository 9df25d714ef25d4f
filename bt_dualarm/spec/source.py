"""YAML data together with the place in the file of every key and value."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

from bt_dualarm.spec.problems import Place, Problem

# Any: a recursive union would have to be narrowed at every step into a document.
Data: TypeAlias = Any
"""What YAML can say here: None, bool, int, float, str, lists, and mappings with text keys."""

Json: TypeAlias = dict[str, Any]
"""An object of JSON, as the schemas of pydantic are."""

Path: TypeAlias = tuple[str | int, ...]
"""Keys and indices from the top of the document down."""


@dataclass(frozen=True)
class Span:
    """A stretch of text; lines and columns count from 0, the end is exclusive."""

    line: int
    column: int
    end_line: int
    end_column: int


@dataclass
class Source:
    """One YAML file that was read.

    Attributes:
        file: Path as the user wrote it.
        lines: Lines of its text.
        data: Data that it says.
        values: Span of each value.
        keys: Span of the key of each value in a mapping.
        texts: Texts of files that it includes, by their paths, in place of those on the disk.
    """

    file: str
    lines: Sequence[str]
    data: Data = None
    values: dict[Path, Span] = field(default_factory=dict)
    keys: dict[Path, Span] = field(default_factory=dict)
    texts: Mapping[str, str] = field(default_factory=dict)

    @property
    def text(self) -> str:
        """What it says, as text that can be read again."""
        return "\n".join(self.lines)

    def get(self, path: Path) -> Data:
        """The value at ``path``, None where there is none."""
        data = self.data
        for part in path:
            if isinstance(part, int):
                data = data[part] if isinstance(data, list) and part < len(data) else None
            else:
                data = data.get(part) if isinstance(data, dict) else None
        return data

    def at(self, span: Span) -> Place:
        """The place of a span; of a span of several lines, its first line."""
        text = self.lines[span.line] if span.line < len(self.lines) else ""
        end = span.end_column if span.end_line == span.line else len(text.rstrip())
        width = max(1, end - span.column)
        return Place(self.file, span.line + 1, span.column + 1, width, text)

    def place(self, path: Path) -> Place:
        """Where the value at ``path`` stands, or the nearest one above it that is in the file."""
        for length in range(len(path), -1, -1):
            span = self.values.get(path[:length])
            if span is not None:
                return self.at(span)
        return Place(self.file)

    def key_place(self, path: Path) -> Place:
        """Where the key that leads to ``path`` stands; the value's place for list items."""
        for length in range(len(path), 0, -1):
            span = self.keys.get(path[:length])
            if span is not None:
                return self.at(span)
            if path[:length] in self.values:
                break
        return self.place(path)

    def problem(self, path: Path, message: str, hint: str = "", *, key: bool = False) -> Problem:
        """An error at the value of ``path``, or at its key."""
        place = self.key_place(path) if key else self.place(path)
        return Problem(place, message, hint)


def with_tuples(data: Data) -> Data:
    """The same data with every list as a tuple: what strict models of frozen values expect."""
    if isinstance(data, dict):
        return {key: with_tuples(value) for key, value in data.items()}
    if isinstance(data, list):
        return tuple(with_tuples(item) for item in data)
    return data
