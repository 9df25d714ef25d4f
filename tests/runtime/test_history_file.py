"""History files: readable up to the last complete block, wherever they are cut or damaged."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_dualarm.runtime.history_file import (
    MAGIC,
    Block,
    HistoryError,
    HistoryWriter,
    read_history,
)

BLOCKS = [
    Block("start", {"name": "a"}),
    Block("second", {"notes": [{"kind": "look"}]}, {"states": np.arange(12.0).reshape(4, 3)}),
    Block("end", {"state_sha256": "0"}, {"key": np.zeros(3)}),
]


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("history") / "run.history"
    writer = HistoryWriter(path)
    for block in BLOCKS:
        writer.add(block)
    writer.finish()
    writer.close()
    return path


def ends(content: bytes) -> list[int]:
    """Length of the file after its magic and after each block."""
    found = [len(MAGIC)]
    at = len(MAGIC)
    for block in BLOCKS:
        at += 12 + len(block.encoded())
        found.append(at)
    assert at == len(content)
    return found


def test_blocks_are_restored(written: Path) -> None:
    history = read_history(written)
    assert history.torn == ""
    assert [block.kind for block in history.blocks] == ["start", "second", "end"]
    assert history.blocks[1].data == BLOCKS[1].data
    np.testing.assert_array_equal(
        history.blocks[1].arrays["states"], BLOCKS[1].arrays["states"], strict=True
    )


@given(st.data())
def test_a_cut_file_keeps_its_complete_blocks(written: Path, data: st.DataObject) -> None:
    content = written.read_bytes()
    length = data.draw(st.integers(len(MAGIC), len(content)))
    cut = written.with_name("cut")
    cut.write_bytes(content[:length])
    history = read_history(cut)
    whole = ends(content)
    assert len(history.blocks) == sum(end <= length for end in whole) - 1
    assert (history.torn == "") == (length in whole)


@given(st.data())
def test_a_damaged_byte_costs_its_block_and_those_after(written: Path, data: st.DataObject) -> None:
    content = bytearray(written.read_bytes())
    at = data.draw(st.integers(len(MAGIC), len(content) - 1))
    content[at] ^= data.draw(st.integers(1, 255))
    damaged = written.with_name("damaged")
    damaged.write_bytes(content)
    history = read_history(damaged)
    assert len(history.blocks) == sum(end <= at for end in ends(bytes(content))) - 1
    assert history.torn


def test_other_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(HistoryError, match="No such file"):
        read_history(tmp_path / "none")
    (tmp_path / "other").write_text("name: tree\n")
    with pytest.raises(HistoryError, match="is not the history of a run"):
        read_history(tmp_path / "other")
    (tmp_path / "later").write_bytes(MAGIC.replace(b"1", b"7"))
    with pytest.raises(HistoryError, match="another version"):
        read_history(tmp_path / "later")


def test_an_existing_file_is_not_overwritten(written: Path) -> None:
    with pytest.raises(FileExistsError):
        HistoryWriter(written).add(BLOCKS[0])
