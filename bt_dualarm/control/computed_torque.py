"""Computed-torque control of one arm.

- `ComputedTorque` commands the torques for a set-point, once per control period.
- `StateObserver` and `MomentumObserver` estimate joint motion and external torques.
- `Compliance` makes the arm soft on contact, `ForceLimit` monitors the contact force.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from bt_dualarm.collision.checker import OutsideContacts
from bt_dualarm.control.collision_detection import CollisionDetector
from bt_dualarm.control.dynamics import (
    BANDWIDTH,
    OBSERVER_BANDWIDTH,
    ArmDynamics,
    control_law,
    joint_constants,
)
from bt_dualarm.control.kernel_rows import (
    BASELINE_TORQUE,
    COMPENSATION,
    CONSTANTS,
    DESIRED_A,
    DESIRED_Q,
    DESIRED_V,
    DISTURBANCE,
    DISTURBANCE_TORQUE,
    EXTERNAL_TORQUE,
    MEAN_V_ERROR,
    MEASURED_Q,
    MEASURED_V,
    MODEL_A,
    MODEL_A_BEFORE,
    NET_TORQUE,
    NEW_MODEL,
    NOT_FINITE,
    OUTSIDE_LIMITS,
    READ_ENCODERS,
    SATURATED,
    SENT_Q,
    SENT_V,
    STATE,
    TELEMETRY,
    TORQUE,
    WITHIN_LIMITS,
    ControlLaw,
    Q,
    V,
)
from bt_dualarm.control.payload_estimation import PayloadEstimator
from bt_dualarm.core.errors import DivergenceError, Failure, ForceLimitFailure
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.kinematics.chain_kernel_arrays import LIMITS, LINK, ROTOR, links_of
from bt_dualarm.sim.arm_models import NominalArm, NominalLoad
from bt_dualarm.sim.kernel_arrays import DRIVES
from bt_dualarm.sim.world import World
from bt_dualarm.trajectory.set_points import SetPoint, SetPointLimiter, limit_rows

BREAKAWAY_S: Final = 0.35
"""Seconds after the start in which joints break away and friction settles: the arm stays stiff."""

_COMPENSATION_S: Final = 0.5
"""Averaging time with which a compliant arm compensates disturbances, s."""

_BANDWIDTH: Final = 30.0
"""Bandwidth of a compliant arm, rad/s: softer, friction causes path errors; stiffer, it bounces."""

_CREEP_SPEED: Final = 0.001
"""Velocity over which dry friction is smoothed in a motion that gets slower without reversing,
rad/s. With more, the friction that is fed forward would fade where the joints are slow: the soft
arm stopped short, as if it had made contact."""

SOFTEST: Final = 6.0
"""Minimum bandwidth of an arm that holds still softly, rad/s; below, its model errors displace it
by centimeters."""

_STIFFENING_S: Final = 1.0
"""Time in which such an arm becomes stiff again, s: at once, it would jump to its set-point."""

# Indices in `law_array`, in which gravity takes three elements.
_BANDWIDTH_AT: Final = 2 + ControlLaw._fields.index("bandwidth")

_FRICTION_SPEED_AT: Final = 2 + ControlLaw._fields.index("friction_speed")

_COMPENSATION_AT: Final = 2 + ControlLaw._fields.index("compensation_share")

SINGULAR: Final = 0.02
"""Singular values below this share of the largest are treated as zero: in such directions joint
torques hardly depend on the wrench. The largest is at least 1, as every joint rotates the tool."""


class ComputedTorque:
    """Computed-torque controller of one arm.

    The torque is ``M(q) (a + 2w(v - v̂) + w²(q - q̂) - d) + bias + friction``, within the effort
    limits (computed torque, Siciliano et al., Robotics, 8.5.2), where q̂, v̂ and the disturbance d
    are estimates of `StateObserver`. M and bias are those of the nominal arm with its payload;
    friction is that of the robot description at the commanded velocity. Limit check, observers and
    control law run in one compiled call (`control_kernels.command_set_point`).

    Args:
        world: World that contains the arm.
        arm: Name of the arm.
        period: Seconds for which a torque is held.

    Attributes:
        saturated: Number of periods in which torques were scaled down to the effort limits.
        observer: State observer of the joints.
        touch: Momentum observer.
        compliance: Compliance of the arm.
        top_speed: Velocity limits of the joints, of shape (dof,), rad/s.
        telemetry: Speed share, position error and contact torque, see `kernel_rows`.
        collision_detector: Collision detector, or None if disabled.
        collision_detected: Whether it detected a collision at the last command.
    """

    def __init__(self, world: World, arm: str, period: float) -> None:
        from bt_dualarm.control.control_kernels import command_set_point, law_array

        self._follow = command_set_point
        self.saturated = 0
        self._name = arm
        self._hardware = world.hardware[arm]
        self._nominal = world.nominal[arm]
        law = control_law(period, world.timestep, self._nominal.model.opt.gravity.copy())
        self._law = law_array(law)
        # The declared limits of an arm may be a share of its robot's. Exceeding only that share
        # damages nothing, so that measured speeds are compared with the robot's own limits.
        self.top_speed = (
            world.robots[arm].limits.velocity / world.declared_arms[arm].limits.velocity
        )
        self._joints = joint_constants(self._nominal, self.top_speed)
        dof = len(self._hardware.q)
        self._state = np.zeros((STATE, dof))
        self._inertias = np.zeros((2, dof, dof))
        self.compliance = Compliance(self._law, period, self._state[COMPENSATION])
        state = self._state  # views of rows: looking one up costs as much as filling it
        state[SENT_Q] = self._hardware.q
        self._desired = state[DESIRED_Q], state[DESIRED_V], state[DESIRED_A]
        self._speed = state[MEASURED_V]
        self._torque = state[TORQUE]
        self.telemetry = np.zeros(TELEMETRY)
        self._disturbance_torque = state[DISTURBANCE_TORQUE]
        self._limits = limit_rows(world.robots[arm].limits)
        self._drives = self._hardware.drives
        self.observer = StateObserver(law, state, self._hardware.q)
        self.touch = MomentumObserver(state, self._inertias[0])
        collision = world.declared_arms[arm].collision
        friction = self._nominal.friction
        self.collision_detector = (
            CollisionDetector(friction, collision.threshold) if collision.stop else None
        )
        self.collision_detected = False
        self._payload_estimator = (
            PayloadEstimator(self._nominal, period) if self._nominal.estimates_payload else None
        )
        self._set_loads(self._nominal.loads, grace=False)

    @property
    def mean_velocity(self) -> Vector:
        """Joint velocities without noise: commanded plus filtered error, of shape (dof,), rad/s."""
        mean_velocity: Vector = self._state[SENT_V] + self._state[MEAN_V_ERROR]
        return mean_velocity

    def breakaway_s(self, error: float) -> float:
        """Longest time until a joint breaks away that dry friction keeps from its set-point, s.

        Where a joint stands, the observer takes the motor torque for a disturbance after a lag,
        and the law compensates it: the torque rises at a constant rate, in proportion to the
        joint's inertia. It may begin with the opposite dry friction, that of the motion before.

        Args:
            error: Position error, rad.
        """
        # Of three equal poles, the disturbance lags a ramp by 3/w, and the velocity is 3/w² off.
        lag = 3.0 / OBSERVER_BANDWIDTH + 6.0 * BANDWIDTH / OBSERVER_BANDWIDTH**2
        rate = np.diag(self._inertias[0]) * BANDWIDTH**2 * error / lag
        friction = self._nominal.friction
        dry = np.maximum(friction.static, friction.coulomb) * (1.0 + friction.uncertainty)
        return float((2.0 * dry / rate).max())

    def command(self, sent: SetPoint, time: float) -> SetPoint:
        """Command the torques for a set-point that is known to keep the limits; return it.

        Raises:
            DivergenceError: A torque is not a number.
        """
        return self._command(sent, None, time)

    def send(self, desired: SetPoint, limiter: SetPointLimiter, time: float) -> SetPoint:
        """Command the torques for a set-point, limited first if it breaks the limits.

        Args:
            desired: Set-point that may break the limits.
            limiter: Limiter that has passed all previous set-points.
            time: Simulated time, s.

        Returns:
            The set-point that was sent.

        Raises:
            DivergenceError: A torque is not a number.
        """
        if self._payload_estimator is None:
            return self._command(desired, limiter, time)
        # The payload estimator needs the final set-point before the kernel call.
        return self._command(limiter.limited(desired), None, time)

    def _command(self, sent: SetPoint, limiter: SetPointLimiter | None, time: float) -> SetPoint:
        """Command a set-point; without a limiter it is known to keep the limits."""
        if self._held is not self._nominal.loads:
            self._set_loads(self._nominal.loads, grace=True)
        hardware = self._hardware
        q, v, a = self._desired
        # The kernel updates the observer, unless the payload estimator needs its estimate before.
        reads = self.observer.store(hardware.q)
        if self._payload_estimator is not None:
            if reads:
                self.observer.update()
                reads = False
            self._update_payload(self._payload_estimator, sent)
        q[:] = sent.q
        v[:] = sent.v
        a[:] = sent.a
        self._speed[:] = hardware.v
        self.compliance.advance()
        flags = (
            READ_ENCODERS * reads
            | NEW_MODEL * self.touch.is_new
            | WITHIN_LIMITS * (limiter is None)
        )
        outcome = self._call(flags)
        # The kernel has changed nothing yet: limit the set-point and call it again.
        if outcome == OUTSIDE_LIMITS and limiter is not None:
            sent = limiter.corrected(sent)
            q[:] = sent.q
            v[:] = sent.v
            a[:] = sent.a
            outcome = self._call(flags | WITHIN_LIMITS)
        self.touch.is_new = False
        if outcome == NOT_FINITE:
            reason = f"the torques of {self._name} are not numbers"
            raise DivergenceError(f"the simulation diverged at {time:.3f} s: {reason}")
        self.saturated += outcome == SATURATED
        if self.collision_detector is not None:
            self.collision_detected = self.collision_detector.update(
                self._inertias[0], sent, self._disturbance_torque
            )
        hardware.note_command(self._torque.copy())
        return sent

    def naming_efforts(self, failure: Failure) -> Failure:
        """Returns a failure to follow, with the joints that apply their whole effort at last."""
        robot = self._nominal.robot
        effort = robot.limits.effort
        for joint in np.flatnonzero(np.abs(self._torque) >= effort * (1.0 - 1e-9)).tolist():
            failure.adding(f"{robot.joints[joint]} applies its whole {effort[joint]:.3g} N m")
            failure.noting(at_effort_limit=robot.joints[joint])
        return failure

    def _call(self, flags: int) -> int:
        return self._follow(
            self._law,
            self._limits,
            self._links,
            self._joints,
            self._inertias,
            self._drives,
            flags,
            self._state,
            self.telemetry,
        )

    def _update_payload(self, estimator: PayloadEstimator, sent: SetPoint) -> None:
        """Update the payload estimate, and switch to a new model without a jump of the torques."""
        observer = self.observer
        if estimator.update(observer.q, observer.v, sent, self._hardware.commanded):
            self._set_loads(self._nominal.loads, grace=False)
            self._dynamics.update(observer.q, observer.v)
            # The last torques stay, but produce another acceleration in the new model.
            driving = self._state[NET_TORQUE] - self._dynamics.bias
            observer.change_model(self._dynamics.accelerations(driving))

    def _set_loads(self, loads: tuple[NominalLoad, ...], *, grace: bool) -> None:
        """Use the dynamics with these loads; ``grace`` as in `CollisionDetector.reset`."""
        self._held = loads
        self._dynamics = ArmDynamics(self._nominal, loads)
        self._links = links_of(self._dynamics.model)
        self.touch.reset()
        if self.collision_detector is not None:
            self.collision_detector.reset(grace=grace)


class StateObserver:
    """Extended state observer of joint position, velocity and disturbance, from encoder readings.

    Each joint is modeled as a double integrator driven by the acceleration that its torque produces
    in the model. Anything else that accelerates it (friction and mass errors, external forces) is
    estimated as an additional state, the disturbance (Han, From PID to active disturbance rejection
    control, IEEE Trans. Ind. Electron. 2009; a single bandwidth for all poles: Gao, ACC 2003). The
    velocity is not a difference of readings: it does not lag, and has less noise.

    Args:
        law: Control law, which has the observer gains.
        state: Controller state, see `kernel_rows`; the estimates are stored there.
        q: Initial position, at rest, of shape (dof,), rad.
    """

    def __init__(self, law: ControlLaw, state: Matrix, q: Vector) -> None:
        from bt_dualarm.control.control_kernels import law_array, observe

        self._observe = observe
        self._law = law_array(law)
        self._state = state
        state[Q] = q
        self._reading = state[MEASURED_Q]
        self._is_new = True

    @property
    def q(self) -> Vector:
        """Estimated positions at the last reading, of shape (dof,), rad."""
        q: Vector = self._state[Q].copy()
        return q

    @property
    def v(self) -> Vector:
        """Estimated velocities, of shape (dof,), rad/s."""
        v: Vector = self._state[V].copy()
        return v

    @property
    def disturbance(self) -> Vector:
        """Estimated disturbance, as accelerations of shape (dof,), rad/s²."""
        disturbance: Vector = self._state[DISTURBANCE].copy()
        return disturbance

    def read(self, q: Vector) -> None:
        """Update with encoder positions, of shape (dof,), rad, one period after the last ones."""
        if self.store(q):
            self.update()

    def store(self, q: Vector) -> bool:
        """Store encoder positions, of shape (dof,), rad; return whether `update` has to follow.

        The first reading sets the estimate directly.
        """
        self._reading[:] = q
        if self._is_new:
            self._is_new = False
            self._state[Q] = q
            return False
        return True

    def update(self) -> None:
        """Update the estimates with the stored reading."""
        self._observe(self._law, self._state)

    def change_model(self, acceleration: Vector) -> None:
        """Replace the model acceleration of the last torques, of shape (dof,), rad/s².

        The total acceleration stays the same: the disturbance compensates the difference.
        """
        change = acceleration - self._state[MODEL_A]
        self._state[MODEL_A] = acceleration
        self._state[MODEL_A_BEFORE] += change
        self._state[DISTURBANCE] -= change


class MomentumObserver:
    """External torques from the residual of the generalized momentum p = M(q) v.

    The rate of p that motor torques, gravity and velocities explain is integrated; the rest of p is
    the external torque through a first-order lag (De Luca, Albu-Schäffer, Haddadin, Hirzinger, IROS
    2006; Haddadin, De Luca, Albu-Schäffer, T-RO 2017). It includes model errors: friction that is
    not fed forward, wrong masses. The update is part of the control kernel
    (`control_kernels.observe_external_torque`).

    Args:
        state: Controller state, see `kernel_rows`.
        inertia: View of the current inertia matrix, of shape (dof, dof), kg m².

    Attributes:
        is_new: Whether the mass of the arm changed since the previous period.
        inertia: View of the current inertia matrix.
    """

    def __init__(self, state: Matrix, inertia: Matrix) -> None:
        self.is_new = True
        self.inertia = inertia
        self._torque = state[EXTERNAL_TORQUE]
        self._disturbance_torque = state[DISTURBANCE_TORQUE]
        self._baseline = state[BASELINE_TORQUE]

    @property
    def torque(self) -> Vector:
        """External torques, of shape (dof,), N m: positive in the joint's positive direction."""
        torque: Vector = self._torque.copy()
        return torque

    @property
    def disturbance_torque(self) -> Vector:
        """Disturbance of the state observer as torques, of shape (dof,), N m.

        Faster than `torque`, and noisier.
        """
        torque: Vector = self._disturbance_torque.copy()
        return torque

    @property
    def contact_torque(self) -> Vector:
        """External torques minus their baseline, of shape (dof,), N m."""
        contact_torque: Vector = self._torque - self._baseline
        return contact_torque

    def set_baseline(self) -> None:
        """Use the current torques as the baseline: without contact they are model errors."""
        self._baseline[:] = self._torque

    def reset(self) -> None:
        """Restart the residual because the mass of the arm changed."""
        self.is_new = True
        self._torque[:] = 0.0


