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

from bt_dualarm.recording.columns import pack, unpack

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
    def decoded(cls, content: bytes) -> Block:
        """The block again.

        Raises:
            ValueError: The bytes are of no block.
        """
        try:
            (length,) = _LENGTH.unpack_from(content)
            at = _LENGTH.size + length
            text = zlib.decompressobj().decompress(content[_LENGTH.size : at], _MOST_TEXT)
            head = json.loads(text)
            arrays = {}
            for name, how in head["arrays"].items():
                arrays[str(name)] = unpack(how, content[at : at + int(how["size"])])
                at += int(how["size"])
            return cls(str(head["kind"]), dict(head["data"]), arrays)
        except (struct.error, zlib.error, KeyError, TypeError, AttributeError) as error:
            raise ValueError(f"not a block: {error}") from error
