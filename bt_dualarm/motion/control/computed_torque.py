"""Computed torque: the nominal arm's dynamics turn a set-point into torques."""

from __future__ import annotations

import numpy as np

from bt_dualarm.errors import DivergenceError
from bt_dualarm.motion.chains.compliance import Compliance
from bt_dualarm.motion.chains.kernel_rows import (
    DISTURBING,
    DRIVING,
    NO_NUMBER,
    SATURATED,
    SENT_A,
    SENT_Q,
    SENT_V,
    SPEED,
    STATE,
    TOLD,
    TORQUE,
    TREMOR,
)
from bt_dualarm.motion.chains.links import links_of
from bt_dualarm.motion.control.collision_watch import CollisionWatch
from bt_dualarm.motion.control.dynamics import ArmDynamics
from bt_dualarm.motion.control.law import joints_of, law_of
from bt_dualarm.motion.control.momentum_observer import MomentumObserver
from bt_dualarm.motion.control.state_observer import StateObserver
from bt_dualarm.motion.control.weighing import Weighing
from bt_dualarm.motion.setpoints.set_point import SetPoint
from bt_dualarm.pose import Vector
from bt_dualarm.world.nominal.nominal_load import NominalLoad
from bt_dualarm.world.world import World


class ComputedTorque:
    """Keeps one arm on its set-points.

    The torque is ``M(q) (a + 2w(v - v̂) + w²(q - q̂) - d) + bias + friction`` (computed torque,
    Siciliano et al., Robotics, 8.5.2; d is the acceleration by which the arm does otherwise than
    its model, see `StateObserver`), within the joints' efforts. Dynamics are those of the nominal
    arm with what it holds, friction is what its page says of the velocity that is meant. All of it,
    the observer's part too, is worked out in one call of machine code (`torque_kernels`).

    Args:
        world: World that the arm is in.
        arm: Name of the arm.
        period: Seconds for which a torque is held.

    Attributes:
        saturated: Number of times that the efforts did not suffice.
        observer: What is known of the joints.
        touch: What is known of external torques.
        compliance: Whether the arm gives way to what it meets.
        top_speed: Speeds that the joints can do, of shape (dof,), rad/s.
        told: What is told of the joints besides, see `kernel_rows`.
        hits: What tells a hit from all that is off in the model; None of an arm that minds none.
        was_hit: Whether it does, at the last command.
    """

    def __init__(self, world: World, arm: str, period: float) -> None:
        from bt_dualarm.motion.chains.law_kernels import numbers_of
        from bt_dualarm.motion.chains.torque_kernels import drive

        self._drive = drive
        self.saturated = 0
        self._name = arm
        self._hardware, self._nominal = world.hardware[arm], world.nominal[arm]
        law = law_of(period, world.timestep, self._nominal.model.opt.gravity.copy())
        self._law = numbers_of(law)
        self.compliance = Compliance(self._law, period)
        # An arm may be told to keep to less than its robot can do: that breaks nothing.
        self.top_speed = (
            world.robots[arm].limits.velocity / world.declared_arms[arm].limits.velocity
        )
        self._joints = joints_of(self._nominal, self.top_speed)
        dof = len(self._hardware.q)
        self._state, self._inertias = np.zeros((STATE, dof)), np.zeros((2, dof, dof))
        state = self._state  # views of rows: looking one up costs as much as filling it
        self._sent = state[SENT_Q], state[SENT_V], state[SENT_A]
        self._speed, self._torque, self.told = state[SPEED], state[TORQUE], np.zeros(TOLD)
        self.observer = StateObserver(law, state, self._hardware.q)
        self.touch = MomentumObserver(state, self._inertias[0])
        minds, friction = world.declared_arms[arm].collision, self._nominal.friction
        self.hits = CollisionWatch(friction, minds.threshold) if minds.stop else None
        self.was_hit = False
        self._weighing = Weighing(self._nominal, period) if self._nominal.weighs else None
        self._take_up(self._nominal.loads, grace=False)

    @property
    def drift(self) -> Vector:
        """Velocities of the joints without their tremor, of shape (dof,), rad/s."""
        drift: Vector = self._state[SENT_V] + self._state[TREMOR]
        return drift

    def command(self, sent: SetPoint, time: float) -> None:
        """Command the torques for a set-point.

        Raises:
            DivergenceError: A torque is not a number.
        """
        if self._held is not self._nominal.loads:
            self._take_up(self._nominal.loads, grace=True)
        hardware, (q, v, a) = self._hardware, self._sent
        reads = self.observer.take(hardware.q)
        if self._weighing is not None:
            reads = self._weigh(self._weighing, sent, reads=reads)
        q[:], v[:], a[:], self._speed[:] = sent.q, sent.v, sent.a, hardware.v
        is_new, self.touch.is_new = self.touch.is_new, False
        self.compliance.advance()
        outcome = self._drive(
            self._law,
            self._links,
            self._joints,
            self._inertias,
            reads,
            is_new,
            self._state,
            self.told,
        )
        if outcome == NO_NUMBER:
            raise DivergenceError(
                f"the simulation diverged at {time:.3f} s: "
                f"the torques of {self._name} are no numbers"
            )
        self.saturated += outcome == SATURATED
        if self.hits is not None:
            self.was_hit = self.hits.take(self._inertias[0], sent, self._state[DISTURBING].copy())
        hardware.command(self._torque.copy())

    def _weigh(self, weighing: Weighing, sent: SetPoint, *, reads: bool) -> bool:
        """Learn what the arm holds; what that changes, no joint feels.

        Args:
            weighing: What is known of that so far.
            sent: Set-point of now.
            reads: Whether the reading of now is to be taken up.

        Returns:
            Whether it remains to be taken up: no.
        """
        observer = self.observer
        if reads:
            observer.observe()
        if weighing.take(observer.q, observer.v, sent, self._hardware.commanded):
            self._take_up(self._nominal.loads, grace=False)
            self._dynamics.update(observer.q, observer.v)
            driving = self._state[DRIVING] - self._dynamics.bias
            observer.believe_instead(self._dynamics.accelerations(driving))
        return False

    def _take_up(self, loads: tuple[NominalLoad, ...], *, grace: bool) -> None:
        """Reckon with what the arm holds now; ``grace`` where that is not what it held before."""
        self._held = loads
        self._dynamics = ArmDynamics(self._nominal, loads)
        self._links = links_of(self._dynamics.model)
        self.touch.forget()
        if self.hits is not None:
            self.hits.forget(grace=grace)
