"""Following a moving target in a plane, at the control rate, within the arm's limits.

What the tool does in the plane says the following law, from what the joints allow there. The third
axis and the orientation are held: they come first where the joints' accelerations, or the change of
them in a period, do not suffice for both. Joint accelerations follow by ``q'' = J⁺(x'' - J'q')``
and are integrated, so that positions, velocities and accelerations always belong together
(closed-loop inverse kinematics, Siciliano et al., Robotics, 3.7.1 and 8.6.1).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np

from bt_dualarm.errors import Failure
from bt_dualarm.motion.chains.kernel_rows import LINK, STEP
from bt_dualarm.motion.chains.links import links_by_jacobian
from bt_dualarm.motion.kinematics.arm_kinematics import Kinematics
from bt_dualarm.motion.setpoints.kernel_rows import (
    DAMPING,
    DISPLACEMENT,
    HELD,
    JACOBIAN_BEFORE,
    NOW_A,
    NOW_Q,
    NOW_V,
    OFF,
    POSTURE,
    SEEN,
    TOO_LATE,
    TURN,
    WORK,
    Reach,
)
from bt_dualarm.motion.setpoints.online_step import OnlineStep
from bt_dualarm.motion.setpoints.set_point import SetPoint
from bt_dualarm.motion.setpoints.stopping_distance import limit_rows
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.robots.robot import JointLimits

SLACK_M = 1.5e-4
"""Jump of a target in m that takes all of the jerk: a few times the noise of an estimate."""


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
        from bt_dualarm.motion.setpoints.servo_kernels import answer, look

        self._answer, self._look = answer, look
        self._period = float(period)
        self._how = self._period, float(bandwidth), float(slack)
        self._target = target
        self._sent = self._now = start
        self._brake = OnlineStep(limits, period)
        plane = np.array((*axes, np.cross(axes[0], axes[1])))
        self._arm = (*_chain(kinematics, start.q), plane)
        self._work, self._seen = np.zeros((WORK, len(start.q))), np.zeros(SEEN)
        self._work[:5], self._work[POSTURE] = limit_rows(limits), start.q
        self._work[JACOBIAN_BEFORE : JACOBIAN_BEFORE + 6] = kinematics.jacobian(start.q)
        # Views: looking a row up costs as much as filling it.
        self._asked = tuple(self._work[row] for row in (NOW_Q, NOW_V, NOW_A))
        self._goal = np.zeros((3, 2))
        self._displacement = self._seen[DISPLACEMENT : DISPLACEMENT + 2]
        self.time_scale = 1.0
        self._is_held = self._look_from(start)

    def __call__(self, time: float) -> SetPoint:
        """The set-point for ``time``.

        Raises:
            Failure: ``UNREACHABLE`` where the arm can no longer hold the plane or the orientation.
        """
        if not self._is_held:
            raise _lost(*self._seen[OFF : TURN + 3].tolist())
        now, goal = self._now, self._goal
        target = self._target(time, self._displacement)
        if target is not None:
            goal[0], goal[1], goal[2] = target
        found = np.empty((3, len(now.q)))
        wanted = self.time_scale, target is not None, goal
        outcome = self._answer(*self._how, *wanted, *self._arm, self._work, self._seen, found)
        if outcome == TOO_LATE:  # for this one: the hardest brake
            self._sent = SetPoint(*self._brake.to_rest(np.array(self._sent)))
            self._now = _after(self._sent, self._period)
            self._is_held = self._look_from(self._now)
        else:
            a, q, v = found
            self._sent, self._now = SetPoint(now.q, now.v, a), SetPoint(q, v, a)
            self._is_held = outcome == HELD
        return self._sent

    def _look_from(self, now: SetPoint) -> bool:
        """Look where the tool is at a set-point; whether it is held there."""
        for row, values in zip(self._asked, now, strict=True):
            row[:] = values
        return self._look(*self._arm, self._period, self._work, self._seen)


def plane_reach(kinematics: Kinematics, limits: JointLimits, q: Vector, axes: Matrix) -> Reach:
    """What the joints allow the tool in the worst direction of a plane, all else held.

    Args:
        kinematics: Kinematics of the arm.
        limits: Limits of the joints.
        q: Configuration of shape (dof,), rad.
        axes: Unit vectors of the plane in the world, of shape (2, 3).
    """
    jacobian = kinematics.jacobian(q)
    inverse = np.linalg.solve(jacobian @ jacobian.T + DAMPING * np.eye(6), jacobian)
    rates = axes @ inverse[:3]
    per_unit = np.maximum(np.hypot(rates[0], rates[1]), 1e-6)
    return Reach(
        float((limits.acceleration / per_unit).min()), float((limits.jerk / per_unit).min())
    )


def _chain(kinematics: Kinematics, start: Vector) -> tuple[Matrix, Matrix]:
    """Links of an arm, and the tool at the start, now, and from the last joint, as in `look`."""
    zero = np.zeros_like(start)
    tool = kinematics.matrix(zero)
    links = links_by_jacobian(tool, kinematics.jacobian(zero))
    origin, frames = kinematics.matrix(start), np.zeros((3, 12))
    frames[:2, :9], frames[:2, 9:] = origin[:3, :3].ravel(), origin[:3, 3]
    frames[2, :9] = tool[:3, :3].ravel()
    frames[2, 9:] = tool[:3, 3] - links[:, STEP : STEP + 3].sum(axis=0)
    return links, frames


def _after(sent: SetPoint, period: float) -> SetPoint:
    """A period later, at the same acceleration."""
    q = sent.q + sent.v * period + 0.5 * sent.a * period**2
    return SetPoint(q, sent.v + sent.a * period, sent.a)


def _lost(off: float, *turn: float) -> Failure:
    """Why a tool gives up that is out of its plane, in m, or turned, in rad about three axes."""
    angle = math.hypot(*turn)
    return Failure(
        "UNREACHABLE",
        f"the tool cannot follow there: it is {abs(off) * 1e3:.0f} mm out of its plane and "
        f"{math.degrees(angle):.0f}° from its orientation",
        plane_error_m=abs(off),
        angle_error_rad=angle,
    )


def follow_something() -> None:
    """Have all kernels of set-points compiled."""
    from bt_dualarm.motion.chains import limit_kernels as limiting
    from bt_dualarm.motion.setpoints.following_kernels import jerk_bandwidth
    from bt_dualarm.motion.setpoints.servo_kernels import answer, look

    work, seen, state = np.ones((WORK, 1)), np.ones(SEEN), np.ones((3, 1))
    links, frames, plane = np.ones((1, LINK)), np.ones((3, 12)), np.ones((3, 3))
    look(links, frames, plane, 1.0, work, seen)
    goal = np.ones((3, 2))
    answer(1.0, 1.0, 1.0, 1.0, True, goal, links, frames, plane, work, seen, state)
    limiting.keep(work[:5].copy(), 1.0, state, state)
    limiting.can_stop(work[:5].copy(), 0, 1.0, 1.0, 1.0)
    limiting.stopping_way(1.0, 1.0, 1.0, 1.0)
    limiting.turn_and_stop(work[:5].copy(), 0, 1.0, 1.0, 1.0)
    jerk_bandwidth(1.0, 1.0)
    limiting.within(np.ones((3, 1, 1)), 1.0, 1.0, state)
