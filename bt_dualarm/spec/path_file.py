"""Points of a plane path in a file next to the tree: CSV, or the first path of an SVG drawing.

Files may come from strangers: size and number of points are bounded, XML declares no entities, and
nothing outside the tree file's folder is read.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Annotated, Final, TypeAlias
from xml.parsers import expat

from pydantic import AfterValidator

from bt_dualarm.spec.node_types import NodeSpec, NodeType, counted, metadata_of, reference_of
from bt_dualarm.spec.problems import Problem
from bt_dualarm.spec.values import RelativePath, below_tree

Point: TypeAlias = tuple[float, float]

MOST_POINTS: Final = 2000
_MOST_BYTES: Final = 256 * 1024
_LARGEST: Final = 1e6
"""Largest coordinate, in the file's unit."""

_PIECES: Final = 16
"""Lines that stand for one Bézier curve."""


@dataclass(frozen=True)
class ReadsText:
    """Metadata of a port that names a text file, which is read with the tree."""


_below_tree = below_tree("a CSV or SVG file", ".csv", ".svg")


def _below(path: str) -> str:
    """The path without ``./`` and ``//``: as one of the names by which texts are known."""
    return PurePosixPath(_below_tree(path)).as_posix()


PathFile: TypeAlias = Annotated[RelativePath, AfterValidator(_below), ReadsText()]
"""Path of a CSV or SVG file, relative to the folder of the tree file."""


def texts_of(
    root: NodeSpec, skills: Mapping[str, NodeType], folder: Path, known: Mapping[str, str]
) -> Iterator[tuple[str, str] | Problem]:
    """Yields path and text of each file that the ports of a tree name, or the problem with it.

    Args:
        root: Root of the tree.
        skills: Node types of skills by name.
        folder: Folder of the tree file; nothing outside of it is read.
        known: Texts of files by path, used instead of those on the disk.
    """
    for node in root.walk():
        node_type = skills.get(node.kind)
        if node_type is None:
            continue
        for name, field in node_type.ports.model_fields.items():
            given = node.ports.get(name)
            if metadata_of(field, ReadsText) is None or given is None:
                continue
            if reference_of(given) is not None:
                message = f"{node.kind}: {name}: a file cannot come from the blackboard"
                yield node.port_problem((name,), message)
                continue
            try:
                _below(str(given))
            except ValueError:
                continue  # the check of the port reports it
            shown = folder / str(given)
            try:
                text = known.get(str(shown))
                text = _read(shown, folder) if text is None else text
                points_in(text, str(given))
            except ValueError as error:
                yield node.port_problem((name,), f"{node.kind}: {name}: {given}: {error}")
                continue
            yield str(shown), text


def _read(path: Path, folder: Path) -> str:
    """Text of a regular file below a folder.

    Raises:
        ValueError: There is none, or it cannot be read.
    """
    try:
        if not path.resolve().is_relative_to(folder.resolve()):
            raise ValueError(f"leads out of the folder {folder}")
        if not path.is_file():
            raise ValueError("there is no such file")
        with path.open("rb") as file:
            raw = file.read(_MOST_BYTES + 1)
        if len(raw) > _MOST_BYTES:
            raise ValueError(f"is larger than {_MOST_BYTES // 1024} KiB")
        return raw.decode("utf-8")
    except UnicodeDecodeError:
        raise ValueError("is not text in UTF-8") from None
    except (OSError, RuntimeError) as error:
        raise ValueError(f"cannot be read: {error}") from error


def points_in(text: str, name: str) -> list[Point]:
    """Points of a file, in its unit, y upward; no two in a row are equal.

    Args:
        text: Content of the file.
        name: Its name, which determines its format.

    Raises:
        ValueError: The content is invalid; the message has the line.
    """
    points = [*(_of_svg(text) if name.lower().endswith(".svg") else _of_csv(text))]
    for point in points:
        if not all(abs(number) <= _LARGEST for number in point):
            raise ValueError(f"a coordinate is not a number within {_LARGEST:g}: {point}")
    found = [point for n, point in enumerate(points) if n == 0 or point != points[n - 1]]
    if len(found) < 2:
        raise ValueError("has fewer than two different points")
    if len(found) > MOST_POINTS:
        raise ValueError(f"has more than {MOST_POINTS} points")
    return found


def _of_csv(text: str) -> Iterator[Point]:
    """Points of lines ``x, y``; a first line of names, empty lines and comments (#) are skipped."""
    begun = False
    for number, line in enumerate(text.splitlines(), 1):
        content = line.partition("#")[0].strip()
        if not content:
            continue
        cells = [cell for cell in re.split(r"[,;\s]+", content) if cell]
        try:
            x, y = (float(cell) for cell in cells)
        except ValueError:
            if not begun and not any(character.isdigit() for character in content):
                begun = True  # the names of the columns
                continue
            raise ValueError(f"line {number}: expected two numbers, not {content[:40]!r}") from None
        begun = True
        yield x, y


