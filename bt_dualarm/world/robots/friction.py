"""Friction of an arm's joints: what is published of it, or the order that arms of its kind have."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
import numpy.typing as npt

from bt_dualarm.pose import Vector

TYPICAL_COULOMB: Final = 0.04
"""Dry friction as a share of the effort limit where a page says nothing: strain-wave gears of
arms this size have 3 to 7 %."""

TYPICAL_VISCOUS: Final = 0.01
"""Friction that grows with speed, as a share of the effort limit for each rad/s, likewise."""


@dataclass(frozen=True, eq=False)
class JointFriction:
    """Friction of the joints, base to tip, each array of shape (dof,).

    ``τ(v) = (c + (s - c) exp(-(v/v_s)²)) T(v) + b v``: dry friction that falls from its static
    level (Stribeck), and viscous friction (Armstrong-Hélouvry, Dupont, Canudas de Wit, Automatica
    1994). ``T`` is the sign of ``v``, or, where dry friction builds up over a speed ``r``,
    ``tanh((v + o)/r) - tanh(o/r)``: the sigmoid of Gaz et al., RA-L 2019, has this form.

    Attributes:
        coulomb: Dry friction c, N m.
        viscous: Viscous friction b, N m s/rad.
        static: Dry friction s of a joint that stands, N m.
        stribeck_velocity: Speed v_s at which that is left behind, rad/s.
        rise: Speed r over which dry friction builds up, rad/s; 0 where it is there at once.
        offset: Offset o of the speed at which it does, rad/s.
        uncertainty: Share to which dry friction is known.
    """

    coulomb: Vector
    viscous: Vector
    static: Vector
    stribeck_velocity: Vector
    rise: Vector
    offset: Vector
    uncertainty: float = 0.0

    @classmethod
    def typical(cls, effort: Vector) -> JointFriction:
        """That of an arm of which nothing is published, from its efforts in N m."""
        coulomb, nothing = TYPICAL_COULOMB * effort, np.zeros_like(effort)
        return cls(
            coulomb, TYPICAL_VISCOUS * effort, coulomb, np.full_like(effort, 0.1), nothing, nothing
        )

    @classmethod
    def none(cls, dof: int) -> JointFriction:
        """That of joints that do not rub."""
        nothing = np.zeros(dof)
        return cls(nothing, nothing, nothing, np.ones(dof), nothing, nothing)

    def torque(self, v: Vector) -> Vector:
        """Torque in N m, of shape (dof,), that keeps the joints at velocities ``v`` in rad/s.

        Friction itself is its negative.
        """
        torque: Vector = self.level(v) * self.build_up(v) + self.viscous * v
        return torque

    def level(self, v: Vector) -> Vector:
        """Dry friction at velocities, of shape (dof,), N m."""
        if self._falling is None:
            return self.coulomb
        drop, narrow = self._falling
        level: Vector = v * v
        np.multiply(level, narrow, level)
        np.exp(level, level)
        np.multiply(level, drop, level)
        return np.add(level, self.coulomb, level)

    @cached_property
    def _falling(self) -> tuple[Vector, Vector] | None:
        """By how much dry friction falls once a joint moves, N m, and -1/v_s²; None for nowhere."""
        drop = self.static - self.coulomb
        return (drop, -1.0 / np.square(self.stribeck_velocity)) if drop.any() else None

    @cached_property
    def is_sudden(self) -> bool:
        """Whether no joint's dry friction builds up over a speed."""
        return not (self.rise > 0.0).any()

    def build_up(self, v: Vector) -> Vector:
        """Share of the dry friction that acts at velocities, of shape (dof,), from -1 to 1."""
        gentle, rise, start = self._rising
        smooth = np.tanh((v + self.offset) / rise) - start
        share: Vector = smooth if gentle.all() else np.where(gentle, smooth, np.sign(v))
        return share

    @cached_property
    def _rising(self) -> tuple[npt.NDArray[np.bool_], Vector, Vector]:
        """Which joints' friction builds up, over which speed, and the sigmoid where they stand."""
        gentle = self.rise > 0
        rise = np.where(gentle, self.rise, 1.0)
        return gentle, rise, np.tanh(self.offset / rise)

    def scaled(self, dry: Vector, viscous: Vector, most: Vector) -> JointFriction:
        """Another robot of the batch.

        Args:
            dry: Factors of the dry friction, of shape (dof,).
            viscous: Factors of the viscous friction, likewise.
            most: Largest dry friction, static too, in N m.
        """
        peak = np.maximum(self.static, self.coulomb) * dry
        dry = dry * np.minimum(1.0, most / np.maximum(peak, 1e-12))
        return replace(
            self,
            coulomb=self.coulomb * dry,
            static=self.static * dry,
            viscous=self.viscous * viscous,
        )
