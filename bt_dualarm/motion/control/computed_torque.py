"""Computed torque: the nominal arm's dynamics turn a set-point into torques."""

from __future__ import annotations

import numpy as np

from bt_dualarm.errors import DivergenceError
from bt_dualarm.motion.chains.compliance import Compliance
from bt_dualarm.motion.chains.kernel_rows import (
    BENT,
    DISTURBING,
    DRIVING,
    IS_NEW,
    KEEPS,
    NO_NUMBER,
    READS,
    SATURATED,
    SENT_Q,
    SENT_V,
    SPEED,
    STATE,
    TOLD,
    TORQUE,
    TREMOR,
    WANTED_A,
    WANTED_Q,
    WANTED_V,
)
from bt_dualarm.motion.chains.links import links_of
from bt_dualarm.motion.control.dynamics import ArmDynamics
from bt_dualarm.motion.control.law import joints_of, law_of
from bt_dualarm.motion.control.momentum_observer import MomentumObserver
from bt_dualarm.motion.control.state_observer import StateObserver
from bt_dualarm.motion.control.weighing import Weighing
from bt_dualarm.motion.hits.collision_watch import CollisionWatch
from bt_dualarm.motion.setpoints.limiter import SetPointLimiter
from bt_dualarm.motion.setpoints.set_point import SetPoint
from bt_dualarm.motion.setpoints.stopping_distance import limit_rows
from bt_dualarm.pose import Vector
from bt_dualarm.world.nominal.nominal_load import NominalLoad
from bt_dualarm.world.world import World


class ComputedTorque:
    """Keeps one arm on its set-points.

    The torque is ``M(q) (a + 2w(v - v̂) + w²(q - q̂) - d) + bias + friction`` (computed torque,
    Siciliano et al., Robotics, 8.5.2; d is the acceleration by which the arm does otherwise than
    its model, see `StateObserver`), within the joints' efforts. Dynamics are those of the nominal
    arm with what it holds, friction is what its page says of the velocity that is meant. All of it,
    the observer's part and the look at the limits too, is worked out in one call of machine code
    (`follow_kernels`).

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
        from bt_dualarm.motion.chains.follow_kernels import follow
        from bt_dualarm.motion.chains.law_kernels import numbers_of

        self._follow = follow
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
        state[SENT_Q] = self._hardware.q
        self._wanted = state[WANTED_Q], state[WANTED_V], state[WANTED_A]
        self._speed, self._torque, self.told = state[SPEED], state[TORQUE], np.zeros(TOLD)
        self._disturbing = state[DISTURBING]
        self._limits, self._drives = limit_rows(world.robots[arm].limits), self._hardware.drives
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

    def command(self, sent: SetPoint, time: float) -> SetPoint:
        """Command the torques for a set-point that keeps the limits of the arm; returns it.

        Raises:
            DivergenceError: A torque is not a number.
        """
        return self._command(sent, None, time)

    def send(self, wanted: SetPoint, limiter: SetPointLimiter, time: float) -> SetPoint:
        """Command the torques for a set-point, bent where it does not keep the limits.

        Args:
            wanted: Set-point that may break them.
            limiter: Gate of the arm, which has let all set-points so far pass.
            time: Simulated time in s.

        Returns:
            The set-point that was sent.

        Raises:
            DivergenceError: A torque is not a number.
        """
        if self._weighing is None:  # who weighs wants to know what is sent before it is
            return self._command(wanted, limiter, time)
        return self._command(limiter.bend(wanted), None, time)

    def _command(self, sent: SetPoint, limiter: SetPointLimiter | None, time: float) -> SetPoint:
        """Without a limiter it is known to keep the limits."""
        if self._held is not self._nominal.loads:
            self._take_up(self._nominal.loads, grace=True)
        hardware, (q, v, a) = self._hardware, self._wanted
        reads = self.observer.take(hardware.q)
        if self._weighing is not None:
            reads = self._weigh(self._weighing, sent, reads=reads)
        q[:], v[:], a[:], self._speed[:] = sent.q, sent.v, sent.a, hardware.v
        self.compliance.advance()
        how = READS * reads | IS_NEW * self.touch.is_new | KEEPS * (limiter is None)
        outcome = self._call(how)
        if outcome == BENT and limiter is not None:
            sent = limiter.bent(sent)
            q[:], v[:], a[:] = sent.q, sent.v, sent.a
            outcome = self._call(how | KEEPS)
        self.touch.is_new = False
        if outcome == NO_NUMBER:
            what = f"the torques of {self._name} are no numbers"
            raise DivergenceError(f"the simulation diverged at {time:.3f} s: {what}")
        self.saturated += outcome == SATURATED
        if self.hits is not None:
            self.was_hit = self.hits.take(self._inertias[0], sent, self._disturbing)
        hardware.was_commanded(self._torque.copy())
        return sent

    def _call(self, how: int) -> int:
        return self._follow(
            self._law,
            self._limits,
            self._links,
            self._joints,
            self._inertias,
            self._drives,
            how,
            self._state,
            self.told,
        )

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
