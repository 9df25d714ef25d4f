"""Strict YAML: text in, data with places out, or every reason why not.

Stricter than ``yaml.safe_load`` because that reads `no` as False, keeps the last of two equal
keys, expands merge keys without bound, and lets ValueError, KeyError and RecursionError escape.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path as FilePath
from typing import Final, cast

import yaml

from bt_dualarm.spec.problems import Place, Problem, SpecError
from bt_dualarm.spec.scalars import ScalarError, control_character, plain_value
from bt_dualarm.spec.source import Data, Path, Source, Span

MAX_BYTES: Final = 256 * 1024
MAX_DEPTH: Final = 64
MAX_NODES: Final = 10_000
MAX_PROBLEMS: Final = 100

# libyaml is 10 times faster; the reader in Python stands in where PyYAML was built without it.
_LOADER: Final[type[yaml.SafeLoader]] = getattr(yaml, "CSafeLoader", yaml.SafeLoader)

_TEXT_RULE: Final = "a text has what can be read, line feeds and tabs"
_TAGGED: Final = (yaml.ScalarEvent, yaml.CollectionStartEvent)


def read_file(path: FilePath) -> Source:
    """Read one YAML file.

    Raises:
        SpecError: Not a readable text file within the caps, or not the strict YAML described here.
    """
    place = Place(str(path))
    try:
        if not path.is_file():
            what = "is not a regular file" if path.exists() else "no such file"
            raise SpecError([Problem(place, what)])
        with path.open("rb") as file:
            raw = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise SpecError([Problem(place, f"cannot be read: {error}")]) from error
    if len(raw) > MAX_BYTES:
        raise SpecError([Problem(place, f"is larger than {MAX_BYTES // 1024} KiB")])
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        message = f"is not UTF-8 text: byte {error.start} is 0x{raw[error.start]:02x}"
        raise SpecError([Problem(place, message, "save the file as UTF-8")]) from error
    return read_text(text, str(path))


def read_text(text: str, file: str = "<text>") -> Source:
    """Read YAML text; ``file`` is how messages name it.

    Raises:
        SpecError: Not the strict YAML described here.
    """
    # str.splitlines would also split at characters that YAML takes for text.
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
            hint = f"{hint}; it began in line {began.line + 1}"
        return Problem(source.at(span), f"not YAML: {what}", hint)
    position = getattr(error, "position", 0) or 0
    before = text[:position].split("\n")
    span = Span(len(before) - 1, len(before[-1]), len(before) - 1, len(before[-1]) + 1)
    return Problem(source.at(span), "not YAML: a character that YAML does not allow here")


def _syntax_hint(what: str) -> str:
    if "mapping values are not allowed" in what:
        return "a colon too many, or a line indented differently from its neighbours"
    if "cannot start any token" in what:
        return "indent with spaces, not tabs; quote text that begins with @, ` or %"
    if "unexpected end of stream" in what:
        return "a quote is not closed"
    if "expected <block end>" in what or "did not find expected" in what:
        return "look at the indentation and for an unclosed bracket or quote above"
    return ""


class _GiveUpError(Exception):
    """Reading on would help nobody: a cap was exceeded."""


class _Reader:
    """Builds data from the parser's events, noting where everything stands."""

    def __init__(self, source: Source) -> None:
        self.source = source
        self.problems: list[Problem] = []
        self._nodes = 0

    def read(self, events: Iterator[yaml.Event]) -> None:
        """Read the only document of the stream into the source."""
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
            self.problems.append(Problem(Place(self.source.file), "is empty"))

    def _node(self, event: yaml.Event, events: Iterator[yaml.Event], path: Path) -> Data:
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

    def _list(self, start: yaml.Event, events: Iterator[yaml.Event], path: Path) -> Data:
        items: list[Data] = []
        for event in events:
            if isinstance(event, yaml.SequenceEndEvent):
                self.source.values[path] = _span(start, event)
                break
            items.append(self._node(event, events, (*path, len(items))))
        return items

    def _mapping(self, start: yaml.Event, events: Iterator[yaml.Event], path: Path) -> Data:
        items: dict[str, Data] = {}
        for event in events:
            if isinstance(event, yaml.MappingEndEvent):
                self.source.values[path] = _span(start, event)
                break
            key = self._key(event, events, path, after=next(reversed(items.values()), None))
            place = (*path, key)
            if key in items:
                first = self.source.keys[place].line + 1
                hint = f"it was first given in line {first}; keep one of the two"
                self._refuse(event, f"key '{key}' is given twice", hint, exact=True)
                place = (*path, f"{key} (again)")
            elif isinstance(event, yaml.ScalarEvent):
                self.source.keys[place] = _span(event, event)
            value = self._node(next(events), events, place)
            items.setdefault(key, value)
        return items

    def _key(self, event: yaml.Event, events: Iterator[yaml.Event], path: Path, after: Data) -> str:
        """A key; ``after`` is the value before it."""
        if not isinstance(event, yaml.ScalarEvent):
            self._node(event, events, (*path, "?"))
            self._refuse(event, "a key that is not text", "keys are plain words", exact=True)
            return f"? {self._nodes}"
        self._count(event, path)
        if event.anchor is not None or event.tag is not None:
            self._refuse(event, "an anchor or tag on a key", "keys are plain words")
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
                hint = f"numbers have a point, not a comma: {after}.{text}"
            self._refuse(event, f"key '{text}' is not text", hint, exact=True)
        return text

    def _count(self, event: yaml.Event, path: Path) -> None:
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
    """Whether an unquoted key is text; `on` and `no` are: as keys they mean what they look like."""
    try:
        return isinstance(plain_value(text), str)
    except ScalarError:
        return text.lower() in ("yes", "no", "on", "off")


def _span(first: yaml.Event, last: yaml.Event) -> Span:
    # Every event of a parser has its marks.
    start, end = cast("yaml.Mark", first.start_mark), cast("yaml.Mark", last.end_mark)
    return Span(start.line, start.column, end.line, end.column)
