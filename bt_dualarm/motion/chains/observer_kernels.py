"""What is known of joints at a set-point: their state, and what pushes them."""

from __future__ import annotations

import numpy as np

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.motion.chains.inertia_kernels import times
from bt_dualarm.motion.chains.kernel_rows import (
    ASKED,
    ASKED_BEFORE,
    BEHIND,
    BIAS,
    DISTURBANCE,
    DRIVING,
    EXPLAINED,
    EXTERNAL,
    FASTEST,
    READING,
    SENT_Q,
    SPEED,
    TOP,
    Law,
    Q,
    V,
)
from bt_dualarm.motion.chains.law_kernels import law_in
from bt_dualarm.pose import Matrix, Vector


@kernel
def observe(numbers: Vector, state: Matrix) -> None:
    """Take up a reading, a period after the last one, into the state (see `StateObserver`)."""
    law = law_in(numbers)
    for i in range(state.shape[1]):
        asked = state[ASKED, i] + law.late * (state[ASKED_BEFORE, i] - state[ASKED, i])
        a = asked + state[DISTURBANCE, i]
        reading = state[READING, i]
        surprise = reading - (state[Q, i] + law.period * state[V, i] + law.fall * a)
        state[Q, i] = reading - (1.0 - law.gain_q) * surprise
        state[V, i] += law.period * a + law.gain_v * surprise
        state[DISTURBANCE, i] += law.gain_d * surprise


@kernel
def tell(joints: Matrix, state: Matrix, told: Vector) -> None:
    """Enter how fast the joints are, and how far from the set-point, see `kernel_rows`."""
    fastest, behind = 0.0, 0.0
    for i in range(state.shape[1]):
        fastest = max(fastest, abs(state[SPEED, i]) / joints[TOP, i])
        behind = max(behind, abs(state[SENT_Q, i] - state[READING, i]))
    told[FASTEST], told[BEHIND] = fastest, behind


@kernel
def feel(law: Law, inertia: Matrix, before: Matrix, is_new: bool, state: Matrix) -> None:
    """Take up a period into the external torques (see `MomentumObserver`).

    Args:
        law: Numbers of the observer.
        inertia: Inertia matrix of now, of shape (dof, dof), kg m².
        before: That of the period before; becomes that of now.
        is_new: Whether there was no period before.
        state: State of the arm, whose bias is that of the period before.
    """
    dof = state.shape[1]
    momentum, old = np.empty(dof), np.empty(dof)
    times(inertia, state[V], momentum)
    if is_new:
        state[EXPLAINED] = momentum
        old[:] = momentum
    else:
        times(before, state[V], old)
    for i in range(dof):
        change = (momentum[i] - old[i]) / law.period
        rate = state[DRIVING, i] + change - state[BIAS, i] + state[EXTERNAL, i]
        state[EXPLAINED, i] += law.period * rate
        state[EXTERNAL, i] = law.touch_bandwidth * (momentum[i] - state[EXPLAINED, i])
        for j in range(dof):
            before[i, j] = inertia[i, j]
