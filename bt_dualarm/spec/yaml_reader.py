"""Strict YAML: text or Python data as located values, or every problem; and edits of one value.

Stricter than ``yaml.safe_load``, which reads `no` as False, keeps the last of two equal keys,
expands merge keys without bound, and lets ValueError, KeyError and RecursionError escape. An edit
(`with_value`) changes one value in the text and leaves every other character as it is.
"""

from __future__ import annotations

import copy
import io
import itertools
import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePath
from typing import Any, Final, TypeAlias, cast

import numpy as np
import yaml

from bt_dualarm.spec.problems import Location, Problem, SpecError

# Any: a recursive union would have to be narrowed at every step into a document.
Data: TypeAlias = Any
"""YAML data: None, bool, int, float, str, lists, and mappings with text keys."""

Json: TypeAlias = dict[str, Any]
"""JSON object, such as a schema made by pydantic."""

DataPath: TypeAlias = tuple[str | int, ...]
"""Keys and indices from the top of the document down."""


@dataclass(frozen=True)
class Span:
    """Range of text; lines and columns count from 0, the end is exclusive."""

    line: int
    column: int
    end_line: int
    end_column: int


@dataclass
class Source:
    """A YAML file with the location of every key and value.

    Attributes:
        file: Path as the user wrote it.
        lines: Lines of its text.
        data: Its data.
        values: Span of each value.
        keys: Span of the key of each value in a mapping.
        texts: Texts of files that it includes, by path, used instead of those on the disk.
    """

    file: str
    lines: Sequence[str]
    data: Data = None
    values: dict[DataPath, Span] = field(default_factory=dict)
    keys: dict[DataPath, Span] = field(default_factory=dict)
    texts: Mapping[str, str] = field(default_factory=dict)

    @property
    def text(self) -> str:
        """Text of the file with normalized line ends."""
        return "\n".join(self.lines)

    def get(self, path: DataPath) -> Data:
        """Returns the value at ``path``, None if there is none."""
        data = self.data
        for part in path:
            if isinstance(part, int):
                data = data[part] if isinstance(data, list) and part < len(data) else None
            else:
                data = data.get(part) if isinstance(data, dict) else None
        return data

    def at(self, span: Span) -> Location:
        """Returns the location of a span; of a span of several lines, that of its first line."""
        text = self.lines[span.line] if span.line < len(self.lines) else ""
        end = span.end_column if span.end_line == span.line else len(text.rstrip())
        width = max(1, end - span.column)
        return Location(self.file, span.line + 1, span.column + 1, width, text)

    def location(self, path: DataPath) -> Location:
        """Returns the location of the value at ``path``, or of its nearest ancestor in the file."""
        for length in range(len(path), -1, -1):
            span = self.values.get(path[:length])
            if span is not None:
                return self.at(span)
        return Location(self.file)

    def key_location(self, path: DataPath) -> Location:
        """Returns the location of the key of the value at ``path``; of a list item, its own."""
        for length in range(len(path), 0, -1):
            span = self.keys.get(path[:length])
            if span is not None:
                return self.at(span)
            if path[:length] in self.values:
                break
        return self.location(path)

    def part_location(self, path: DataPath, start: int, end: int) -> Location:
        """Returns the location of some characters of the text at ``path``.

        A text that the file does not have letter by letter has the location of the whole text.
        """
        whole = self.location(path)
        while path and path not in self.values:
            path = path[:-1]  # a bare value stands for a port
        text = self.get(path)
        span = self.values.get(path)
        if span is None or span.line != span.end_line or not isinstance(text, str):
            return whole
        if span.line >= len(self.lines):  # YAML counts separators such as U+2028 as line breaks
            return whole
        written = self.lines[span.line][span.column : span.end_column]
        for quote in ("", "'", '"'):
            if written == f"{quote}{text}{quote}":
                column = whole.column + len(quote) + start
                return replace(whole, column=column, width=max(1, end - start))
        return whole

    def problem(
        self, path: DataPath, message: str, hint: str = "", *, key: bool = False
    ) -> Problem:
        """Returns an error at the value of ``path``, or at its key."""
        location = self.key_location(path) if key else self.location(path)
        return Problem(location, message, hint)


