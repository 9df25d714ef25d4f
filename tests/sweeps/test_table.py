"""Tables of rows: independent of order and files, with varying columns, safe from concurrency."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from bt_dualarm.sweeps import table as table_module
from bt_dualarm.sweeps.job import Row
from bt_dualarm.sweeps.manifest import Manifest, SweepError, checked
from bt_dualarm.sweeps.table import (
    RowStore,
    concat,
    digest,
    ordered,
    read_rows,
    table_of,
)
from tests.sweeps.synthetic import TREE, row_of


@pytest.fixture(scope="module")
def rows() -> list[Row]:
    trials = checked(Manifest(TREE, seeds=tuple(range(12)))).trials()
    return [row_of(trial, works=trial.seed % 3 > 0, error_m=0.1 * trial.seed) for trial in trials]


def test_hash_does_not_depend_on_order_and_files(rows: list[Row], tmp_path: Path) -> None:
    hashes = set()
    for seed in range(4):
        shuffled = [rows[i] for i in np.random.default_rng(seed).permutation(len(rows))]
        folder = tmp_path / str(seed)
        store = RowStore(folder)
        for first in range(0, len(rows), seed + 1):
            store.add(shuffled[first : first + seed + 1])
        if seed == 2:
            store.merge()
        table = read_rows([folder])
        assert table is not None
        hashes.add(digest(ordered(table)))
    assert len(hashes) == 1


def test_hash_includes_results_but_not_costs(rows: list[Row]) -> None:
    base = digest(ordered(table_of(rows)))
    costlier = [{**row, "cpu_s": 9.0, "machine": "there", "attempts": 2} for row in rows]
    assert digest(ordered(table_of(costlier))) == base
    other = [*rows[:-1], {**rows[-1], "metric.arm1.circle.error_m": 0.5}]
    assert digest(ordered(table_of(other))) != base


def test_equal_trials_of_two_folders_count_once(rows: list[Row], tmp_path: Path) -> None:
    RowStore(tmp_path / "a").add(rows[:8])
    RowStore(tmp_path / "b").add(rows[4:])
    table = read_rows([tmp_path / "a", tmp_path / "b"])
    assert table is not None
    assert sorted(table["trial"].to_pylist()) == list(range(12))


def test_columns_may_differ_and_change_their_type() -> None:
    tables = [
        table_of([{"a": 1, "b": "x"}, {"a": 2.5}]),
        table_of([{"a": 3, "c": True}]),
        table_of([{"b": 7}]),
    ]
    assert concat(tables).to_pylist() == [
        {"a": 1.0, "b": "x", "c": None},
        {"a": 2.5, "b": None, "c": None},
        {"a": 3.0, "b": None, "c": True},
        {"a": None, "b": "7", "c": None},
    ]


def test_files_are_merged_into_one(rows: list[Row], tmp_path: Path) -> None:
    store = RowStore(tmp_path)
    for row in rows:
        store.add([row])
    store.merge()
    assert len([*(tmp_path / "rows").iterdir()]) == 1
    assert len(read_rows([tmp_path])) == len(rows)  # type: ignore[arg-type]


def test_folder_name_may_be_invalid_utf8(rows: list[Row], tmp_path: Path) -> None:
    store = RowStore(tmp_path / os.fsdecode(b"caf\xe9"))
    for row in rows:
        store.add([row])
    store.merge()
    table = read_rows([tmp_path / os.fsdecode(b"caf\xe9")])
    assert table is not None
    assert len(table) == len(rows)


def test_folder_without_a_sweep_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(SweepError, match="not the output of a sweep"):
        read_rows([tmp_path])
    (tmp_path / "rows").mkdir()
    (tmp_path / "rows" / "x.parquet").write_bytes(b"no parquet")
    with pytest.raises(SweepError, match="cannot be read"):
        read_rows([tmp_path])


def test_unwritable_folder_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(SweepError, match="cannot write to"):
        RowStore(tmp_path / "file")


def test_rows_merged_by_another_process_are_not_lost(
    rows: list[Row], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = RowStore(tmp_path)
    for row in rows:
        store.add([row])
    read = table_module.read_file
    merging = iter([store.merge])

    def merge_first(path: Path):  # type: ignore[no-untyped-def]
        for merge in merging:
            merge()
        return read(path)

    monkeypatch.setattr(table_module, "read_file", merge_first)
    found = read_rows([tmp_path])
    assert found is not None
    assert len(found) == len(rows)
