"""All kernels of a chain, called once with arrays of the types that they are given later."""

from __future__ import annotations

import numpy as np

from bt_dualarm.motion.chains.kernel_rows import CONSTANTS, LINK, ROTOR, STATE, TOLD, Law


def move_something() -> None:
    """Have all kernels of the control law compiled."""
    from bt_dualarm.motion.chains.observer_kernels import observe
    from bt_dualarm.motion.chains.torque_kernels import drive

    links, state = np.zeros((1, LINK)), np.zeros((STATE, 1))
    links[:, ROTOR] = 1.0
    law = np.ones(len(Law._fields) + 2)
    observe(law, state)
    joints, told = np.ones((CONSTANTS, 1)), np.zeros(TOLD)
    drive(law, links, joints, np.zeros((2, 1, 1)), False, True, state, told)
