"""Computed torque: the nominal arm's dynamics turn a set-point into torques."""

from __future__ import annotations

import math

import numpy as np

from bt_dualarm.errors import DivergenceError
from bt_dualarm.motion.control.collision_watch import CollisionWatch
from bt_dualarm.motion.control.dynamics import ArmDynamics
from bt_dualarm.motion.control.friction import feed_forward
from bt_dualarm.motion.control.momentum_observer import MomentumObserver
from bt_dualarm.motion.control.state_observer import DRIVE_DELAY_S, StateObserver
from bt_dualarm.motion.control.weighing import Weighing
from bt_dualarm.motion.setpoints.set_point import SetPoint
from bt_dualarm.motion.setpoints.stopping_distance import every
from bt_dualarm.pose import Vector
from bt_dualarm.world.nominal.nominal_load import NominalLoad
from bt_dualarm.world.world import World

BANDWIDTH = 75.0
"""Natural frequency of the error dynamics in rad/s: e'' + 2we' + w²e = 0 (critically damped).

Drives that take 3 ms more than is believed bear it, with inertia off by a fifth; 90 they do not.
"""

_COMPENSATED = 0.3
"""Share of a joint's effort with which a disturbance is made up for: dry friction that is twice
what is believed, masses that are off by a fifth; no more, or an arm that leans on something would
push ever harder."""

_CONTENT = 1e-4
"""Error in rad at which a joint that rubs and is to stand is left alone: the tool is within 0.1 mm.
Dry friction and an observer would hunt for less for ever."""

_TREMOR_S = 0.05  # over which it is averaged by how much velocities differ from those meant


