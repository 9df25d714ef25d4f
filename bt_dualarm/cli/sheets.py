"""Tables and texts of the catalogues in the terminal."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.table import Table


def print_parts(*parts: str | Table) -> None:
    """Lines and tables, one below the other."""
    from rich.console import Console

    console = Console(highlight=False)
    for part in parts:
        console.print(part)


def print_json(content: object) -> None:
    """For programs."""
    print(json.dumps(content, indent=2, ensure_ascii=False))


def table(titles: Sequence[str], rows: Iterable[Sequence[str]]) -> Table:
    """Rows with titles, without a frame; the first column is never folded."""
    from rich.table import Table

    rows_of = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="dim")
    first, *others = titles
    rows_of.add_column(f"  {first}", no_wrap=True)
    for title in others:
        rows_of.add_column(title)
    for name, *cells in rows:
        rows_of.add_row(f"  {escape(name)}", *map(escape, cells))
    return rows_of


def escape(text: str) -> str:
    """Text in which rich sees no markup."""
    from rich.markup import escape as escaped

    return escaped(text)