def _of_svg(text: str) -> list[Point]:
    """Points of the first ``path`` element; curves become short lines."""
    found: list[tuple[str, int]] = []
    parser = expat.ParserCreate("utf-8")

    def start(tag: str, attributes: dict[str, str]) -> None:
        line = parser.CurrentLineNumber
        if "transform" in attributes:
            raise ValueError(f"line {line}: transforms are not supported: apply them in the editor")
        if tag.rpartition(":")[2] == "path" and not found:
            found.append((attributes.get("d", ""), line))

    def doctype(*_: object) -> None:
        raise ValueError("declares a document type, which is not allowed")

    parser.StartElementHandler = start
    parser.StartDoctypeDeclHandler = doctype
    try:
        parser.Parse(text, True)
    except expat.ExpatError as error:
        reason = expat.errors.messages[error.code]
        raise ValueError(f"line {error.lineno}: not XML: {reason}") from None
    if not found:
        raise ValueError("has no path element")
    data, line = found[0]
    try:
        return [(x, -y) for x, y in _Pen(data).points()]
    except ValueError as error:
        raise ValueError(f"line {line}: {error}") from None


_TOKEN: Final = re.compile(r"\s*,?\s*(?:([A-Za-z])|([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?))")
_NUMBERS: Final = {"M": 2, "L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2, "Z": 0}
"""Numbers of each command (SVG 2, chapter Paths)."""


class _Pen:
    """Draws the path data of SVG.

    Args:
        data: The attribute ``d``.
    """

    def __init__(self, data: str) -> None:
        self._tokens = [*_tokens(data)]
        self._here: Point = (0.0, 0.0)
        self._handle: Point | None = None
        self._last = ""

    def points(self) -> list[Point]:
        """All points.

        Raises:
            ValueError: A command is unknown or incomplete, or there is a second subpath.
        """
        found: list[Point] = []
        at = 0
        command = ""
        while at < len(self._tokens):
            token = self._tokens[at]
            if isinstance(token, str):
                command = token
                at += 1
            elif not command or command in "Zz":
                raise ValueError("a number stands where a command is expected")
            count = _NUMBERS.get(command.upper())
            if count is None:
                raise ValueError(f"the command {command!r} is not supported: convert it to curves")
            numbers = self._tokens[at : at + count]
            at += count
            if len(numbers) < count or any(isinstance(one, str) for one in numbers):
                raise ValueError(f"the command {command!r} needs {counted(count, 'number')}")
            if command in "Mm" and found:
                raise ValueError("has a second subpath: one line without lifting the pen is needed")
            if not found and command not in "Mm":
                raise ValueError("does not begin with the command M")
            found += self._drawn(command, [float(one) for one in numbers], found)
            if len(found) > MOST_POINTS:
                raise ValueError(f"has more than {MOST_POINTS} points")
            if command in "Mm":  # further pairs of numbers are lines
                command = "L" if command == "M" else "l"
        return found

    def _drawn(self, command: str, numbers: list[float], before: Sequence[Point]) -> list[Point]:
        x, y = self._here
        kind = command.upper()
        if command.islower() and kind not in "HVZ":
            numbers = [one + (x, y)[n % 2] for n, one in enumerate(numbers)]
        ends = [*zip(numbers[::2], numbers[1::2], strict=False)]
        handle = None
        if kind == "Z":
            points = [before[0]]
        elif kind == "H":
            points = [(numbers[0] + (x if command == "h" else 0.0), y)]
        elif kind == "V":
            points = [(x, numbers[0] + (y if command == "v" else 0.0))]
        elif kind in "ML":
            points = ends
        else:
            mirrored = self._mirrored(kind)
            if kind in "CS":
                controls = ends if kind == "C" else [mirrored, *ends]
                handle = controls[1]
            else:
                handle = ends[0] if kind == "Q" else mirrored
                end = ends[-1]
                # A quadratic curve as a cubic one.
                controls = [
                    (x + 2 / 3 * (handle[0] - x), y + 2 / 3 * (handle[1] - y)),
                    (end[0] + 2 / 3 * (handle[0] - end[0]), end[1] + 2 / 3 * (handle[1] - end[1])),
                    end,
                ]
            points = [*_bezier((x, y), *controls)]
        self._here = points[-1]
        self._handle = handle
        self._last = kind
        return points

    def _mirrored(self, kind: str) -> Point:
        """Control point of a smooth curve: that of the curve before, mirrored."""
        same = "CS" if kind in "CS" else "QT"
        if self._handle is None or self._last not in same:
            return self._here
        return 2 * self._here[0] - self._handle[0], 2 * self._here[1] - self._handle[1]


def _tokens(data: str) -> Iterator[str | float]:
    at = 0
    data = data.rstrip()
    while at < len(data):
        match = _TOKEN.match(data, at)
        if match is None:
            raise ValueError(f"{data[at : at + 20].strip()!r} is neither a command nor a number")
        at = match.end()
        yield match[1] if match[1] else float(match[2])


def _bezier(start: Point, first: Point, second: Point, end: Point) -> Iterator[Point]:
    """Points of a cubic curve, without its start."""
    for step in range(1, _PIECES + 1):
        t = step / _PIECES
        u = 1.0 - t
        weights = (u**3, 3 * u * u * t, 3 * u * t * t, t**3)
        shares = [*zip(weights, (start, first, second, end), strict=True)]
        yield (
            math.fsum(weight * point[0] for weight, point in shares),
            math.fsum(weight * point[1] for weight, point in shares),
        )
