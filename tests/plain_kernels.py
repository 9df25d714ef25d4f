"""Kernels in plain Python, as a reference for their machine code."""

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
    """The same kernel, and all that it calls, in plain Python; ``py_func`` covers only itself."""
    found: Callable[..., Any] = getattr(_plain_module(kernel.__module__), kernel.__name__)
    return found


@cache
def _plain_module(name: str) -> ModuleType:
    """An uncompiled copy of a module of kernels, beside the regular one."""
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
    """Within the context, modules of kernels are imported anew."""
    before = {name: sys.modules.pop(name) for name in _kernel_modules()}
    try:
        yield
    finally:
        for name in _kernel_modules():
            del sys.modules[name]
            package, _, last = name.rpartition(".")
            delattr(sys.modules[package], last)
        for name, module in before.items():
            sys.modules[name] = module
            package, _, last = name.rpartition(".")
            setattr(sys.modules[package], last, module)


def _kernel_modules() -> list[str]:
    return [name for name in sys.modules if name.endswith("_kernels") and "bt_dualarm" in name]
