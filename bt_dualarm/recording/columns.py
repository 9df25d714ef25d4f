"""Arrays of numbers as few bytes, without loss: what changes little costs little."""

from __future__ import annotations

import math
import zlib
from typing import Final, TypedDict

import numpy as np
import numpy.typing as npt

from bt_dualarm.recording.untrusted import Budget

Array = npt.NDArray[np.generic]

_LEVEL: Final = 4
"""Level of zlib: higher ones win 1 % on states of a run, and take twice the time."""

_MOST_BYTES: Final = 1 << 25
"""Bytes that an array may have once it is unpacked: unpacking takes four times as many."""

_MOST_DIMENSIONS: Final = 4

_KINDS: Final = frozenset({"<f8", "<f4", "<u4", "|u1"})


class Packed(TypedDict):
    """How to read the bytes of an array.

    Attributes:
        dtype: Type of the numbers as NumPy writes it, of little-endian order.
        shape: Shape of the array.
        size: Number of bytes that it takes when packed.
    """

    dtype: str
    shape: list[int]
    size: int


def pack(array: Array) -> tuple[Packed, bytes]:
    """An array as bytes, and what is needed to read them.

    Each row is combined by exclusive or with the one before it, which leaves zeros where nothing
    has changed; bytes of the same weight are put together; the rest is zlib's.

    Args:
        array: Array of float64, float32, uint32 or uint8; rows along the first axis.

    Raises:
        ValueError: It has another type.
    """
    little = np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("<"))
    kind = little.dtype.str
    if kind not in _KINDS:
        raise ValueError(f"arrays of {array.dtype} are not kept")
    content = zlib.compress(_shuffled(little), _LEVEL)
    return {"dtype": kind, "shape": [*array.shape], "size": len(content)}, content


def size_of(packed: object) -> int:
    """Bytes that an array takes when packed.

    Raises:
        ValueError: What is said of it is not a `Packed`.
    """
    if not isinstance(packed, dict):
        raise ValueError("expected an object with dtype, shape and size")
    if not isinstance(packed.get("dtype"), str) or packed["dtype"] not in _KINDS:
        kinds = ", ".join(sorted(_KINDS))
        raise ValueError(f"dtype is {str(packed.get('dtype'))[:40]!r}; expected one of {kinds}")
    shape, size = packed.get("shape"), packed.get("size")
    if not (
        isinstance(shape, list)
        and 0 < len(shape) <= _MOST_DIMENSIONS
        and all(type(count) is int and 0 <= count <= _MOST_BYTES for count in shape)
    ):
        raise ValueError(f"shape is {str(shape)[:80]}; expected 1 to {_MOST_DIMENSIONS} counts")
    if type(size) is not int or size < 0:
        raise ValueError(f"size is {str(size)[:40]}; expected a number of bytes")
    return size


def unpack(packed: Packed, content: bytes, budget: Budget | None = None) -> Array:
    """The array again, bit for bit.

    Args:
        packed: What is said of it.
        content: Its bytes, as packed.
        budget: Memory that it is counted against; None counts nothing.

    Raises:
        ValueError: The bytes are not those of such an array, or it takes too much memory.
    """
    size = size_of(packed)
    dtype, shape = np.dtype(packed["dtype"]), tuple(packed["shape"])
    expected = math.prod(shape) * dtype.itemsize
    if expected > _MOST_BYTES:
        raise ValueError(f"has {expected} bytes; expected at most {_MOST_BYTES}")
    if len(content) != size:
        raise ValueError(f"has {len(content)} bytes; expected {size}")
    if budget is not None:
        budget.take(expected)
    plain = unzipped(content, expected)
    if len(plain) != expected:
        raise ValueError(f"has {len(plain)} bytes unpacked; expected {expected}")
    planes = np.frombuffer(plain, np.uint8).reshape(dtype.itemsize, math.prod(shape))
    rows = np.ascontiguousarray(planes.T).view(_unsigned(dtype)).reshape(shape)
    if len(shape) > 1:
        rows = np.bitwise_xor.accumulate(rows, axis=0)
    return rows.view(dtype)


def unzipped(content: bytes, most: int) -> bytes:
    """What zlib made smaller.

    Raises:
        ValueError: It is damaged, or more than so many bytes.
    """
    unzip = zlib.decompressobj()
    try:
        plain = unzip.decompress(content, most + 1)
    except zlib.error as error:
        raise ValueError(f"cannot be unpacked: {error}") from error
    if len(plain) > most:
        raise ValueError(f"has more bytes unpacked than expected: {most}")
    return plain


def _shuffled(array: Array) -> bytes:
    rows = array.view(_unsigned(array.dtype))
    if array.ndim > 1:
        rows = rows.copy()
        rows[1:] ^= rows[:-1].copy()
    planes = np.ascontiguousarray(rows.reshape(-1)).view(np.uint8)
    return np.ascontiguousarray(planes.reshape(-1, array.dtype.itemsize).T).tobytes()


def _unsigned(dtype: np.dtype[np.generic]) -> np.dtype[np.generic]:
    return np.dtype(f"<u{dtype.itemsize}") if dtype.itemsize > 1 else np.dtype("|u1")
