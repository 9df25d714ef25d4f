"""The history file: blocks of data and packed arrays, complete even if the process is killed.

`HistoryWriter` appends each `Block` by one system call, with a checksum; `read_history` reads up to
the first damage. Records are sent around with bug reports, so their files are untrusted: no length,
type or kind of file is used before it is checked, and `ReadBudget` limits the memory.
"""

from __future__ import annotations

import errno
import hashlib
import json
import math
import os
import re
import stat
import struct
import zlib
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, Final, TypedDict

import mujoco
import numpy as np
import numpy.typing as npt
from pydantic_core import from_json

from bt_dualarm.core.errors import DualArmError
from bt_dualarm.core.share import LARGEST_INT

# Untrusted files

MOST_MEMORY: Final = 600 * 2**20
"""Largest size of a record in memory, bytes; with Python and MuJoCo less than 1 GB in total."""

MOST_FILE: Final = 2**30
"""Largest size of one file of a record, bytes."""

_SUSPICIOUS: Final = re.compile(rb"[0-9]{19}|[eE]\+?[0-9]{3}")
"""Pattern of every number that does not fit into 64 bits; strings may match it, too."""

_KINDS: Final = (
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISLNK, "a symbolic link"),
)


class HistoryError(DualArmError):
    """A file of a record cannot be read; the message names the file."""


def file_kind(mode: int) -> str:
    """Name of the type of a file that is not a regular one."""
    return next((name for matches, name in _KINDS if matches(mode)), "a device")


class ReadBudget:
    """Remaining memory for one record.

    Args:
        most: Bytes.
    """

    def __init__(self, most: int = MOST_MEMORY) -> None:
        self._most = self._left = most

    def take(self, count: int) -> None:
        """Reserve bytes before they are allocated.

        Raises:
            ValueError: The budget is exceeded.
        """
        self._left -= count
        if self._left < 0:
            raise ValueError(
                f"the record takes more than {self._most // 2**20} MB of memory once it is unpacked"
            )


def open_regular(path: Path, most: int = MOST_FILE, *, links: bool = False) -> tuple[BinaryIO, int]:
    """Open a file for reading, and return it with its current size in bytes.

    Args:
        path: The file.
        most: Largest size allowed, bytes.
        links: Whether the file may be a symbolic link; one of a record could lead anywhere.

    Raises:
        HistoryError: It does not exist, is not a regular file (but a link, pipe or device), or is
            too large.
    """
    try:
        # Without O_NONBLOCK, opening a pipe waits for a writer.
        flags = os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC
        descriptor = os.open(path, flags if links else flags | os.O_NOFOLLOW)
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise HistoryError(f"{path}: is a symbolic link; expected a regular file") from error
        raise HistoryError(f"cannot read {path}: {error.strerror or error}") from error
    except ValueError as error:  # a null character
        raise HistoryError(f"cannot read {str(path)!r}: {error}") from error
    found = os.fstat(descriptor)
    if not stat.S_ISREG(found.st_mode):
        os.close(descriptor)
        kind = file_kind(found.st_mode)
        raise HistoryError(f"{path}: is {kind}; expected a regular file")
    if found.st_size > most:
        os.close(descriptor)
        raise HistoryError(
            f"{path}: has {found.st_size / 2**20:.0f} MB; expected at most {most // 2**20} MB"
        )
    return os.fdopen(descriptor, "rb"), found.st_size


def read_regular(path: Path, most: int = MOST_FILE, *, links: bool = False) -> bytes:
    """Read a file, up to its size when it is opened; arguments as for `open_regular`.

    Raises:
        HistoryError: As for `open_regular`, or it cannot be read.
    """
    file, size = open_regular(path, most, links=links)
    with file:
        try:
            return file.read(size)
        except OSError as error:
            raise HistoryError(f"cannot read {path}: {error.strerror or error}") from error


