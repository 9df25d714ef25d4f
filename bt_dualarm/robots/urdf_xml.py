"""Strict XML reader for URDF and SRDF files, with errors at their line and column.

Python's own parsers lose lines and columns, expand entities, and let the LookupError and ValueError
of unknown encodings escape. `AttributeReader` collects all problems of a file instead of stopping
at the first.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NoReturn
from xml.parsers import expat

from bt_dualarm.core.errors import CatalogError
from bt_dualarm.core.pose import Pose
from bt_dualarm.spec.node_types import counted
from bt_dualarm.spec.problems import Location, Problem, in_order, nearest

MAX_BYTES: Final = 8 * 1024 * 1024
MAX_DEPTH: Final = 64
MAX_ELEMENTS: Final = 200_000
MAX_PROBLEMS: Final = 100


class DescriptionError(CatalogError):
    """A file of a robot or gripper cannot be used; carries its problems, in the file's order."""

    def __init__(self, problems: Sequence[Problem]) -> None:
        self.problems = in_order(problems)
        shown = [str(problem) for problem in self.problems[:MAX_PROBLEMS]]
        left = len(self.problems) - len(shown)
        super().__init__(
            "\n".join([*shown, f"and {counted(left, 'more problem')}"] if left else shown)
        )


@dataclass(frozen=True, eq=False)
class Document:
    """The text of a file, to which elements and error messages refer.

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
        """This element and all its descendants, in the file's order."""
        pending = [self]
        while pending:
            element = pending.pop()
            yield element
            pending += reversed(element.children)

    def place(self, attribute: str | None = None) -> Location:
        """Location of the element's start, or of the value of one of its attributes."""
        if attribute in self.attributes:
            found = self._value_place(str(attribute))
            if found is not None:
                return found
        text = self.document.lines[self.line - 1]
        return Location(self.document.file, self.line, self.column, len(self.tag) + 1, text)

    def problem(self, message: str, hint: str = "", attribute: str | None = None) -> Problem:
        """An error at the element, or at the value of one of its attributes."""
        return Problem(self.place(attribute), message, hint)

    def _value_place(self, attribute: str) -> Location | None:
        value = re.compile(rf"(?:^|\s){re.escape(attribute)}\s*=\s*([\"'])(.*?)(\1|$)")
        lines = self.document.lines
        for number in range(self.line, min(self.line + 50, len(lines) + 1)):
            skipped = self.column if number == self.line else 0
            match = value.search(lines[number - 1], skipped)
            if match is not None:
                width = max(1, len(match[2]))
                return Location(
                    self.document.file, number, match.start(2) + 1, width, lines[number - 1]
                )
        return None


def read_xml(path: Path) -> Element:
    """Read one file; returns its top element.

    Raises:
        DescriptionError: Not a readable file within the size limits, not XML, or with a DOCTYPE.
    """
    return parse_xml(_text(path), str(path))


def parse_xml(text: str, file: str) -> Element:
    """Read the text of one file; returns its top element.

    Args:
        text: Text.
        file: Path of the file, for messages.

    Raises:
        DescriptionError: Not XML, too large, or with a DOCTYPE.
    """
    # Normalize line ends to what expat counts as lines.
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    return _Reader(Document(file, text.split("\n"))).read(text)


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
    raise DescriptionError([Problem(Location(str(path)), message, hint)])


class _Reader:
    """Builds elements from expat's events."""

    def __init__(self, document: Document) -> None:
        self.document = document
        # The text was decoded from UTF-8, whatever encoding its XML declaration claims.
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
            del self._expat  # breaks the reference cycle through the handlers
        assert self._top is not None  # noqa: S101  # expat refuses a text without an element
        return self._top

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        line = self._expat.CurrentLineNumber
        column = self._expat.CurrentColumnNumber
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

    def _at(self, line: int, column: int) -> Location:
        text = self.document.lines[line - 1] if line <= len(self.document.lines) else ""
        return Location(self.document.file, line, column + 1, 1, text)

    def _unclosed(self) -> str:
        """Hint about the innermost element that is still open."""
        if not self._open:
            return ""
        last = self._open[-1]
        return f"<{last.tag}> began on line {last.line}"


# Attributes


_NUMBER: Final = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?(?:inf|nan)\w*", re.I)
_LONGEST_NAME: Final = 128
_GIMBAL_LOCK: Final = 1e-9  # cosine of the pitch below which roll and yaw are indistinguishable


