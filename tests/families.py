"""Families of similar cases: ``make test`` runs some of each, ``make matrix`` runs all."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import TypeVar

ALL = "BT_DUALARM_MATRIX"
"""Environment variable that ``make matrix`` sets; it runs every file that imports this module."""

WHOLE = os.environ.get(ALL) == "all"

Case = TypeVar("Case")


def some(cases: Iterable[Case], one_in: int) -> list[Case]:
    """Every `one_in`-th case, starting with the first; in ``make matrix`` every case.

    Args:
        cases: Cases that differ in degree only: the selected ones must cover each behavior.
        one_in: Number of cases that one represents.
    """
    return [*cases][:: 1 if WHOLE else one_in]
