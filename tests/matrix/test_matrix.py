"""Every feature works with every other: each operation on each kind of tree file.

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
"""Columns of ``make test`` whose run is recorded: each end, and each gripper."""

FILMED = "xarm7_weld"
"""The only one of them that is filmed by ``make test``: the shortest."""

ONE_IN = 12
"""One in so many cells of those columns is in ``make test``, in the pattern of a Latin square."""


def chosen() -> Iterator[tuple[Column, str]]:
    """Cells that are tested, column by column, so that a run that was made is used at once."""
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
    """What the row says of itself holds for the column."""
    record_property("row", row)
    record_property("column", column.name)
    ROWS[row](Cell(column, recordings, tmp_path))


def test_every_row_and_every_column_is_tested() -> None:
    """Whatever is added to the matrix is tested by ``make test``, too."""
    cells = {(column.name, row) for column, row in chosen()}
    assert {row for _, row in cells} == set(ROWS)
    assert {column for column, _ in cells} == {column.name for column in columns()}