class Compliance:
    """Makes an arm respond to contact like a spring of 5 to 10 N/mm at the tool.

    A stiff arm compensates every disturbance at once, contact forces included: 0.1 mm of
    penetration into a table causes 60 N. A compliant one compensates only the slow part of the
    disturbance, as model errors are; against the rest it has a stiffness of inertia times the
    square of a lower bandwidth.

    Args:
        numbers: Control law, of shape (18,), see `law_array`; modified in place.
        period: Control period, s.
        compensation: Torques that compensate disturbances, of shape (dof,), N m; modified in place.

    Attributes:
        is_spring: Whether the arm is a spring, see `spring`.
    """

    def __init__(self, numbers: Vector, period: float, compensation: Vector) -> None:
        self._compensation = compensation
        self._numbers = numbers
        self._period = period
        self._stiff = numbers.copy()
        self._active = False
        self._holds = False
        self._elapsed = 0.0
        self.is_spring = False
        self._soft = 0.0
        self._stiffening = 0.0

    @property
    def active(self) -> bool:
        """Whether the arm is compliant. Setting it to its current value changes nothing."""
        return self._active

    @active.setter
    def active(self, active: bool) -> None:
        if active != self._active:
            self._active = active
            self._elapsed = 0.0
            # An arm that has held still softly may be far from its set-point.
            self._stiffening = _STIFFENING_S if self.is_spring and not active else 0.0
            self._soft = float(self._numbers[_BANDWIDTH_AT])
            self.is_spring = False
            self._numbers[:] = self._stiff
            self._holds = False

    def begin_moving(self) -> None:
        """Become compliant in the middle of a motion.

        The joints have broken away, so that the mean disturbance begins now.
        """
        self.active = True
        self._holds = False
        self._elapsed = BREAKAWAY_S
        self._numbers[_FRICTION_SPEED_AT] = _CREEP_SPEED

    def spring(self, bandwidth: float) -> None:
        """Be a spring about the set-point until the arm is stiff again.

        The compensation of disturbances is unchanged: call it at rest without contact, once the
        arm has been compliant for a second.

        Args:
            bandwidth: Natural frequency of the arm's motion, rad/s: the joints have a stiffness of
                inertia times its square.
        """
        self._active = True
        self._holds = True
        self.is_spring = True
        self._numbers[_BANDWIDTH_AT] = bandwidth
        self._numbers[_COMPENSATION_AT] = 0.0

    def hold_force(self) -> None:
        """Freeze the compensation until the arm is stiff again: contact force does not build up."""
        if self._active and not self.is_spring:
            self._holds = True
            self._numbers[_COMPENSATION_AT] = 0.0

    @property
    def compensation(self) -> Vector:
        """Torques that compensate disturbances now, of shape (dof,), N m."""
        return self._compensation.copy()

    def soften(
        self,
        friction_speed: float | None = None,
        *,
        bandwidth: float = _BANDWIDTH,
        compensation: Vector | None = None,
    ) -> None:
        """Become compliant at once and freeze the compensation: for an arm that just made contact.

        While it brakes its set-point still advances, and a stiff arm presses with 60 N for each
        0.1 mm of that.

        Args:
            friction_speed: Velocity over which dry friction is smoothed, rad/s, for an arm that
                starts to move in contact: feeding the friction forward at once would cause an
                impact.
            bandwidth: Bandwidth of the compliant arm, rad/s.
            compensation: Compensation to freeze, of shape (dof,), N m, for an arm that is about to
                make contact: that of an earlier motion along the same path. By default the current
                one, which is a single noisy value if the arm was stiff.
        """
        if friction_speed is not None:
            self._numbers[_FRICTION_SPEED_AT] = friction_speed
        self._active = True
        self._holds = True
        self._numbers[_BANDWIDTH_AT] = bandwidth
        self._numbers[_COMPENSATION_AT] = 0.0
        if compensation is not None:
            self._compensation[:] = compensation

    def yield_to(self, torque: Vector) -> None:
        """Change the frozen compensation of a soft arm by torques, of shape (dof,), N m.

        With those of a measured contact force, the arm yields to it. No effect unless the
        compensation is frozen (`soften`, `hold_force`).
        """
        if self._active and self._holds and not self.is_spring:
            self._compensation += torque

    def advance(self) -> None:
        """Advance by one period.

        The compensation starts as the mean disturbance since breakaway, later it is an exponential
        average: a single noisy value would persist.
        """
        if self._stiffening > 0.0:
            self._stiffening -= self._period
            self._numbers[:] = self._stiff
            if self._stiffening > 0.0:
                stiff = self._stiff[_BANDWIDTH_AT]
                done = 1.0 - self._stiffening / _STIFFENING_S
                self._numbers[_BANDWIDTH_AT] = self._soft + done * (stiff - self._soft)
                self._numbers[_COMPENSATION_AT] = self._period / _COMPENSATION_S
            return
        if not self._active or self._holds:
            return
        self._elapsed += self._period
        settled = self._elapsed - BREAKAWAY_S
        if settled > 0.0:
            average_s = min(max(settled, self._period), _COMPENSATION_S)
            self._numbers[_BANDWIDTH_AT] = _BANDWIDTH
            self._numbers[_COMPENSATION_AT] = self._period / average_s