def with_tuples(data: Data) -> Data:
    """Returns the data with every list as a tuple, as strict models of frozen values expect."""
    if isinstance(data, dict):
        return {key: with_tuples(value) for key, value in data.items()}
    if isinstance(data, list):
        return tuple(with_tuples(item) for item in data)
    return data


# Plain scalars: each has the value that it looks like to every YAML reader, or is refused.

_INTEGER = re.compile(r"[-+]?(?:0|[1-9][0-9]*)")
_NUMBER = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?")
_CLOCK = re.compile(r"[-+]?[0-9]+(?::[0-5]?[0-9])+(?:\.[0-9]*)?")
_OTHER_BASE = re.compile(r"[-+]?0[xXoObB][0-9a-fA-F_]+")
_LEADING_ZERO = re.compile(r"[-+]?0[0-9]+")
_GROUPED = re.compile(r"[-+]?[0-9][0-9_]*_[0-9_.]*")
_NOT_FINITE = re.compile(r"[-+]?\.(?:inf|nan)", re.IGNORECASE)
LARGEST_INTEGER: Final = 2**53
"""Largest magnitude up to which a double, and so JSON, represents every integer exactly."""

_LONGEST_NUMBER = 40
_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")


class ScalarError(ValueError):
    """A scalar that YAML readers disagree on, or a number that is too large; carries a hint."""

    def __init__(self, message: str, hint: str) -> None:
        super().__init__(message)
        self.hint = hint


def control_character(text: str) -> str:
    """Returns the first control character of a text as ``U+001B``, empty if there is none.

    Line feed and tab are allowed. Marks of text direction count as control characters, because
    they make a text look like another one.
    """
    found = _CONTROL.search(text)
    return f"U+{ord(found[0]):04X}" if found else ""


def plain_value(text: str) -> bool | int | float | str | None:
    """Returns the value of an unquoted scalar.

    Raises:
        ScalarError: YAML readers disagree on it, or it is not a finite number of sensible size.
    """
    if text in ("", "~", "null", "Null", "NULL"):
        return None
    if text in ("true", "True", "TRUE"):
        return True
    if text in ("false", "False", "FALSE"):
        return False
    _refuse_ambiguous(text)
    if text[0] in "+-.0123456789":
        return _number_or_text(text)
    return text


def _refuse_ambiguous(text: str) -> None:
    quoted = f'"{text}"'
    if text.lower() in ("yes", "no", "on", "off"):
        meant = "true" if text.lower() in ("yes", "on") else "false"
        raise ScalarError(
            f"'{text}' is a truth value to some YAML readers and text to others",
            f"write {meant}, or {quoted} if text is meant",
        )
    if _CLOCK.fullmatch(text):
        raise ScalarError(
            f"'{text}' is {_sexagesimal(text)} to some YAML readers and text to others",
            f"write {_sexagesimal(text)} if a number is meant, or {quoted} if text is meant",
        )
    if _NOT_FINITE.fullmatch(text):
        raise ScalarError(f"'{text}' is not a finite number", f"or quote it as text: {quoted}")


def _number_or_text(text: str) -> int | float | str:
    quoted = f'"{text}"'
    if _INTEGER.fullmatch(text):
        if len(text) > _LONGEST_NUMBER or abs(int(text)) > LARGEST_INTEGER:
            raise ScalarError("this number is too large", f"at most {LARGEST_INTEGER} is allowed")
        return int(text)
    if _OTHER_BASE.fullmatch(text) or _GROUPED.fullmatch(text) or _LEADING_ZERO.fullmatch(text):
        raise ScalarError(
            f"'{text}' is a number in some notations only",
            f"write it in plain decimal digits, or {quoted} if text is meant",
        )
    if not _NUMBER.fullmatch(text):
        return text
    number = float(text)
    if not math.isfinite(number):
        raise ScalarError("this number is too large", "it has no finite value")
    return number


