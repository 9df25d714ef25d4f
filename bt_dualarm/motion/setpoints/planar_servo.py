"""Following a moving target in a plane, at the control rate, within the arm's limits.

What the tool does in the plane says the following law, from what the joints allow there. The third
axis and the orientation are held: they come first where the joints' accelerations, or the change of
them in a period, do not suffice for both. Joint accelerations follow by ``q'' = J⁺(x'' - J'q')``
and are integrated, so that positions, velocities and accelerations always belong together
(closed-loop inverse kinematics, Siciliano et al., Robotics, 3.7.1 and 8.6.1).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np

from bt_dualarm.errors import Failure
from bt_dualarm.motion.kinematics.arm_kinematics import Kinematics
from bt_dualarm.motion.setpoints.following_law import (
    closing_velocity,
    fading_acceleration,
    following_gains,
)
from bt_dualarm.motion.setpoints.online_step import OnlineStep
from bt_dualarm.motion.setpoints.plane_reach import pseudo_inverse, reach_by_rates
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

SLACK_M = 1.5e-4
"""Jump of a target in m that takes all of the jerk: a few times the noise of an estimate."""

_BRAKING_SHARE = 0.3  # of the way to the acceleration that brakes, a period
_BRAKE_SHARE = 0.5  # of the acceleration is planned for slowing down before the target
_TOP_SHARE = 0.95  # of the velocity limits is planned for


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
        bandwidth: The most in rad/s with which it follows; the jerk of the joints may allow less.
        slack: Jump of the target in m for which it may take all of the jerk.

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
        slack: float = SLACK_M,
    ) -> None:
        self._kinematics = kinematics
        self._limits = limits
        self._period = period
        self._axes = axes
        self._target = target
        self._bandwidth = bandwidth
        self._slack = slack
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
        inverse = pseudo_inverse(jacobian)
        rates = inverse[:, :3] @ self._axes.T
        drift = (jacobian - self._last_jacobian) @ v / self._period
        self._last_jacobian = jacobian
        hold = inverse @ (self._held(tool, twist) - drift)
        if len(q) > 6:
            rest = POSTURE_BANDWIDTH**2 * (self._posture - q) - 2 * POSTURE_BANDWIDTH * v
            hold += rest - inverse @ (jacobian @ rest)
        now = self._axes @ (jacobian @ self._now.a + drift)[:3]
        a = self._within(hold, rates, now, *self._pursuit(time, rates))
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

    def _pursuit(self, time: float, rates: Matrix) -> tuple[Vector, float]:
        """Acceleration wanted in the plane, (2,), and the share of the way to it in a period."""
        reach = reach_by_rates(self._limits, rates)
        target = self._target(time, self.displacement)
        if target is None:
            wanted = fading_acceleration(-self.velocity, 2 * BRAKING_BANDWIDTH, reach.jerk)
            return wanted, _BRAKING_SHARE
        gains = following_gains(self._bandwidth, self._slack, reach.jerk, self._period)
        away = target.position - self.displacement
        goal = target.velocity + closing_velocity(away, gains, reach)
        share = self._passable_share(rates, goal)
        ahead = target.acceleration if share == 1.0 else 0.0
        lack = share * goal - self.velocity
        return ahead + fading_acceleration(lack, gains.b, reach.jerk), gains.f

    def _passable_share(self, rates: Matrix, velocity: Vector) -> float:
        """Share of a plane velocity that `time_scale` allows and the joints can stop from."""
        limits, q = self._limits, self._now.q
        turning = rates @ velocity
        room = np.maximum(np.where(turning > 0, limits.upper - q, q - limits.lower), 0.0)
        braking = np.sqrt(2 * _BRAKE_SHARE * limits.acceleration * room)
        most = np.minimum(braking, _TOP_SHARE * limits.velocity)
        return float(min(self.time_scale, *(most / np.maximum(np.abs(turning), 1e-9)).tolist()))

    def _within(
        self, hold: Vector, rates: Matrix, now: Vector, wanted: Vector, share: float
    ) -> Vector:
        """Joint accelerations, of shape (dof,), that hold, and move as far as the limits allow.

        Args:
            hold: Joint accelerations, of shape (dof,), that keep what is held.
            rates: Joint accelerations by those in the plane, of shape (dof, 2).
            now: Acceleration in the plane that was sent last, of shape (2,).
            wanted: The one that is wanted.
            share: Part of the way from one to the other that is to be gone.
        """
        top, last = self._limits.acceleration, self._now.a
        change = self._limits.jerk * self._period
        wanted = wanted * _passable(hold, rates @ wanted, -top, top)
        step = share * (wanted - now)
        kept = hold + rates @ now
        a = kept + _passable(kept, rates @ step, last - change, last + change) * (rates @ step)
        a *= min(1.0, 1.0 / max(1e-9, *(np.abs(a) / top).tolist()))
        turn = a - last
        turn *= min(1.0, 1.0 / max(1e-9, *(np.abs(turn) / change).tolist()))
        within: Vector = last + turn
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


def _passable(start: Vector, way: Vector, low: Vector, high: Vector) -> float:
    """Largest share, from 0 to 1, of a way of shape (dof,) on which no joint leaves its bounds."""
    room = np.where(way > 0.0, high - start, start - low)
    share = float(min((room / np.maximum(np.abs(way), 1e-9)).tolist()))
    return min(max(share, 0.0), 1.0)
