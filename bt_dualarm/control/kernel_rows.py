"""Array layouts shared by the control kernels and their callers.

Kernels take a few two-dimensional arrays instead of many vectors: passing an array to compiled code
costs about as much as the computation for one joint. Each constant below is the index of a row (one
value per joint), or of an element of a vector.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from bt_dualarm.core.pose import Vector

# Joint constants, of shape (CONSTANTS, dof), for `control_kernels`.
LIMIT: Final = 0
"""Effort limit, N m."""
DEADBAND: Final = 1
"""Position error below which a joint at rest is not corrected, rad."""
COULOMB: Final = 2
"""Coulomb friction, N m."""
STATIC_EXCESS: Final = 3
"""Static minus Coulomb friction, N m."""
STRIBECK: Final = 4
"""-1/v_s² for the Stribeck velocity v_s, s²/rad²."""
VISCOUS: Final = 5
"""Viscous friction, N m s/rad."""
RISE: Final = 6
"""Velocity over which dry friction builds up, rad/s; 0 if it is discontinuous."""
OFFSET: Final = 7
"""Velocity offset of that build-up, rad/s."""
TOP_SPEED: Final = 8
"""Velocity limit of the joint, rad/s."""
CONSTANTS: Final = 9

# Controller state, of shape (STATE, dof); rad, rad/s, rad/s², N m.
MEASURED_Q: Final = 0
"""Positions read from the encoders."""
MEASURED_V: Final = 1
"""Velocities reported by the drives."""
SENT_Q: Final = 2
SENT_V: Final = 3
SENT_A: Final = 4
"""Current set-point: position, velocity, acceleration."""
BEFORE_A: Final = 5
"""Acceleration of the previous set-point."""
Q: Final = 6
V: Final = 7
DISTURBANCE: Final = 8
"""Estimates of the state observer: position, velocity, and disturbance as an acceleration."""
MODEL_A: Final = 9
MODEL_A_BEFORE: Final = 10
"""Accelerations that the last torques, and those before, produce in the model."""
MEAN_V_ERROR: Final = 11
"""Velocity error, low-pass filtered."""
NET_TORQUE: Final = 12
"""Motor torques minus friction."""
EXTERNAL_TORQUE: Final = 13
MODEL_MOMENTUM: Final = 14
"""State of the momentum observer: external torque, and momentum that the model explains."""
BIAS: Final = 15
"""Gravity, Coriolis and centrifugal torques."""
DISTURBANCE_TORQUE: Final = 16
"""Disturbance as a torque: inertia matrix times `DISTURBANCE`."""
TORQUE: Final = 17
"""Motor torques."""
COMPENSATION: Final = 18
"""Torques that compensate the disturbance."""
DESIRED_Q: Final = 19
DESIRED_V: Final = 20
DESIRED_A: Final = 21
"""Set-point that is requested; it is sent if it keeps the limits."""
BASELINE_TORQUE: Final = 22
"""External torques while nothing was in contact: friction and mass errors."""
STATE: Final = 23

# Telemetry, of shape (TELEMETRY,).
SPEED_SHARE: Final = 0
"""Largest joint speed, as a fraction of the joint's limit."""
POSITION_ERROR: Final = 1
"""Largest joint position error, rad."""
CONTACT_SQUARE: Final = 2
"""Squared norm of external torques minus their baseline, (N m)²."""
TELEMETRY: Final = 3

# Outcome of a control period.
COMMANDED: Final = 0
SATURATED: Final = 1
"""Torques were scaled down to the effort limits."""
NOT_FINITE: Final = 2
OUTSIDE_LIMITS: Final = 3
"""The set-point breaks a limit; no torque was computed."""

# Flags of a control period.
READ_ENCODERS: Final = 1
"""The observer has not used the encoder reading yet."""
NEW_MODEL: Final = 2
"""The arm's model changed since the previous period."""
WITHIN_LIMITS: Final = 4
"""The set-point is known to keep the limits."""


class ControlLaw(NamedTuple):
    """Parameters of the control law and its observers; derived in `dynamics.control_law`.

    Attributes:
        gravity: Acceleration of gravity in the world, of shape (3,), m/s².
        period: Control period T, s.
        position_step: Displacement per unit of acceleration within a period, s².
        gain_q: Observer gain of the position, dimensionless.
        gain_v: Observer gain of the velocity, 1/s.
        gain_d: Observer gain of the disturbance, 1/s².
        delay_share: Drive delay as a fraction of the period.
        delay: Drive delay, s.
        lead: Periods from now to the middle of the interval in which a torque acts.
        half_step: Half of the simulation time step, s.
        velocity_error_share: Weight of a new velocity error in its low-pass filter.
        bandwidth: Natural frequency of the position error dynamics, rad/s.
        touch_bandwidth: Bandwidth of the momentum observer, 1/s.
        compensation_limit: Largest disturbance compensation, as a fraction of the effort limit.
        friction_speed: Velocity over which discontinuous dry friction is smoothed, rad/s.
        compensation_share: Weight of a new disturbance in its compensation; see `Compliance`.
    """

    gravity: Vector
    period: float
    position_step: float
    gain_q: float
    gain_v: float
    gain_d: float
    delay_share: float
    delay: float
    lead: float
    half_step: float
    velocity_error_share: float
    bandwidth: float
    touch_bandwidth: float
    compensation_limit: float
    friction_speed: float
    compensation_share: float


# Planar visual servoing (`servo_kernels`).

HOLD_BANDWIDTH: Final = 40.0
"""Bandwidth with which plane distance and orientation are corrected, rad/s."""

