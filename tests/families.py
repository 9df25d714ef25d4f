"""Families of like cases: ``make test`` has some of each, ``make matrix`` has all of them."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import TypeVar

ALL = "BT_DUALARM_MATRIX"
"""Environment variable that ``make matrix`` sets; it tests every file that names this module."""

WHOLE = os.environ.get(ALL) == "all"

Case = TypeVar("Case")


def some(cases: Iterable[Case], one_in: int) -> list[Case]:
    """Every so-many-th case, from the first on; every case where ``make matrix`` asks.

    Args:
        cases: Cases that differ in degree: each behavior has to be among those that are taken.
        one_in: How many cases one stands for.
    """
    return [*cases][:: 1 if WHOLE else one_in]
