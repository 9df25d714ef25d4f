"""The signs and colours of statuses, in Unicode and in ASCII."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

STYLES: Mapping[str, str] = MappingProxyType(
    {
        "SUCCESS": "green",
        "FAILURE": "bold red",
        "RUNNING": "bold cyan",
        "INVALID": "dim",
        "HALTED": "yellow",
        "UNFINISHED": "yellow",
        "REMOVED": "dim",
        "NOT_SPAWNED": "dim",
    }
)
"""Colour of each status and outcome, and of what was halted.

The signs differ too: nobody has to see the colours.
"""


@dataclass(frozen=True)
class Symbols:
    """One alphabet to draw trees with.

    Attributes:
        status: Sign of each status and outcome, and of what was halted.
        branch: Line that leads to a child that has siblings below it.
        last: Line that leads to the last child.
        through: Line that passes by below a child that has siblings.
        full: Piece of a bar for progress done.
        empty: Piece of a bar for progress to come.
        more: Sign that stands for rows or letters left out.
        dot: Separator.
        times: Sign of multiplication.
        line: Horizontal rule.
    """

    status: Mapping[str, str]
    branch: str
    last: str
    through: str
    full: str
    empty: str
    more: str
    dot: str
    times: str
    line: str


UNICODE = Symbols(
    status=MappingProxyType(
        {
            "SUCCESS": "✔",
            "FAILURE": "✘",
            "RUNNING": "▶",
            "INVALID": "·",
            "HALTED": "■",
            "UNFINISHED": "■",
            "REMOVED": "◌",
            "NOT_SPAWNED": "○",
        }
    ),
    branch="├─",
    last="└─",
    through="│ ",
    full="━",
    empty="─",
    more="…",
    dot="·",
    times="×",  # noqa: RUF001 - a multiplication it is
    line="─",
)

ASCII = Symbols(
    status=MappingProxyType(
        {
            "SUCCESS": "+",
            "FAILURE": "x",
            "RUNNING": ">",
            "INVALID": ".",
            "HALTED": "#",
            "UNFINISHED": "#",
            "REMOVED": "-",
            "NOT_SPAWNED": "o",
        }
    ),
    branch="|-",
    last="`-",
    through="| ",
    full="=",
    empty="-",
    more="~",
    dot="|",
    times="x",
    line="-",
)