class ForceLimit:
    """Monitors the contact force of an arm against its limit.

    Contact is reported by switches on links, tool and payload; the force follows from the external
    torques minus their baseline before the contact, which is friction or mass error. An excess is
    reported once, and again only after the force was below the limit, so that the arm can retreat.

    Args:
        world: World that contains the arm.
        arm: Name of the arm.
        touch: Momentum observer of the arm.
    """

    def __init__(self, world: World, arm: str, touch: MomentumObserver) -> None:
        self._world = world
        self._arm = arm
        self._touch = touch
        self._hardware = world.hardware[arm]
        self._nominal = world.nominal[arm]
        self._limit_n = world.declared_arms[arm].force_limit
        # A force F causes torques of at least SINGULAR * F (see there); half of that as a margin.
        # Below, neither contacts nor wrench need to be computed.
        self._negligible = (0.5 * SINGULAR * self._limit_n) ** 2
        self._reported = False
        self._generation = -1

    def look(self, square: float) -> ForceLimitFailure | None:
        """Failure ``FORCE_LIMIT`` if the force has begun to exceed the limit, else None.

        Args:
            square: Squared norm of `MomentumObserver.contact_torque`, (N m)².
        """
        if square < self._negligible:
            self._reported = False
            return None
        contact_torque = self._touch.contact_torque
        if self._generation != self._world.generation:
            self._generation = self._world.generation
            self._contacts = OutsideContacts(self._world, self._arm)
        touching = self._contacts.deepest()
        if touching is None:
            # Without contact, external torques are model errors: the new baseline.
            self._touch.set_baseline()
            self._reported = False
            return None
        wrench = tool_wrench(self._nominal, self._hardware.q, contact_torque)
        force_n = float(np.linalg.norm(wrench[:3]))
        was_reported = self._reported
        self._reported = force_n > self._limit_n
        if was_reported or not self._reported:
            return None
        return ForceLimitFailure(*touching, force_n, self._limit_n)