def _sexagesimal(text: str) -> str:
    """Returns the value of a number in base 60 in YAML 1.1: ``1:30`` is 90."""
    sign = -1.0 if text.startswith("-") else 1.0
    total = 0.0
    for part in text.lstrip("+-").split(":"):
        total = total * 60 + float(part)
    return f"{sign * total:g}"


# Files and texts.

MAX_BYTES: Final = 256 * 1024
MAX_DEPTH: Final = 64
MAX_NODES: Final = 10_000
MAX_PROBLEMS: Final = 100

# libyaml is 10 times faster; the reader in Python stands in where PyYAML was built without it.
_LOADER: Final[type[yaml.SafeLoader]] = getattr(yaml, "CSafeLoader", yaml.SafeLoader)

_TEXT_RULE: Final = "text may contain printable characters, line feeds and tabs"
_TAGGED: Final = (yaml.ScalarEvent, yaml.CollectionStartEvent)


def read_file(path: Path) -> Source:
    """Reads a YAML file.

    Raises:
        SpecError: Not a readable text file within the caps, or not the strict YAML of this module.
    """
    return read_text(text_of(path), str(path))


def text_of(path: Path) -> str:
    """Reads a text file.

    Raises:
        SpecError: Not a readable text file within the caps.
    """
    whole_file = Location(str(path))
    try:
        if not path.is_file():
            what = "is not a regular file" if path.exists() else "no such file"
            raise SpecError([Problem(whole_file, what)])
        with path.open("rb") as file:
            raw = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise SpecError([Problem(whole_file, f"cannot be read: {error}")]) from error
    if len(raw) > MAX_BYTES:
        raise SpecError([Problem(whole_file, f"is larger than {MAX_BYTES // 1024} KiB")])
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        message = f"is not UTF-8 text: byte {error.start} is 0x{raw[error.start]:02x}"
        raise SpecError([Problem(whole_file, message, "save the file as UTF-8")]) from error


def read_text(text: str, file: str = "<text>") -> Source:
    """Reads YAML text; ``file`` is its name in messages.

    Raises:
        SpecError: Not the strict YAML of this module.
    """
    # str.splitlines would also split at characters that are text in YAML.
    source = Source(file, text.replace("\r\n", "\n").replace("\r", "\n").split("\n"))
    reader = _Reader(source)
    try:
        reader.read(yaml.parse(text, Loader=_LOADER))
    except yaml.YAMLError as error:
        reader.problems.append(_syntax_problem(source, text, error))
    except _GiveUpError:
        pass
    if reader.problems:
        raise SpecError(reader.problems)
    return source


def _syntax_problem(source: Source, text: str, error: yaml.YAMLError) -> Problem:
    mark = getattr(error, "problem_mark", None)
    if mark is not None:
        what = " ".join(str(part) for part in (error.context, error.problem) if part)  # type: ignore[attr-defined]
        span = Span(mark.line, mark.column, mark.line, mark.column + 1)
        hint = _syntax_hint(what)
        began = getattr(error, "context_mark", None)
        if hint and began is not None and began.line != mark.line:
            hint = f"{hint}; it began on line {began.line + 1}"
        return Problem(source.at(span), f"not YAML: {what}", hint)
    position = getattr(error, "position", 0) or 0
    before = text[:position].split("\n")
    span = Span(len(before) - 1, len(before[-1]), len(before) - 1, len(before[-1]) + 1)
    return Problem(source.at(span), "not YAML: a character that YAML does not allow here")


