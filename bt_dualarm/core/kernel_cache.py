"""Cache of the kernels' machine code: its location, and files that are checked for damage."""

from __future__ import annotations

import hashlib
import pickle
import zlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any
from uuid import uuid4

import numba
from numba.core.caching import FunctionCache, UserWideCacheLocator
from numba.core.serialize import dumps

from bt_dualarm.core.share import folder

_SUM_BYTES = 4


class KernelFiles:
    """Cache files of one kernel, one per signature.

    Each begins with a checksum: numba would raise, or LLVM would end the process, on a file that
    was truncated by a full disk or a power failure. Without write access nothing is stored.

    Args:
        place: Folder of the files.
        name: Prefix of their names.
    """

    def __init__(self, place: Path, name: str) -> None:
        self._place = place
        self._name = name

    def load(self, key: object) -> object:
        """Returns the data stored under a key; None if there are none or they are damaged."""
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
        """Store machine code atomically."""
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
        """Delete the code of all signatures."""
        with suppress(OSError):
            for path in self._place.glob(f"{self._name}.*"):
                path.unlink(missing_ok=True)

    def _path(self, key: object) -> Path:
        """Path of the file of a key: a signature and the target processor."""
        digest = hashlib.sha256(f"{numba.__version__} {key}".encode()).hexdigest()
        return self._place / f"{self._name}.{digest[:16]}.nbc"


def _check_sum(content: bytes) -> bytes:
    return zlib.crc32(content).to_bytes(_SUM_BYTES, "big")


class KernelPlace(UserWideCacheLocator):
    """Cache locator with one folder for all installations of the same sources.

    Numba's own locators add the file's location, so each installation would compile again, and they
    do not use a folder that has the code but is not writable.
    """

    def get_cache_path(self) -> str:
        """Returns the folder of these sources."""
        return str(folder())

    def get_source_stamp(self) -> str:
        """Returns a stamp of the sources of all kernels, rather than of this file alone."""
        return folder().name

    def ensure_cache_path(self) -> None:
        """Create the folder; an existing one is at least readable.

        Raises:
            OSError: It does not exist and cannot be created.
        """
        folder().mkdir(parents=True, exist_ok=True)


class KernelCache(FunctionCache):
    """Machine code of one kernel, per signature.

    Numba's cache also compares the byte code, which differs without docstrings (``-OO``), so
    everything would be compiled twice. Here the folder identifies the sources.
    """

    def __init__(self, function: Callable[..., object]) -> None:
        super().__init__(function)  # type: ignore[no-untyped-call]  # numba has no types
        files: Any = KernelFiles(Path(self.cache_path), self._impl.filename_base)
        self._cache_file = files  # numba itself uses two per signature

    def _index_key(
        self,
        sig: object,
        codegen: Any,  # numba has no types
    ) -> tuple[object, ...]:
        return sig, codegen.magic_tuple()


def keep_code(
    compiled: Any,  # numba has no types
    function: Callable[..., object],
) -> None:
    """Let a compiled function load its code from the cache folder and store it there.

    Raises:
        RuntimeError: The folder does not exist and cannot be created.
    """
    compiled._cache = KernelCache(function)