def parsed(text: bytes, budget: ReadBudget) -> Any:  # Any: any JSON value
    """Parse JSON whose numbers are all finite and fit into 64 bits.

    Args:
        text: JSON of at most 200 levels.
        budget: Memory budget, from which an upper bound is taken before parsing.

    Raises:
        ValueError: It is not such JSON, or exceeds the budget.
    """
    budget.take(_memory(text))
    data = from_json(text, allow_inf_nan=False)
    if _SUSPICIOUS.search(text):
        _refuse_large_numbers(data)
    return data


def _memory(text: bytes) -> int:
    """Upper bound of the memory in bytes of parsed JSON, from counts of its punctuation."""
    costs = ((b"{", 190), (b"[", 72), (b":", 60), (b",", 36), (b'"', 24))
    # A single character outside the basic plane makes a Python string take 4 bytes per character.
    wide = 1 if text.isascii() and b"\\u" not in text else 4
    return wide * len(text) + sum(cost * text.count(mark) for mark, cost in costs)


def _refuse_large_numbers(data: object) -> None:
    pending = [data]
    while pending:
        value = pending.pop()
        if isinstance(value, dict):
            pending += value.values()
        elif isinstance(value, list):
            pending += value
        elif isinstance(value, float) and not math.isfinite(value):
            raise ValueError("a number is not finite")
        elif isinstance(value, int) and abs(value) > LARGEST_INT:
            raise ValueError(f"a number has {len(str(value))} digits; expected one of 64 bits")


# Packed arrays

Array = npt.NDArray[np.generic]

_LEVEL: Final = 4
"""Compression level of zlib: higher ones save 1 % on states of a run, and take twice as long."""

_MOST_COLUMN_BYTES: Final = 1 << 25
"""Largest size of an unpacked array, bytes; unpacking temporarily takes four times as much."""

_MOST_DIMENSIONS: Final = 4

_COLUMN_KINDS: Final = frozenset({"<f8", "<f4", "<u4", "|u1"})


class Packed(TypedDict):
    """Header of a packed array.

    Attributes:
        dtype: NumPy's type string, little-endian.
        shape: Shape of the array.
        size: Number of packed bytes.
    """

    dtype: str
    shape: list[int]
    size: int


def pack(array: Array) -> tuple[Packed, bytes]:
    """Pack an array; returns its header and its bytes.

    Each row is combined by exclusive or with the previous one, which leaves zeros where nothing
    has changed; bytes of the same significance are grouped; the result is compressed by zlib.

    Args:
        array: Array of float64, float32, uint32 or uint8; rows along the first axis.

    Raises:
        ValueError: It has another type.
    """
    little = np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("<"))
    kind = little.dtype.str
    if kind not in _COLUMN_KINDS:
        raise ValueError(f"arrays of {array.dtype} are not kept")
    content = zlib.compress(_shuffled(little), _LEVEL)
    return {"dtype": kind, "shape": [*array.shape], "size": len(content)}, content


def size_of(packed: object) -> int:
    """Number of bytes of a packed array.

    Raises:
        ValueError: The header is not a valid `Packed`.
    """
    if not isinstance(packed, dict):
        raise ValueError("expected an object with dtype, shape and size")
    if not isinstance(packed.get("dtype"), str) or packed["dtype"] not in _COLUMN_KINDS:
        kinds = ", ".join(sorted(_COLUMN_KINDS))
        raise ValueError(f"dtype is {str(packed.get('dtype'))[:40]!r}; expected one of {kinds}")
    shape = packed.get("shape")
    size = packed.get("size")
    if not (
        isinstance(shape, list)
        and 0 < len(shape) <= _MOST_DIMENSIONS
        and all(type(count) is int and 0 <= count <= _MOST_COLUMN_BYTES for count in shape)
    ):
        raise ValueError(f"shape is {str(shape)[:80]!r}; expected 1 to {_MOST_DIMENSIONS} counts")
    if type(size) is not int or size < 0:
        raise ValueError(f"size is {str(size)[:40]}; expected a number of bytes")
    return size


