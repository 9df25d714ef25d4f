"""Names that a tree file gives to its things."""

from __future__ import annotations

import re
from typing import Annotated, Final, TypeAlias

from pydantic import StringConstraints

NAME_PATTERN: Final = r"^[A-Za-z][A-Za-z0-9_-]{0,47}$"
"""Names end up in MuJoCo's names (``arm1/wrist``), in file names and in paths of nodes."""

Name: TypeAlias = Annotated[str, StringConstraints(pattern=NAME_PATTERN)]


def is_name(text: str) -> bool:
    """Whether a tree file could give this name to something."""
    return re.fullmatch(NAME_PATTERN[1:-1], text) is not None


def written_as(value: object) -> str:
    """``name`` or ``value``: what stands where something can be named or written out."""
    return "name" if isinstance(value, str) else "value"
