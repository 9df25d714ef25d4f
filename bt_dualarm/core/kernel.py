"""Compiled kernels: the decorator for numba functions, and the cache of their machine code.

Modules with kernels are named ``…_kernels.py`` and are imported where a kernel is called, because
importing numba takes 0.3 s. Kernels are compiled for the baseline processor of the architecture,
without fused multiply-add or reordering, so results do not depend on the processor. The machine
code is stored in the user's cache directory, in a folder named after a digest of all kernel
sources: it serves every installation of the same sources, writable or not, and a changed kernel
also invalidates its callers. Constants and field orders that are compiled in are therefore defined
in files with ``kernel`` in their names.
"""

from __future__ import annotations

import fcntl
import hashlib
import logging
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from types import ModuleType
from typing import Any, Final, ParamSpec, TypeVar, cast

from bt_dualarm.core.share import folder

_LOG: Final = logging.getLogger(__name__)
_NO_CACHE: Final = "cannot cache function"

Given = ParamSpec("Given")
Returned = TypeVar("Returned")


def kernel(function: Callable[Given, Returned]) -> Callable[Given, Returned]:
    """Compile a function on its first call, or load its machine code from the cache.

    Without a writable cache it is compiled in every process.
    """
    with _settings() as numba:
        from bt_dualarm.core.kernel_cache import keep_code

        compiled = numba.njit(function)
        try:
            keep_code(compiled, function)
        except RuntimeError as error:
            if _NO_CACHE not in str(error):
                raise
    return cast("Callable[Given, Returned]", compiled)


@contextmanager
def _settings() -> Iterator[ModuleType]:
    """Configure numba for our kernels in the block; other packages keep their cache location."""
    os.environ.setdefault("NUMBA_CPU_NAME", "generic")
    import numba

    config: Any = numba.config  # its attributes are created at run time
    config.reload_config()  # another package may have imported it before
    before = config.CACHE_LOCATOR_CLASSES
    config.CACHE_LOCATOR_CLASSES = "bt_dualarm.core.kernel_cache.KernelPlace"
    try:
        yield numba
    finally:
        config.CACHE_LOCATOR_CLASSES = before


def compile_once(warm_ups: Sequence[Callable[[], object]]) -> None:
    """Compile all kernels before they are needed; logs a message if that takes time.

    Of several processes one compiles, and the others wait for it. Does nothing if numba's JIT is
    disabled.

    Args:
        warm_ups: Functions that call all kernels with arguments of the types used later.
    """
    with _settings() as numba:
        if numba.config.DISABLE_JIT:
            return
        mark = folder() / f"compiled-{sys.implementation.cache_tag}-{_target(numba)}"
    if mark.exists():
        return
    often = "once on this machine" if _is_kept() else f"in every run: {folder()} cannot be written"
    _LOG.info("Compiling kernels, %s: about a minute", often)
    with _alone():
        if mark.exists():
            return
        for warm_up in warm_ups:
            warm_up()
        with suppress(OSError):
            mark.touch()


def _target(numba: ModuleType) -> str:
    """Digest of numba's version and target processor; the latter is fixed by its first user."""
    processor = numba.core.registry.cpu_target.target_context.codegen().magic_tuple()
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