def unpack(packed: Packed, content: bytes, budget: ReadBudget | None = None) -> Array:
    """Unpack an array, bit for bit.

    Args:
        packed: Its header.
        content: Its packed bytes.
        budget: Memory budget; None for none.

    Raises:
        ValueError: The bytes do not match the header, or exceed the budget.
    """
    size = size_of(packed)
    dtype = np.dtype(packed["dtype"])
    shape = tuple(packed["shape"])
    expected = math.prod(shape) * dtype.itemsize
    if expected > _MOST_COLUMN_BYTES:
        raise ValueError(f"has {expected} bytes; expected at most {_MOST_COLUMN_BYTES}")
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
    """Decompress zlib data of at most ``most`` bytes.

    Raises:
        ValueError: It is damaged or larger.
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


# Blocks

_LENGTH: Final = struct.Struct("<I")
_MOST_TEXT: Final = 1 << 26
"""Largest size of the JSON data of one block, bytes: far more than of a second of a run."""


@dataclass(frozen=True, eq=False)
class Block:
    """A part of a history.

    Attributes:
        kind: Name of the kind of content.
        data: Data in JSON's types.
        arrays: Arrays of numbers by name.
    """

    kind: str
    data: Mapping[str, object] = field(default_factory=dict)
    arrays: Mapping[str, npt.NDArray[np.generic]] = field(default_factory=dict)

    def encoded(self) -> bytes:
        """Encode the block as bytes.

        Raises:
            ValueError: It contains something that is neither JSON nor an array of a valid type.
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
    def decoded(cls, content: bytes, budget: ReadBudget) -> Block:
        """Decode a block from untrusted bytes.

        Args:
            content: Bytes.
            budget: Memory budget.

        Raises:
            ValueError: The bytes are not a block, or exceed the budget; the message states what is
                wrong and what is expected.
        """
        if len(content) < _LENGTH.size:
            raise ValueError(f"has {len(content)} bytes; expected at least {_LENGTH.size}")
        (length,) = _LENGTH.unpack_from(content)
        at = _LENGTH.size + length
        text = unzipped(content[_LENGTH.size : at], _MOST_TEXT)
        head = parsed(text, budget)
        if not isinstance(head, dict):
            raise ValueError(f"says {type(head).__name__}; expected a JSON object")
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


# Files

__all__ = ["MAGIC", "HistoryError", "HistoryFile", "HistoryWriter", "blocks_of", "read_history"]

MAGIC: Final = b"bt_dualarm history 1\n"
"""First bytes of the file, with the version of its format."""

_HEAD: Final = struct.Struct("<4sII")
_MARK: Final = b"BLCK"
_MOST_BYTES: Final = 1 << 26
"""Bytes of one block on the disk."""


