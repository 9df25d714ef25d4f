"""Kernels of one control period: control law, observers and collision detection.

`command_set_point` is the entry point of the control law, `detect_collision` that of collision
detection. Array layouts are in `kernel_rows`.
"""

from __future__ import annotations

import math

import numpy as np

from bt_dualarm.control.kernel_rows import (
    BASELINE_TORQUE,
    BEFORE_A,
    BIAS,
    CHANGE,
    COLLISION,
    COMMANDED,
    COMPARE,
    COMPENSATION,
    CONTACT_SQUARE,
    COULOMB,
    DEADBAND,
    DESIRED_Q,
    DEVIATIONS,
    DISTURBANCE,
    DISTURBANCE_TORQUE,
    EXTERNAL_TORQUE,
    FIRST,
    INERTIAL_TORQUE,
    JUDGE,
    LEARN,
    LIMIT,
    MAX_SAMPLES,
    MEAN_V_ERROR,
    MEASURED_Q,
    MEASURED_V,
    MIN_DEVIATION,
    MODEL_A,
    MODEL_A_BEFORE,
    MODEL_ERROR,
    MODEL_MOMENTUM,
    MOVING,
    NET_TORQUE,
    NEW_MODEL,
    NOT_FINITE,
    OFFSET,
    OUTSIDE_LIMITS,
    POSITION_ERROR,
    READ_ENCODERS,
    REVERSAL_PERIODS,
    REVERSAL_SPEED,
    REVERSAL_TORQUE,
    RISE,
    SAMPLES,
    SATURATED,
    SENT_A,
    SENT_Q,
    SENT_V,
    SINCE_REVERSAL,
    SPEED_SHARE,
    STATIC_EXCESS,
    STRIBECK,
    THRESHOLD,
    TOP_SPEED,
    TORQUE,
    VARIANCE,
    VISCOUS,
    WITHIN_LIMITS,
    ControlLaw,
    Q,
    V,
)
from bt_dualarm.core.kernel import kernel
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.kinematics.chain_kernels import equations_of_motion, multiply, solve
from bt_dualarm.sim.device_kernels import command_torques
from bt_dualarm.trajectory.trajectory_kernels import keeps_limits

_PERIOD = 3
"""Index of the period in `law_array`, after three elements of gravity."""


@kernel
def command_set_point(
    numbers: Vector,
    limits: Matrix,
    links: Matrix,
    joints: Matrix,
    inertias: Matrix,
    drives: Matrix,
    flags: int,
    state: Matrix,
    telemetry: Vector,
) -> int:
    """Compute and command the torques for the desired set-point, if it keeps the limits.

    Args:
        numbers: Control law, see `law_array`.
        limits: Joint limits, of shape (LIMITS, dof).
        links: Links of the arm with its payload, see `chain_kernel_arrays`.
        joints: Joint constants, of shape (CONSTANTS, dof).
        inertias: Current and previous inertia matrices, of shape (2, dof, dof), kg m².
        drives: Drives of the joints, see `sim.kernel_arrays`.
        flags: Bits: `READ_ENCODERS`, `NEW_MODEL`, `WITHIN_LIMITS`.
        state: Controller state with the desired and the previous set-point.
        telemetry: Output of shape (TELEMETRY,).

    Returns:
        `OUTSIDE_LIMITS` if the set-point breaks a limit: nothing has changed then. Else the outcome
        of `compute_torques`.
    """
    last = state[SENT_Q : SENT_Q + 3]
    desired = state[DESIRED_Q : DESIRED_Q + 3]
    if not (flags & WITHIN_LIMITS or keeps_limits(limits, numbers[_PERIOD], last, desired)):
        return OUTSIDE_LIMITS
    for row in range(3):
        for i in range(state.shape[1]):
            last[row, i] = desired[row, i]
    reads = flags & READ_ENCODERS != 0
    is_new = flags & NEW_MODEL != 0
    outcome = compute_torques(numbers, links, joints, inertias, reads, is_new, state, telemetry)
    square = 0.0
    for i in range(state.shape[1]):
        square += (state[EXTERNAL_TORQUE, i] - state[BASELINE_TORQUE, i]) ** 2
    telemetry[CONTACT_SQUARE] = square
    if outcome != NOT_FINITE:
        command_torques(state[TORQUE], drives)
    return outcome


