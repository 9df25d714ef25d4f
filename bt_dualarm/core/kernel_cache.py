"""Where numba keeps the machine code of kernels, and files of which a broken one counts as none."""

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

# The files with a kernel's machine code, of which a broken one is as good as none.


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


# Where numba keeps the machine code of our kernels, and by what it finds it again.


class KernelPlace(UserWideCacheLocator):
    """One folder for every installation of the same sources.

    Numba's own locators add the place of the file, so that each installation compiles anew, and
    make nothing of a folder that has the code but cannot be written.
    """

    def get_cache_path(self) -> str:
        """The folder of these sources."""
        return str(folder())

    def get_source_stamp(self) -> str:
        """Stands for the sources of all kernels, not of this file alone."""
        return folder().name

    def ensure_cache_path(self) -> None:
        """Make the folder; one that is there can be read, at least.

        Raises:
            OSError: There is none, and none can be made.
        """
        folder().mkdir(parents=True, exist_ok=True)


class KernelCache(FunctionCache):
    """The machine code of one kernel, for each signature.

    Numba's own asks for the same byte code, too, which is another without docstrings (``-OO``):
    all would be compiled twice. Here the sources are known by the folder.
    """

    def __init__(self, function: Callable[..., object]) -> None:
        super().__init__(function)  # type: ignore[no-untyped-call]  # numba has no types
        files: Any = KernelFiles(Path(self.cache_path), self._impl.filename_base)
        self._cache_file = files  # numba's own are two for each signature

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
    """Have a compiled function take its code from the folder, and leave it there.

    Raises:
        RuntimeError: There is no such folder, and none can be made.
    """
    compiled._cache = KernelCache(function)
