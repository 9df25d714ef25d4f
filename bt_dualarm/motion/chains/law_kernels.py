"""The numbers of the control law on their way to machine code: an array, then a tuple again.

To hand a tuple of fifteen numbers over costs three times as much as all that is worked out with it.
"""

from __future__ import annotations

import numpy as np

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.motion.chains.kernel_rows import Law
from bt_dualarm.pose import Vector


def numbers_of(law: Law) -> Vector:
    """The law as kernels take it, of shape (18,): gravity, then the others in their order."""
    return np.concatenate((law.gravity, law[1:]))


@kernel
def law_in(numbers: Vector) -> Law:
    """The law again."""
    return Law(
        numbers[:3],
        numbers[3],
        numbers[4],
        numbers[5],
        numbers[6],
        numbers[7],
        numbers[8],
        numbers[9],
        numbers[10],
        numbers[11],
        numbers[12],
        numbers[13],
        numbers[14],
        numbers[15],
        numbers[16],
        numbers[17],
    )