@kernel
def compute_torques(
    numbers: Vector,
    links: Matrix,
    joints: Matrix,
    inertias: Matrix,
    reads: bool,
    is_new: bool,
    state: Matrix,
    telemetry: Vector,
) -> int:
    """Update the observers; write torques for the set-point, and the acceleration they produce.

    Args:
        numbers: Control law, see `law_array`.
        links: Links of the arm with its payload, see `chain_kernel_arrays`.
        joints: Joint constants, of shape (CONSTANTS, dof).
        inertias: Current and previous inertia matrices, of shape (2, dof, dof), kg m².
        reads: Whether the state observer still has to use the encoder reading.
        is_new: Whether the model changed since the previous period.
        state: Controller state, of shape (STATE, dof).
        telemetry: Output of shape (TELEMETRY,).

    Returns:
        `COMMANDED`, `SATURATED` or `NOT_FINITE`.
    """
    if reads:
        observe(numbers, state)
    law = law_from(numbers)
    report_tracking(joints, state, telemetry)
    dof = state.shape[1]
    inertia = inertias[0]
    bias = np.empty(dof)
    equations_of_motion(links, law.gravity, state[Q], state[V], inertia, bias)
    observe_external_torque(law, inertia, inertias[1], is_new, state)
    state[BIAS] = bias
    multiply(inertia, state[DISTURBANCE], state[DISTURBANCE_TORQUE])
    desired = np.empty(dof)
    driving = np.empty(dof)
    friction = np.empty(dof)
    _desired_motion(law, joints, state, desired, friction)
    multiply(inertia, desired, driving)
    outcome = _sum_torques(law, joints, driving, friction, bias, state)
    if outcome == NOT_FINITE:
        return outcome
    if outcome == SATURATED:
        _keep_within_effort(law, joints, inertia, bias, state)
    _predict_acceleration(inertia, friction, state)
    return outcome


@kernel
def observe(numbers: Vector, state: Matrix) -> None:
    """Update the state observer with an encoder reading, one period after the previous one."""
    law = law_from(numbers)
    for i in range(state.shape[1]):
        # The drive delay spreads the previous torque over the first part of this period.
        model_a = state[MODEL_A, i] + law.delay_share * (
            state[MODEL_A_BEFORE, i] - state[MODEL_A, i]
        )
        a = model_a + state[DISTURBANCE, i]
        reading = state[MEASURED_Q, i]
        innovation = reading - (state[Q, i] + law.period * state[V, i] + law.position_step * a)
        # Equals prediction + gain_q * innovation.
        state[Q, i] = reading - (1.0 - law.gain_q) * innovation
        state[V, i] += law.period * a + law.gain_v * innovation
        state[DISTURBANCE, i] += law.gain_d * innovation


@kernel
def report_tracking(joints: Matrix, state: Matrix, telemetry: Vector) -> None:
    """Write the largest speed share and position error of the joints into the telemetry."""
    speed_share = 0.0
    position_error = 0.0
    for i in range(state.shape[1]):
        speed_share = max(speed_share, abs(state[MEASURED_V, i]) / joints[TOP_SPEED, i])
        position_error = max(position_error, abs(state[SENT_Q, i] - state[MEASURED_Q, i]))
    telemetry[SPEED_SHARE] = speed_share
    telemetry[POSITION_ERROR] = position_error


