"""What the kernels of a chain read and write: columns of its links, rows of what joints have.

One matrix in place of twenty vectors: to hand an array to machine code costs as much as a joint.
"""

from __future__ import annotations

from typing import Final, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from bt_dualarm.pose import Vector

Stack: TypeAlias = npt.NDArray[np.float64]
"""Matrices, one behind the other."""

Triple: TypeAlias = tuple[float, float, float]
"""A vector of the world: numbers that stay in registers."""

# Columns of the links, of shape (dof, LINK): in the world's axes, all joints at zero.
AXIS: Final = 0
"""Axis of the joint, 3 numbers."""
STEP: Final = 3
"""From the joint before, or from the origin, to this one, 3 numbers, m."""
MASS: Final = 6
"""Mass of the link, kg."""
CENTER: Final = 7
"""From the joint to the link's centre of mass, 3 numbers, m."""
INERTIA: Final = 10
"""Inertia about that centre, 9 numbers, kg m²."""
ROTOR: Final = 19
"""Inertia of the rotor, kg m²."""
LINK: Final = 20

# Rows of the limits of joints, of shape (LIMITS, dof).
LOWER: Final = 0
UPPER: Final = 1
"""Positions, rad."""
MOST_VELOCITY: Final = 2
MOST_ACCELERATION: Final = 3
MOST_JERK: Final = 4
"""Rates, rad/s, rad/s², rad/s³."""
LIMITS: Final = 5
ROUNDING: Final = 1e-6
"""In rad, and as a share of a rate's limit: floating point, not motion."""

# Rows of what is known of the joints, of shape (CONSTANTS, dof).
LIMIT: Final = 0
"""Effort, N m."""
CONTENT: Final = 1
"""Error at which a joint that stands is left alone, rad."""
COULOMB: Final = 2
"""Dry friction, N m."""
DROP: Final = 3
"""How much more of it a joint has that stands, N m."""
NARROW: Final = 4
"""-1/v_s² of the speed at which that is left behind, s²/rad²."""
VISCOUS: Final = 5
"""Friction that grows with speed, N m s/rad."""
RISE: Final = 6
"""Speed over which dry friction builds up, rad/s; 0 where it is there at once."""
OFFSET: Final = 7
"""Offset of the speed at which it does, rad/s."""
TOP: Final = 8
"""Speed that the joint can do, rad/s."""
CONSTANTS: Final = 9

# Rows of the state, of shape (STATE, dof); rad, rad/s, rad/s², N m.
READING: Final = 0
"""Positions by the encoders."""
SPEED: Final = 1
"""Velocities by the drives."""
SENT_Q: Final = 2
SENT_V: Final = 3
SENT_A: Final = 4
"""The set-point."""
BEFORE_A: Final = 5
"""Acceleration of the one before."""
Q: Final = 6
V: Final = 7
DISTURBANCE: Final = 8
"""State by the observer, and the acceleration that nobody has asked for."""
ASKED: Final = 9
ASKED_BEFORE: Final = 10
"""Accelerations that the last torques give by the model, and those before."""
TREMOR: Final = 11
"""By how much velocities differ from those meant, averaged."""
DRIVING: Final = 12
"""Torques of the motors without what friction takes of them."""
EXTERNAL: Final = 13
EXPLAINED: Final = 14
"""External torques; and the momentum that all else explains."""
BIAS: Final = 15
"""Torques of gravity and of velocity."""
DISTURBING: Final = 16
"""Torques that would disturb the nominal arm as much."""
TORQUE: Final = 17
"""Torques of the motors."""
MADE_UP: Final = 18
"""Torques that make up for what disturbs it: all of it, or what was there for some time."""
WANTED_Q: Final = 19
WANTED_V: Final = 20
WANTED_A: Final = 21
"""The set-point that is wanted; it is sent if it keeps the limits."""
UNTOUCHED: Final = 22
"""External torques while nothing was touched."""
STATE: Final = 23

# What is told of the joints besides, of shape (TOLD,).
FASTEST: Final = 0
"""Largest speed, as a share of what the joint can do."""
BEHIND: Final = 1
"""Largest distance from the set-point, rad."""
PRESSED: Final = 2
"""Square of how much external torques differ from those while nothing was touched, (N m)²."""
TOLD: Final = 3

# How a torque came out.
FINE: Final = 0
SATURATED: Final = 1
NO_NUMBER: Final = 2
BENT: Final = 3
"""There is none: the set-point does not keep the limits."""

# Which set-point is handed over; bits.
READS: Final = 1
"""The encoders' reading is to be taken up with it."""
IS_NEW: Final = 2
"""The arm is another one than in the period before."""
KEEPS: Final = 4
"""It is known to keep the limits."""


class Law(NamedTuple):
    """Numbers of the control law and of its observers; `ComputedTorque` says what they are.

    Attributes:
        gravity: Acceleration of gravity in the world, of shape (3,), m/s².
        period: Seconds for which a torque is held.
        fall: Way that an acceleration of one leads in a period, s².
        gain_q: Share of a surprise that positions take up.
        gain_v: Gain of the velocities, 1/s.
        gain_d: Gain of the disturbance, 1/s².
        late: Share of a period until a torque acts.
        delay: Time until a torque acts, s.
        ahead: Periods from now to the middle of what a torque acts for.
        half_step: Half a step of the plant's physics, s.
        calm: Share of a tremor that is taken up in a period.
        bandwidth: Natural frequency of the error dynamics, rad/s.
        touch_bandwidth: Bandwidth of the external torques, 1/s.
        compensated: Share of the effort with which a disturbance is made up for.
        turn: Speed over which dry friction changes sides, rad/s.
        heeded: Share of a new disturbance that is made up for in a period; see `Compliance`.
    """

    gravity: Vector
    period: float
    fall: float
    gain_q: float
    gain_v: float
    gain_d: float
    late: float
    delay: float
    ahead: float
    half_step: float
    calm: float
    bandwidth: float
    touch_bandwidth: float
    compensated: float
    turn: float
    heeded: float