class HistoryWriter:
    """Appends blocks; each is one system call, so a killed process leaves only complete blocks.

    Args:
        path: The file, created with the first block.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._file: int | None = None

    def add(self, block: Block) -> None:
        """Append a block.

        Raises:
            OSError: The disk is full, or the file exists already or cannot be created.
        """
        content = block.encoded()
        head = _HEAD.pack(_MARK, len(content), zlib.crc32(content))
        if self._file is None:
            flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND
            self._file = os.open(self.path, flags, 0o644)
            head = MAGIC + head
        left = head + content
        while left:
            left = left[os.write(self._file, left) :]

    def finish(self) -> None:
        """Flush everything to the disk.

        Raises:
            OSError: That failed, or the file was deleted.
        """
        if self._file is not None:
            self.path.stat()
            os.fsync(self._file)

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            os.close(self._file)
            self._file = None


@dataclass(frozen=True, eq=False)
class HistoryFile:
    """Readable part of a history file.

    Attributes:
        blocks: All complete blocks before the first damage, in order.
        torn: Reason why the rest was left out; empty if the file ends with a complete block.
    """

    blocks: tuple[Block, ...]
    torn: str


def read_history(path: Path, budget: ReadBudget | None = None) -> HistoryFile:
    """Read a file up to the first damage.

    Args:
        path: The file.
        budget: Memory budget; by default that of one record.

    Raises:
        HistoryError: It does not exist, is not a regular file, is too large, cannot be read, or is
            not a history of a known format.
    """
    blocks: list[Block] = []
    file, size = open_regular(path)
    with file:
        try:
            for block in _blocks(path, file, size, budget or ReadBudget()):
                blocks.append(block)  # noqa: PERF402 - those before the damage are kept
        except _TornError as torn:
            return HistoryFile(tuple(blocks), str(torn))
    return HistoryFile(tuple(blocks), "")


def blocks_of(path: Path) -> Iterator[Block]:
    """Yield the blocks of a file up to the first damage, with only one of them in memory.

    Raises:
        HistoryError: As for `read_history`.
    """
    file, size = open_regular(path)
    with file, suppress(_TornError):
        yield from _blocks(path, file, size, None)


class _TornError(Exception):
    """The file ends, or is damaged, in the middle of a block."""


def _blocks(path: Path, file: BinaryIO, size: int, budget: ReadBudget | None) -> Iterator[Block]:
    """Yield the blocks of a file; without a budget each may take as much as a whole record."""
    start = _read(path, file, len(MAGIC))
    if start != MAGIC:
        if start.startswith(MAGIC[:-2]):
            raise HistoryError(f"{path} is of another version: {start!r}")
        raise HistoryError(f"{path} is not the history of a run")
    at = len(MAGIC)
    while at < size:
        if at + _HEAD.size > size:
            raise _TornError(f"its last {size - at} bytes are part of a block")
        head = _read(path, file, _HEAD.size)
        mark, length, checksum = _HEAD.unpack(head) if len(head) == _HEAD.size else (b"", 0, 0)
        if mark != _MARK or length > _MOST_BYTES:
            raise _TornError(f"it is damaged from byte {at} on")
        if at + _HEAD.size + length > size:
            raise _TornError(f"its last {size - at} bytes are part of a block")
        body = _read(path, file, length)
        if len(body) < length or zlib.crc32(body) != checksum:
            raise _TornError(f"it is damaged from byte {at} on")
        try:
            yield Block.decoded(body, budget or ReadBudget())
        except ValueError as error:
            raise HistoryError(f"{path}: the block at byte {at}: {error}") from error
        at += _HEAD.size + length


def _read(path: Path, file: BinaryIO, count: int) -> bytes:
    try:
        return file.read(count)
    except OSError as error:
        raise HistoryError(f"cannot read {path}: {error.strerror or error}") from error


# Models
#
# Compiled models of one run share their large parts: attaching an object or spawning an arm makes a
# new model with the same meshes and textures. These are cut out of MuJoCo's binary format and
# stored once, by their digest.

_MIN_PART: Final = 2048
"""Size in bytes from which on a part of a model is stored by its digest."""

MOST_MODEL: Final = 1 << 25
"""Largest size of a model, bytes: sixteen arms with all their meshes have a third of that."""

Bytes = npt.NDArray[np.uint8]


class ModelWriter:
    """Encodes compiled models as blocks, without the parts that earlier blocks contain."""

    def __init__(self) -> None:
        self._written: set[str] = set()

    def block(self, model: mujoco.MjModel, generation: int) -> Block:
        """Encode a model.

        Args:
            model: Compiled model.
            generation: Number of recompilations of the world so far.
        """
        content = np.zeros(mujoco.mj_sizeModel(model), np.uint8)
        mujoco.mj_saveModel(model, None, content)
        whole = content.tobytes()
        cuts = _cuts(model, whole)
        arrays: dict[str, Bytes] = {}
        rest = []
        at = 0
        for start, end, digest in cuts:
            rest.append(whole[at:start])
            at = end
            if digest not in self._written:
                self._written.add(digest)
                arrays[digest] = content[start:end]
        rest.append(whole[at:])
        arrays["rest"] = np.frombuffer(b"".join(rest), np.uint8)
        return Block("model", {"generation": generation, "cuts": cuts}, arrays)


class ModelReader(Mapping[int, bytes]):
    """Binary format of each compiled model of a run, by generation, assembled on access.

    Blocks are untrusted: their cuts must match the stored parts.
    """

    def __init__(self) -> None:
        self._parts: dict[str, Bytes] = {}
        self._models: dict[int, tuple[bytes, list[tuple[int, int, str]]]] = {}

    def add(self, block: Block) -> None:
        """Add the next block of a model, beginning with the first of the run.

        Raises:
            ValueError: The block is inconsistent, or an earlier one is missing; the message says
                what is wrong and what is expected.
        """
        if "rest" not in block.arrays:
            raise ValueError("model: array `rest` is missing")
        for name, part in block.arrays.items():
            if part.dtype != np.uint8 or part.ndim != 1:
                raise ValueError(
                    f"model: array {name[:80]!r} is of {part.dtype}, of {part.ndim} dimensions; "
                    "expected one of bytes"
                )
            if name != "rest":
                self._parts[name] = part.view(np.uint8)
        rest = block.arrays["rest"].tobytes()
        generation: Any = block.data["generation"]
        if generation in self._models:
            raise ValueError(f"model: generation {generation} is already there")
        self._models[generation] = rest, self._checked(block.data["cuts"], len(rest))

    def _checked(self, cuts: object, rest: int) -> list[tuple[int, int, str]]:
        """Check that cuts are in order, have the lengths of their parts, and fit the model."""
        found: list[tuple[int, int, str]] = []
        at = inside = 0
        for number, cut in enumerate(cuts if isinstance(cuts, list) else ()):
            where = f"model: cut {number}"
            if not (isinstance(cut, list) and [type(each) for each in cut] == [int, int, str]):
                raise ValueError(f"{where} is {str(cut)[:80]}; expected begin, end and a digest")
            start, end, digest = cut
            if digest not in self._parts:
                raise ValueError(f"{where}: there is no part {digest[:80]!r}")
            if not at <= start <= end or end - start != len(self._parts[digest]):
                raise ValueError(
                    f"{where} is from {start} to {end}, after {at}, for "
                    f"{len(self._parts[digest])} bytes: they do not fit"
                )
            inside += end - start
            at = end
            found.append((start, end, digest))
        if at - inside > rest or inside + rest > MOST_MODEL:
            raise ValueError(
                f"model: has {inside + rest} bytes, cuts up to {at}; expected at most {MOST_MODEL}"
            )
        return found

    def __getitem__(self, generation: int) -> bytes:
        """MuJoCo's binary form of a model."""
        rest, cuts = self._models[generation]
        pieces: list[bytes] = []
        at = taken = 0
        for start, end, digest in cuts:
            pieces += (rest[taken : taken + start - at], self._parts[digest].tobytes())
            taken += start - at
            at = end
        return b"".join((*pieces, rest[taken:]))

    def __contains__(self, generation: object) -> bool:
        """Whether there is a model of a generation; without this method each test would join it."""
        return generation in self._models

    def __iter__(self) -> Iterator[int]:
        return iter(self._models)

    def __len__(self) -> int:
        return len(self._models)


def _cuts(model: mujoco.MjModel, whole: bytes) -> list[tuple[int, int, str]]:
    """Start, end and digest of the large parts of a model that are found in its binary form."""
    cuts = []
    for name in dir(model):
        if name.startswith("_"):
            continue
        value = getattr(model, name)
        if isinstance(value, np.ndarray) and value.nbytes >= _MIN_PART:
            part = np.ascontiguousarray(value).tobytes()
            at = whole.find(part)
            if at >= 0:
                cuts.append((at, at + len(part), hashlib.sha256(part).hexdigest()))
    apart = []
    end = 0
    for cut in sorted(cuts):
        if cut[0] >= end:
            apart.append(cut)
            end = cut[1]
    return apart