@dataclass(frozen=True)
class Range:
    """Valid range of a number, both ends included.

    Attributes:
        unit: Unit of the number, for messages.
        above: Whether the lower end itself is excluded.
    """

    least: float
    most: float
    unit: str = ""
    above: bool = False

    def __str__(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        if self.above:
            return f"greater than {self.least:g}{unit} and at most {self.most:g}{unit}"
        return f"from {self.least:g} to {self.most:g}{unit}"

    def holds(self, number: float) -> bool:
        """Whether the number is in the range; false for NaN."""
        return self.least < number <= self.most if self.above else self.least <= number <= self.most

    def conversion(self, number: float) -> str:
        """Hint that a number outside the range may be in another unit; empty if that is no help."""
        other, factor = _OTHER_UNITS.get(self.unit, ("", math.nan))
        if not self.holds(number * factor):
            return ""
        return f"in {self.unit}: {number * factor:.4g}, if {number:g} {other} are meant"


_OTHER_UNITS: Final[Mapping[str, tuple[str, float]]] = {
    "m": ("mm", 1e-3),
    "rad": ("degrees", math.radians(1.0)),
    "rad/s": ("degrees/s", math.radians(1.0)),
    "kg": ("g", 1e-3),
}
"""Unit that is often taken for the right one, and its size."""

LENGTH: Final = Range(-10.0, 10.0, "m")
"""Positions in a robot: beyond them, they are in millimeters."""

ANGLE: Final = Range(-4.0 * math.pi, 4.0 * math.pi, "rad")
"""Orientations in a robot: beyond them, they are in degrees."""


@dataclass(frozen=True)
class Origin:
    """Pose of a frame in its parent, as in URDF: meters, and roll, pitch, yaw in radians."""

    xyz: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @classmethod
    def of(cls, pose: Pose) -> Origin:
        """Convert a pose to angles about fixed axes; yaw is 0 at a pitch of ±90°."""
        turn = pose.rotation_matrix
        pitch = math.atan2(-turn[2, 0], math.hypot(turn[0, 0], turn[1, 0]))
        if math.hypot(turn[0, 0], turn[1, 0]) > _GIMBAL_LOCK:
            roll = math.atan2(turn[2, 1], turn[2, 2])
            yaw = math.atan2(turn[1, 0], turn[0, 0])
        else:
            roll = math.atan2(-turn[1, 2], turn[1, 1])
            yaw = 0.0
        x, y, z = (float(part) for part in pose.position)
        return cls((x, y, z), (roll, pitch, yaw))

    @property
    def pose(self) -> Pose:
        """The origin as a transform."""
        return Pose.from_rpy(self.xyz, self.rpy)


class AttributeReader:
    """Reads attributes and collects problems; after a problem it returns a harmless value.

    Attributes:
        problems: Problems so far.
    """

    def __init__(self) -> None:
        self.problems: list[Problem] = []

    def add(
        self, element: Element, message: str, hint: str = "", attribute: str | None = None
    ) -> None:
        """Add a problem at an element, or at one of its attributes."""
        self.problems.append(element.problem(message, hint, attribute))

    def number(
        self, element: Element, attribute: str, within: Range, default: float | None = None
    ) -> float:
        """A number; if it is missing the default, or a problem if there is none."""
        text = element.attributes.get(attribute)
        if text is None:
            return self._missing(element, attribute) if default is None else default
        found = self._numbers(element, attribute, text, 1, within)
        return found[0] if found else 0.0

    def vector(
        self,
        element: Element,
        attribute: str,
        within: Range,
        default: tuple[float, float, float] | None = None,
    ) -> tuple[float, float, float]:
        """Three numbers of an attribute."""
        text = element.attributes.get(attribute)
        if text is None:
            if default is None:
                self._missing(element, attribute)
            return default or (0.0, 0.0, 0.0)
        found = self._numbers(element, attribute, text, 3, within)
        return (found[0], found[1], found[2]) if found else default or (0.0, 0.0, 0.0)

    def name(self, element: Element, attribute: str = "name") -> str:
        """A name that is valid in a world with other arms; empty after a problem."""
        name = element.attributes.get(attribute)
        if name is None:
            self._missing(element, attribute)
            return ""
        wrong = (
            "is empty" if not name.strip() else
            f"is longer than {_LONGEST_NAME} characters" if len(name) > _LONGEST_NAME else
            "holds a slash" if "/" in name else
            "contains a character that cannot be printed" if not name.isprintable() else ""
        )  # fmt: skip
        if wrong:
            hint = "a slash separates the names of an arm and its links" if "slash" in wrong else ""
            self.add(element, f"<{element.tag}> {attribute} {wrong}", hint, attribute)
        return "" if wrong else name

    def origin(self, element: Element) -> Origin:
        """The ``<origin>`` of an element; without one, the identity."""
        found = element.find("origin")
        if found is None:
            return Origin()
        zero = (0.0, 0.0, 0.0)
        return Origin(
            self.vector(found, "xyz", LENGTH, zero), self.vector(found, "rpy", ANGLE, zero)
        )

    def _missing(self, element: Element, attribute: str) -> float:
        near = nearest(attribute, element.attributes)
        hint = f"is '{near}' meant?" if near else ""
        self.add(element, f"<{element.tag}> lacks the attribute '{attribute}'", hint)
        return 0.0

    def _numbers(
        self, element: Element, attribute: str, text: str, count: int, within: Range
    ) -> tuple[float, ...]:
        """``count`` numbers; an empty tuple after a problem."""
        words = text.split()
        what = f"<{element.tag}> {attribute}"
        wrong = next((word for word in words if not _NUMBER.fullmatch(word)), None)
        if wrong is not None or len(words) != count:
            expected = "a number" if count == 1 else f"{count} numbers"
            given = repr(text[:40]) if wrong is not None else f"{len(words)}"
            self.add(
                element, f"{what}: expected {expected}, not {given}", _advice(wrong), attribute
            )
            return ()
        numbers = tuple(float(word) for word in words)
        outside = next((number for number in numbers if not within.holds(number)), None)
        if outside is not None:
            hint = within.conversion(outside)
            self.add(element, f"{what}: must be {within}, not {outside:g}", hint, attribute)
            return ()
        return numbers


def _advice(word: str | None) -> str:
    if word and re.fullmatch(r"[+-]?\d+,\d+", word):
        return f"write {word.replace(',', '.')}: use a decimal point"
    if word and "${" in word:
        return "this is a template: run xacro on it first"
    return ""
