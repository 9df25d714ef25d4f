"""A record in MCAP, the container that Foxglove and others read: messages in JSON, with schemas."""

from __future__ import annotations

import json
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

from bt_dualarm.replay.message import Message
from bt_dualarm.replay.message_schemas import schema_of
from bt_dualarm.replay.record import ReplayError
from bt_dualarm.runtime.atomic_write import write_atomically

if TYPE_CHECKING:
    from mcap.writer import Writer


def write_mcap(messages: Sequence[Message], path: Path) -> None:
    """Write messages in the order of their times, whole or not at all.

    Args:
        messages: The messages.
        path: File to write.

    Raises:
        ReplayError: The package mcap is not installed.
        OSError: The file cannot be written.
    """
    try:
        from mcap.writer import Writer
    except ImportError as error:
        raise ReplayError("--mcap needs the package mcap (the extra bt_dualarm[export])") from error

    def write(file: object) -> None:
        writer = Writer(file)  # type: ignore[arg-type]  # a binary file
        writer.start(library=f"bt_dualarm {version('bt_dualarm')}")
        _add(writer, messages)
        writer.finish()  # type: ignore[no-untyped-call]  # the package leaves it so

    write_atomically(path, write)


def _add(writer: Writer, messages: Sequence[Message]) -> None:
    schemas: dict[str, int] = {}
    channels: dict[str, int] = {}
    for number, message in enumerate(messages):
        name = message.schema
        if name not in schemas:
            schema = json.dumps(schema_of(name)).encode()
            schemas[name] = writer.register_schema(name, "jsonschema", schema)
        if message.topic not in channels:
            channels[message.topic] = writer.register_channel(message.topic, "json", schemas[name])
        text = json.dumps(message.content, allow_nan=False, separators=(",", ":"))
        time = message.nanoseconds
        writer.add_message(channels[message.topic], time, text.encode(), time, number)