class ComputedTorque:
    """Keeps one arm on its set-points.

    The torque is ``M(q) (a + 2w(v - v̂) + w²(q - q̂) - d) + bias + friction`` (computed torque,
    Siciliano et al., Robotics, 8.5.2; d is the acceleration by which the arm does otherwise than
    its model, see `StateObserver`), within the joints' efforts. Dynamics are those of the nominal
    arm with what it holds, friction is what its page says of the velocity that is meant.

    Args:
        world: World that the arm is in.
        arm: Name of the arm.
        period: Seconds for which a torque is held.

    Attributes:
        saturated: Number of times that the efforts did not suffice.
        observer: What is known of the joints.
        touch: What is known of external torques.
        hits: What tells a hit from all that is off in the model; None of an arm that minds none.
        was_hit: Whether it does, at the last command.
        drift: Velocities of the joints without their tremor, of shape (dof,), rad/s.
    """

    def __init__(self, world: World, arm: str, period: float) -> None:
        self.saturated = 0
        # A torque takes the velocity from half a step before now to half a step before the next
        # set-point: it is to give the acceleration in the middle of that, so many periods ahead.
        self._ahead = 0.5 * (period - world.timestep) / period
        self._half_period = 0.5 * period
        self._name = arm
        self._hardware, self._nominal = world.hardware[arm], world.nominal[arm]
        self.observer = StateObserver(self._hardware.q, period, world.timestep)
        minds = world.declared_arms[arm].collision
        effort, friction = world.robots[arm].limits.effort, self._nominal.friction
        self.hits = CollisionWatch(effort, friction, minds.threshold) if minds.stop else None
        self.was_hit = False
        self.touch = MomentumObserver(len(self._hardware.q), period)
        # MuJoCo's Euler steps end with the velocity that they had in their middle.
        self._half_step = 0.5 * world.timestep
        self._limit = world.robots[arm].limits.effort
        self._content = _CONTENT * (self._nominal.friction.coulomb > 0.0)
        self._before, self._tremor, self.drift, self._driving = np.zeros((4, len(self._limit)))
        self._calm = -math.expm1(-period / _TREMOR_S)
        self._weighing = Weighing(self._nominal, period) if self._nominal.weighs else None
        self._take_up(self._nominal.loads, grace=False)

    def command(self, sent: SetPoint, time: float) -> Vector:
        """Command the torques for a set-point; returns how far behind each joint is, in rad.

        Raises:
            DivergenceError: A torque is not a number.
        """
        if self._held is not self._nominal.loads:
            self._take_up(self._nominal.loads, grace=True)
        hardware, observer = self._hardware, self.observer
        observer.read(hardware.q)
        if self._weighing is not None:
            self._weigh(self._weighing, sent)
        dynamics = self._dynamics
        self._tremor = self._tremor + self._calm * (observer.v - sent.v - self._tremor)
        self.drift = sent.v + self._tremor
        dynamics.update(observer.q, observer.v)
        self.touch.update(dynamics, observer.v, self._driving)
        meant = sent.a + self._ahead * (sent.a - self._before)
        self._before = sent.a
        friction = feed_forward(self._nominal.friction, sent.v + self._half_period * meant)
        disturbing = dynamics.inertia_times(observer.disturbance)
        if self.hits is not None:
            self.was_hit = self.hits.take(dynamics, sent, disturbing)
        rest = dynamics.bias + friction + self._compensation(disturbing)
        torque = rest + dynamics.inertia_times(meant + self._correction(sent))
        if not every(np.abs(torque) <= self._limit):
            if not np.isfinite(torque).all():
                raise DivergenceError(
                    f"the simulation diverged at {time:.3f} s: "
                    f"the torques of {self._name} are no numbers"
                )
            self.saturated += 1
            torque = self._within_effort(torque, rest)
        self._driving = torque - friction
        observer.expect(dynamics.accelerations(self._driving - dynamics.bias))
        hardware.command(torque)
        behind: Vector = sent.q - hardware.q
        return behind

    def _correction(self, sent: SetPoint) -> Vector:
        """Accelerations, of shape (dof,), that bring the joints back to a set-point.

        The errors are those of the moment at which the torque will act.
        """
        observer, late = self.observer, DRIVE_DELAY_S
        gap = sent.a - observer.acceleration
        lag = sent.v - self._half_step * sent.a - observer.v + late * gap
        error = sent.q - observer.q + late * lag - 0.5 * late**2 * gap
        if not (sent.v.any() or sent.a.any()):
            error -= np.clip(error, -self._content, self._content)
        correction: Vector = (2 * BANDWIDTH) * lag + BANDWIDTH**2 * error
        return correction

    def _compensation(self, disturbing: Vector) -> Vector:
        """Torques, of shape (dof,), N m, against those that disturb the arm, likewise."""
        most = _COMPENSATED * self._limit
        compensation: Vector = np.clip(-disturbing, -most, most)
        return compensation

    def _within_effort(self, wanted: Vector, rest: Vector) -> Vector:
        """As much of the wanted torques as the joints can give, in their direction.

        Clipped joint by joint they would turn an arm that was knocked elsewhere, and feed it with
        energy until it whirls.

        Args:
            wanted: Torques of shape (dof,), N m.
            rest: Those of them that only hold, likewise.
        """
        limit = self._limit
        drive = wanted - rest
        if (np.abs(rest) > limit).any():  # so fast that no path can be held: brake, nothing else
            drive = self._dynamics.inertia_times(-2 * BANDWIDTH * self._hardware.v)
            rest = np.zeros_like(rest)
        room = np.where(drive > 0.0, limit - rest, limit + rest)
        share = float((room / np.maximum(np.abs(drive), 1e-9)).min())
        within: Vector = np.clip(rest + min(1.0, share) * drive, -limit, limit)
        return within

    def _weigh(self, weighing: Weighing, sent: SetPoint) -> None:
        """Learn what the arm holds; what that changes, no joint feels."""
        observer = self.observer
        if weighing.take(observer.q, observer.v, sent.a, self._hardware.commanded):
            self._take_up(self._nominal.loads, grace=False)
            self._dynamics.update(observer.q, observer.v)
            driving = self._driving - self._dynamics.bias
            observer.believe_instead(self._dynamics.accelerations(driving))

    def _take_up(self, loads: tuple[NominalLoad, ...], *, grace: bool) -> None:
        """Reckon with what the arm holds now; ``grace`` where that is not what it held before."""
        self._held = loads
        self._dynamics = ArmDynamics(self._nominal, loads)
        self.touch.forget()
        if self.hits is not None:
            self.hits.forget(grace=grace)