def _syntax_hint(what: str) -> str:
    if "while scanning an alias" in what:
        return 'quote text that begins with *, and expressions: "{n} * 2"'
    if "mapping values are not allowed" in what:
        return "an extra colon, or a line indented differently from its neighbors"
    if "cannot start any token" in what:
        return "indent with spaces, not tabs; quote text that begins with @, ` or %"
    if "unexpected end of stream" in what:
        return "a quote is not closed"
    if "expected <block end>" in what or "did not find expected" in what:
        return "check the indentation, and look for an unclosed bracket or quote above"
    return ""


class _GiveUpError(Exception):
    """Reading stops: a cap was exceeded."""


class _Reader:
    """Builds data from the parser's events and records the span of every key and value."""

    def __init__(self, source: Source) -> None:
        self.source = source
        self.problems: list[Problem] = []
        self._nodes = 0

    def read(self, events: Iterator[yaml.Event]) -> None:
        """Reads the only document of the stream into the source."""
        documents = 0
        for event in events:
            if isinstance(event, yaml.DocumentStartEvent):
                documents += 1
                if documents > 1:
                    self._refuse(event, "a second document in one file", "remove the line '---'")
                    return
                if event.tags or event.version:
                    self._refuse(event, "a YAML directive", "remove the line that begins with %")
            elif isinstance(event, yaml.NodeEvent):
                self.source.data = self._node(event, events, ())
        if documents == 0:
            self.problems.append(Problem(Location(self.source.file), "is empty"))

    def _node(self, event: yaml.Event, events: Iterator[yaml.Event], path: DataPath) -> Data:
        self._count(event, path)
        if isinstance(event, yaml.AliasEvent):
            advice = "use a subtree or a parameter, or write the value again"
            self._refuse(event, f"alias '*{event.anchor}'", advice)
            return None
        if isinstance(event, yaml.NodeEvent) and event.anchor is not None:
            self._refuse(event, f"anchor '&{event.anchor}'", "use a subtree or a parameter instead")
        if isinstance(event, _TAGGED) and event.tag is not None:
            self._refuse(event, f"tag '{event.tag}'", "a tree file is plain data")
        if isinstance(event, yaml.ScalarEvent):
            self.source.values[path] = _span(event, event)
            return self._scalar(event)
        if isinstance(event, yaml.SequenceStartEvent):
            return self._list(event, events, path)
        return self._mapping(event, events, path)

    def _scalar(self, event: yaml.ScalarEvent) -> Data:
        control = control_character(event.value)
        if control:
            self._refuse(event, f"the control character {control}", _TEXT_RULE)
            return ""
        if event.style:  # quoted or block text
            return event.value
        try:
            return plain_value(event.value)
        except ScalarError as error:
            self._add(Problem(self.source.at(_span(event, event)), str(error), error.hint))
            return None

    def _list(self, start: yaml.Event, events: Iterator[yaml.Event], path: DataPath) -> Data:
        items: list[Data] = []
        for event in events:
            if isinstance(event, yaml.SequenceEndEvent):
                self.source.values[path] = _span(start, event)
                break
            items.append(self._node(event, events, (*path, len(items))))
        return items

    def _mapping(self, start: yaml.Event, events: Iterator[yaml.Event], path: DataPath) -> Data:
        items: dict[str, Data] = {}
        for event in events:
            if isinstance(event, yaml.MappingEndEvent):
                self.source.values[path] = _span(start, event)
                break
            key = self._key(event, events, path, after=next(reversed(items.values()), None))
            item_path = (*path, key)
            if key in items:
                first = self.source.keys[item_path].line + 1
                hint = f"it was first given on line {first}; keep one of the two"
                self._refuse(event, f"key '{key}' is given twice", hint, exact=True)
                item_path = (*path, f"{key} (again)")
            elif isinstance(event, yaml.ScalarEvent):
                self.source.keys[item_path] = _span(event, event)
            value = self._node(next(events), events, item_path)
            items.setdefault(key, value)
        return items

    def _key(
        self, event: yaml.Event, events: Iterator[yaml.Event], path: DataPath, after: Data
    ) -> str:
        """Returns a key; ``after`` is the value before it, for the hint on decimal commas."""
        if not isinstance(event, yaml.ScalarEvent):
            self._node(event, events, (*path, "?"))
            self._refuse(event, "a key that is not text", "keys must be plain words", exact=True)
            return f"? {self._nodes}"
        self._count(event, path)
        if event.anchor is not None or event.tag is not None:
            self._refuse(event, "an anchor or tag on a key", "keys must be plain words")
        text = str(event.value)
        if control_character(text):
            what = f"the control character {control_character(text)} in a key"
            self._refuse(event, what, _TEXT_RULE)
            return f"? {self._nodes}"
        if text == "<<" and not event.style:
            self._refuse(event, "merge key '<<'", "use a subtree, or write the values again")
        elif not event.style and not _reads_as_text(text):
            hint = f'quote it if it is meant: "{text}"'
            if text.isdigit() and isinstance(after, int) and not isinstance(after, bool):
                hint = f"use a decimal point, not a comma: {after}.{text}"
            self._refuse(event, f"key '{text}' is not text", hint, exact=True)
        return text

    def _count(self, event: yaml.Event, path: DataPath) -> None:
        self._nodes += 1
        if self._nodes > MAX_NODES:
            self._refuse(event, f"more than {MAX_NODES} values in one file", "", exact=True)
            raise _GiveUpError
        if len(path) >= MAX_DEPTH:
            self._refuse(event, f"nested deeper than {MAX_DEPTH} levels", "", exact=True)
            raise _GiveUpError

    def _refuse(self, event: yaml.Event, what: str, hint: str, *, exact: bool = False) -> None:
        message = what if exact else f"{what} is not allowed"
        self._add(Problem(self.source.at(_span(event, event)), message, hint))

    def _add(self, problem: Problem) -> None:
        self.problems.append(problem)
        if len(self.problems) >= MAX_PROBLEMS:
            raise _GiveUpError


