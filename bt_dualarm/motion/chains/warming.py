"""All kernels of a chain, called once with arrays of the types that they are given later."""

from __future__ import annotations

import numpy as np

from bt_dualarm.motion.chains.kernel_rows import (
    CONSTANTS,
    KEEPS,
    LIMITS,
    LINK,
    ROTOR,
    STATE,
    TOLD,
    Law,
)
from bt_dualarm.world.hardware.kernel_columns import DRIVES


def move_something() -> None:
    """Have all kernels of the control law compiled."""
    from bt_dualarm.motion.chains.follow_kernels import follow
    from bt_dualarm.motion.chains.observer_kernels import observe

    links, state = np.zeros((1, LINK)), np.zeros((STATE, 1))
    links[:, ROTOR] = 1.0
    law = np.ones(len(Law._fields) + 2)
    observe(law, state)
    joints, told = np.ones((CONSTANTS, 1)), np.zeros(TOLD)
    limits, drives = np.ones((LIMITS, 1)), np.ones((1, DRIVES))
    follow(law, limits, links, joints, np.zeros((2, 1, 1)), drives, KEEPS, state, told)
