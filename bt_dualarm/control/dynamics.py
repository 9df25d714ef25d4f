"""Control law parameters, nominal dynamics of an arm with its payload, and effort limits."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterable
from typing import Final, TypeAlias

import mujoco
import numpy as np

from bt_dualarm.control.kernel_rows import (
    CONSTANTS,
    COULOMB,
    DEADBAND,
    LIMIT,
    OFFSET,
    RISE,
    STATIC_EXCESS,
    STRIBECK,
    TOP_SPEED,
    VISCOUS,
    ControlLaw,
)
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.robots.robot import Robot
from bt_dualarm.sim.arm_models import NominalArm, NominalLoad
from bt_dualarm.trajectory.set_points import at_scale
from bt_dualarm.trajectory.trajectory import Trajectory

BANDWIDTH: Final = 75.0
"""Natural frequency w of the error dynamics e'' + 2we' + w²e = 0 (critically damped), rad/s.

Stable with 3 ms more drive delay than modeled and 20 % of inertia error; 90 rad/s is not.
"""

OBSERVER_BANDWIDTH: Final = 300.0
"""Triple pole of the observer error, 1/s. Four times the control bandwidth, so that it hardly
affects the loop; encoder noise of 2e-5 rad then causes velocity noise of 6e-3 rad/s."""

TOUCH_BANDWIDTH: Final = 50.0
"""Bandwidth of the momentum observer, 1/s: it shows 63 % of a step after 20 ms."""

DRIVE_DELAY_S: Final = 0.001
"""Delay until a torque acts, s: one cycle of a drive with a 1 kHz torque interface."""

_COMPENSATION_LIMIT: Final = 0.3
"""Fraction of a joint's effort limit that may compensate a disturbance. Sufficient for twice the
modeled dry friction or 20 % of mass error; with more, an arm in contact would push ever harder."""

_DEADBAND_RAD: Final = 1e-4
"""Position error at which a joint with dry friction, commanded to rest, is not corrected, rad: the
tool is within 0.1 mm. For less, dry friction and observer would cause a limit cycle (hunting)."""

_VELOCITY_FILTER_S: Final = 0.05
"""Time constant of the velocity error filter, s."""

_FRICTION_SPEED: Final = 0.02
"""Velocity over which dry friction is smoothed where a joint reverses, rad/s: near rest, the
sign of the actual velocity is not known any better."""

EFFORT_SHARE = 0.95
"""Fraction of a joint's effort limit that a motion may use; the rest is reserved for feedback."""

SLOWEST = 0.1
"""Minimum time scale to which a payload may slow a motion: slower, the arm can barely hold it."""

_SAMPLE_S = 0.024
"""Time between two samples of a motion, s: half of that in which a joint reaches its full
acceleration."""

_MAX_SAMPLES = 500
"""Maximum number of samples of a motion."""

_Body: TypeAlias = tuple[float, Matrix, Pose]
"""Mass in kg; inertia about the center of mass, of shape (3, 3), kg m²; pose of the center of mass
and the axes of the inertia, in a link."""


def control_law(period: float, timestep: float, gravity: Vector) -> ControlLaw:
    """Parameters of the control law.

    The observer gains give its error a triple pole at ``exp(-OBSERVER_BANDWIDTH * period)``: they
    are those of the critically damped g-h-k filter (Brookner, Tracking and Kalman Filtering Made
    Easy, 1998).

    Args:
        period: Control period, for which a torque is held, s.
        timestep: Simulation time step, s.
        gravity: Acceleration of gravity in the world, of shape (3,), m/s².
    """
    pole = math.exp(-OBSERVER_BANDWIDTH * period)
    return ControlLaw(
        gravity=gravity,
        period=period,
        # T²/2, plus half a step: semi-implicit Euler moves by the velocity at the end of each step.
        position_step=0.5 * period * (period + timestep),
        gain_q=1.0 - pole**3,
        gain_v=1.5 * (1.0 - pole) ** 2 * (1.0 + pole) / period,
        gain_d=(1.0 - pole) ** 3 / period**2,
        delay_share=DRIVE_DELAY_S / period,
        delay=DRIVE_DELAY_S,
        # A torque takes the velocity from half a time step before now to half a time step before
        # the next set-point: it should produce the acceleration in the middle of that interval.
        lead=0.5 * (period - timestep) / period,
        # Semi-implicit Euler steps end with the velocity that continuous motion has halfway.
        half_step=0.5 * timestep,
        velocity_error_share=-math.expm1(-period / _VELOCITY_FILTER_S),
        bandwidth=BANDWIDTH,
        touch_bandwidth=TOUCH_BANDWIDTH,
        compensation_limit=_COMPENSATION_LIMIT,
        friction_speed=_FRICTION_SPEED,
        compensation_share=1.0,
    )