@kernel
def observe_external_torque(
    law: ControlLaw, inertia: Matrix, before: Matrix, is_new: bool, state: Matrix
) -> None:
    """Update the momentum observer by one period (see `MomentumObserver`).

    Generalized momentum p = M v obeys ``dp/dt = τ + (dM/dt) v - bias + τ_ext``. Its residual
    ``K (p - ∫(τ + (dM/dt) v - bias + residual) dt)`` follows τ_ext with a lag of 1/K.

    Args:
        law: Control law; K is its `touch_bandwidth`.
        inertia: Current inertia matrix, of shape (dof, dof), kg m².
        before: Inertia matrix of the previous period, of the same shape; overwritten by the current
            one.
        is_new: Whether there is no previous period: the residual starts at zero.
        state: Controller state; its bias is that of the previous period.
    """
    dof = state.shape[1]
    momentum = np.empty(dof)
    old = np.empty(dof)
    multiply(inertia, state[V], momentum)
    if is_new:
        state[MODEL_MOMENTUM] = momentum
        old[:] = momentum
    else:
        multiply(before, state[V], old)
    for i in range(dof):
        # (dM/dt) v from the difference of both inertia matrices.
        change = (momentum[i] - old[i]) / law.period
        rate = state[NET_TORQUE, i] + change - state[BIAS, i] + state[EXTERNAL_TORQUE, i]
        state[MODEL_MOMENTUM, i] += law.period * rate
        state[EXTERNAL_TORQUE, i] = law.touch_bandwidth * (momentum[i] - state[MODEL_MOMENTUM, i])
        for j in range(dof):
            before[i, j] = inertia[i, j]


@kernel
def _desired_motion(
    law: ControlLaw, joints: Matrix, state: Matrix, desired: Vector, friction: Vector
) -> None:
    """Write desired accelerations: feedforward plus feedback; and friction along the set-points."""
    still = True
    for i in range(len(desired)):
        change = state[V, i] - state[SENT_V, i] - state[MEAN_V_ERROR, i]
        state[MEAN_V_ERROR, i] += law.velocity_error_share * change
        still = still and state[SENT_V, i] == 0.0 and state[SENT_A, i] == 0.0
    for i in range(len(desired)):
        sent = state[SENT_A, i]
        # Extrapolated to the middle of the interval in which the torque acts.
        feedforward = sent + law.lead * (sent - state[BEFORE_A, i])
        state[BEFORE_A, i] = sent
        desired[i] = feedforward + _feedback(law, joints, state, still, i)
        # Friction of the commanded velocity, not the measured one: the sign of a noisy
        # measurement around zero would make the torque chatter.
        velocity = state[SENT_V, i] + 0.5 * law.period * feedforward
        friction[i] = _friction(law, joints, velocity, i)


@kernel
def _feedback(law: ControlLaw, joints: Matrix, state: Matrix, still: bool, i: int) -> float:
    """Feedback acceleration ``2w ė + w² e`` of a joint, critically damped.

    Errors are predicted over the drive delay, to the time at which the torque begins to act.
    """
    a_error = state[SENT_A, i] - (state[MODEL_A, i] + state[DISTURBANCE, i])
    # Half a step: semi-implicit Euler steps yield the velocity of their middle.
    v_error = (
        state[SENT_V, i] - law.half_step * state[SENT_A, i] - state[V, i] + law.delay * a_error
    )
    error = state[SENT_Q, i] - state[Q, i] + law.delay * v_error - 0.5 * law.delay**2 * a_error
    if still:
        deadband = joints[DEADBAND, i]
        error -= min(max(error, -deadband), deadband)
    feedback: float = (2.0 * law.bandwidth) * v_error + law.bandwidth**2 * error
    return feedback


@kernel
def _friction(law: ControlLaw, joints: Matrix, v: float, i: int) -> float:
    """Friction torque of a joint in N m at a velocity in rad/s: Stribeck curve plus viscous."""
    level = joints[COULOMB, i]
    if joints[STATIC_EXCESS, i] != 0.0:
        level += joints[STATIC_EXCESS, i] * math.exp(v * v * joints[STRIBECK, i])
    rise = joints[RISE, i]
    offset = joints[OFFSET, i]
    if rise > 0.0:
        share = math.tanh((v + offset) / rise) - math.tanh(offset / rise)
    else:
        share = math.tanh(v / law.friction_speed)
    torque: float = level * share + joints[VISCOUS, i] * v
    return torque


