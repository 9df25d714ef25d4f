"""Computed torque: the arm's own dynamics turn a set-point into torques."""

from __future__ import annotations

import numpy as np

from bt_dualarm.errors import DivergenceError
from bt_dualarm.motion.control.payload import Payload
from bt_dualarm.motion.setpoints.set_point import SetPoint
from bt_dualarm.motion.setpoints.stopping_distance import every
from bt_dualarm.pose import Vector
from bt_dualarm.world.nominal.nominal_load import NominalLoad
from bt_dualarm.world.world import World

BANDWIDTH = 60.0
"""Natural frequency of the error dynamics in rad/s: e'' + 2we' + w²e = 0 (critically damped)."""

_LOAD_FEEDBACK = 0.6
"""Share of the error's correction that is amplified by the load. With all of it the light wrist of
an xArm7 shakes at its payload: the weld gives way a little between wrist and load."""


class ComputedTorque:
    """Keeps one arm on its set-points.

    The torque is ``M(q) (a + 2w(v - v̂) + w²(q - q̂)) + bias`` (computed torque, Siciliano et al.,
    Robotics, 8.5.2) plus what the attached objects need, within the joints' efforts. Dynamics are
    those of the nominal arm at what its sensors say.

    Args:
        world: World that the arm is in.
        arm: Name of the arm.
        period: Seconds for which a torque is held.

    Attributes:
        saturated: Number of times that the efforts did not suffice.
    """

    def __init__(self, world: World, arm: str, period: float) -> None:
        self.saturated = 0
        # A torque takes the velocity from half a step before now to half a step before the next
        # set-point: it is to give the acceleration in the middle of that, so many periods ahead.
        self._ahead = 0.5 * (period - world.timestep) / period
        self._name = arm
        self._hardware, self._nominal = world.hardware[arm], world.nominal[arm]
        # MuJoCo's Euler steps end with the velocity that they had in their middle.
        self._half_step = 0.5 * world.timestep
        self._limit = world.robots[arm].limits.effort
        self._before = np.zeros_like(self._limit)
        self._loads: list[Payload] = []
        self._held: tuple[NominalLoad, ...] = ()

    def command(self, sent: SetPoint, time: float) -> Vector:
        """Command the torques for a set-point; returns how far behind each joint is, in rad.

        Raises:
            DivergenceError: A torque is not a number.
        """
        hardware, nominal = self._hardware, self._nominal
        if self._held is not nominal.loads:
            self._held = nominal.loads
            self._loads = [Payload(load, nominal) for load in self._held]
        nominal.update(hardware.q, hardware.v)
        error: Vector = sent.q - hardware.q
        lag = sent.v - self._half_step * sent.a - hardware.v
        meant = sent.a + self._ahead * (sent.a - self._before)
        self._before = sent.a
        torque = self._torque(meant, (2 * BANDWIDTH) * lag + BANDWIDTH**2 * error)
        if not every(np.abs(torque) <= self._limit):
            if not np.isfinite(torque).all():
                raise DivergenceError(
                    f"the simulation diverged at {time:.3f} s: "
                    f"the torques of {self._name} are no numbers"
                )
            self.saturated += 1
            torque = self._within_effort(torque)
        hardware.command(torque)
        return error

    def _torque(self, meant: Vector, correction: Vector) -> Vector:
        """Torques, of shape (dof,), that give the joints both accelerations."""
        nominal = self._nominal
        torque: Vector = nominal.inertia_times(meant + correction) + nominal.bias
        for load in self._loads:
            torque += load.torque(meant + _LOAD_FEEDBACK * correction)
        return torque

    def _within_effort(self, wanted: Vector) -> Vector:
        """As much of the wanted torques as the joints can give, in their direction.

        Clipped joint by joint they would turn an arm that was knocked elsewhere, and feed it with
        energy until it whirls.
        """
        limit, nothing = self._limit, np.zeros_like(wanted)
        rest = self._torque(nothing, nothing)
        drive = wanted - rest
        if (np.abs(rest) > limit).any():  # so fast that no path can be held: brake, nothing else
            drive = self._torque(nothing, -2 * BANDWIDTH * self._hardware.v) - rest
            rest = nothing
        room = np.where(drive > 0.0, limit - rest, limit + rest)
        share = float((room / np.maximum(np.abs(drive), 1e-9)).min())
        within: Vector = np.clip(rest + min(1.0, share) * drive, -limit, limit)
        return within