def joint_constants(nominal: NominalArm, top_speed: Vector) -> Matrix:
    """Joint constants of the control kernels, of shape (CONSTANTS, dof), see `kernel_rows`.

    Args:
        nominal: Nominal model of the arm.
        top_speed: Velocity limits of the robot's joints, of shape (dof,), rad/s.
    """
    friction = nominal.friction
    effort = nominal.robot.limits.effort
    joints = np.zeros((CONSTANTS, len(effort)))
    joints[LIMIT] = effort
    joints[DEADBAND] = _DEADBAND_RAD * (friction.coulomb > 0.0)
    joints[COULOMB] = friction.coulomb
    joints[STATIC_EXCESS] = friction.static - friction.coulomb
    joints[STRIBECK] = -1.0 / np.square(friction.stribeck_velocity)
    joints[VISCOUS] = friction.viscous
    joints[RISE] = friction.rise
    joints[OFFSET] = friction.offset
    joints[TOP_SPEED] = top_speed
    return joints


class ArmDynamics:
    """Equations of motion of an arm with its payload, as one chain of rigid bodies.

    Masses are those of the robot description and the tree file, not those of the simulated plant.

    Args:
        nominal: Nominal model of the arm.
        loads: Objects that it holds rigidly; those of unknown mass are ignored.
    """

    def __init__(self, nominal: NominalArm, loads: Iterable[NominalLoad] = ()) -> None:
        self.model = copy.copy(nominal.model)
        self.data = mujoco.MjData(self.model)
        known = [
            (load.share * load.mass, np.diag(load.share * load.inertia), load.pose)
            for load in loads
            if load.mass is not None and load.inertia is not None and load.share > 0.0
        ]
        if known:
            _load(self.model, nominal.tool_body, known)
            mujoco.mj_setConst(self.model, self.data)

    def update(self, q: Vector, v: Vector) -> None:
        """Set positions in rad and velocities in rad/s, each of shape (dof,)."""
        model = self.model
        data = self.data
        data.qpos[:] = q
        data.qvel[:] = v
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_makeM(model, data)
        mujoco.mj_factorM(model, data)
        mujoco.mj_comVel(model, data)
        mujoco.mj_rne(model, data, 0, data.qfrc_bias)

    @property
    def inertia(self) -> Matrix:
        """Inertia matrix at the last update, of shape (dof, dof), kg m²."""
        inertia = np.empty((self.model.nv, self.model.nv))
        mujoco.mj_fullM(self.model, self.data, inertia)
        return inertia

    @property
    def bias(self) -> Vector:
        """Gravity, Coriolis and centrifugal torques at the last update, of shape (dof,), N m."""
        bias: Vector = self.data.qfrc_bias
        return bias

    def inertia_times(self, acceleration: Vector) -> Vector:
        """Inertia matrix times accelerations of shape (dof,), rad/s²: torques of shape (dof,)."""
        product = np.empty_like(acceleration)
        mujoco.mj_mulM(self.model, self.data, product, acceleration)
        return product

    def accelerations(self, torque: Vector) -> Vector:
        """Accelerations in rad/s² caused by net torques in N m, both of shape (dof,)."""
        found = np.empty((1, len(torque)))
        mujoco.mj_solveM(self.model, self.data, found, torque[None])
        accelerations: Vector = found[0]
        return accelerations

    def at_rest(self, q: Vector) -> Vector:
        """Torques in N m that hold a configuration in rad, both of shape (dof,)."""
        zero = np.zeros_like(q)
        return self.moving(q, zero, zero)

    def moving(self, q: Vector, v: Vector, a: Vector) -> Vector:
        """Torques of a motion, of shape (dof,), N m: inverse dynamics (recursive Newton-Euler).

        Args:
            q: Configuration, of shape (dof,), rad.
            v: Velocity, of shape (dof,), rad/s.
            a: Acceleration, of shape (dof,), rad/s².
        """
        model = self.model
        data = self.data
        data.qpos[:] = q
        data.qvel[:] = v
        data.qacc[:] = a
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        torques = np.empty(model.nv)
        mujoco.mj_rne(model, data, 1, torques)
        total: Vector = torques + model.dof_armature * a  # mj_rne leaves rotor inertia out
        return total


