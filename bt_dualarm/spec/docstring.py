"""What the docstring of a model says of it and of its fields."""

from __future__ import annotations

import inspect
import re
from typing import Any, Final

_ATTRIBUTE: Final = re.compile(r"^ {4}(\w+): (.*(?:\n {8}.*)*)", re.MULTILINE)


def summary_of(model: type[Any]) -> str:
    """The first paragraph of the docstring of a class, in one line."""
    return _text(model).partition("\n\n")[0].replace("\n", " ")


def attributes_of(model: type[Any]) -> dict[str, str]:
    """What the docstring of a class says of each attribute, in one line each."""
    found = _ATTRIBUTE.findall(_text(model))
    return {name: " ".join(words.split()) for name, words in found}


def _text(model: type[Any]) -> str:
    return (inspect.getdoc(model) or "").replace("``", "`")
