"""Kernels as Python reads them: what their machine code is held against."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from types import ModuleType
from typing import Any

from bt_dualarm.core import kernel as compiling


def plain(kernel: Callable[..., Any]) -> Callable[..., Any]:
    """The same kernel, and all that it calls, as Python reads it; ``py_func`` is itself alone."""
    found: Callable[..., Any] = getattr(_plain_module(kernel.__module__), kernel.__name__)
    return found


@cache
def _plain_module(name: str) -> ModuleType:
    """A module of kernels of which nothing is compiled, beside the one that everybody has."""
    with _kernels_forgotten(), _decorator_off():
        return importlib.import_module(name)


@contextmanager
def _decorator_off() -> Iterator[None]:
    decorator = compiling.kernel
    compiling.kernel = lambda function: function
    try:
        yield
    finally:
        compiling.kernel = decorator


@contextmanager
def _kernels_forgotten() -> Iterator[None]:
    """Modules of kernels are imported anew meanwhile."""
    before = {name: sys.modules.pop(name) for name in _kernel_modules()}
    try:
        yield
    finally:
        for name in _kernel_modules():
            del sys.modules[name]
            room, _, last = name.rpartition(".")
            delattr(sys.modules[room], last)
        for name, module in before.items():
            sys.modules[name] = module
            room, _, last = name.rpartition(".")
            setattr(sys.modules[room], last, module)


def _kernel_modules() -> list[str]:
    return [name for name in sys.modules if name.endswith("_kernels") and "bt_dualarm" in name]
