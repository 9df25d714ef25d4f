"""Files of MCAP, the container that Foxglove and others read: messages in JSON, with schemas.

Written as https://mcap.dev/spec says, without chunks and compression: small enough to need no
package, and the one of that name would bring two compressors with it.
"""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

_MAGIC: Final = b"\x89MCAP0\r\n"
_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE = 0x01, 0x02, 0x03, 0x04, 0x05
_STATISTICS, _DATA_END = 0x0B, 0x0F


@dataclass(frozen=True)
class Message:
    """One message.

    Attributes:
        topic: Name of its channel.
        schema: Name of what it says; viewers know those that begin with ``foxglove.``.
        time_s: Simulated time in s.
        content: Fields, ready for JSON.
    """

    topic: str
    schema: str
    time_s: float
    content: Mapping[str, object]

    @property
    def nanoseconds(self) -> int:
        """Time of the message as the file has it."""
        return round(1e9 * self.time_s)


def mcap_of(messages: Sequence[Message], library: str) -> bytes:
    """A whole file.

    Args:
        messages: Messages in the order of their times.
        library: Name and version of what writes it.
    """
    data = b"".join((_MAGIC, _record(_HEADER, _text("") + _text(library)), *_data(messages)))
    data += _record(_DATA_END, struct.pack("<I", zlib.crc32(data)))
    summary = b"".join((*_declarations(messages), _statistics(messages)))
    start = len(data)
    head = struct.pack("<BQQQ", _FOOTER, 20, start, 0)
    crc = zlib.crc32(summary + head)
    return b"".join((data, summary, head, struct.pack("<I", crc), _MAGIC))


def _data(messages: Sequence[Message]) -> Iterator[bytes]:
    yield from _declarations(messages)
    channels = _channels(messages)
    for number, message in enumerate(messages):
        time = message.nanoseconds
        head = struct.pack("<HIQQ", channels[message.topic][0], number, time, time)
        text = json.dumps(message.content, allow_nan=False, separators=(",", ":"))
        yield _record(_MESSAGE, head + text.encode())


def _channels(messages: Sequence[Message]) -> dict[str, tuple[int, str]]:
    """Number and schema of each topic."""
    found: dict[str, tuple[int, str]] = {}
    for message in messages:
        found.setdefault(message.topic, (len(found), message.schema))
    return found


def _declarations(messages: Sequence[Message]) -> Iterator[bytes]:
    channels = _channels(messages)
    names = list(dict.fromkeys(schema for _, schema in channels.values()))
    for number, name in enumerate(names, 1):
        schema = json.dumps({"type": "object", "title": name}).encode()
        said = struct.pack("<H", number) + _text(name) + _text("jsonschema")
        yield _record(_SCHEMA, said + struct.pack("<I", len(schema)) + schema)
    for topic, (number, name) in channels.items():
        said = struct.pack("<HH", number, names.index(name) + 1) + _text(topic) + _text("json")
        yield _record(_CHANNEL, said + struct.pack("<I", 0))


def _statistics(messages: Sequence[Message]) -> bytes:
    channels = _channels(messages)
    times = [message.nanoseconds for message in messages] or [0]
    counts = dict.fromkeys((number for number, _ in channels.values()), 0)
    for message in messages:
        counts[channels[message.topic][0]] += 1
    schemas = len({schema for _, schema in channels.values()})
    said = struct.pack(
        "<QHIIIIQQ", len(messages), schemas, len(channels), 0, 0, 0, min(times), max(times)
    )
    pairs = b"".join(struct.pack("<HQ", *pair) for pair in counts.items())
    return _record(_STATISTICS, said + struct.pack("<I", len(pairs)) + pairs)


def _record(kind: int, content: bytes) -> bytes:
    return struct.pack("<BQ", kind, len(content)) + content


def _text(text: str) -> bytes:
    said = text.encode()
    return struct.pack("<I", len(said)) + said