def _reads_as_text(text: str) -> bool:
    """Returns whether an unquoted key is text; `on` and `no` are, as no key is a truth value."""
    try:
        return isinstance(plain_value(text), str)
    except ScalarError:
        return text.lower() in ("yes", "no", "on", "off")


def _span(first: yaml.Event, last: yaml.Event) -> Span:
    # PyYAML types marks as optional, but a parser's events always have them.
    start = cast("yaml.Mark", first.start_mark)
    end = cast("yaml.Mark", last.end_mark)
    return Span(start.line, start.column, end.line, end.column)


# Python data instead of a file: keys are text, numbers are finite and of sensible size, depth and
# number of values have the caps of a file.


class MappingSource(Source):
    """A tree given as Python data; its locations are paths of keys.

    Args:
        file: Name in messages; relative paths in the tree start from its folder.
        data: Data, as YAML would have it.
        order: Every path in ``data`` with its number in the order of the mapping.
    """

    def __init__(self, file: str, data: Data, order: Mapping[DataPath, int]) -> None:
        super().__init__(file, (), data)
        self._order = order

    @property
    def text(self) -> str:
        """Data as JSON, which is also YAML."""
        return json.dumps(self.data)

    def location(self, path: DataPath) -> Location:
        """Returns the location of the value at ``path``, or of its nearest ancestor that exists."""
        there = next(path[:end] for end in range(len(path), -1, -1) if path[:end] in self._order)
        return Location(self.file, rank=self._order[there], keys=dotted(there))

    def key_location(self, path: DataPath) -> Location:
        """Returns the location of the value: a key and its value have one path."""
        return self.location(path)


def read_mapping(mapping: Mapping[str, object], file: str = "<mapping>") -> Source:
    """Reads Python data as a tree file; ``file`` is its name in messages.

    Tuples become lists, NumPy arrays and scalars their values, paths text.

    Raises:
        SpecError: A value cannot be expressed in YAML, or a cap is exceeded.
    """
    data, order = plain(mapping, file)
    return MappingSource(file, data, order)


