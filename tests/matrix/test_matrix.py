"""Every operation works on every type of tree file.

``make test`` runs every operation and every column at least once, ``make matrix`` every cell.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.families import WHOLE
from tests.matrix.columns import Column, columns
from tests.matrix.operations import FILMS, ROWS, WITHOUT_A_RUN, Cell
from tests.matrix.recordings import Recordings

SHORT = (
    "panda_panda_hand",
    "ur5_robotiq_2f85",
    "ur3_suction_cup",
    "xarm7_weld",
    "duration",
    "failing",
    "halted",
    "signaled",
    "time_limited",
    "spawn_and_remove",
    "overrun",
    "diverged",
)
"""Columns of ``make test`` whose run is recorded: all endings and all grippers."""

FILMED = "xarm7_weld"
"""The only one of them, the shortest, of which ``make test`` renders videos."""

ONE_IN = 12
"""``make test`` includes one in this many cells of those columns, as in a Latin square."""


def chosen() -> Iterator[tuple[Column, str]]:
    """Cells to test, column by column, so that a recording is used right after it is made."""
    for number, column in enumerate(columns()):
        if WHOLE:
            rows = list(ROWS)
        elif column.name in SHORT:
            first = SHORT.index(column.name)
            rows = [row for at, row in enumerate(ROWS) if (at + first) % ONE_IN == 0]
            rows = [row for row in rows if row not in FILMS]
            rows += FILMS if column.name == FILMED else ()
        else:
            rows = [WITHOUT_A_RUN[number % len(WITHOUT_A_RUN)]]
        for row in rows:
            yield column, row


@pytest.mark.parametrize(
    ("column", "row"),
    [pytest.param(column, row, id=f"{column}-{row}") for column, row in chosen()],
)
def test_cell(
    column: Column,
    row: str,
    recordings: Recordings,
    tmp_path: Path,
    record_property: Callable[[str, object], None],
) -> None:
    """The row's operation works for the column."""
    record_property("row", row)
    record_property("column", column.name)
    ROWS[row](Cell(column, recordings, tmp_path))


def test_every_row_and_every_column_is_tested() -> None:
    """``make test`` also tests all rows and columns that are added to the matrix."""
    cells = {(column.name, row) for column, row in chosen()}
    assert {row for _, row in cells} == set(ROWS)
    assert {column for column, _ in cells} == {column.name for column in columns()}
