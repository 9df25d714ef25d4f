"""Whether a long way is clear, by machine code: MuJoCo need not look at all of it then."""

from __future__ import annotations

from typing import Final

import numpy as np

from bt_dualarm.motion.collision.checker import CollisionChecker
from bt_dualarm.motion.search.swept import UnknownShapeError, swept
from bt_dualarm.pose import Matrix

_LONG_M: Final = 2.0
"""Metres that the arm moves from which it pays: to gather its shapes takes as long as MuJoCo's
looks at 0.7 m, and to load the code 30 ms in each process."""

_SAMPLES: Final = 12
"""Configurations at which MuJoCo confirms it, the ends among them."""


def is_clear(checker: CollisionChecker, rows: Matrix) -> bool | None:
    """Whether nothing is touched on a way; None where that is not certain, or the way is short.

    What touches at neither end touches nowhere in between, not by a hair; where it is clear, each
    look of MuJoCo's at the way would find nothing, either.

    Args:
        checker: Test of configurations that holds for the way.
        rows: Configurations, of shape (n, dof), rad, straight from one to the next.
    """
    if float((np.abs(np.diff(rows, axis=0)) @ checker.radii).sum()) < _LONG_M:
        return None
    picked = np.linspace(0.0, len(rows) - 1.0, _SAMPLES)
    low = np.minimum(picked.astype(int), len(rows) - 2)
    between = rows[low] + (picked - low)[:, None] * (rows[low + 1] - rows[low])
    if not all(checker.free(q) for q in between):
        return False
    return True if _keeps_off(checker, rows) else None


def _keeps_off(checker: CollisionChecker, rows: Matrix) -> bool:
    from bt_dualarm.motion.search.sweep_kernels import first_too_near

    try:
        arm = swept(checker, (rows[0], rows[-1]))
    except UnknownShapeError:
        return False
    hints, spent = arm.pairs.apart.copy(), np.zeros(1, np.int64)
    rows = np.ascontiguousarray(rows)
    return first_too_near(arm, rows, checker.radii, hints, spent) == len(rows)
