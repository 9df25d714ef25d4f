"""Compiled kernels: the decorator for numba functions, and the cache of their machine code.

A module with kernels is called ``…_kernels.py``, and is imported where its kernels are called, not
before: numba takes 0.3 s. Their code is for the plainest processor of its kind and takes no
liberties with arithmetic (no fused multiply-add, nothing reordered), so that its bits depend on no
processor. It is kept in the user's cache directory, in a folder named after the sources of all
kernels: it serves every installation of the same sources, writable or not, and a change of a kernel
is noticed by those that call it, too. What is compiled in besides (constants, the order of fields)
stands in files that have ``kernel`` in their names as well.
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
    """Have a function compiled when it is first called, or its code taken from the cache.

    Where nothing can be kept, it is compiled in every process.
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
    """Numba, as our kernels want it; where it keeps the kernels of others is left alone."""
    os.environ.setdefault("NUMBA_CPU_NAME", "generic")
    import numba

    config: Any = numba.config  # its settings are made at run time
    config.reload_config()  # somebody else may have imported it before
    before = config.CACHE_LOCATOR_CLASSES
    config.CACHE_LOCATOR_CLASSES = "bt_dualarm.core.kernel_cache.KernelPlace"
    try:
        yield numba
    finally:
        config.CACHE_LOCATOR_CLASSES = before


def compile_once(warm_ups: Sequence[Callable[[], object]]) -> None:
    """See to it that machine code is there before it is needed; says so where that takes time.

    Of several processes one compiles, the others wait for it. Where numba is switched off there is
    nothing to do.

    Args:
        warm_ups: Call all the kernels, with arrays of the types that they are given later.
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
    """Which numba compiles, and what for: who has used it before us has settled that."""
    processor = numba.core.registry.cpu_target.target_context.codegen().magic_tuple()
    return f"{numba.__version__}-{hashlib.sha256(str(processor).encode()).hexdigest()[:8]}"


def _is_kept() -> bool:
    """Whether code that is compiled now will be found by the next process."""
    with suppress(OSError):
        folder().mkdir(parents=True, exist_ok=True)
    return os.access(folder(), os.W_OK)


@contextmanager
def _alone() -> Iterator[None]:
    """While no other process compiles; without a lock where none can be written."""
    try:
        file = (folder() / "lock").open("w")
    except OSError:
        yield
        return
    with file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield
