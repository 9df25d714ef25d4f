"""The numbers of the control law, and what it knows of the joints of one arm."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from bt_dualarm.motion.chains.kernel_rows import (
    CONSTANTS,
    CONTENT,
    COULOMB,
    DROP,
    LIMIT,
    NARROW,
    OFFSET,
    RISE,
    TOP,
    VISCOUS,
    Law,
)
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.nominal.nominal_arm import NominalArm

BANDWIDTH: Final = 75.0
"""Natural frequency of the error dynamics in rad/s: e'' + 2we' + w²e = 0 (critically damped).

Drives that take 3 ms more than is believed bear it, with inertia off by a fifth; 90 they do not.
"""

OBSERVER_BANDWIDTH: Final = 300.0
"""All poles of the observer's error, in 1/s: four times that of the control loop, so that the loop
hardly feels it; an encoder's noise of 2e-5 rad then is 6e-3 rad/s of velocity."""

TOUCH_BANDWIDTH: Final = 50.0
"""Of the external torques, in 1/s: they have 63 % of a push after 20 ms."""

DRIVE_DELAY_S: Final = 0.001
"""Until a torque acts: what drives with a torque interface of 1 kHz need at least."""

_COMPENSATED: Final = 0.3
"""Share of a joint's effort with which a disturbance is made up for: dry friction that is twice
what is believed, masses that are off by a fifth; no more, or an arm that leans on something would
push ever harder."""

_CONTENT: Final = 1e-4
"""Error in rad at which a joint that rubs and is to stand is left alone: the tool is within 0.1 mm.
Dry friction and an observer would hunt for less for ever."""

_TREMOR_S: Final = 0.05  # over which it is averaged by how much velocities differ from those meant

_TURN: Final = 0.02
"""Speed in rad/s over which dry friction changes sides: of a joint that turns back, nobody knows
better when it stands."""


def law_of(period: float, timestep: float, gravity: Vector) -> Law:
    """The numbers of the control law.

    Args:
        period: Seconds between two readings, for which a torque is held.
        timestep: Seconds of a step of the plant's physics.
        gravity: Acceleration of gravity in the world, of shape (3,), m/s².
    """
    pole = math.exp(-OBSERVER_BANDWIDTH * period)
    return Law(
        gravity=gravity,
        period=period,
        fall=0.5 * period * (period + timestep),  # Euler steps move by the velocity at their end
        gain_q=1.0 - pole**3,
        gain_v=1.5 * (1.0 - pole) ** 2 * (1.0 + pole) / period,
        gain_d=(1.0 - pole) ** 3 / period**2,
        late=DRIVE_DELAY_S / period,
        delay=DRIVE_DELAY_S,
        # A torque takes the velocity from half a step before now to half a step before the next
        # set-point: it is to give the acceleration in the middle of that, so many periods ahead.
        ahead=0.5 * (period - timestep) / period,
        half_step=0.5 * timestep,  # Euler steps end with the velocity that they had in their middle
        calm=-math.expm1(-period / _TREMOR_S),
        bandwidth=BANDWIDTH,
        touch_bandwidth=TOUCH_BANDWIDTH,
        compensated=_COMPENSATED,
        turn=_TURN,
        heeded=1.0,
    )


def joints_of(nominal: NominalArm, top_speed: Vector) -> Matrix:
    """What the law knows of the joints, of shape (CONSTANTS, dof), see `kernel_rows`.

    Args:
        nominal: What is believed of the arm.
        top_speed: Speeds that the joints can do, of shape (dof,), rad/s.
    """
    friction, effort = nominal.friction, nominal.robot.limits.effort
    joints = np.zeros((CONSTANTS, len(effort)))
    joints[LIMIT] = effort
    joints[CONTENT] = _CONTENT * (friction.coulomb > 0.0)
    joints[COULOMB] = friction.coulomb
    joints[DROP] = friction.static - friction.coulomb
    joints[NARROW] = -1.0 / np.square(friction.stribeck_velocity)
    joints[VISCOUS] = friction.viscous
    joints[RISE] = friction.rise
    joints[OFFSET] = friction.offset
    joints[TOP] = top_speed
    return joints
