"""Following a moving target in a plane, at the control rate, within the arm's limits.

The tool's acceleration is ``a = â + 2w(v̂ + u - v)``, where (p̂, v̂, â) is the target's motion and
``u`` points to the target: ``w/2`` times the distance near it, and farther away no faster than the
arm can brake. Near the target that is ``e'' + 2we' + w²e = 0``. The third axis and the orientation
are held, and come first where the joints' accelerations do not suffice for both. Joint
accelerations follow by ``q'' = J⁺(x'' - J'q')`` and are integrated, so that positions, velocities
and accelerations always belong together (closed-loop inverse kinematics, Siciliano et al.,
Robotics, 3.7.1 and 8.6.1).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np

from bt_dualarm.errors import Failure
from bt_dualarm.motion.kinematics.arm_kinematics import Kinematics
from bt_dualarm.motion.setpoints.online_step import OnlineStep
from bt_dualarm.motion.setpoints.set_point import SetPoint
from bt_dualarm.motion.setpoints.stopping_distance import StoppingFeasibility
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.robots.robot import JointLimits

HOLD_BANDWIDTH = 40.0
"""With which the held directions return, rad/s."""

POSTURE_BANDWIDTH = 4.0
"""With which a redundant arm returns to its posture at the start, rad/s."""

LOST_M = 0.02
"""How far the tool may leave its plane in m before it gives up."""

LOST_RAD = 0.1
"""How far the tool may turn from its orientation in rad before it gives up."""

BRAKING_BANDWIDTH = 8.0
"""With which the tool comes to rest when there is no target, rad/s."""

_BRAKE_SHARE = 0.5  # of the acceleration is planned for slowing down before the target
_TOP_SHARE = 0.95  # of the velocity limits is planned for
_DAMPING = 1e-6  # of the pseudo-inverse: keeps it finite at a singularity


class PlaneTarget(NamedTuple):
    """Where the tool should be in the plane: m, m/s, m/s² from its start, each of shape (2,)."""

    position: Vector
    velocity: Vector
    acceleration: Vector


TargetOf: TypeAlias = Callable[[float, Vector], PlaneTarget | None]
"""The target at a simulated time in s, for a tool displaced so in the plane, (2,), in m.

