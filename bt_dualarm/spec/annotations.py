"""What a type annotation holds: the models that a value may be, metadata, containers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from types import UnionType
from typing import Annotated, TypeVar, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

_T = TypeVar("_T")


def models_in(annotation: object) -> Iterator[type[BaseModel]]:
    """The models that a value of this type may be."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    elif get_origin(annotation) in (Annotated, Union, UnionType):
        for member in get_args(annotation):
            yield from models_in(member)


def containers_in(annotation: object) -> Iterator[object]:
    """The tuples, lists and dicts that a value of this type may be."""
    if get_origin(annotation) in (tuple, list, dict):
        yield annotation
    elif get_origin(annotation) in (Annotated, Union, UnionType):
        for member in get_args(annotation):
            yield from containers_in(member)


def fixed_length(annotation: object) -> int:
    """How many items a list of this type always has; 0 where that is not fixed."""
    for container in containers_in(annotation):
        items = get_args(container)
        if get_origin(container) is tuple and items[-1] is not ...:
            return len(items)
    return 0


def metadata_of(field: FieldInfo, wanted: type[_T]) -> _T | None:
    """The first metadata of this type on a field, or on a member of its type."""
    return _metadata_in([*field.metadata, field.annotation], wanted)


def _metadata_in(items: Sequence[object], wanted: type[_T]) -> _T | None:
    for item in items:
        if isinstance(item, wanted):
            return item
        found = _metadata_in([*getattr(item, "__metadata__", ()), *get_args(item)], wanted)
        if found is not None:
            return found
    return None
