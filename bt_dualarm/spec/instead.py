"""What was meant by a value of another form: the list or the mapping that it could be."""

from __future__ import annotations

import re
from typing import Final

from pydantic import BaseModel

from bt_dualarm.spec.annotations import fixed_length
from bt_dualarm.spec.source import Data

_NUMBERS: Final = re.compile(r"\s*(-?[\d.]+(?:\s*[x,; ]\s*-?[\d.]+)+)\s*")
_BETWEEN: Final = re.compile(r"\s*[x,; ]\s*")


def list_of(text: str) -> str:
    """The list that text such as ``320x240`` was meant for; empty if it was none."""
    match = _NUMBERS.fullmatch(text)
    return f"as a list: [{', '.join(_BETWEEN.split(match[1]))}]" if match else ""


def mapping_of(given: Data, model: type[BaseModel]) -> str:
    """A mapping in which a bare list, ``[0.4, 0, 0.5]``, is the field that must be there.

    Empty where the list is none of numbers, or of another length.
    """
    if not isinstance(given, (list, tuple)) or not all(_is_number(item) for item in given):
        return ""
    for name, field in model.model_fields.items():
        if field.is_required() and fixed_length(field.annotation) == len(given):
            return f"{{{name}: [{', '.join(f'{item:g}' for item in given)}]}}"
    return ""


def _is_number(item: Data) -> bool:
    return isinstance(item, (int, float)) and not isinstance(item, bool)
