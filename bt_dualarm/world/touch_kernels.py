"""Whether a contact is one that anybody minds, without looking at each from Python."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from bt_dualarm.kernels.kernel import kernel

Pairs: TypeAlias = npt.NDArray[np.int32]
Numbers: TypeAlias = npt.NDArray[np.int64]


@kernel
def any_strange(geoms: Pairs, owner: Numbers, holder: Numbers) -> bool:
    """Whether an arm touches what is neither its own nor held by it.

    Args:
        geoms: Numbers of the shapes of each contact, of shape (n, 2).
        owner: Number of the arm that has a shape, by the shape's number; -1 for none.
        holder: Number of the arm that holds it, likewise; less than -1 for none.
    """
    for i in range(len(geoms)):
        one, other = geoms[i, 0], geoms[i, 1]
        mine, theirs = owner[one], owner[other]
        if mine == theirs or max(mine, theirs) < 0:
            continue
        if holder[one] != theirs and holder[other] != mine:
            return True
    return False
