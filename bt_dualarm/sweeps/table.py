"""The table of a sweep: one row per trial, in Parquet files that are complete at any time.

Rows are written in small files that appear at once or not at all, so that the end of any process
loses none that was written. Which trials are left is the difference between the manifest and the
rows, whoever has written them.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Collection, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from secrets import token_hex
from typing import TYPE_CHECKING, Any, BinaryIO, Final

from bt_dualarm.core.errors import DualArmError
from bt_dualarm.core.share import kind_at, write_atomically
from bt_dualarm.sweeps.job import COST_COLUMNS, CRASHED, Row
from bt_dualarm.sweeps.manifest import SweepError

if TYPE_CHECKING:
    import pyarrow as pa

ROWS: Final = "rows"
"""Folder with the files of rows."""

TABLE: Final = "trials.parquet"
"""File with the rows of all trials of the manifest, in their order."""

MANIFEST: Final = "manifest.json"
"""File with the arguments of the sweep, for people and for the report."""

FAULTS: Final = "faults.yaml"
"""File with the faults that every trial has in addition to the tree's, for ``--faults``."""

FIRST_COLUMNS: Final = (
    "trial", "identity", "seed", "reality", "outcome", "code", "arm", "leaf", "cause", "reason",
)  # fmt: skip

_MANY_FILES: Final = 200
"""Files that are merged to one, so that folders stay small."""


def arrow() -> Any:  # Any: a module without types
    """The package pyarrow.

    Raises:
        DualArmError: It is not installed; the message states how to install it.
    """
    try:
        import pyarrow as pa
        import pyarrow.compute
        import pyarrow.parquet
    except ImportError as error:
        raise DualArmError(
            "sweeps write Parquet files, which needs pyarrow: pip install 'bt_dualarm[sweep]'"
        ) from error
    return pa


