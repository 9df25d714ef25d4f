"""Types of ports in words: what an author writes there, and between which bounds."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from types import UnionType
from typing import Annotated, Any, Final, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from bt_dualarm.spec.node import NodeSpec
from bt_dualarm.spec.ports import Template, WrittenKey
from bt_dualarm.spec.source import Json
from bt_dualarm.spec.unit import Unit
from bt_dualarm.spec.values import Refers

_WORDS: Final[Mapping[object, str]] = {
    bool: "true or false",
    int: "whole number",
    float: "number",
    str: "text",
    Any: "any value",
    NodeSpec: "node",
}
_QUANTITIES: Final = {"s": "duration", "deg": "angle"}
_BOUNDS: Final = {
    "gt": ("lower", ">"),
    "ge": ("lower", "≥"),
    "lt": ("upper", "<"),
    "le": ("upper", "≤"),
}


def notation_of(field: FieldInfo) -> str:
    """What an author writes for a field, such as ``number`` or ``list of 3 numbers``."""
    special = _special(field.metadata)
    return special or _words(field.annotation)


def range_of(field: FieldInfo) -> str:
    """Between what it must be, such as ``> 0, ≤ 100`` or ``1 to 200 items``; empty if anything."""
    found = list(_constraints([*field.metadata, field.annotation]))
    return ", ".join(part for part in (_numbers(found), _length(found), _pattern(found)) if part)


def model_name(model: type[BaseModel]) -> str:
    """How a type of values is called in the pages: ``PoseSpec`` is a pose."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", model.__name__.removesuffix("Spec")).lower()


def names_of(model: type[BaseModel]) -> list[str]:
    """Names that may be written instead of the fields."""
    forms: list[Json] = model.model_json_schema().get("anyOf", [])
    return [name for form in forms for name in form.get("enum", [])]


def _words(annotation: object) -> str:
    origin, arguments = get_origin(annotation), get_args(annotation)
    if annotation in _WORDS:
        return _WORDS[annotation]
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return model_name(annotation)
    if origin is Annotated:
        return _special(arguments[1:]) or _words(arguments[0])
    if origin is Literal:
        return " or ".join(str(choice) for choice in arguments)
    if origin in (Union, UnionType):
        members = (_words(member) for member in arguments if member is not type(None))
        return " or ".join(dict.fromkeys(members))
    if origin is tuple:
        return _list(arguments)
    if origin is dict:
        return f"mapping from names to {_plural(_words(arguments[1]))}"
    return str(annotation)


def _list(items: tuple[object, ...]) -> str:
    word = _plural(_words(items[0]))
    return f"list of {word}" if items[-1] is Ellipsis else f"list of {len(items)} {word}"


def _plural(words: str) -> str:
    """Several of them: of ``list of 2 numbers`` the list."""
    if words.endswith("value"):
        return words
    head, of, rest = words.partition(" of ")
    return f"{head}s{of}{rest}"


def _special(metadata: Iterable[object]) -> str:
    """The word for a type that is more than what it is made of."""
    for item in metadata:
        if isinstance(item, Unit):
            return _QUANTITIES.get(item.yaml, "quantity")
        if isinstance(item, Refers):
            return f"name of an {' or '.join(item.to)}"
        if isinstance(item, WrittenKey):
            return "name of a key"
        if isinstance(item, Template):
            return "text with {key}"
    return ""


def _constraints(items: Sequence[object]) -> Iterator[object]:
    """Metadata of a field and of all members of its type."""
    for item in items:
        if isinstance(item, FieldInfo):
            yield from item.metadata
        elif isinstance(item, type) and issubclass(item, BaseModel):
            continue
        else:
            yield item
            yield from _constraints([*getattr(item, "__metadata__", ()), *get_args(item)])


def _numbers(found: list[object]) -> str:
    ends: dict[str, tuple[float, str]] = {}
    for attribute, (end, sign) in _BOUNDS.items():
        for bound in _given(found, attribute):
            if end not in ends or _tighter(end, (bound, sign), ends[end]):
                ends[end] = (bound, sign)
    told = (ends[end] for end in ("lower", "upper") if end in ends)
    return ", ".join(
        f"{sign} {bound}" if isinstance(bound, int) else f"{sign} {bound:.9g}"
        for bound, sign in told
    )


def _given(found: list[object], attribute: str) -> list[int | float]:
    """What metadata say of one bound; pydantic's are told by their attributes."""
    values = (getattr(item, attribute, None) for item in found)
    return [value for value in values if isinstance(value, (int, float))]


def _tighter(end: str, new: tuple[float, str], old: tuple[float, str]) -> bool:
    if new[0] == old[0]:
        return new[1] in "<>"
    return (new[0] > old[0]) == (end == "lower")


def _length(found: list[object]) -> str:
    least = max(_given(found, "min_length"), default=0)
    most = min(_given(found, "max_length"), default=0)
    if least and most:
        return f"length {least} to {most}"
    return f"length ≥ {least}" if least else f"length ≤ {most}" if most else ""


def _pattern(found: list[object]) -> str:
    patterns = (getattr(item, "pattern", None) for item in found)
    return next((f"matches {pattern}" for pattern in patterns if isinstance(pattern, str)), "")
