"""The force with which an arm may press on things."""

from __future__ import annotations

import numpy as np

from bt_dualarm.errors import ForceFailure
from bt_dualarm.motion.collision.outside_contacts import OutsideContacts
from bt_dualarm.motion.control.momentum_observer import MomentumObserver
from bt_dualarm.pose import Vector
from bt_dualarm.world.nominal.nominal_arm import NominalArm
from bt_dualarm.world.world import World

_WEAK = 0.02
"""Share of its strongest direction below which an arm does not feel the tool. In the strongest one
it feels a torque of one newton metre at least for each of a moment: every joint turns the tool."""


def wrench_of(nominal: NominalArm, q: Vector, torque: Vector) -> Vector:
    """Force in N, then moment in N m about the tool, in the world, of shape (6,).

    It is what explains torques of the joints best if all that pushes acts on the tool.

    Args:
        nominal: The arm, as it is believed to be.
        q: Positions of its joints, of shape (dof,), rad.
        torque: External torques, of shape (dof,), N m.
    """
    jacobian = nominal.tool_jacobian_at(q)
    inverse = np.asarray(np.linalg.pinv(jacobian.T, rcond=_WEAK), dtype=np.float64)
    wrench: Vector = inverse @ torque
    return wrench


class ForceLimit:
    """Finds that an arm presses on something with more than it may.

    That something is touched is told by switches on links, tool and what is held; how hard, by the
    external torques that have come since: what was there before is friction, or a mass that is off.
    A force is told once; again after it was smaller, so that an arm can go away from what it
    presses on.

    Args:
        world: World that the arm is in.
        arm: Name of the arm.
        touch: What is known of external torques.
    """

    def __init__(self, world: World, arm: str, touch: MomentumObserver) -> None:
        self._world, self._arm, self._touch = world, arm, touch
        self._hardware, self._nominal = world.hardware[arm], world.nominal[arm]
        self._limit_n = world.declared_arms[arm].force_limit
        self._little = (0.5 * _WEAK * self._limit_n) ** 2
        self._told = False
        self._generation = -1

    def look(self, square: float) -> ForceFailure | None:
        """``FORCE_LIMIT`` if the arm has begun to press harder than it may.

        Args:
            square: Square of what `MomentumObserver.since` says, (N m)².
        """
        if square < self._little:
            self._told = False
            return None
        since = self._touch.since
        if self._generation != self._world.generation:
            self._generation = self._world.generation
            self._contacts = OutsideContacts(self._world, self._arm)
        touching = self._contacts.deepest()
        if touching is None:
            self._touch.untouched()
            self._told = False
            return None
        force_n = float(np.linalg.norm(wrench_of(self._nominal, self._hardware.q, since)[:3]))
        told, self._told = self._told, force_n > self._limit_n
        if told or not self._told:
            return None
        return ForceFailure(*touching, force_n, self._limit_n)
