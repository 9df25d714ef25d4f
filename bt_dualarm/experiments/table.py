"""The table of results on a terminal, whole on 80 columns."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from rich import box
from rich.console import JustifyMethod
from rich.table import Table
from rich.text import Text

from bt_dualarm.experiments.report import HEADER, row
from bt_dualarm.experiments.results import Result

_WORDS: Final = 3
"""Columns of words, on the left; those of numbers follow."""

_SHOWN: Final = 9
"""Columns on a terminal; the report has them all."""


def table_of(results: Sequence[Result]) -> Table:
    """One line a result; units stand below the names of the columns, which saves width."""
    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=0)
    for number, name in enumerate(HEADER[:_SHOWN]):
        justify: JustifyMethod = "left" if number < _WORDS else "right"
        heading = Text(name.replace(" [", "\n["), justify=justify)
        table.add_column(heading, justify=justify, vertical="bottom", overflow="fold")
    for result in results:
        table.add_row(*(Text(cell) for cell in row(result)[:_SHOWN]))
    return table
