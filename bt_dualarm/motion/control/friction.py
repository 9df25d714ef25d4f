"""Friction that a controller makes up for, ahead: by the velocity that is meant."""

from __future__ import annotations

import numpy as np

from bt_dualarm.pose import Vector
from bt_dualarm.world.robots.friction import JointFriction

_TURN = 0.02
"""Speed in rad/s over which dry friction changes sides: of a joint that turns back, nobody knows
better when it stands."""


def feed_forward(friction: JointFriction, v: Vector) -> Vector:
    """Torques, of shape (dof,), N m, that joints need to rub along at velocities ``v``, rad/s."""
    share = np.tanh(v / _TURN)
    if not friction.is_sudden:
        share = np.where(friction.rise > 0.0, friction.build_up(v), share)
    torque: Vector = friction.level(v) * share
    torque += friction.viscous * v
    return torque
