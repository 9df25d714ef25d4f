"""pydantic's locations of errors: which value of the data they mean, and which type."""

from __future__ import annotations

from typing import TypeAlias, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from bt_dualarm.spec.annotations import containers_in, models_in
from bt_dualarm.spec.source import Data, Path

Location: TypeAlias = tuple[int | str, ...]
"""Keys and indices, with the names of union members between them."""


def type_at(model: type[BaseModel], location: Location) -> object:
    """The annotation of what lies at a location."""
    annotation: object = model
    for part in location:
        annotation = _step(annotation, part)
    return annotation


def field_at(model: type[BaseModel], location: Location) -> FieldInfo | None:
    """The innermost declared field that a location passes through."""
    annotation: object = model
    field = None
    for part in location:
        for found in models_in(annotation):
            field = found.model_fields.get(str(part), field)
        annotation = _step(annotation, part)
    return field


def path_in(data: Data, location: Location) -> Path:
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


def _step(annotation: object, part: int | str) -> object:
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
