"""HTML tables of runs and results for notebooks."""

from __future__ import annotations

import html
from collections.abc import Iterable, Mapping, Sequence

_MOST_METRICS = 6
"""Metrics that one row shows; the result itself has all of them."""


def html_table(caption: str, header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Table of texts as HTML; every text is escaped, none is markup.

    Args:
        caption: One line above the table.
        header: Titles of the columns.
        rows: Texts of the cells, as many in each row as there are titles.
    """
    lines = [f"<table><caption>{html.escape(caption)}</caption>"]
    lines.append(f"<thead>{_row('th', header)}</thead><tbody>")
    lines += [_row("td", row) for row in rows]
    lines.append("</tbody></table>")
    return "\n".join(lines)


def metrics_text(metrics: Mapping[str, object]) -> str:
    """Names and values of the first metrics, to four digits, and how many more there are."""
    parts = [
        f"{name} = {value:.4g}" if isinstance(value, float) else f"{name} = {value}"
        for name, value in metrics.items()
    ]
    more = len(parts) - _MOST_METRICS
    return ", ".join(parts[:_MOST_METRICS]) + (f", and {more} more" if more > 0 else "")


def _row(tag: str, cells: Sequence[str]) -> str:
    # Jupyter aligns cells to the right otherwise, where the indentation of nodes cannot be seen.
    begin = f'<{tag} style="text-align: left">'
    texts = "".join(f"{begin}{html.escape(cell)}</{tag}>" for cell in cells)
    return f"<tr>{texts}</tr>"