@kernel
def _sum_torques(
    law: ControlLaw, joints: Matrix, driving: Vector, friction: Vector, bias: Vector, state: Matrix
) -> int:
    """Write the motor torques, and add friction and compensation to the bias; return the outcome.

    Afterwards the bias is what is needed to continue without acceleration.
    """
    outcome = COMMANDED
    for i in range(len(bias)):
        # A limited, low-pass filtered torque against the disturbance; at a share of 1, unfiltered.
        most = law.compensation_limit * joints[LIMIT, i]
        against = min(max(-state[DISTURBANCE_TORQUE, i], -most), most)
        state[COMPENSATION, i] = (
            law.compensation_share * against
            + (1.0 - law.compensation_share) * state[COMPENSATION, i]
        )
        bias[i] += friction[i] + state[COMPENSATION, i]
        state[TORQUE, i] = bias[i] + driving[i]
        if not abs(state[TORQUE, i]) <= joints[LIMIT, i]:  # true for NaN as well
            outcome = max(outcome, SATURATED if math.isfinite(state[TORQUE, i]) else NOT_FINITE)
    return outcome


@kernel
def _keep_within_effort(
    law: ControlLaw, joints: Matrix, inertia: Matrix, rest: Vector, state: Matrix
) -> None:
    """Scale the accelerating part of the torques down until all joints are within their efforts.

    Clipping joint by joint would change the direction of the acceleration: an arm that was pushed
    could gain energy until it spins. If even the holding torques exceed the efforts, the arm is so
    fast that no path can be followed, and it only brakes.

    Args:
        law: Control law.
        joints: Joint constants.
        inertia: Inertia matrix, of shape (dof, dof), kg m².
        rest: Torques that continue without acceleration, of shape (dof,), N m.
        state: Controller state; its `TORQUE` is changed.
    """
    dof = len(rest)
    driving = np.empty(dof)
    held = True
    for i in range(dof):
        driving[i] = state[TORQUE, i] - rest[i]
        held = held and abs(rest[i]) <= joints[LIMIT, i]
    if not held:
        multiply(inertia, -2.0 * law.bandwidth * state[MEASURED_V], driving)
        rest[:] = 0.0
    # One share for all joints keeps the direction of the acceleration.
    share = 1.0
    for i in range(dof):
        limit = joints[LIMIT, i]
        room = limit - rest[i] if driving[i] > 0.0 else limit + rest[i]
        share = min(share, room / max(abs(driving[i]), 1e-9))
    for i in range(dof):
        limit = joints[LIMIT, i]
        state[TORQUE, i] = min(max(rest[i] + share * driving[i], -limit), limit)


@kernel
def _predict_acceleration(inertia: Matrix, friction: Vector, state: Matrix) -> None:
    """Write the net torques, and the accelerations that they produce in the model."""
    accelerating = np.empty(len(friction))
    for i in range(len(friction)):
        state[NET_TORQUE, i] = state[TORQUE, i] - friction[i]
        accelerating[i] = state[NET_TORQUE, i] - state[BIAS, i]
        state[MODEL_A_BEFORE, i] = state[MODEL_A, i]
    solve(inertia, accelerating, state[MODEL_A])


@kernel
def detect_collision(
    inertia: Matrix,
    sent: Matrix,
    torque: Vector,
    factor: float,
    flags: int,
    joints: Matrix,
    torques: Matrix,
    changes: Matrix,
) -> int:
    """Update the collision detector by one period (see `CollisionDetector`).

    Args:
        inertia: Inertia matrix, of shape (dof, dof), kg m².
        sent: Velocity and acceleration of the set-point, of shape (2, dof), rad/s, rad/s².
        torque: Disturbance torques, of shape (dof,), N m.
        factor: Multiplies all thresholds.
        flags: Bits: `FIRST`, `COMPARE`, `JUDGE`, `LEARN`.
        joints: Detector state, of shape (DETECTOR_ROWS, dof).
        torques: History of disturbance torques, newest first, of shape (n, dof), N m.
        changes: History of absolute changes of the inertial torque, of the same shape.

    Returns:
        Bits: `MOVING`, `COLLISION`.
    """
    outcome = 0
    v = sent[0]
    for i in range(len(v)):
        _shift_history(inertia, sent[1], torque[i], flags & FIRST != 0, joints, torques, changes, i)
        joints[SINCE_REVERSAL, i] = (
            0.0 if abs(v[i]) < REVERSAL_SPEED else joints[SINCE_REVERSAL, i] + 1.0
        )
        if v[i] != 0.0:
            outcome |= MOVING
        if flags & COMPARE:
            joints[CHANGE, i] = torque[i] - torques[-1, i]
        if flags & JUDGE and _exceeds_threshold(
            inertia, factor, flags & LEARN != 0, joints, changes, i
        ):
            outcome |= COLLISION
    return outcome


