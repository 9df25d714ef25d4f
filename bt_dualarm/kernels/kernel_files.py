"""The files with a kernel's machine code, of which a broken one is as good as none."""

from __future__ import annotations

import hashlib
import pickle
import zlib
from contextlib import suppress
from pathlib import Path
from uuid import uuid4

import numba
from numba.core.serialize import dumps

_SUM_BYTES = 4


class KernelFiles:
    """The files of one kernel, one for each signature.

    Each begins with a check sum: numba would raise, or LLVM end the process, over a file that was
    cut off by a full disk or a loss of power. Where nothing can be written nothing is kept.

    Args:
        place: Folder of the files.
        name: What their names begin with.
    """

    def __init__(self, place: Path, name: str) -> None:
        self._place = place
        self._name = name

    def load(self, key: object) -> object:
        """What was kept under a key; None where there is nothing, or nothing whole."""
        try:
            whole = self._path(key).read_bytes()
        except OSError:
            return None
        content = whole[_SUM_BYTES:]
        if whole[:_SUM_BYTES] != _check_sum(content):
            return None
        kept_under, data = pickle.loads(content)  # noqa: S301  # from the user's own cache
        return data if kept_under == key else None

    def save(self, key: object, data: object) -> None:
        """Keep machine code, whole or not at all."""
        content: bytes = dumps((key, data))  # type: ignore[no-untyped-call]  # numba has no types
        path = self._path(key)
        part = path.with_name(f"{path.name}.{uuid4().hex}")
        with suppress(OSError):
            try:
                part.write_bytes(_check_sum(content) + content)
                part.replace(path)
            finally:
                part.unlink(missing_ok=True)

    def flush(self) -> None:
        """Forget the code of all signatures."""
        with suppress(OSError):
            for path in self._place.glob(f"{self._name}.*"):
                path.unlink(missing_ok=True)

    def _path(self, key: object) -> Path:
        """The file of a key: a signature, and the processor that the code is for."""
        digest = hashlib.sha256(f"{numba.__version__} {key}".encode()).hexdigest()
        return self._place / f"{self._name}.{digest[:16]}.nbc"


def _check_sum(content: bytes) -> bytes:
    return zlib.crc32(content).to_bytes(_SUM_BYTES, "big")