class RowStore:
    """Rows of one output folder.

    Args:
        folder: Output folder of the sweep; created if missing.

    Raises:
        SweepError: The folder cannot be written to.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder / ROWS
        self._mine: list[Path] = []
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise SweepError(f"cannot write to {folder}: {error.strerror or error}") from error

    def add(self, rows: Sequence[Row]) -> None:
        """Write rows; after the return nothing loses them.

        Raises:
            SweepError: The disk is full, or the folder is gone.
        """
        if not rows:
            return
        self._mine.append(self._write(table_of(rows)))
        if len(self._mine) >= _MANY_FILES:
            self.merge()

    def merge(self) -> None:
        """Merge the files that this object has written; another process may read at any time."""
        if len(self._mine) < 2:
            return
        merged = self._write(concat([read_file(path) for path in self._mine]))
        for path in self._mine:
            path.unlink(missing_ok=True)
        self._mine = [merged]

    def _write(self, table: pa.Table) -> Path:
        path = self._folder / f"{token_hex(8)}.parquet"
        try:
            write_table(table, path)
        except OSError as error:
            raise SweepError(f"cannot write {path}: {error.strerror or error}") from error
        return path


def write_table(table: pa.Table, path: Path) -> None:
    """Write a table to a Parquet file, at once or not at all.

    Raises:
        OSError: It cannot be written.
    """
    write_atomically(path, partial(_put, table))


def _put(table: pa.Table, file: BinaryIO) -> None:
    arrow().parquet.write_table(table, file, compression="zstd")


def table_of(rows: Iterable[Row]) -> pa.Table:
    """Table of rows, whose columns may differ; whole numbers stay whole."""
    pa = arrow()
    listed = list(rows)
    names = dict.fromkeys(name for row in listed for name in row)
    columns = {}
    for name in names:
        values = [row.get(name) for row in listed]
        kinds = {type(value) for value in values if value is not None}
        if kinds <= {int, float} and len(kinds) == 2:
            values = [None if value is None else float(value) for value in values]
        elif len(kinds) > 1:
            values = [None if value is None else _text(value) for value in values]
        columns[name] = values
    return pa.table(columns)


def _text(value: object) -> str:
    return value if isinstance(value, str) else json.dumps(value)


def concat(tables: Sequence[pa.Table]) -> pa.Table:
    """One table of all rows; a column that a table lacks is null there.

    A column that is a number in one table and a text in another becomes text.
    """
    pa = arrow()
    types: dict[str, set[Any]] = {}
    for table in tables:
        for field in table.schema:
            types.setdefault(field.name, set()).add(field.type)
    target = {}
    for name, found in types.items():
        known = found - {pa.null()}
        if len(known) <= 1:
            target[name] = next(iter(known), pa.null())
        elif known <= {pa.int64(), pa.float64()}:
            target[name] = pa.float64()
        else:
            target[name] = pa.string()
    schema = pa.schema(list(target.items()))
    aligned = [
        pa.table(
            {
                name: table[name].cast(kind)
                if name in table.column_names
                else pa.nulls(len(table), kind)
                for name, kind in target.items()
            },
            schema=schema,
        )
        for table in tables
    ]
    return pa.concat_tables(aligned)


def read_file(path: Path) -> pa.Table:
    """Rows of one file.

    Raises:
        SweepError: It is not a Parquet file of a sweep.
    """
    pa = arrow()
    try:
        with pa.OSFile(os.fsencode(path)) as file:  # pyarrow refuses text that is not UTF-8
            table = pa.parquet.read_table(file)
    except (OSError, pa.ArrowException) as error:
        raise SweepError(f"{path} cannot be read: {str(error).splitlines()[0][:200]}") from error
    missing = [name for name in ("trial", "identity", "outcome") if name not in table.column_names]
    if missing:
        raise SweepError(f"{path} has no column '{missing[0]}': it is not of a sweep")
    return table


def read_rows(folders: Iterable[Path]) -> pa.Table | None:
    """All rows in output folders, each identity once; None if there are none.

    Of several rows of one trial, one with a result counts more than one that says that its workers
    died.

    Raises:
        SweepError: A folder is not one of a sweep, or a file cannot be read.
    """
    tables = [table for folder in folders for table in _tables_in(folder)]
    if not tables:
        return None
    table = concat(tables)
    chosen: dict[str, int] = {}
    outcomes = table["outcome"].to_pylist()
    for number, identity in enumerate(table["identity"].to_pylist()):
        before = chosen.setdefault(identity, number)
        if outcomes[before] == CRASHED != outcomes[number]:
            chosen[identity] = number
    return table if len(chosen) == len(table) else table.take(sorted(chosen.values()))


def _tables_in(folder: Path) -> list[pa.Table]:
    """Tables of one output folder, whose files another process may merge meanwhile.

    Raises:
        SweepError: It is not one of a sweep, or a file cannot be read.
    """
    if kind_at(folder / ROWS) != "folder":
        raise SweepError(f"{folder} is not the output of a sweep: it has no folder '{ROWS}'")
    while True:
        tables = []
        for path in sorted((folder / ROWS).glob("*.parquet")):
            try:
                tables.append(read_file(path))
            except SweepError:
                if path.exists():
                    raise
                break  # merged to a file that the list may lack
        else:
            return tables


def ordered(table: pa.Table, identities: Collection[str] | None = None) -> pa.Table:
    """Rows in the order of the trials, the columns in a fixed order.

    Args:
        table: Rows in any order.
        identities: Trials to select; None for all.
    """
    pa = arrow()
    if identities is not None:
        wanted = pa.compute.is_in(table["identity"], pa.array(sorted(identities), pa.string()))
        table = table.filter(wanted)
    table = table.sort_by([("trial", "ascending"), ("identity", "ascending")])
    names = table.column_names
    first = [name for name in FIRST_COLUMNS if name in names]
    params = sorted(name for name in names if name.startswith("param."))
    last = [name for name in COST_COLUMNS if name in names]
    others = sorted(set(names) - {*first, *params, *last})
    return table.select([*first[:2], *params, *first[2:], *others, *last])


def digest(table: pa.Table) -> str:
    """Hash of the results of a sorted table, without the columns that depend on the machine.

    It is the same for every engine, order of execution and number of deaths of workers.
    """
    names = [name for name in table.column_names if name not in COST_COLUMNS]
    hashed = hashlib.sha256(json.dumps(names).encode())
    for name in names:  # by columns, which takes a fifth of the time
        hashed.update(json.dumps(table[name].to_pylist()).encode())
    return hashed.hexdigest()


def columns_of(table: pa.Table, prefix: str) -> Mapping[str, str]:
    """Names of the columns with a prefix, by the rest of their name."""
    return {
        name.removeprefix(prefix): name for name in table.column_names if name.startswith(prefix)
    }
