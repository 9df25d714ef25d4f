"""From a set-point to torques: the control law of `ComputedTorque`, in one call."""

from __future__ import annotations

import math

import numpy as np

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.motion.chains.inertia_kernels import equations, solve, times
from bt_dualarm.motion.chains.kernel_rows import (
    ASKED,
    ASKED_BEFORE,
    BEFORE_A,
    BIAS,
    CONTENT,
    COULOMB,
    DISTURBANCE,
    DISTURBING,
    DRIVING,
    DROP,
    FINE,
    LIMIT,
    MADE_UP,
    NARROW,
    NO_NUMBER,
    OFFSET,
    RISE,
    SATURATED,
    SENT_A,
    SENT_Q,
    SENT_V,
    SPEED,
    TORQUE,
    TREMOR,
    VISCOUS,
    Law,
    Q,
    V,
)
from bt_dualarm.motion.chains.law_kernels import law_in
from bt_dualarm.motion.chains.observer_kernels import feel, observe, tell
from bt_dualarm.pose import Matrix, Vector


@kernel
def drive(
    numbers: Vector,
    links: Matrix,
    joints: Matrix,
    inertias: Matrix,
    reads: bool,
    is_new: bool,
    state: Matrix,
    told: Vector,
) -> int:
    """Take up a reading; enter torques for the set-point, and what they give by the model.

    Args:
        numbers: Numbers of the law, see `numbers_of`.
        links: Links of the arm with what it holds, see `kernel_rows`.
        joints: What is known of the joints, likewise.
        inertias: Inertia matrices of now and of the period before, of shape (2, dof, dof).
        reads: Whether the reading is to be taken up; it may have been already.
        is_new: Whether the arm is another one than in the period before.
        state: State of the arm.
        told: Takes what else is told of the joints, of shape (TOLD,).

    Returns:
        `FINE`, `SATURATED` where the efforts do not suffice, `NO_NUMBER`.
    """
    if reads:
        observe(numbers, state)
    law = law_in(numbers)
    tell(joints, state, told)
    dof = state.shape[1]
    inertia, bias = inertias[0], np.empty(dof)
    equations(links, law.gravity, state[Q], state[V], inertia, bias)
    feel(law, inertia, inertias[1], is_new, state)
    state[BIAS] = bias
    times(inertia, state[DISTURBANCE], state[DISTURBING])
    wanted, driving, rubbing = np.empty(dof), np.empty(dof), np.empty(dof)
    _want(law, joints, state, wanted, rubbing)
    times(inertia, wanted, driving)
    outcome = _add_up(law, joints, driving, rubbing, bias, state)
    if outcome == NO_NUMBER:
        return outcome
    if outcome == SATURATED:
        _keep_within_effort(law, joints, inertia, bias, state)
    _expect(inertia, rubbing, state)
    return outcome


@kernel
def _expect(inertia: Matrix, rubbing: Vector, state: Matrix) -> None:
    """Enter what the torques give the joints by the model, and those of them that drive."""
    accelerating = np.empty(len(rubbing))
    for i in range(len(rubbing)):
        state[DRIVING, i] = state[TORQUE, i] - rubbing[i]
        accelerating[i] = state[DRIVING, i] - state[BIAS, i]
        state[ASKED_BEFORE, i] = state[ASKED, i]
    solve(inertia, accelerating, state[ASKED])


@kernel
def _add_up(
    law: Law, joints: Matrix, driving: Vector, rubbing: Vector, bias: Vector, state: Matrix
) -> int:
    """Enter torques, and into the bias those that only hold; says how they came out."""
    outcome = FINE
    for i in range(len(bias)):
        most = law.compensated * joints[LIMIT, i]
        against = min(max(-state[DISTURBING, i], -most), most)
        state[MADE_UP, i] = law.heeded * against + (1.0 - law.heeded) * state[MADE_UP, i]
        bias[i] += rubbing[i] + state[MADE_UP, i]
        state[TORQUE, i] = bias[i] + driving[i]
        if not abs(state[TORQUE, i]) <= joints[LIMIT, i]:
            outcome = max(outcome, SATURATED if math.isfinite(state[TORQUE, i]) else NO_NUMBER)
    return outcome


