"""Visual servoing in a plane, or in space, at the control rate, within the arm's limits.

The servo law (`servo_kernels`) computes the tool's acceleration along the followed axes, the two of
a plane or three, from the limits that the joints impose there. The distance to the plane, if it is
one, and the orientation are held; they have priority where joint acceleration or jerk limits do not
suffice for both. Joint accelerations follow from
``q'' = J⁺(x'' - J'q')`` and are integrated, so that positions, velocities and accelerations are
always consistent (closed-loop inverse kinematics, Siciliano et al., Robotics, 3.7.1 and 8.6.1).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np

from bt_dualarm.control.kernel_rows import (
    ANGLE_ERROR,
    DAMPING,
    DISPLACEMENT,
    FADE_JERK,
    HELD,
    JACOBIAN_BEFORE,
    NOW_A,
    NOW_Q,
    NOW_V,
    OBSERVED,
    PLANE_ERROR,
    POSTURE,
    SERVO_STATE,
    TOO_LATE,
    PlaneLimits,
)
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.kinematics.chain_kernel_arrays import LINK, STEP, links_from_jacobian
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.robots.robot import JointLimits
from bt_dualarm.trajectory.set_points import OnlineStep, SetPoint, limit_rows

SLACK_M = 1.5e-4
"""Jump of a target that may use all of the jerk, m: a few times the noise of an estimate."""


class PlaneTarget(NamedTuple):
    """Target of the tool along the followed axes, relative to its start: m, m/s, m/s².

    Each of shape (k,), with k the number of axes.
    """

    position: Vector
    velocity: Vector
    acceleration: Vector


TargetOf: TypeAlias = Callable[[float, Vector], PlaneTarget | None]
"""Target at a simulated time in s, given the tool's displacement along the followed axes, of shape
(k,), m; None to come to rest."""


class PlanarServo:
    """Stream of set-points that follows a target in a plane or in space.

    Args:
        kinematics: Kinematics of the arm.
        limits: Joint limits, already scaled by the allowed speed.
        period: Seconds between set-points.
        start: The last set-point that was sent.
        axes: Orthogonal unit vectors in the world along which the tool follows, of shape (k, 3):
            two of a plane, or three.
        target: Returns the target, see `TargetOf`.
        bandwidth: Upper bound of the following bandwidth, rad/s; the joints' jerk may allow less.
        slack: Jump of the target that may use all of the jerk, m.

    Attributes:
        time_scale: Fraction of the velocity in [0, 1]; set by the guard.
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
        from bt_dualarm.control.servo_kernels import observe_tool, servo_step

        self._servo_step = servo_step
        self._observe_tool = observe_tool
        self._period = float(period)
        self._parameters = self._period, float(bandwidth), float(slack)
        self._target = target
        self._sent = start
        self._now = start
        self._brake = OnlineStep(limits, period)
        plane = np.array((*axes[:2], np.cross(axes[0], axes[1])))
        self._arm = (*_chain(kinematics, start.q), plane)
        self._followed = len(axes)
        self._work = np.zeros((SERVO_STATE, len(start.q)))
        self._seen = np.zeros(OBSERVED)
        self._work[:5] = limit_rows(limits)
        self._work[POSTURE] = start.q
        self._work[JACOBIAN_BEFORE : JACOBIAN_BEFORE + 6] = kinematics.jacobian(start.q)
        # Views: indexing a row costs as much as filling it.
        self._set_point_rows = tuple(self._work[row] for row in (NOW_Q, NOW_V, NOW_A))
        self._goals = np.zeros((3, 3))
        self._goal = self._goals[:, : self._followed]
        self._displacement = self._seen[DISPLACEMENT : DISPLACEMENT + self._followed]
        self.time_scale = 1.0
        self._is_held = self._observe_from(start)

    def __call__(self, time: float) -> SetPoint:
        """The set-point for ``time``.

        Raises:
            Failure: ``UNREACHABLE`` when the arm can no longer hold the plane or the orientation.
        """
        if not self._is_held:
            distance, *rotation = self._seen[PLANE_ERROR : ANGLE_ERROR + 3].tolist()
            angle = math.hypot(*rotation)
            plane = f"{abs(distance) * 1e3:.0f} mm out of its plane and "
            raise Failure(
                "UNREACHABLE",
                f"the tool cannot follow here: it is {plane if self._followed == 2 else ''}"
                f"{math.degrees(angle):.0f}° from its orientation",
                plane_error_m=abs(distance),
                angle_error_rad=angle,
            )
        now = self._now
        goal = self._goal
        target = self._target(time, self._displacement)
        if target is not None:
            goal[0], goal[1], goal[2] = target
        found = np.empty((3, len(now.q)))
        desired = self.time_scale, target is not None, self._goals
        outcome = self._servo_step(
            *self._parameters, *desired, *self._arm, self._followed, self._work, self._seen, found
        )
        if outcome == TOO_LATE:  # after this acceleration a joint could not stop: brake fully
            q, v, a = self._brake.to_rest(np.array(self._sent))
            dt = self._period
            self._sent = SetPoint(q, v, a)
            self._now = SetPoint(q + v * dt + 0.5 * a * dt**2, v + a * dt, a)
            self._is_held = self._observe_from(self._now)
        else:
            a, q, v = found
            self._sent = SetPoint(now.q, now.v, a)
            self._now = SetPoint(q, v, a)
            self._is_held = outcome == HELD
        return self._sent

    def _observe_from(self, now: SetPoint) -> bool:
        """Observe the tool at a set-point; return whether plane and orientation are held there."""
        for row, values in zip(self._set_point_rows, now, strict=True):
            row[:] = values
        return self._observe_tool(*self._arm, self._followed, self._period, self._work, self._seen)


