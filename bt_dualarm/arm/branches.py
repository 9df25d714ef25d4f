"""Choosing among the branches of the inverse kinematics: an arm reaches most paths in several."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from itertools import islice
from typing import Final, TypeVar

import numpy as np

from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Matrix, Vector

MOST_BRANCHES: Final = 16
"""Branches to try: an arm of six joints has eight, and their full turns."""

Branch = TypeVar("Branch")
Planned = TypeVar("Planned")


def first_possible(
    branches: Iterable[Branch],
    attempt: Callable[[Branch], Planned],
    *,
    most: int = MOST_BRANCHES,
    per_tick: int = 1,
    is_final: Callable[[Failure], bool] | None = None,
) -> Generator[None, None, Planned]:
    """Plan in the first branch in which that is possible.

    Yields after every ``per_tick`` branches that are refused, so that a search takes simulated
    time.

    Args:
        branches: Paths or configurations, the preferred one first; computed on demand.
        attempt: Plans in one branch, or raises a `Failure`.
        most: Branches to try.
        per_tick: Branches that are tried in one tick.
        is_final: Whether a refusal ends the search: the branches after it would be refused for the
            same reason, or its reason may vanish and the branch is better than those. By default
            none does.

    Returns:
        What ``attempt`` returned.

    Raises:
        Failure: That of the preferred branch if all are refused, or the final one; as ``branches``.
    """
    refusal: Failure | None = None
    for number, branch in enumerate(islice(branches, most), 1):
        try:
            return attempt(branch)
        except Failure as failure:
            if is_final is not None and is_final(failure):
                raise
            refusal = refusal or failure.with_traceback(None)  # would keep this frame alive
        if number % per_tick == 0:
            yield
    if refusal is None:
        raise ValueError("there are no branches to choose from")
    raise refusal


def beginning_at(q: Vector, paths: Iterable[Matrix]) -> Matrix:
    """The path, of shape (n, dof), rad, that begins at a configuration, or nearest to it.

    Args:
        q: Configuration in which a motion to one of the paths ends, of shape (dof,), rad.
        paths: Configurations along each path, of shape (n, dof), rad; at least one path.
    """
    return min(paths, key=lambda rows: float(np.abs(rows[0] - q).max()))
