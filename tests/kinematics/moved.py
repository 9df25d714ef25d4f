"""Kernels of the control loop applied to random arms: python -m tests.kinematics.moved 0 1.

Writes the pickled results for the given seeds to standard output.
"""

from __future__ import annotations

import pickle
import sys

import numpy as np

from bt_dualarm.control.control_kernels import compute_torques, law_array, observe
from bt_dualarm.control.dynamics import control_law
from bt_dualarm.control.kernel_rows import (
    CONSTANTS,
    LIMIT,
    MEASURED_Q,
    RISE,
    SENT_A,
    SENT_Q,
    SENT_V,
    STATE,
    STRIBECK,
    TELEMETRY,
)
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.kinematics.chain_kernel_arrays import AXIS, INERTIA, LINK

DOF = 5


def drawn_links(rng: np.random.Generator) -> Matrix:
    """Random links with positive masses and inertias."""
    links = rng.uniform(0.05, 0.5, (DOF, LINK))
    links[:, AXIS : AXIS + 3] = rng.normal(size=(DOF, 3))
    links[:, AXIS : AXIS + 3] /= np.linalg.norm(links[:, AXIS : AXIS + 3], axis=1)[:, None]
    for row in links:
        root = rng.normal(size=(3, 3))
        row[INERTIA : INERTIA + 9] = (root @ root.T).ravel()
    return links


def moved(seed: int) -> tuple[list[int], Matrix]:
    """Outcomes of torque computations, saturated and NaN ones included, and the states after."""
    rng = np.random.default_rng(seed)
    joints = rng.uniform(0.1, 1.0, (CONSTANTS, DOF))
    joints[STRIBECK] *= -1.0
    joints[RISE, ::2] = 0.0
    state = np.zeros((STATE, DOF))
    inertias = np.zeros((2, DOF, DOF))
    law = law_array(control_law(0.004, 0.002, np.array((0.0, 0.0, -9.81))))
    links = drawn_links(rng)
    telemetry = np.zeros(TELEMETRY)
    outcomes = []
    states = []
    for step, effort in enumerate((1e6, 1e6, 40.0, 1.0, 1e6, 1e6)):
        joints[LIMIT] = effort
        desired: Vector = rng.normal(size=(3, DOF)) * 0.1
        state[SENT_Q], state[SENT_V], state[SENT_A] = desired
        if step == 4:
            state[SENT_V] = state[SENT_A] = 0.0
        if step == 5:
            state[SENT_Q, 0] = np.nan
        state[MEASURED_Q] = rng.normal(size=DOF) * 0.1
        if step % 2:
            observe(law, state)
        reads = step % 2 == 0
        is_new = step == 0
        outcomes.append(
            compute_torques(law, links, joints, inertias, reads, is_new, state, telemetry)
        )
        states.append(np.vstack((state, np.pad(telemetry, (0, DOF - TELEMETRY)))))
    return outcomes, np.concatenate(states)


if __name__ == "__main__":
    sys.stdout.buffer.write(pickle.dumps([moved(int(seed)) for seed in sys.argv[1:]]))