def _load(model: mujoco.MjModel, link: int, loads: Iterable[_Body]) -> None:
    """Add the payload to a link: combined mass, center of mass and inertia."""
    own = Pose(model.body_ipos[link].copy(), model.body_iquat[link].copy())
    bodies = [(float(model.body_mass[link]), np.diag(model.body_inertia[link]), own), *loads]
    mass = sum(body[0] for body in bodies)
    center: Vector = sum((body[0] * body[2].position for body in bodies), np.zeros(3)) / mass
    tensor = sum((_inertia_about(center, *body) for body in bodies), np.zeros((3, 3)))
    moments, axes = np.linalg.eigh(tensor)
    axes *= np.sign(np.linalg.det(axes))  # a rotation, not a reflection
    model.body_mass[link] = mass
    model.body_ipos[link] = center
    model.body_inertia[link] = moments
    mujoco.mju_mat2Quat(model.body_iquat[link], axes.ravel())


def _inertia_about(point: Vector, mass: float, inertia: Matrix, pose: Pose) -> Matrix:
    """Inertia of a body about a point of a link, in the link's axes (parallel-axis theorem)."""
    rotation = pose.rotation_matrix
    offset = pose.position - point
    own: Matrix = rotation @ inertia @ rotation.T
    return own + mass * (float(offset @ offset) * np.eye(3) - np.outer(offset, offset))


def within_efforts(motion: Trajectory, robot: Robot, dynamics: ArmDynamics) -> Trajectory:
    """The same motion, slowed down until the effort limits suffice.

    At a constant time scale r, velocity scales with r and acceleration with r², so that torques
    beyond the holding torques scale with r²: the largest r of each sample and joint is
    ``sqrt(available / required)``, and the least of them is taken.

    Args:
        motion: Motion from rest to rest.
        robot: Robot that moves.
        dynamics: Its dynamics with its payload.

    Raises:
        Failure: ``OVERLOADED`` if some configuration of the motion cannot even be held, or if the
            motion would be slower than `SLOWEST`.
    """
    count = min(int(motion.duration / _SAMPLE_S) + 2, _MAX_SAMPLES)
    index = np.unique(np.linspace(0, len(motion) - 1, count).round().astype(int))
    samples = motion.rows(index)
    # Gravity alone is independent of the time scale: no slowdown helps against it.
    rest = np.array([dynamics.at_rest(q) for q in samples[0]])
    refuse_overload(rest, robot)
    total = np.array([dynamics.moving(*sample) for sample in zip(*samples, strict=True)])
    most = EFFORT_SHARE * robot.limits.effort
    if (np.abs(total) <= most).all():
        return motion
    required = total - rest
    available = np.where(required > 0.0, most - rest, most + rest)
    scales = np.sqrt(available / np.maximum(np.abs(required), 1e-9))
    scale = float(scales.min())
    if scale < SLOWEST:
        joint = int(scales.min(axis=0).argmin())
        raise _overload(robot, joint, float(np.abs(rest[:, joint]).max()))
    return at_scale(motion, scale)


def most_force(torques: Matrix, levers: Matrix, robot: Robot) -> float:
    """Largest force that the joints can exert in all of several configurations, N.

    Args:
        torques: Holding torques of n configurations, of shape (n, dof), N m.
        levers: Joint torques for each newton of the force, of the same shape, m.
        robot: Robot that exerts it.
    """
    left = robot.limits.effort - np.sign(levers) * torques
    return float((left / np.maximum(np.abs(levers), 1e-9)).min())


def refuse_overload(torques: Matrix, robot: Robot) -> None:
    """Check holding torques against the effort limits.

    Args:
        torques: Holding torques of n configurations, of shape (n, dof), N m.
        robot: Robot that is held.

    Raises:
        Failure: ``OVERLOADED`` with the joint that exceeds its share of the limit most.
    """
    worst: Vector = np.abs(torques).max(axis=0)
    shares = worst / robot.limits.effort
    joint = int(shares.argmax())
    if shares[joint] > EFFORT_SHARE:
        raise _overload(robot, joint, float(worst[joint]))


def _overload(robot: Robot, joint: int, torque: float) -> Failure:
    effort = float(robot.limits.effort[joint])
    return Failure(
        "OVERLOADED",
        f"joint {robot.joints[joint]} would need {torque:.3g} N m to hold the arm at rest; "
        f"its limit is {effort:.3g} N m"
        + (f", of which {EFFORT_SHARE:.0%} may be planned with" if torque <= effort else ""),
        joint=robot.joints[joint],
        torque_nm=torque,
        effort_nm=effort,
    )