def plain(value: object, file: str) -> tuple[Data, dict[DataPath, int]]:
    """Converts a Python value to YAML data; also returns every path in it with its number.

    Raises:
        SpecError: A value cannot be expressed in YAML, or a cap is exceeded.
    """
    reading = _MappingReader(file)
    try:
        data = reading.value(value, ())
    except _GiveUpError:
        data = None
    if reading.problems:
        raise SpecError(reading.problems)
    return data, reading.order


def dotted(path: DataPath) -> str:
    """Returns keys joined by dots, indices in brackets: ``arms.arm1.tree.sequence[0]``."""
    parts = (f"[{part}]" if isinstance(part, int) else f".{part}" for part in path)
    return "".join(parts).removeprefix(".")


class _MappingReader:
    """Converts Python data to YAML data and records the order of its parts."""

    def __init__(self, file: str) -> None:
        self.problems: list[Problem] = []
        self.order: dict[DataPath, int] = {}
        self._file = file
        self._characters = 0

    def value(self, value: object, path: DataPath) -> Data:
        self._count(path)
        if isinstance(value, (np.ndarray, np.generic)):
            value = value.tolist()
        if isinstance(value, Mapping):
            return self._mapping(value, path)
        if isinstance(value, (list, tuple)):
            return [self.value(item, (*path, index)) for index, item in enumerate(value)]
        if isinstance(value, (str, PurePath)):
            # `str.__str__` gives the value of an enumeration's member, `str` its name.
            return self._text(str.__str__(value) if isinstance(value, str) else str(value), path)
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            return self._number(value, path)
        if value is None or isinstance(value, bool):
            return value
        wanted = "a mapping, a list, text, a number, true, false or None"
        self._add(path, f"{type(value).__name__} cannot be part of a tree", wanted)
        return None

    def _mapping(self, mapping: Mapping[object, object], path: DataPath) -> Data:
        data: dict[str, Data] = {}
        for key, item in mapping.items():
            if key is True:  # what YAML 1.1, and so PyYAML, makes of the unquoted key `on`
                data["on"] = self.value(item, (*path, "on"))
            elif isinstance(key, str):
                name = self._text(key, path)
                data[name] = self.value(item, (*path, name))
            else:
                hint = f"write it as text: '{key}'"
                self._add(path, f"key {str(key)[:40]} is not text", hint)
        return data

    def _text(self, text: str, path: DataPath) -> str:
        self._characters += len(text)
        if self._characters > MAX_BYTES:
            self._add(path, f"more than {MAX_BYTES // 1024} Ki characters of text")
            raise _GiveUpError
        if any(0xD800 <= ord(letter) <= 0xDFFF for letter in text):
            self._add(path, "text with an unpaired surrogate", "it is not valid Unicode text")
            return ""
        control = control_character(text)
        if control:
            self._add(path, f"the control character {control} is not allowed")
            return ""
        return text

    def _number(self, number: int | float, path: DataPath) -> int | float:
        if not math.isfinite(number):
            self._add(path, f"'{number}' is not a finite number")
            return 0
        if isinstance(number, int) and abs(number) > LARGEST_INTEGER:
            self._add(path, "this number is too large", f"at most {LARGEST_INTEGER} is allowed")
            return 0
        return number

    def _count(self, path: DataPath) -> None:
        if len(path) >= MAX_DEPTH:
            self._add(path[:1], f"nested deeper than {MAX_DEPTH} levels")
            raise _GiveUpError
        if len(self.order) >= MAX_NODES:
            self._add(path[:1], f"more than {MAX_NODES} values in one tree")
            raise _GiveUpError
        self.order[path] = len(self.order)

    def _add(self, path: DataPath, message: str, hint: str = "") -> None:
        location = Location(self._file, rank=self.order.get(path, 0), keys=dotted(path))
        self.problems.append(Problem(location, message, hint))
        if len(self.problems) >= MAX_PROBLEMS:
            raise _GiveUpError


TreeInput: TypeAlias = Path | str | Mapping[str, object] | Source
"""Path of a tree file, YAML text, Python data, or a source that was already read."""


