"""Changes one value in the text of a YAML file and leaves every other character as it is."""

from __future__ import annotations

import copy
import io
import itertools
import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from bt_dualarm.spec.problems import Problem, SpecError
from bt_dualarm.spec.yaml_reader import (
    Data,
    DataPath,
    ScalarError,
    Source,
    Span,
    plain_value,
    read_text,
)

_PLAIN = re.compile(r"[A-Za-z](?:[A-Za-z0-9_ -]*[A-Za-z0-9_])?")
_COMMENT = re.compile(r"(?m)(?:^|\s)#")


def flow_text(value: Data) -> str:
    """Returns a value in YAML on one line: ``[{hue: [42, 70]}]``."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {flow_text(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list):
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
    """Replaces the whole value, from the end of its key on if it is in lines of its own."""
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
