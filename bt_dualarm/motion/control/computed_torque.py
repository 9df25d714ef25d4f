"""Computed torque: the arm's own dynamics turn a set-point into torques."""

from __future__ import annotations

import mujoco
import numpy as np

from bt_dualarm.errors import DivergenceError
from bt_dualarm.motion.control.payload import Payload
from bt_dualarm.motion.setpoints.set_point import SetPoint
from bt_dualarm.motion.setpoints.stopping_distance import every
from bt_dualarm.pose import Vector
from bt_dualarm.world.arm_body import ArmBody
from bt_dualarm.world.world import World

BANDWIDTH = 60.0
"""Natural frequency of the error dynamics in rad/s: e'' + 2we' + w²e = 0 (critically damped)."""

_LOAD_FEEDBACK = 0.6
"""Share of the error's correction that is amplified by the load. With all of it the light wrist of
an xArm7 shakes at its payload: the weld gives way a little between wrist and load."""


class ComputedTorque:
    """Keeps one arm on its set-points.

    The torque is ``M(q) (a + 2w(v - v̂) + w²(q - q̂)) + bias`` (computed torque, Siciliano et al.,
    Robotics, 8.5.2) plus what the attached objects need, within the joints' efforts.

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
        self._world, self._name = world, arm
        self._limit = world.robots[arm].limits.effort
        self._before = np.zeros_like(self._limit)
        self._bind()

    def command(self, sent: SetPoint, time: float) -> Vector:
        """Command the torques for a set-point; returns how far behind each joint is, in rad.

        Raises:
            DivergenceError: A torque is not a number.
        """
        if self._generation != self._world.generation:
            self._bind()
        data, body = self._world.data, self._body
        error: Vector = sent.q - data.qpos[body.qpos_ids]
        lag = sent.v - self._half_step * sent.a - data.qvel[body.dof_ids]
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
        data.ctrl[body.actuator_ids] = torque
        return error

    def _torque(self, meant: Vector, correction: Vector) -> Vector:
        """Torques, of shape (dof,), that give the joints both accelerations."""
        world, dofs = self._world, self._body.dof_ids
        self._wide[dofs] = meant + correction
        mujoco.mj_mulM(world.model, world.data, self._product, self._wide)
        torque: Vector = self._product[dofs] + world.data.qfrc_bias[dofs]
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
            drive = self._torque(nothing, -2 * BANDWIDTH * self._body.v) - rest
            rest = nothing
        room = np.where(drive > 0.0, limit - rest, limit + rest)
        share = float((room / np.maximum(np.abs(drive), 1e-9)).min())
        within: Vector = np.clip(rest + min(1.0, share) * drive, -limit, limit)
        return within

    def _bind(self) -> None:
        """Look up what a recompilation of the world has moved."""
        world = self._world
        self._generation = world.generation
        self._body: ArmBody = world.arms[self._name]
        # MuJoCo's Euler steps end with the velocity that they had in their middle.
        self._half_step = 0.5 * world.timestep
        self._wide, self._product = np.zeros((2, world.model.nv))
        held = world.attachments.attached_to(self._name)
        self._loads = [
            Payload(world.model, world.data, world.object_body(thing), self._body) for thing in held
        ]