def read_tree(tree: TreeInput, folder: Path | None = None) -> Source:
    """Reads a tree from any kind of input.

    Args:
        tree: The tree; `is_yaml` decides which text is YAML.
        folder: Folder from which relative paths in YAML text or Python data start (included files,
            robot descriptions); by default the current one. Those in a file start from its own.

    Raises:
        SpecError: It cannot be read; carries every problem.
    """
    if isinstance(tree, Source):
        return tree
    if isinstance(tree, Mapping):
        return read_mapping(tree, str((folder or Path()) / "<mapping>"))
    if isinstance(tree, str) and is_yaml(tree):
        return read_text(tree, str((folder or Path()) / "<text>"))
    return read_file(Path(tree))


def is_yaml(text: str) -> bool:
    """Returns whether text is YAML rather than a path: several lines, or a flow mapping."""
    return "\n" in text or text.lstrip().startswith("{")


_PLAIN = re.compile(r"[A-Za-z](?:[A-Za-z0-9_ -]*[A-Za-z0-9_])?")
_COMMENT = re.compile(r"(?m)(?:^|\s)#")


def flow_text(value: Data) -> str:
    """Returns a value in YAML on one line: ``[{hue: [42, 70]}]``."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {flow_text(item)}" for key, item in value.items()) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(flow_text, value)) + "]"
    if isinstance(value, str) and _PLAIN.fullmatch(value) and _reads_as_itself(value):
        return value
    return json.dumps(value, ensure_ascii=False)


def _reads_as_itself(text: str) -> bool:
    """Returns whether unquoted text is read as text: `on` is not."""
    try:
        return plain_value(text) == text
    except ScalarError:
        return False


def with_value(text: str, file: str, path: DataPath, value: Data) -> str:
    """Returns the text of a file with another value at ``path``; comments and layout are kept.

    Where old and new have the same shape, only the scalars that differ are replaced; otherwise the
    whole value is, on one line. A new key goes before the other keys of its mapping.

    Args:
        text: Strict YAML, with any ends of lines.
        file: Name of the file in messages.
        path: Path of the value, in a mapping that is there or is left out (``wait:``, ``- wait``).
        value: Value of the types that YAML has here.

    Raises:
        SpecError: The text is not YAML; the value holds comments that would be lost; the edit
            would change more than this value.
    """
    mark = "\ufeff" if text.startswith("\ufeff") else ""
    body = text.removeprefix(mark)
    source = read_text(body, file)
    pieces = sorted(_pieces(body, source, path, value), key=lambda piece: piece.begin)
    edited = []
    at = 0
    for piece in pieces:
        edited += [body[at : piece.begin], piece.text]
        at = piece.end
    result = "".join([*edited, body[at:]])
    _verify(result, source, path, value)
    return mark + result


@dataclass(frozen=True)
class _Piece:
    """Replacement of the characters ``begin`` to ``end`` by ``text``."""

    begin: int
    end: int
    text: str


class _ReshapedError(Exception):
    """Old and new value do not have the same shape."""


def _pieces(text: str, source: Source, path: DataPath, value: Data) -> Iterator[_Piece]:
    lines = io.StringIO(text, newline="").readlines()
    if path in source.values:
        try:
            spans = list(_differences(source, path, source.get(path), value))
        except _ReshapedError:
            yield _whole(text, lines, source, path, value)
            return
        for span, scalar in spans:
            yield _Piece(_begin(lines, span), _end(lines, span), flow_text(scalar))
    else:
        yield _entry(text, lines, source, path, value)


def _differences(
    source: Source, path: DataPath, old: Data, new: Data
) -> Iterator[tuple[Span, Data]]:
    """Yields the span and the new value of each scalar that differs."""
    if isinstance(old, dict) and isinstance(new, dict) and old.keys() == new.keys():
        for key in old:
            yield from _differences(source, (*path, key), old[key], new[key])
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for index, pair in enumerate(zip(old, new, strict=True)):
            yield from _differences(source, (*path, index), *pair)
    elif isinstance(old, (dict, list)) or isinstance(new, (dict, list)):
        raise _ReshapedError
    elif old != new:
        yield source.values[path], new


def _whole(text: str, lines: Sequence[str], source: Source, path: DataPath, value: Data) -> _Piece:
    """Replaces the whole value, from the end of its key on if it is on lines of its own."""
    span = source.values[path]
    if _is_compact(text, lines, source, path):
        return _Piece(_begin(lines, span), _end(lines, span), flow_text(value))
    # A block's span ends where the next value begins, with comments between: use its last scalar.
    below = (other for other in source.values if other[: len(path)] == path)
    compact = (other for other in below if _is_compact(text, lines, source, other))
    end = max(_end(lines, source.values[other]) for other in compact)
    key = source.keys.get(path)
    begin = _begin(lines, span) if key is None else text.index(":", _end(lines, key)) + 1
    if _COMMENT.search(text[begin:end]):
        hint = f"write it by hand: {flow_text(value)}"
        message = "changing this value would lose the comments in it"
        raise SpecError([source.problem(path, message, hint)])
    return _Piece(begin, end, " " * (key is not None) + flow_text(value))


def _is_compact(text: str, lines: Sequence[str], source: Source, path: DataPath) -> bool:
    """Returns whether a value is a scalar or in brackets, so that its span has its exact end."""
    begin = _begin(lines, source.values[path])
    return not isinstance(source.get(path), (dict, list)) or text[begin : begin + 1] in ("[", "{")


def _entry(text: str, lines: Sequence[str], source: Source, path: DataPath, value: Data) -> _Piece:
    """Adds a key that does not exist yet."""
    above = path[:-1]
    entry = flow_text({str(path[-1]): value})[1:-1]
    body = source.get(above)
    if isinstance(body, dict) and body:
        first = source.keys[(*above, next(iter(body)))]
        begin = _begin(lines, first)
        if text[_begin(lines, source.values[above])] == "{":
            return _Piece(begin, begin, f"{entry}, ")
        ending = re.search(r"\r\n|\r|\n|$", lines[first.line])
        newline = (ending[0] if ending else "") or "\n"
        return _Piece(begin, begin, f"{entry}{newline}{' ' * first.column}")
    if above in source.values:  # `{}`, or nothing behind the colon
        span = source.values[above]
        gap = "" if isinstance(body, dict) else " "
        return _Piece(_begin(lines, span), _end(lines, span), f"{gap}{{{entry}}}")
    span = source.values[above[:-1]]  # a bare node type
    return _Piece(_begin(lines, span), _end(lines, span), f"{{{above[-1]}: {{{entry}}}}}")


def _begin(lines: Sequence[str], span: Span) -> int:
    return sum(map(len, lines[: span.line])) + span.column


def _end(lines: Sequence[str], span: Span) -> int:
    return sum(map(len, lines[: span.end_line])) + span.end_column


def _verify(text: str, before: Source, path: DataPath, value: Data) -> None:
    """Reads the edited text again to check that only this value has changed.

    Raises:
        SpecError: The edited text has other data than expected.
    """
    expected = copy.deepcopy(before.data)
    _put(expected, path, value)
    try:
        after = read_text(text, before.file).data
    except SpecError:
        after = None
    if after != expected:
        hint = f"write it by hand: {flow_text(value)}"
        message = "this value cannot be changed without changing its neighbors"
        raise SpecError([Problem(before.location(path), message, hint)])


def _put(data: Data, path: DataPath, value: Data) -> None:
    """Puts a value into data, making mappings of bare node types and of empty bodies."""
    for part, following in itertools.pairwise(path):
        inner = data[part]
        if not isinstance(inner, (dict, list)):
            data[part] = inner = {} if inner is None else {inner: {}}
            if following not in inner:
                inner[following] = {}
        data = inner
    data[path[-1]] = value