@kernel
def _want(law: Law, joints: Matrix, state: Matrix, wanted: Vector, rubbing: Vector) -> None:
    """Enter the accelerations that are wanted, and the torques that rub at what comes of them."""
    still = True
    for i in range(len(wanted)):
        late = state[V, i] - state[SENT_V, i] - state[TREMOR, i]
        state[TREMOR, i] += law.calm * late
        still = still and state[SENT_V, i] == 0.0 and state[SENT_A, i] == 0.0
    for i in range(len(wanted)):
        sent = state[SENT_A, i]
        meant = sent + law.ahead * (sent - state[BEFORE_A, i])
        state[BEFORE_A, i] = sent
        wanted[i] = meant + _correction(law, joints, state, still, i)
        rubbing[i] = _friction(law, joints, state[SENT_V, i] + 0.5 * law.period * meant, i)


@kernel
def _correction(law: Law, joints: Matrix, state: Matrix, still: bool, i: int) -> float:
    """Acceleration that brings a joint back to its set-point.

    The errors are those of the moment at which the torque will act.
    """
    gap = state[SENT_A, i] - (state[ASKED, i] + state[DISTURBANCE, i])
    lag = state[SENT_V, i] - law.half_step * state[SENT_A, i] - state[V, i] + law.delay * gap
    error = state[SENT_Q, i] - state[Q, i] + law.delay * lag - 0.5 * law.delay**2 * gap
    if still:
        content = joints[CONTENT, i]
        error -= min(max(error, -content), content)
    correction: float = (2.0 * law.bandwidth) * lag + law.bandwidth**2 * error
    return correction


@kernel
def _friction(law: Law, joints: Matrix, v: float, i: int) -> float:
    """Torque that a joint needs to rub along at a velocity in rad/s."""
    level = joints[COULOMB, i]
    if joints[DROP, i] != 0.0:
        level += joints[DROP, i] * math.exp(v * v * joints[NARROW, i])
    rise, offset = joints[RISE, i], joints[OFFSET, i]
    if rise > 0.0:
        share = math.tanh((v + offset) / rise) - math.tanh(offset / rise)
    else:
        share = math.tanh(v / law.turn)
    torque: float = level * share + joints[VISCOUS, i] * v
    return torque


@kernel
def _keep_within_effort(
    law: Law, joints: Matrix, inertia: Matrix, rest: Vector, state: Matrix
) -> None:
    """Leave as much of the torques as the joints can give, in their direction.

    Clipped joint by joint they would turn an arm that was knocked elsewhere, and feed it with
    energy until it whirls. So fast that no path can be held, it brakes and does nothing else.

    Args:
        law: Numbers of the law.
        joints: What is known of the joints, see `kernel_rows`.
        inertia: Inertia matrix, of shape (dof, dof), kg m².
        rest: Torques that only hold, of shape (dof,), N m.
        state: State of the arm.
    """
    dof = len(rest)
    drive = np.empty(dof)
    held = True
    for i in range(dof):
        drive[i] = state[TORQUE, i] - rest[i]
        held = held and abs(rest[i]) <= joints[LIMIT, i]
    if not held:
        times(inertia, -2.0 * law.bandwidth * state[SPEED], drive)
        rest[:] = 0.0
    share = 1.0
    for i in range(dof):
        limit = joints[LIMIT, i]
        room = limit - rest[i] if drive[i] > 0.0 else limit + rest[i]
        share = min(share, room / max(abs(drive[i]), 1e-9))
    for i in range(dof):
        limit = joints[LIMIT, i]
        state[TORQUE, i] = min(max(rest[i] + share * drive[i], -limit), limit)
