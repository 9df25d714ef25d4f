"""Compiled kernels: the decorator for numba functions, and the cache of their machine code.

Modules with kernels are named ``…_kernels.py`` and are imported where a kernel is called, because
importing numba takes 0.3 s; the same holds for this module. Kernels are compiled for the baseline
processor of the architecture, without fused multiply-add or reordering, so results do not depend on
the processor. The machine code is stored in the user's cache directory, in a folder named after a
digest of all kernel sources: it serves every installation of the same sources, writable or not, and
a changed kernel also invalidates its callers. Constants and field orders that are compiled in are
therefore defined in files with ``kernel`` in their names.
"""

from __future__ import annotations

import fcntl
import hashlib
import logging
import os
import pickle
import sys
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final, ParamSpec, TypeVar, cast
from uuid import uuid4

import numba
from numba.core import registry
from numba.core.caching import FunctionCache, UserWideCacheLocator
from numba.core.serialize import dumps

from bt_dualarm.core.share import folder

_LOG: Final = logging.getLogger(__name__)
_NO_CACHE: Final = "cannot cache function"
_SUM_BYTES = 4

Given = ParamSpec("Given")
Returned = TypeVar("Returned")


def kernel(function: Callable[Given, Returned]) -> Callable[Given, Returned]:
    """Compile a function on its first call, or load its machine code from the cache.

    Without a writable cache it is compiled in every process.
    """
    with _settings():
        compiled = numba.njit(function)
        try:
            keep_code(compiled, function)
        except RuntimeError as error:
            if _NO_CACHE not in str(error):
                raise
    return cast("Callable[Given, Returned]", compiled)


@contextmanager
def _settings() -> Iterator[Any]:  # Any: a module whose attributes are created at run time
    """Configure numba for our kernels in the block; other packages keep their cache location."""
    os.environ.setdefault("NUMBA_CPU_NAME", "generic")
    config: Any = numba.config  # its attributes are created at run time
    config.reload_config()  # another package may have imported it before
    before = config.CACHE_LOCATOR_CLASSES
    config.CACHE_LOCATOR_CLASSES = "bt_dualarm.core.kernel.KernelPlace"
    try:
        yield config
    finally:
        config.CACHE_LOCATOR_CLASSES = before


def compile_once(warm_ups: Sequence[Callable[[], object]]) -> None:
    """Compile all kernels before they are needed; logs a message if that takes time.

    Of several processes one compiles, and the others wait for it. Does nothing if numba's JIT is
    disabled.

    Args:
        warm_ups: Functions that call all kernels with arguments of the types used later.
    """
    with _settings() as config:
        if config.DISABLE_JIT:
            return
        mark = folder() / f"compiled-{sys.implementation.cache_tag}-{_target()}"
    if mark.exists():
        return
    often = "once on this machine" if _is_kept() else f"in every run: {folder()} cannot be written"
    _LOG.info("Compiling kernels, %s: one to three minutes", often)
    with _alone():
        if mark.exists():
            return
        for warm_up in warm_ups:
            warm_up()
        with suppress(OSError):
            mark.touch()


def _target() -> str:
    """Digest of numba's version and target processor; the latter is fixed by its first user."""
    processor = registry.cpu_target.target_context.codegen().magic_tuple()
    return f"{numba.__version__}-{hashlib.sha256(str(processor).encode()).hexdigest()[:8]}"


def _is_kept() -> bool:
    """Whether the next process will find the code that is compiled now."""
    with suppress(OSError):
        folder().mkdir(parents=True, exist_ok=True)
    return os.access(folder(), os.W_OK)


@contextmanager
def _alone() -> Iterator[None]:
    """Hold the lock of compiling processes in the block; no lock if it cannot be written."""
    try:
        file = (folder() / "lock").open("w")
    except OSError:
        yield
        return
    with file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


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
