"""Strict XML: text in, elements that know their place out, or the reason why not.

Python's own readers forget lines and columns, expand entities, and let LookupError and ValueError
of unknown encodings escape.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NoReturn
from xml.parsers import expat  # entities are refused before they are read

from bt_dualarm.errors import CatalogueError
from bt_dualarm.spec.problems import Place, Problem, in_order

MAX_BYTES: Final = 8 * 1024 * 1024
MAX_DEPTH: Final = 64
MAX_ELEMENTS: Final = 200_000
MAX_PROBLEMS: Final = 100


class DescriptionError(CatalogueError):
    """A file of a robot cannot be used. Carries everything that is wrong, in the file's order."""

    def __init__(self, problems: Sequence[Problem]) -> None:
        self.problems = in_order(problems)
        shown = [str(problem) for problem in self.problems[:MAX_PROBLEMS]]
        left = len(self.problems) - len(shown)
        super().__init__("\n".join([*shown, f"and {left} more problems"] if left else shown))


@dataclass(frozen=True, eq=False)
class Document:
    """The text that elements point into.

    Attributes:
        file: Path as the user wrote it.
        lines: Text, line by line.
    """

    file: str
    lines: Sequence[str]


@dataclass(frozen=True, eq=False)
class Element:
    """One XML element.

    Attributes:
        tag: Name of the element.
        attributes: Text of each attribute by name.
        document: Text that holds the element.
        line: Line of its ``<``, counted from 1; likewise ``column``.
        children: Elements directly inside, in the file's order.
    """

    tag: str
    attributes: Mapping[str, str]
    document: Document
    line: int
    column: int
    children: list[Element] = field(default_factory=list)

    def find(self, tag: str) -> Element | None:
        """The first child of that tag."""
        return next(self.all(tag), None)

    def all(self, tag: str) -> Iterator[Element]:
        """The children of that tag."""
        return (child for child in self.children if child.tag == tag)

    def walk(self) -> Iterator[Element]:
        """This element and all below it, in the file's order."""
        waiting = [self]
        while waiting:
            element = waiting.pop()
            yield element
            waiting += reversed(element.children)

    def place(self, attribute: str | None = None) -> Place:
        """Where the element begins, or where the value of one of its attributes stands."""
        if attribute in self.attributes:
            found = self._value_place(str(attribute))
            if found is not None:
                return found
        text = self.document.lines[self.line - 1]
        return Place(self.document.file, self.line, self.column, len(self.tag) + 1, text)

    def problem(self, message: str, hint: str = "", attribute: str | None = None) -> Problem:
        """An error at the element, or at the value of one of its attributes."""
        return Problem(self.place(attribute), message, hint)

    def _value_place(self, attribute: str) -> Place | None:
        value = re.compile(rf"(?:^|\s){re.escape(attribute)}\s*=\s*([\"'])(.*?)(\1|$)")
        lines = self.document.lines
        for number in range(self.line, min(self.line + 50, len(lines) + 1)):
            skipped = self.column if number == self.line else 0
            match = value.search(lines[number - 1], skipped)
            if match is not None:
                width = max(1, len(match[2]))
                return Place(
                    self.document.file, number, match.start(2) + 1, width, lines[number - 1]
                )
        return None


def read_xml(path: Path) -> Element:
    """Read one file; returns its top element.

    Raises:
        DescriptionError: Not a readable text file within the caps, no XML, or one with entities.
    """
    text = _text(path)
    # Lines end as expat counts them.
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    return _Reader(Document(str(path), text.split("\n"))).read(text)


def _text(path: Path) -> str:
    try:
        if not path.is_file():
            _refuse(path, "is not a regular file" if path.exists() else "no such file")
        with path.open("rb") as file:
            raw = file.read(MAX_BYTES + 1)
    except OSError as error:
        _refuse(path, f"cannot be read: {error.strerror or error}")
    if len(raw) > MAX_BYTES:
        _refuse(path, f"is larger than {MAX_BYTES // 1024**2} MiB")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        message = f"is not UTF-8 text: byte {error.start} is 0x{raw[error.start]:02x}"
        _refuse(path, message, "save the file as UTF-8")


def _refuse(path: Path, message: str, hint: str = "") -> NoReturn:
    raise DescriptionError([Problem(Place(str(path)), message, hint)])


class _Reader:
    """Builds elements from expat's events."""

    def __init__(self, document: Document) -> None:
        self.document = document
        # Whatever encoding the file claims: it was UTF-8.
        self._expat = expat.ParserCreate("utf-8")
        self._expat.StartElementHandler = self._start
        self._expat.EndElementHandler = self._end
        self._expat.StartDoctypeDeclHandler = self._doctype
        self._open: list[Element] = []
        self._top: Element | None = None
        self._count = 0

    def read(self, text: str) -> Element:
        try:
            self._expat.Parse(text, True)
        except expat.ExpatError as error:
            place = self._at(error.lineno, error.offset)
            what = f"not XML: {expat.errors.messages[error.code]}"
            raise DescriptionError([Problem(place, what, self._unclosed())]) from error
        finally:
            del self._expat  # it refers to this reader
        assert self._top is not None  # noqa: S101  # expat refuses a text without an element
        return self._top

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        line, column = self._expat.CurrentLineNumber, self._expat.CurrentColumnNumber
        element = Element(tag, attributes, self.document, line, column + 1)
        self._count += 1
        if self._count > MAX_ELEMENTS:
            self._refuse(f"more than {MAX_ELEMENTS} elements in one file")
        if len(self._open) >= MAX_DEPTH:
            self._refuse(f"nested deeper than {MAX_DEPTH} levels")
        if self._open:
            self._open[-1].children.append(element)
        else:
            self._top = element
        self._open.append(element)

    def _end(self, _tag: str) -> None:
        self._open.pop()

    def _doctype(self, *_: object) -> None:
        self._refuse("a document type (<!DOCTYPE …>) is not allowed", "remove it: entities are not")

    def _refuse(self, message: str, hint: str = "") -> NoReturn:
        place = self._at(self._expat.CurrentLineNumber, self._expat.CurrentColumnNumber)
        raise DescriptionError([Problem(place, message, hint)])

    def _at(self, line: int, column: int) -> Place:
        text = self.document.lines[line - 1] if line <= len(self.document.lines) else ""
        return Place(self.document.file, line, column + 1, 1, text)

    def _unclosed(self) -> str:
        """The element that was being read when reading ended."""
        if not self._open:
            return ""
        last = self._open[-1]
        return f"<{last.tag}> began in line {last.line}"
