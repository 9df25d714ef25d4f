"""From a set-point that is wanted to what the drives are given, in one call."""

from __future__ import annotations

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.motion.chains.kernel_rows import (
    BENT,
    EXTERNAL,
    IS_NEW,
    KEEPS,
    NO_NUMBER,
    PRESSED,
    READS,
    SENT_Q,
    TORQUE,
    UNTOUCHED,
    WANTED_Q,
)
from bt_dualarm.motion.chains.limit_kernels import keep
from bt_dualarm.motion.chains.torque_kernels import drive
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.hardware.hardware_kernels import take_torques

_PERIOD = 3  # place of the period among the numbers of the law, see `law_in`


@kernel
def follow(
    numbers: Vector,
    limits: Matrix,
    links: Matrix,
    joints: Matrix,
    inertias: Matrix,
    drives: Matrix,
    how: int,
    state: Matrix,
    told: Vector,
) -> int:
    """Send a set-point if it keeps the limits: work out torques for it, and command them.

    Args:
        numbers: Numbers of the law, see `numbers_of`.
        limits: Limits of the joints, see `kernel_rows`.
        links: Links of the arm with what it holds, likewise.
        joints: What is known of the joints, likewise.
        inertias: Inertia matrices of now and of the period before, of shape (2, dof, dof).
        drives: What is known of the drives, see `kernel_rows` of the hardware.
        how: Bits: `READS`, `IS_NEW`, `KEEPS`.
        state: State of the arm, with the set-point that is wanted, and the one sent last.
        told: Takes what else is told of the joints, of shape (TOLD,).

    Returns:
        `BENT` where it does not keep the limits, and nothing is done; else as of `drive`.
    """
    last, wanted = state[SENT_Q : SENT_Q + 3], state[WANTED_Q : WANTED_Q + 3]
    if not (how & KEEPS or keep(limits, numbers[_PERIOD], last, wanted)):
        return BENT
    for row in range(3):
        for i in range(state.shape[1]):
            last[row, i] = wanted[row, i]
    reads, is_new = how & READS != 0, how & IS_NEW != 0
    outcome = drive(numbers, links, joints, inertias, reads, is_new, state, told)
    square = 0.0
    for i in range(state.shape[1]):
        square += (state[EXTERNAL, i] - state[UNTOUCHED, i]) ** 2
    told[PRESSED] = square
    if outcome != NO_NUMBER:
        take_torques(state[TORQUE], drives)
    return outcome
