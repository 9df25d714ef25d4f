"""Packages that are imported when they are first used."""

from __future__ import annotations

import importlib
from typing import Any


class Later:
    """Stands for a package that takes long to import until one of its members is needed.

    Args:
        name: Name of the package.
    """

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, member: str) -> Any:  # a package attribute of any type
        found = getattr(importlib.import_module(self._name), member)
        vars(self)[member] = found  # later lookups find it without this call
        return found