POSTURE_BANDWIDTH: Final = 4.0
"""Bandwidth with which a redundant arm returns to its initial posture, rad/s: a tenth of
`HOLD_BANDWIDTH`, so that the null-space motion hardly disturbs the tool."""

BRAKING_BANDWIDTH: Final = 8.0
"""Bandwidth with which the tool comes to rest when it has no target, rad/s."""

FADE_JERK: Final = 0.5
"""Fraction of the plane jerk for letting an acceleration fade."""

LOST_M: Final = 0.02
"""Distance from the plane at which servoing fails, m."""

LOST_RAD: Final = 0.1
"""Orientation error at which servoing fails, rad."""

DAMPING: Final = 1e-6
"""Damping d of the right inverse Jᵀ (J Jᵀ + d I)⁻¹: keeps it finite at a singularity."""

# Servo state, of shape (SERVO_STATE, dof); rows 0 to 4 are the joint limits.
NOW_Q: Final = 5
NOW_V: Final = 6
NOW_A: Final = 7
"""Position and velocity of the next set-point; acceleration of the previous one."""
POSTURE: Final = 8
"""Initial configuration, to which a redundant arm returns, rad."""
HOLD_A: Final = 9
"""Accelerations that correct plane distance and orientation, rad/s²."""
PLANE_RATES: Final = 10
"""Joint rates per unit of tool velocity along each followed axis, 3 rows; zeros beyond them."""
JACOBIAN: Final = 13
"""Jacobian of the tool in the world, linear first, 6 rows."""
JACOBIAN_BEFORE: Final = 19
"""Jacobian at the previous set-point, 6 rows."""
INVERSE: Final = 25
"""Damped right inverse of the Jacobian, transposed, 6 rows."""
SERVO_STATE: Final = 31

# Tool motion along the followed axes, of shape (OBSERVED,): the two of a plane, or three in space.
DISPLACEMENT: Final = 0
"""Displacement along the followed axes since the start, 3 elements, m; zero beyond them."""
VELOCITY: Final = 3
"""Velocity along the followed axes, 3 elements, m/s."""
ACCELERATION: Final = 6
"""Acceleration along the followed axes at the previous set-point, 3 elements, m/s²."""
PLANE_ERROR: Final = 9
"""Signed distance to the plane, m; zero in space."""
ANGLE_ERROR: Final = 10
"""Orientation error as a rotation vector (small angles), 3 elements, rad."""
PLANE_LIMITS: Final = 13
"""Acceleration and jerk that the joints allow along the followed axes, m/s² and m/s³."""
NEEDED: Final = 15
"""Acceleration that the target has needed lately, m/s²."""
OBSERVED: Final = 16

# Outcome of a servo step.
HELD: Final = 0
"""The next set-point keeps the tool in the plane and its orientation."""
LOST: Final = 1
"""The next set-point exceeds `LOST_M` or `LOST_RAD`."""
TOO_LATE: Final = 2
"""Some joint could not stop within its limits after the next set-point."""


class PlaneLimits(NamedTuple):
    """Limits of the tool in every direction of the plane: m/s² and m/s³."""

    acceleration: float
    jerk: float


class Gains(NamedTuple):
    """Gains of the three servo loops: ``c`` and ``b`` in 1/s, ``f`` a share per period."""

    c: float
    b: float
    f: float


# Collision detection (`control_kernels.detect_collision`).

SPAN: Final = 8
"""Periods over which the change of a torque is taken: 32 ms at 250 Hz. A collision builds up within
them; torques from mass and friction errors hardly change."""

DELAY: Final = 16
"""Periods by which the effect of a commanded acceleration may lag: drive and observer delay."""

DEVIATIONS: Final = 8.0
"""Standard deviations of the collision-free torque change that count as a collision."""

MODEL_ERROR: Final = 0.25
"""Relative error of inertial torques that is not a collision: inertia and delays are uncertain."""

REVERSAL_SPEED: Final = 0.04
"""Speed below which dry friction may change sign, rad/s."""

REVERSAL_PERIODS: Final = SPAN + 17
"""Periods for which a reversal widens the threshold: span, plus drive and observer delay."""

MAX_SAMPLES: Final = 100.0
"""Sample count at which the running variance becomes an exponential average."""

MIN_DEVIATION: Final = 0.1
"""Lower bound of the estimated standard deviation, rad/s²."""

# Detector state, of shape (DETECTOR_ROWS, dof).
REVERSAL_TORQUE: Final = 0
"""Change of dry friction when a joint reverses, N m."""
INERTIAL_TORQUE: Final = 1
"""Inertia matrix times the previous commanded acceleration, N m."""
SINCE_REVERSAL: Final = 2
"""Periods since the joint was slower than `REVERSAL_SPEED`."""
VARIANCE: Final = 3
"""Variance of the torque change without a collision, as an acceleration, rad²/s⁴."""
SAMPLES: Final = 4
"""Number of samples in `VARIANCE`."""
CHANGE: Final = 5
"""Change of the external torque over `SPAN`, N m."""
THRESHOLD: Final = 6
"""Absolute change that counts as a collision, N m."""
DETECTOR_ROWS: Final = 7

# Flags of a detection.
FIRST: Final = 1
"""First period: fill the history with the current torque."""
COMPARE: Final = 2
"""The history spans `SPAN` periods: compute the change."""
JUDGE: Final = 4
"""Compare the change with its threshold."""
LEARN: Final = 8
"""Update the variance."""

# Result flags of a detection.
MOVING: Final = 1
"""Some joint is commanded to move."""
COLLISION: Final = 2
"""Some joint's change exceeds its threshold."""