def stopping_positions(
    kinematics: Kinematics, limits: JointLimits, axes: Matrix, now: SetPoint, count: int
) -> Matrix:
    """Configurations through which a servo without a target comes to rest, at least.

    The tool slows down in the direction of its motion, by the law of `servo_kernels.servo_step`,
    so that the joints keep the ratio of their velocities. What holds plane and orientation changes
    that little on so short a path. It is longer than that of joints that brake as hard as they can.

    Args:
        kinematics: Kinematics of the arm.
        limits: Joint limits.
        axes: Axes along which the tool follows, of shape (k, 3).
        now: Last set-point.
        count: Number of configurations, from the present one to that at rest.

    Returns:
        Array of shape (count, dof), rad.
    """
    from bt_dualarm.control.servo_kernels import stopping_time

    speeds = np.maximum(np.abs(now.v), 1e-9)
    most = float((limits.acceleration / speeds).min())
    jerk = float((limits.jerk / speeds).min())
    tool_speed = max(float(np.linalg.norm(kinematics.jacobian(now.q)[:3] @ now.v)), 1e-9)
    fade = 2.0 * FADE_JERK * plane_limits(kinematics, limits, now.q, axes).jerk / tool_speed
    # All as a fraction of the present velocity.
    rate = float(np.clip(now.v @ now.a / max(float(now.v @ now.v), 1e-18), -most, most))
    passed = stopping_time(most, jerk, fade, rate)
    rows: Matrix = now.q + np.linspace(0.0, passed, count)[:, None] * now.v
    return rows


def plane_limits(
    kinematics: Kinematics, limits: JointLimits, q: Vector, axes: Matrix
) -> PlaneLimits:
    """Acceleration and jerk that the joints allow the tool in any direction of a plane or space.

    Args:
        kinematics: Kinematics of the arm.
        limits: Joint limits.
        q: Configuration of shape (dof,), rad.
        axes: Orthogonal unit vectors in the world, of shape (k, 3): two of a plane, or three.
    """
    jacobian = kinematics.jacobian(q)
    inverse = np.linalg.solve(jacobian @ jacobian.T + DAMPING * np.eye(6), jacobian)
    rates = axes @ inverse[:3]
    per_unit = np.maximum(np.hypot.reduce(rates, axis=0), 1e-6)
    return PlaneLimits(
        float((limits.acceleration / per_unit).min()), float((limits.jerk / per_unit).min())
    )


def _chain(kinematics: Kinematics, start: Vector) -> tuple[Matrix, Matrix]:
    """Links and tool frames of an arm, as in `servo_kernels.observe_tool`."""
    zero = np.zeros_like(start)
    tool = kinematics.matrix(zero)
    links = links_from_jacobian(tool, kinematics.jacobian(zero))
    origin = kinematics.matrix(start)
    frames = np.zeros((3, 12))
    frames[:2, :9] = origin[:3, :3].ravel()
    frames[:2, 9:] = origin[:3, 3]
    # Relative to the last joint, whose position with all joints at zero is the sum of the steps.
    frames[2, :9] = tool[:3, :3].ravel()
    frames[2, 9:] = tool[:3, 3] - links[:, STEP : STEP + 3].sum(axis=0)
    return links, frames


def warm_up_servo() -> None:
    """Compile the kernels of the servo, by calling them with arrays of the final types."""
    from bt_dualarm.control.servo_kernels import (
        jerk_bandwidth,
        observe_tool,
        servo_step,
        stopping_time,
    )

    work = np.ones((SERVO_STATE, 1))
    seen = np.ones(OBSERVED)
    state = np.ones((3, 1))
    links = np.ones((1, LINK))
    frames = np.ones((3, 12))
    plane = np.ones((3, 3))
    observe_tool(links, frames, plane, 2, 1.0, work, seen)
    goal = np.ones((3, 3))
    servo_step(1.0, 1.0, 1.0, 1.0, True, goal, links, frames, plane, 2, work, seen, state)
    jerk_bandwidth(1.0, 1.0)
    stopping_time(1.0, 1.0, 1.0, 0.0)