None to come to rest.
"""


class PlanarServo:
    """A stream of set-points that follows a target in a plane.

    Args:
        kinematics: Kinematics of the arm.
        limits: Already scaled by the speed that is allowed.
        period: Seconds between set-points.
        start: The last set-point that was sent.
        axes: Unit vectors of the plane in the world, of shape (2, 3).
        target: Says where to go.
        bandwidth: ``w`` in rad/s.

    Attributes:
        time_scale: Share, from 0 to 1, of the velocity that it would have: the guard's to set.
    """

    def __init__(
        self,
        kinematics: Kinematics,
        limits: JointLimits,
        period: float,
        start: SetPoint,
        axes: Matrix,
        target: TargetOf,
        bandwidth: float,
    ) -> None:
        self._kinematics = kinematics
        self._limits = limits
        self._period = period
        self._axes = axes
        self._target = target
        self._bandwidth = bandwidth
        self._sent = self._now = start
        self._foresight = StoppingFeasibility(limits)
        self._pursuer = OnlineStep(limits, period)
        self._posture = start.q
        self._origin = kinematics.matrix(start.q)
        self._normal = np.cross(axes[0], axes[1])
        self._last_jacobian = kinematics.jacobian(start.q)
        self.displacement = np.zeros(2)
        self.velocity = np.zeros(2)
        self.time_scale = 1.0

    def __call__(self, time: float) -> SetPoint:
        """The set-point for ``time``.

        Raises:
            Failure: ``UNREACHABLE`` where the arm can no longer hold the plane or the orientation.
        """
        q, v = self._now.q, self._now.v
        tool, jacobian = self._kinematics.tool(q)
        twist = jacobian @ v
        self.displacement = self._axes @ (tool[:3, 3] - self._origin[:3, 3])
        self.velocity = self._axes @ twist[:3]
        inverse = _pseudo_inverse(jacobian)
        drift = (jacobian - self._last_jacobian) @ v / self._period
        self._last_jacobian = jacobian
        hold = inverse @ (self._held(tool, twist) - drift)
        if len(q) > 6:
            rest = POSTURE_BANDWIDTH**2 * (self._posture - q) - 2 * POSTURE_BANDWIDTH * v
            hold += rest - inverse @ (jacobian @ rest)
        move = inverse[:, :3] @ (self._pursuit(time, inverse) @ self._axes)
        a = self._within(hold, move)
        self._sent = self._feasible(SetPoint(q, v, a))
        self._now = self._after(self._sent)
        return self._sent

    def _held(self, tool: Matrix, twist: Vector) -> Vector:
        """Acceleration, of shape (6,), that keeps the third axis and the orientation."""
        w = HOLD_BANDWIDTH
        off = float(self._normal @ (self._origin[:3, 3] - tool[:3, 3]))
        speed = float(self._normal @ twist[:3])
        skew = self._origin[:3, :3] @ tool[:3, :3].T
        turn = 0.5 * np.array(
            (skew[2, 1] - skew[1, 2], skew[0, 2] - skew[2, 0], skew[1, 0] - skew[0, 1])
        )
        if abs(off) > LOST_M or max(np.abs(turn).tolist()) > LOST_RAD:
            raise Failure(
                "UNREACHABLE",
                f"the tool cannot follow there: it is {abs(off) * 1e3:.0f} mm out of its plane and "
                f"{np.degrees(np.linalg.norm(turn)):.0f}° from its orientation",
                plane_error_m=abs(off),
                angle_error_rad=float(np.linalg.norm(turn)),
            )
        return np.concatenate(
            ((w * w * off - 2 * w * speed) * self._normal, w * w * turn - 2 * w * twist[3:])
        )

    def _pursuit(self, time: float, inverse: Matrix) -> Vector:
        """Acceleration in the plane, of shape (2,)."""
        target = self._target(time, self.displacement)
        if target is None:
            return -2 * BRAKING_BANDWIDTH * self.velocity
        away = target.position - self.displacement
        distance = float(np.hypot(*away)) + 1e-12
        braking = 2 * _BRAKE_SHARE * self._reachable_acceleration(inverse) * distance
        closing = min(0.5 * self._bandwidth * distance, float(np.sqrt(braking)))
        goal = target.velocity + away * (closing / distance)
        share = self._passable_share(inverse, goal)
        ahead = target.acceleration if share == 1.0 else 0.0
        return ahead + 2 * self._bandwidth * (share * goal - self.velocity)

    def _passable_share(self, inverse: Matrix, velocity: Vector) -> float:
        """Share of a plane velocity that `time_scale` allows and the joints can stop from."""
        limits, q = self._limits, self._now.q
        rates = inverse[:, :3] @ (velocity @ self._axes)
        room = np.maximum(np.where(rates > 0, limits.upper - q, q - limits.lower), 0.0)
        braking = np.sqrt(2 * _BRAKE_SHARE * limits.acceleration * room)
        most = np.minimum(braking, _TOP_SHARE * limits.velocity)
        return float(min(self.time_scale, *(most / np.maximum(np.abs(rates), 1e-9)).tolist()))

    def _reachable_acceleration(self, inverse: Matrix) -> float:
        """What the joints allow in the worse of the two directions, m/s²."""
        per_unit = np.abs(inverse[:, :3] @ self._axes.T).max(axis=1)
        return float(min((self._limits.acceleration / np.maximum(per_unit, 1e-6)).tolist()))

    def _within(self, hold: Vector, move: Vector) -> Vector:
        """Both accelerations, as much of the second as the limits leave, then less of both."""
        limits, dt = self._limits, self._period
        left = limits.acceleration - hold * np.sign(move)
        share = min((left / np.maximum(np.abs(move), 1e-9)).tolist())
        a = hold + min(max(share, 0.0), 1.0) * move
        a *= min(1.0, 1.0 / max(1e-9, *(np.abs(a) / limits.acceleration).tolist()))
        change = a - self._now.a
        change *= min(1.0, 1.0 / max(1e-9, *(np.abs(change) / (limits.jerk * dt)).tolist()))
        within: Vector = self._now.a + change
        return within

    def _feasible(self, wanted: SetPoint) -> SetPoint:
        """The set-point itself; the hardest brake where it would be too late for one."""
        if self._foresight.all_feasible(wanted.q, wanted.v, wanted.a):
            return wanted
        last = self._sent
        return SetPoint(*self._pursuer.to_rest(np.array((last.q, last.v, last.a))))

    def _after(self, sent: SetPoint) -> SetPoint:
        dt = self._period
        return SetPoint(sent.q + sent.v * dt + 0.5 * sent.a * dt * dt, sent.v + sent.a * dt, sent.a)


def _pseudo_inverse(jacobian: Matrix) -> Matrix:
    """The damped right inverse, of shape (dof, 6)."""
    square = jacobian @ jacobian.T
    square.flat[::7] += _DAMPING
    inverse: Matrix = np.linalg.solve(square, jacobian).T.astype(float, copy=False)
    return inverse
