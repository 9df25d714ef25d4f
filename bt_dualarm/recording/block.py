"""A block of a history: some plain data, and arrays by name."""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import numpy.typing as npt

from bt_dualarm.recording.columns import pack, size_of, unpack, unzipped
from bt_dualarm.recording.untrusted import Budget, parsed

_LENGTH: Final = struct.Struct("<I")
_MOST_TEXT: Final = 1 << 26
"""Bytes of plain data in one block: far more than a second of a run has to say."""


@dataclass(frozen=True, eq=False)
class Block:
    """A part of a history.

    Attributes:
        kind: Name that says what the block is about.
        data: Plain data, ready for JSON.
        arrays: Arrays of numbers by name.
    """

    kind: str
    data: Mapping[str, object] = field(default_factory=dict)
    arrays: Mapping[str, npt.NDArray[np.generic]] = field(default_factory=dict)

    def encoded(self) -> bytes:
        """The block as bytes.

        Raises:
            ValueError: Something in it is neither plain data nor an array that is kept.
        """
        packed = {name: pack(array) for name, array in self.arrays.items()}
        head = {
            "kind": self.kind,
            "data": self.data,
            "arrays": {name: how for name, (how, _) in packed.items()},
        }
        text = zlib.compress(json.dumps(head, allow_nan=False, separators=(",", ":")).encode())
        contents = (content for _, content in packed.values())
        return b"".join((_LENGTH.pack(len(text)), text, *contents))

    @classmethod
    def decoded(cls, content: bytes, budget: Budget) -> Block:
        """The block again.

        Args:
            content: Bytes that `encoded` gave, or that somebody else made up.
            budget: Memory that is counted against.

        Raises:
            ValueError: The bytes are of no block, or take too much memory; the message says what
                is wrong with them, and what is expected.
        """
        if len(content) < _LENGTH.size:
            raise ValueError(f"has {len(content)} bytes; expected at least {_LENGTH.size}")
        (length,) = _LENGTH.unpack_from(content)
        at = _LENGTH.size + length
        text = unzipped(content[_LENGTH.size : at], _MOST_TEXT)
        head = parsed(text, budget)
        if not isinstance(head, dict):
            raise ValueError(f"says {type(head).__name__}; expected an object of JSON")
        kind, data, packed = (head.get(name) for name in ("kind", "data", "arrays"))
        if not (isinstance(kind, str) and isinstance(data, dict) and isinstance(packed, dict)):
            raise ValueError("expected a text `kind` and objects `data` and `arrays`")
        arrays = {}
        for name, how in packed.items():
            try:
                size = size_of(how)
                arrays[str(name)] = unpack(how, content[at : at + size], budget)
            except ValueError as error:
                raise ValueError(f"array {str(name)[:80]!r}: {error}") from error
            at += size
        return cls(kind, data, arrays)
