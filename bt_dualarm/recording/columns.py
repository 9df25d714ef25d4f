"""Arrays of numbers as few bytes, without loss: what changes little costs little."""

from __future__ import annotations

import zlib
from typing import Final, TypedDict

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.generic]

_LEVEL: Final = 4
"""Level of zlib: higher ones win 1 % on states of a run, and take twice the time."""

_MOST_BYTES: Final = 1 << 30
"""Bytes that an array may have once it is unpacked: a damaged file must not fill the memory."""

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


def unpack(packed: Packed, content: bytes) -> Array:
    """The array again, bit for bit.

    Raises:
        ValueError: The bytes are not those of such an array.
    """
    if packed["dtype"] not in _KINDS:
        raise ValueError(f"arrays of {packed['dtype']!r} are not known")
    dtype, shape = np.dtype(packed["dtype"]), tuple(packed["shape"])
    expected = int(np.prod(shape, dtype=np.int64)) * dtype.itemsize
    if not 0 <= expected <= _MOST_BYTES:
        raise ValueError(f"an array of {expected} bytes")
    unzip = zlib.decompressobj()
    try:
        plain = unzip.decompress(content, expected + 1)
    except zlib.error as error:
        raise ValueError(str(error)) from error
    if len(plain) != expected:
        raise ValueError(f"an array of {expected} bytes has {len(plain)}")
    planes = np.frombuffer(plain, np.uint8).reshape(dtype.itemsize, -1)
    rows = np.ascontiguousarray(planes.T).view(_unsigned(dtype)).reshape(shape)
    if len(shape) > 1:
        rows = np.bitwise_xor.accumulate(rows, axis=0)
    return rows.view(dtype)


def _shuffled(array: Array) -> bytes:
    rows = array.view(_unsigned(array.dtype))
    if array.ndim > 1:
        rows = rows.copy()
        rows[1:] ^= rows[:-1].copy()
    planes = np.ascontiguousarray(rows.reshape(-1)).view(np.uint8)
    return np.ascontiguousarray(planes.reshape(-1, array.dtype.itemsize).T).tobytes()


def _unsigned(dtype: np.dtype[np.generic]) -> np.dtype[np.generic]:
    return np.dtype(f"<u{dtype.itemsize}") if dtype.itemsize > 1 else np.dtype("|u1")