def tool_wrench(nominal: NominalArm, q: Vector, torque: Vector) -> Vector:
    """Wrench on the tool that explains external joint torques best (least squares).

    Args:
        nominal: Nominal model of the arm.
        q: Joint positions, of shape (dof,), rad.
        torque: External torques, of shape (dof,), N m.

    Returns:
        Force in N, then moment in N m about the tool, in the world, of shape (6,).
    """
    jacobian = nominal.tool_jacobian_at(q)
    inverse = np.asarray(np.linalg.pinv(jacobian.T, rcond=SINGULAR), dtype=np.float64)
    wrench: Vector = inverse @ torque
    return wrench


def warm_up_control() -> None:
    """Compile the kernels of the control law, by calling them with arrays of the final types."""
    from bt_dualarm.control.control_kernels import command_set_point, observe

    links = np.zeros((1, LINK))
    state = np.zeros((STATE, 1))
    links[:, ROTOR] = 1.0
    law = np.ones(len(ControlLaw._fields) + 2)
    observe(law, state)
    joints = np.ones((CONSTANTS, 1))
    telemetry = np.zeros(TELEMETRY)
    limits = np.ones((LIMITS, 1))
    drives = np.ones((1, DRIVES))
    command_set_point(
        law, limits, links, joints, np.zeros((2, 1, 1)), drives, WITHIN_LIMITS, state, telemetry
    )
