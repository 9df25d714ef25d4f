"""Internal wrench of an object that several arms hold: its estimate, and its regulation.

Arms that hold one rigid object can press against each other through it without moving it. The
contact wrenches of the arms therefore have two parts: those that accelerate the object and bear its
weight, and the internal ones, which sum to zero. The first part is distributed as if each arm
carried a virtual rigid body of mass ``share`` at its grasp, and these bodies moved together (Erhart
and Hirche, Internal force analysis and load distribution for cooperative multi-robot manipulation,
IEEE T-RO 31(5), 2015; for equal shares the non-squeezing pseudoinverse of Walker, Freeman and
Marcus, IJRR 10(4), 1991). What a contact wrench exceeds it by is internal::

    l = BORNE_GYRATION_M, so that the hands share moments about the line between two grasps
    J = sum_i share_i (l² 1 + |r_i|² 1 - r_i r_i^T)      r_i: grasp from the center sum share_i p_i
    F = sum_i f_i,  M = sum_i m_i + r_i x f_i,  alpha = J^-1 M
    internal force  of arm i:  f_i - share_i (F + alpha x r_i)
    internal moment of arm i:  m_i - share_i l² alpha    about its grasp

While the arms carry an object of known mass freely, the sum of all wrenches beyond its load is
zero; while it still stands, its support bears its weight at most. What is measured beyond that is
an error. It is not distributed by these shares, but by how little the joint torques of each arm
tell (`without_load`): at rest, dry friction hides 80 N at the tool of a UR10.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from bt_dualarm.control.computed_torque import SINGULAR
from bt_dualarm.control.controller import JointController
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.sim.arm_models import BORNE_GYRATION_M, NominalArm
from bt_dualarm.sim.devices import ArmHardware

_FORCE_GAIN: Final = 1e-4
"""Speed at which a grasp yields to an internal force, m/s per N: an arm with a stiffness of 50 N/mm
at the tool loses it with a time constant of 50 ms. Twice as much overshoots with friction."""

_MOMENT_GAIN: Final = 1e-3
"""Likewise to an internal moment, rad/s per N m."""

_FOLLOW_1_S: Final = 20.0
"""Rate at which a grasp follows the displacement that the arms have forced on each other, 1/s: the
difference between their measured and commanded positions that no motion of the object explains.
Without it, yielding and the disturbance observers are two integrators in a row, which overshoot;
and what friction has led astray at a reversal stays, until the observers press against it."""

_DEADBAND_N: Final = 2.0
_DEADBAND_NM: Final = 0.5
"""Internal wrench that is ignored: joint friction and sensor noise cause as much."""

_AT_REST_N: Final = 6.0
"""Internal force that may be left at the end of a motion, N: some is an error of the estimate."""

_AT_REST_M: Final = 5e-5
"""Internal displacement that may be left then, m: the observers press against a larger one."""

_FASTEST: Final = (0.01, 0.05)
"""Largest speed of yielding, m/s and rad/s."""

_FARTHEST: Final = (0.006, 0.04)
"""Largest displacement by yielding, m and rad: beyond, something else is wrong."""

_TORQUE_DOUBT: Final = 0.01
"""Error of joint torques besides friction, as a fraction of the effort limits."""

_SLOW_RAD_S: Final = 0.05
"""Joint speed below which dry friction may not have its full size, or the other sign, rad/s."""

_SMOOTH_S: Final = 0.005
"""Time constant of each of the two filters of the yielding speed, s. With a single one, sensor
noise caused accelerations that broke the jerk limits of the joints."""

_EASE_S: Final = 0.1
"""Time in which yielding sets in at the beginning of a motion, s."""

_FILTER_S: Final = 0.05
"""Time constant of the reported internal wrench, s."""


def internal_wrenches(shares: Sequence[float], points: Matrix, wrenches: Matrix) -> Matrix:
    """Internal part of the contact wrenches on an object.

    Args:
        shares: Share of the load that each arm bears; they add up to 1.
        points: Positions of the grasps in the world, of shape (n, 3), m.
        wrenches: Force on the object in N and moment about the grasp in N m, in the world, (n, 6).

    Returns:
        Internal force and moment about the grasp, of shape (n, 6); the forces add up to zero.
    """
    share = np.asarray(shares, dtype=float)[:, None]
    forces = wrenches[:, :3]
    moments = wrenches[:, 3:]
    arms = points - (share * points).sum(axis=0)
    total = forces.sum(axis=0)
    moment = (moments + crossed(arms, forces)).sum(axis=0)
    square = BORNE_GYRATION_M**2 + float((share[:, 0] * (arms**2).sum(axis=1)).sum())
    inertia = square * np.eye(3) - (share * arms).T @ arms
    alpha = np.linalg.solve(inertia, moment)
    required = share * (total + crossed(alpha[None], arms))
    return np.hstack((forces - required, moments - share * BORNE_GYRATION_M**2 * alpha))


def without_load(
    points: Matrix, wrenches: Matrix, doubts: Matrix, support_n: float = 0.0
) -> Matrix:
    """Most likely wrenches if the measured ones should add up to what a support bears.

    Args:
        points: Positions of the grasps in the world, of shape (n, 3), m.
        wrenches: Measured wrenches on the object about the grasps, beyond its load, (n, 6).
        doubts: Covariance of each of them, of shape (n, 6, 6).
        support_n: Largest force of a support on the object, N: the standard deviation of the sum
            of the wrenches. Its moment is that of the same force at a grasp.

    Returns:
        Wrenches, of shape (n, 6), that add up to zero if there is no support.
    """
    to_middle = np.zeros((len(points), 6, 6))
    to_middle[:, range(6), range(6)] = 1.0
    levers = points - points.mean(axis=0)
    x, y, z = levers.T
    to_middle[:, (3, 4, 5), (1, 2, 0)] = np.column_stack((-z, -x, -y))
    to_middle[:, (4, 5, 3), (0, 1, 2)] = np.column_stack((z, x, y))
    spread = doubts @ to_middle.transpose(0, 2, 1)
    total = (to_middle @ wrenches[:, :, None]).sum(axis=0)
    longest = float(np.linalg.norm(levers, axis=1).max())
    support = np.diag(np.square(support_n * np.array((1.0, 1.0, 1.0, longest, longest, longest))))
    solved = np.linalg.solve((to_middle @ spread).sum(axis=0) + support, total)
    left: Matrix = wrenches - (spread @ solved)[:, :, 0]
    return left


def crossed(first: Matrix, second: Matrix) -> Matrix:
    """Cross products of rows, of shape (n, 3); a tenth of the time of `numpy.cross`."""
    a, b, c = first.T
    d, e, f = second.T
    return np.column_stack((b * f - c * e, c * d - a * f, a * e - b * d))


class CarryingArm:
    """Sensors and model of one of the arms that hold an object.

    Args:
        nominal: Nominal model of the arm.
        hardware: Its sensors.
        controller: Its joint controller.

    Attributes:
        position: Position of the tool at the last `look`, of shape (3,), m.
        wrench: Wrench on the object then, minus its load, of shape (6,), N and N m. The load that
            the arm's model supports is not part of it.
        lag: Twist, of shape (6,), m and rad, from where the tool was commanded to where it was.
        doubt: Covariance of the wrench, of shape (6, 6): most of it is due to joint friction.
    """

    def __init__(
        self, nominal: NominalArm, hardware: ArmHardware, controller: JointController
    ) -> None:
        self.position = np.zeros(3)
        self.wrench = np.zeros(6)
        self.lag = np.zeros(6)
        self.doubt = np.eye(6)
        self._floor = _TORQUE_DOUBT * nominal.robot.limits.effort
        self._nominal = nominal
        self._hardware = hardware
        self._controller = controller
        self._inverse: Matrix = np.zeros((0, 6))

    def look(self, time: float) -> None:
        """Update the attributes at a simulated time in s."""
        q = self._hardware.q
        jacobian = self._nominal.tool_jacobian_at(q)
        self._inverse = np.asarray(np.linalg.pinv(jacobian, rcond=SINGULAR), dtype=np.float64)
        self.position = self._nominal.tool_position_at(q)
        self.wrench = -self._inverse.T @ self._controller.touch.torque
        # Controllers may be half a period apart: both set-points must be those of one moment.
        sent = self._controller.commanded_at(time)
        self.lag = jacobian @ (q - sent.q)
        # Where a joint reverses, neither sign nor size of its dry friction is known.
        friction = self._nominal.friction
        unknown = np.maximum(np.exp(-np.square(sent.v / _SLOW_RAD_S)), friction.uncertainty)
        torque = np.square(self._floor) + np.square(unknown * friction.static)
        self.doubt = self._inverse.T @ (torque[:, None] * self._inverse)

    def joint_velocity(self, twist: Vector) -> Vector:
        """Joint velocities, of shape (dof,), rad/s, for a twist of the tool in the world, (6,).

        At the configuration of the last `look`.
        """
        velocity: Vector = self._inverse @ twist
        return velocity


class InternalWrenchRegulator:
    """Lets the arms that hold an object yield to the internal wrench that their joints sense.

    Two stiff arms press against each other with 50 N for 0.1 mm of disagreement, and compliant ones
    still with 25 N, since their disturbance observers compensate friction and, with it, the
    internal wrench. Each arm therefore moves its grasp slowly in the direction in which the object
    is pressed less, and follows the displacement that the arms have forced on each other. As both
    are internal, the object stays where it is.

    Call it once per control period, as the correction of a `CoupledMotion`.

    Args:
        arms: The arms, by name, in the order of the joints of the motion.
        shares: Share of the load of each.
        parts: Columns of each arm's joints.
        period: Control period, s.

    Attributes:
        force_n: Largest internal force of an arm, filtered, N.
        moment_nm: Largest internal moment of an arm about its grasp, filtered, N m.
        strain_m: Largest internal displacement of an arm, filtered, m.
        total: Sum of all wrenches on the object minus its load: force in N, then moment about the
            center of the grasps in N m, filtered, of shape (6,). Contact of the object changes it.
    """

    def __init__(
        self,
        arms: Mapping[str, CarryingArm],
        shares: Mapping[str, float],
        parts: Mapping[str, slice],
        period: float,
    ) -> None:
        self.force_n = 0.0
        self.moment_nm = 0.0
        self.strain_m = 0.0
        self.total = np.zeros(6)
        self._arms = dict(arms)
        self._shares = [shares[arm] for arm in arms]
        self._parts = [parts[arm] for arm in arms]
        self._period = period
        # Displacements have the algebra of the wrenches that would cause them on virtual bodies.
        square = BORNE_GYRATION_M**2
        self._masses = np.outer(self._shares, (1.0, 1.0, 1.0, square, square, square))
        self._internal = np.zeros((len(arms), 6))
        self._strain = np.zeros((len(arms), 6))
        self._share = 0.0
        self._aimed = np.zeros((len(arms), 6))
        self._speed = np.zeros((len(arms), 6))
        self._yielded = np.zeros((len(arms), 6))
        self._dof = max(part.stop for part in parts.values())
        self._has_looked = False
        self._support_n: float | None = None

    def begin(self, support_n: float | None = None) -> None:
        """Begin a new motion: the set-points of the arms include what they have yielded so far.

        Args:
            support_n: Largest force of a support on the object, N: its weight, or 0 if the arms
                carry all of it. None if they do not know its mass.
        """
        self._support_n = support_n
        self._share = 0.0
        self._aimed[:] = 0.0
        self._speed[:] = 0.0

    def is_pressed(self) -> bool:
        """Whether the arms press so hard that they would not come to rest at their set-points.

        Their disturbance observers act as integrators: against each other, both push harder until
        the set-points agree.
        """
        return self.force_n > _AT_REST_N or self.strain_m > _AT_REST_M

    def look(self, time: float) -> tuple[Matrix, Matrix]:
        """Update the estimates.

        Args:
            time: Simulated time, s.

        Returns:
            Unfiltered internal wrenches and displacements, each of shape (n, 6).
        """
        arms = self._arms.values()
        for arm in arms:
            arm.look(time)
        points = np.array([arm.position for arm in arms])
        wrenches = np.array([arm.wrench for arm in arms])
        lags = np.array([arm.lag for arm in arms])
        likely = wrenches
        if self._support_n is not None:
            doubts = np.array([arm.doubt for arm in arms])
            likely = without_load(points, wrenches, doubts, self._support_n)
        found = internal_wrenches(self._shares, points, likely)
        strain = internal_wrenches(self._shares, points, self._masses * lags) / self._masses
        center = np.asarray(self._shares) @ points
        moments = wrenches[:, 3:] + crossed(points - center, wrenches[:, :3])
        total = np.concatenate((wrenches[:, :3].sum(axis=0), moments.sum(axis=0)))
        # The first sample is taken as it is: a filter that starts at zero would report no squeeze
        # during the first 0.1 s, when the second arm has just closed its hand.
        new = -np.expm1(-self._period / _FILTER_S) if self._has_looked else 1.0
        self._has_looked = True
        self._internal += new * (found - self._internal)
        self._strain += new * (strain - self._strain)
        self.total = self.total + new * (total - self.total)
        self.force_n = float(np.linalg.norm(self._internal[:, :3], axis=1).max())
        self.moment_nm = float(np.linalg.norm(self._internal[:, 3:], axis=1).max())
        self.strain_m = float(np.linalg.norm(self._strain[:, :3], axis=1).max())
        return found, strain

    def __call__(self, time: float) -> Vector:
        """Velocities that all joints should add, side by side, rad/s, at a simulated time in s."""
        found, strain = self.look(time)
        self._share = min(self._share + self._period / _EASE_S, 1.0)
        velocity = np.empty(self._dof)
        new = -np.expm1(-self._period / _SMOOTH_S)
        for i, arm in enumerate(self._arms.values()):
            wanted = self._share * self._wanted(found[i], strain[i], self._yielded[i])
            self._aimed[i] += new * (wanted - self._aimed[i])
            self._speed[i] += new * (self._aimed[i] - self._speed[i])
            self._yielded[i] += self._period * self._speed[i]
            velocity[self._parts[i]] = arm.joint_velocity(self._speed[i])
        return velocity

    @staticmethod
    def _wanted(internal: Vector, strain: Vector, yielded: Vector) -> Vector:
        """Twist with which a grasp should yield, of shape (6,)."""
        twist = np.empty(6)
        gains = (_FORCE_GAIN, _DEADBAND_N), (_MOMENT_GAIN, _DEADBAND_NM)
        for part, (gain, deadband), fastest, farthest in zip(
            (slice(0, 3), slice(3, 6)), gains, _FASTEST, _FARTHEST, strict=True
        ):
            size = float(np.linalg.norm(internal[part]))
            relief = -gain * max(size - deadband, 0.0) / max(size, 1e-9) * internal[part]
            wanted = relief + _FOLLOW_1_S * strain[part]
            speed = float(np.linalg.norm(wanted))
            # A grasp at its farthest may still go back: only further yielding is stopped.
            is_far = float(wanted @ yielded[part]) > farthest * speed
            twist[part] = 0.0 if is_far else wanted * min(1.0, fastest / max(speed, 1e-12))
        return twist
