"""pydantic's errors in words for the author of a tree file, each with its path in the data."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final, TypeAlias, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from bt_dualarm.spec.annotations import containers_in, models_in
from bt_dualarm.spec.ports import key_name, reference_of, shown, unit_of
from bt_dualarm.spec.problems import suggestion
from bt_dualarm.spec.source import Data, Path

_Location: TypeAlias = tuple[int | str, ...]

_WANTED: Final = {
    "float_type": "a number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "bool_type": "true or false",
    "string_type": "text",
    "tuple_type": "a list",
    "list_type": "a list",
    "dict_type": "a mapping",
    "model_type": "a mapping",
    "finite_number": "a finite number",
}
_COMPARED: Final = {
    "greater_than": ("gt", "must be greater than"),
    "greater_than_equal": ("ge", "must be at least"),
    "less_than": ("lt", "must be less than"),
    "less_than_equal": ("le", "must be at most"),
}


@dataclass(frozen=True)
class Finding:
    """What is wrong with data, not yet tied to a file.

    Attributes:
        path: In the data that was validated; a missing field is that of its parent.
        message: What is wrong.
        hint: What was expected.
        at_key: Whether the key is at fault rather than the value.
    """

    path: Path
    message: str
    hint: str = ""
    at_key: bool = False


def explain(
    error: ValidationError,
    model: type[BaseModel],
    data: Data,
    noun: str,
    also: frozenset[str] = frozenset(),
) -> Iterator[Finding]:
    """One finding for each thing that is wrong.

    Args:
        error: What validating ``data`` against ``model`` raised.
        model: Top of what was validated.
        data: What was validated.
        noun: What the fields of the top model are: ``"port"`` or ``"field"``.
        also: Names that may stand beside the top model's fields.
    """
    found = error.errors(include_url=False)
    for details in found:
        if details["type"] == "too_short" and _has_deeper(details["loc"], found):
            continue  # pydantic counts only the items that are right
        if details["type"] == "extra_forbidden":
            yield _unknown(details, model, data, noun, also)
        else:
            yield _finding(details, model, data, noun)


def _has_deeper(location: _Location, found: list[ErrorDetails]) -> bool:
    depth = len(location)
    return any(other["loc"][:depth] == location and len(other["loc"]) > depth for other in found)


def describe(value: Data) -> str:
    """A value in words, short enough for a message."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        value = shown(value)
        return f"text '{value if len(value) <= 40 else value[:37] + '...'}'"
    if isinstance(value, dict):
        return "a mapping"
    if isinstance(value, (list, tuple)):
        return f"a list of {len(value)}"
    return f"{value:g}" if isinstance(value, float) else str(value)[:40]


def _finding(details: ErrorDetails, model: type[BaseModel], data: Data, noun: str) -> Finding:
    location, kind = details["loc"], details["type"]
    path = _path_in(data, location)
    noun = noun if len(path) + (kind == "missing") <= 1 else "field"
    if kind == "missing":
        return _missing(location, path, model, noun)
    if location and location[-1] == "[key]":
        hint = "names have letters, digits, _ and -, begin with a letter, at most 48 characters"
        return Finding(path, f"'{path[-1] if path else ''}' cannot be a name", hint, at_key=True)
    message, hint = _wrong_value(details, _field_at(model, location))
    owner = next((str(part) for part in reversed(path) if isinstance(part, str)), "")
    return Finding(path, f"{owner}: {message}" if owner else message, hint)


def _unknown(
    details: ErrorDetails, model: type[BaseModel], data: Data, noun: str, also: frozenset[str]
) -> Finding:
    location = details["loc"]
    names = _names_at(model, location[:-1])
    if len(location) == 1:
        names |= also
    else:
        noun = "field"
    hint = suggestion(str(location[-1]), names, noun)
    path = _path_in(data, location)
    return Finding(path, f"unknown {noun} '{location[-1]}'", hint, at_key=True)


def _missing(location: _Location, path: Path, model: type[BaseModel], noun: str) -> Finding:
    name = location[-1]
    if isinstance(name, int):
        return Finding(path, f"{path[-1] if path else 'the list'}: has too few items")
    field = _field_at(model, location)
    words = field.description if field and field.description else ""
    unit = f" [{unit_of(field)}]" if field and unit_of(field) else ""
    hint = f"{name}: {words}{unit}" if words else ""
    return Finding(path, f"{noun} '{name}' is missing", hint, at_key=bool(path))


def _wrong_value(details: ErrorDetails, field: FieldInfo | None) -> tuple[str, str]:
    kind, given, context = details["type"], details["input"], details.get("ctx", {})
    unit = f" {unit_of(field)}" if field and unit_of(field) else ""
    if kind in _COMPARED:
        bound, words = _COMPARED[kind]
        return f"{words} {context[bound]:g}{unit}, not {describe(given)}", ""
    if kind == "literal_error":
        choices = re.findall(r"'([^']*)'", str(context["expected"])) or [str(context["expected"])]
        return f"there is no choice {describe(given)}", suggestion(str(given), choices, "choice")
    if kind in _WANTED:
        return f"expected {_WANTED[kind]}, not {describe(given)}", _reference_hint(given)
    if kind == "value_error":
        return str(context["error"]), ""
    if kind == "string_pattern_mismatch":
        return f"{describe(given)} is not allowed here", f"it must match {context['pattern']}"
    if kind in ("too_long", "too_short"):
        wanted = context.get("max_length" if kind == "too_long" else "min_length")
        most = "at most" if kind == "too_long" else "at least"
        return f"expected {most} {wanted} items, not {context['actual_length']}", ""
    return f"{details['msg'][:1].lower()}{details['msg'][1:]}", ""


def _reference_hint(given: Data) -> str:
    if isinstance(given, dict) and len(given) == 1 and None in given.values():
        return f'if the key or parameter is meant, quote it: "{{{next(iter(given))}}}"'
    key = reference_of(given)
    if key is None:
        return ""
    return f"there is no parameter '{key_name(key)}', and a key stands for a whole port only"


def _path_in(data: Data, location: _Location) -> Path:
    """Follow pydantic's location through the data, past its names of union members."""
    path: Path = ()
    for part in location:
        if isinstance(part, int):
            fits = isinstance(data, (list, tuple)) and part < len(data)
        else:
            fits = isinstance(data, dict) and part in data
        if fits:
            data = data[part]
            path = (*path, part)
    return path


def _step(annotation: Any, part: int | str) -> Any:
    """The type of a part of a value, or the same type where pydantic names a union's member."""
    for model in models_in(annotation):
        if part in model.model_fields:
            return model.model_fields[str(part)].annotation
    for member in containers_in(annotation):
        if isinstance(part, int) and get_origin(member) in (tuple, list):
            items = get_args(member)
            return items[min(part, len(items) - 1)] if items[-1] is not ... else items[0]
        if get_origin(member) is dict and part not in ("[key]",):
            return get_args(member)[1]
    return annotation


def _names_at(model: type[BaseModel], location: _Location) -> set[str]:
    annotation: Any = model
    for part in location:
        annotation = _step(annotation, part)
    return {name for found in models_in(annotation) for name in found.model_fields}


def _field_at(model: type[BaseModel], location: _Location) -> FieldInfo | None:
    """The innermost declared field that the location passes through."""
    annotation: Any = model
    field = None
    for part in location:
        for found in models_in(annotation):
            field = found.model_fields.get(str(part), field)
        annotation = _step(annotation, part)
    return field
