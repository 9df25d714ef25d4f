"""pydantic's errors in words for the author of a tree file, each with its path in the data."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from bt_dualarm.spec.annotations import fixed_length, models_in
from bt_dualarm.spec.instead import list_of, mapping_of
from bt_dualarm.spec.location import Location, field_at, path_in, type_at
from bt_dualarm.spec.notation import names_of
from bt_dualarm.spec.ports import is_unknown, key_name, reference_of, unit_of
from bt_dualarm.spec.problems import nearest, suggestion
from bt_dualarm.spec.source import Data, Path
from bt_dualarm.spec.unit import bare
from bt_dualarm.spec.wording import counted, in_words

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
    "greater_than": ("gt", "greater than"),
    "greater_than_equal": ("ge", "at least"),
    "less_than": ("lt", "less than"),
    "less_than_equal": ("le", "at most"),
}
_COUNTED: Final = {
    "too_long": ("most", "max_length", "item"),
    "too_short": ("least", "min_length", "item"),
    "string_too_long": ("most", "max_length", "character"),
    "string_too_short": ("least", "min_length", "character"),
}
_NAME_RULE: Final = (
    "names have letters, digits, _ and -, begin with a letter, at most 48 characters"
)


@dataclass(frozen=True)
class Finding:
    """What is wrong with data, not yet tied to a file.

    Attributes:
        path: Path in the data that was validated; a missing field has that of its parent.
        message: Sentence that says what is wrong.
        hint: Words for what was expected.
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
        error: Error that validating ``data`` against ``model`` raised.
        model: Model of the whole data.
        data: Data that was validated.
        noun: Word for the fields of the top model: ``"port"`` or ``"field"``.
        also: Names that may stand beside the top model's fields.
    """
    words = _Words(model, data, noun, also)
    # The members of a union each complain about the same value.
    by_path: dict[Path, list[ErrorDetails]] = {}
    for details in error.errors(include_url=False):
        by_path.setdefault(path_in(data, details["loc"]), []).append(details)
    for path, found in by_path.items():
        yield from words.at(path, found, deeper=any(_is_below(other, path) for other in by_path))


def _is_below(path: Path, top: Path) -> bool:
    return len(path) > len(top) and path[: len(top)] == top


@dataclass(frozen=True)
class _Words:
    """Puts pydantic's findings on one piece of data into words; arguments as `explain`."""

    model: type[BaseModel]
    data: Data
    noun: str
    also: frozenset[str]

    def at(self, path: Path, found: Sequence[ErrorDetails], *, deeper: bool) -> Iterator[Finding]:
        """What is wrong with the value at one path.

        Args:
            path: Path in the data.
            found: Errors that pydantic has found in this value.
            deeper: Whether something inside of the value is wrong, too.
        """
        values = []
        for details in found:
            if details["type"] == "missing":
                yield self._missing(path, details["loc"])
            elif details["type"] == "extra_forbidden":
                yield self._unknown(path, details["loc"])
            elif details["loc"] and details["loc"][-1] == "[key]":
                yield Finding(path, f"'{path[-1]}' cannot be a name", _NAME_RULE, at_key=True)
            elif not is_unknown(details["input"]):
                values.append(details)
        # A value that has parts is not of the other members' types; that is no news.
        if values and not deeper and len(values) == len(found):
            yield self._value(path, values)

    def _unknown(self, path: Path, location: Location) -> Finding:
        names = {n for m in models_in(type_at(self.model, location[:-1])) for n in m.model_fields}
        top = len(location) == 1
        noun = self.noun if top else "field"
        hint = suggestion(str(location[-1]), names | self.also if top else names, noun)
        return Finding(path, f"unknown {noun} '{location[-1]}'", hint, at_key=True)

    def _missing(self, path: Path, location: Location) -> Finding:
        name = location[-1]
        if isinstance(name, int):
            return Finding(path, _owned(path, self._too_few(location[:-1])))
        field = field_at(self.model, location)
        words = field.description if field and field.description else ""
        unit = f" [{unit_of(field)}]" if field and unit_of(field) else ""
        noun = "field" if path else self.noun
        hint = f"{name}: {words}{unit}" if words else ""
        return Finding(path, f"{noun} '{name}' is missing", hint, at_key=bool(path))

    def _too_few(self, location: Location) -> str:
        given = self.data
        for part in path_in(self.data, location):
            given = given[part]
        return f"expected {fixed_length(type_at(self.model, location))} items, not {len(given)}"

    def _value(self, path: Path, found: Sequence[ErrorDetails]) -> Finding:
        given = found[0]["input"]
        if len(found) == 1:
            message, hint = self._one_value(found[0])
        else:
            wanted = [self._expectation(details) for details in found]
            message = f"expected {' or '.join(dict.fromkeys(wanted))}, not {in_words(given)}"
            hint = self._nearest_choice(found)
        hint = hint or (_reference_hint(given) if path else "") or self._bare_number(found)
        hint = hint or self._forms(found)
        return Finding(path, _owned(path, message), hint)

    def _bare_number(self, found: Sequence[ErrorDetails]) -> str:
        """The number or list that text would be, where no text may stand."""
        for details in found:
            field, given = field_at(self.model, details["loc"]), details["input"]
            if isinstance(given, str) and details["type"] in ("list_type", "tuple_type"):
                return list_of(given)
            if isinstance(given, str) and details["type"] == "float_type" and field:
                return bare(given, unit_of(field))
        return ""

    def _forms(self, found: Sequence[ErrorDetails]) -> str:
        """What may stand where a mapping was expected."""
        for details in found:
            if details["type"] == "model_type":
                for model in models_in(type_at(self.model, details["loc"])):
                    if meant := mapping_of(details["input"], model):
                        return meant
                    names = [f"'{name}'" for name in names_of(model)]
                    return " or ".join([*names, f"a mapping of {', '.join(model.model_fields)}"])
        return ""

    def _one_value(self, details: ErrorDetails) -> tuple[str, str]:
        kind, given, context = details["type"], details["input"], details.get("ctx", {})
        if kind in _COMPARED:
            return f"must be {self._bound(details)}, not {in_words(given)}", ""
        if kind == "value_error":
            return str(context["error"]), ""
        if kind == "string_pattern_mismatch":
            return f"{in_words(given)} is not allowed here", f"it must match {context['pattern']}"
        if kind in _COUNTED:
            return f"expected {self._count(details)}, not {len(given)}", ""
        if kind in _WANTED or kind == "literal_error":
            message = f"expected {self._expectation(details)}, not {in_words(given)}"
            return message, self._nearest_choice([details])
        return f"{details['msg'][:1].lower()}{details['msg'][1:]}", ""

    def _expectation(self, details: ErrorDetails) -> str:
        """What the value should be, to follow "expected"."""
        kind = details["type"]
        if kind == "literal_error":
            choices = _choices(details)
            return choices[0] if len(choices) == 1 else f"one of {', '.join(choices)}"
        if kind in _COMPARED:
            return f"a number {self._bound(details)}"
        return _WANTED[kind] if kind in _WANTED else self._one_value(details)[0]

    def _count(self, details: ErrorDetails) -> str:
        """How many items or characters there should be."""
        words, bound, noun = _COUNTED[details["type"]]
        exactly = fixed_length(type_at(self.model, details["loc"]))
        if exactly:
            return counted(exactly, noun)
        return f"at {words} {counted(details['ctx'][bound], noun)}"

    def _bound(self, details: ErrorDetails) -> str:
        bound, words = _COMPARED[details["type"]]
        field = field_at(self.model, details["loc"])
        unit = f" {unit_of(field)}" if field and unit_of(field) else ""
        return f"{words} {details['ctx'][bound]:g}{unit}"

    def _nearest_choice(self, found: Sequence[ErrorDetails]) -> str:
        choices = [choice for details in found for choice in _choices(details)]
        close = nearest(str(found[0]["input"]), choices)
        return f"did you mean '{close}'?" if close else ""


def _choices(details: ErrorDetails) -> list[str]:
    if details["type"] != "literal_error":
        return []
    expected = str(details["ctx"]["expected"])
    return re.findall(r"'([^']*)'", expected) or [expected]


def _owned(path: Path, message: str) -> str:
    """The message after the name of the innermost field or port that it is about."""
    owner = next((part for part in reversed(path) if isinstance(part, str)), "")
    return f"{owner}: {message}" if owner else message


def _reference_hint(given: Data) -> str:
    if isinstance(given, dict) and len(given) == 1 and None in given.values():
        return f'if the key or parameter is meant, quote it: "{{{next(iter(given))}}}"'
    key = reference_of(given)
    if key is None:
        return ""
    return f"there is no parameter '{key_name(key)}', and a key stands for a whole port only"