@kernel
def _shift_history(
    inertia: Matrix,
    a: Vector,
    torque: float,
    is_first: bool,
    joints: Matrix,
    torques: Matrix,
    changes: Matrix,
    i: int,
) -> None:
    """Append a joint's torques of this period to both histories; the oldest ones drop out."""
    commanded = 0.0
    for j in range(len(a)):
        commanded += inertia[i, j] * a[j]
    if is_first:
        torques[:, i] = torque
        changes[:, i] = 0.0
        joints[INERTIAL_TORQUE, i] = commanded
    for row in range(len(torques) - 1, 0, -1):
        torques[row, i] = torques[row - 1, i]
    for row in range(len(changes) - 1, 0, -1):
        changes[row, i] = changes[row - 1, i]
    torques[0, i] = torque
    changes[0, i] = abs(commanded - joints[INERTIAL_TORQUE, i])
    joints[INERTIAL_TORQUE, i] = commanded


@kernel
def _exceeds_threshold(
    inertia: Matrix, factor: float, learns: bool, joints: Matrix, changes: Matrix, i: int
) -> bool:
    """Write a joint's threshold; return whether the change of its torque exceeds it."""
    allowed = 0.0
    square = 0.0
    for row in range(len(changes)):
        allowed += changes[row, i]
    allowed *= MODEL_ERROR
    # A joint that reversed within the span may have changed the sign of its dry friction.
    turns = joints[SINCE_REVERSAL, i] < REVERSAL_PERIODS
    if turns:
        allowed += joints[REVERSAL_TORQUE, i]
    for j in range(len(inertia)):
        square += inertia[i, j] * inertia[i, j]
    # Independent noise of all joints' accelerations adds up by squares.
    lever = math.sqrt(square)
    deviation = lever * math.sqrt(joints[VARIANCE, i])
    joints[THRESHOLD, i] = factor * (allowed + DEVIATIONS * deviation)
    size = abs(joints[CHANGE, i])
    # Only noise is learned: no reversal, and no commanded change that would drown it.
    if learns and not turns and allowed <= deviation:
        _update_variance(size / lever, joints, i)
    # Written so that NaN counts as a collision.
    return not size <= joints[THRESHOLD, i]


@kernel
def _update_variance(size: float, joints: Matrix, i: int) -> None:
    """Update the variance of a joint that moves steadily with a sample in rad/s²."""
    variance = joints[VARIANCE, i]
    square = min(size * size, 25.0 * variance)  # 5 deviations: a collision must not raise it
    joints[SAMPLES, i] = min(joints[SAMPLES, i] + 1.0, MAX_SAMPLES)
    variance += (square - variance) / joints[SAMPLES, i]
    joints[VARIANCE, i] = max(variance, MIN_DEVIATION * MIN_DEVIATION)


def law_array(law: ControlLaw) -> Vector:
    """Control law as an array of shape (18,): gravity, then the other parameters in order.

    The law crosses into compiled code as an array and becomes a tuple again there: passing a tuple
    of 16 elements costs three times as much as all that is computed with it.
    """
    return np.concatenate((law.gravity, law[1:]))


@kernel
def law_from(numbers: Vector) -> ControlLaw:
    """Control law from its array; the inverse of `law_array`."""
    return ControlLaw(
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
