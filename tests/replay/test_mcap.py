"""What is exported as MCAP is a file as its specification says, with all that the record has."""

from __future__ import annotations

import json
import struct
import zlib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from bt_dualarm import cli
from bt_dualarm.replay.mcap_file import Message, mcap_of
from bt_dualarm.replay.messages import messages_of
from bt_dualarm.replay.record import Record
from tests.replay.runs import recorded

MAGIC = b"\x89MCAP0\r\n"


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> Record:
    return recorded(tmp_path_factory.mktemp("short"))


def records(content: bytes) -> Iterator[tuple[int, int, bytes]]:
    """Place, kind and content of every record, read by the specification."""
    assert content[:8] == content[-8:] == MAGIC
    at = 8
    while at < len(content) - 8:
        kind, length = struct.unpack_from("<BQ", content, at)
        yield at, kind, content[at + 9 : at + 9 + length]
        at += 9 + length
    assert at == len(content) - 8


def topic_of(channel: bytes) -> tuple[int, str]:
    number, _, length = struct.unpack_from("<HHI", channel)
    return number, channel[8 : 8 + length].decode()


def test_it_has_all_events_and_joints_in_their_order(short: Record) -> None:
    content = mcap_of(messages_of(short), "test 1")
    found = [*records(content)]
    topics = dict(topic_of(record) for _, kind, record in found if kind == 4)
    messages = [record for _, kind, record in found if kind == 5]
    heads = [struct.unpack_from("<HIQQ", message) for message in messages]
    assert [head[2] for head in heads] == sorted(head[2] for head in heads)
    counts = Counter(topics[head[0]] for head in heads)
    assert counts["/status"] == len(short.events)
    assert counts["/arm1/joints"] == len(short.times)
    assert counts["/bodies"] == -(-len(short.times) // 2)
    said: list[dict[str, Any]] = [
        json.loads(message[22:])
        for head, message in zip(heads, messages, strict=True)
        if topics[head[0]] == "/status"
    ]
    assert said == list(short.events)


def test_its_checksums_and_its_summary_are_right(short: Record) -> None:
    content = mcap_of(messages_of(short), "test 1")
    found = [*records(content)]
    end = next(at for at, kind, _ in found if kind == 0x0F)
    footer_at, _, footer = next(each for each in found if each[1] == 0x02)
    assert found[[at for at, *_ in found].index(end)][2] == struct.pack(
        "<I", zlib.crc32(content[:end])
    )
    start, _, crc = struct.unpack("<QQI", footer)
    assert start == end + 9 + 4
    assert crc == zlib.crc32(content[start : footer_at + 9 + 16])
    statistics = next(record for _, kind, record in found if kind == 0x0B)
    count, schemas, channels = struct.unpack_from("<QHI", statistics)
    assert count == sum(kind == 5 for _, kind, _ in found)
    assert channels == sum(kind == 4 and at < end for at, kind, _ in found)
    assert schemas == sum(kind == 3 and at < end for at, kind, _ in found)


def test_the_package_of_that_name_reads_it(short: Record, tmp_path: Path) -> None:
    reader = pytest.importorskip("mcap.reader")
    path = tmp_path / "short.mcap"
    assert cli.record(["export", str(short.folder), "--mcap", str(path)]) == 0
    with path.open("rb") as file:
        made = reader.make_reader(file, validate_crcs=True)
        summary = made.get_summary()
        assert summary.statistics.message_count == sum(1 for _ in made.iter_messages())
        names = {schema.name for schema in summary.schemas.values()}
    assert "foxglove.FrameTransforms" in names


def test_a_file_without_messages_is_one_too() -> None:
    assert [kind for _, kind, _ in records(mcap_of((), "test 1"))] == [0x01, 0x0F, 0x0B, 0x02]


def test_what_is_no_number_is_refused() -> None:
    with pytest.raises(ValueError, match="Out of range"):
        mcap_of([Message("/a", "A", 0.0, {"x": float("nan")})], "test 1")
