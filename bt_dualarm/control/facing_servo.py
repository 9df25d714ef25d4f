"""Visual servoing in space by a camera that faces its target.

The orientation is a function of the camera's position (a virtual constraint): the optical axis
points away from a fixed pivot behind the camera. A camera that is brought onto the ray from the
pivot through the target, at a distance from it, faces it. Only the position is controlled, by the
law of `planar_servo`, whose joint rates and limits include the rotation; the orientation needs no
estimate of its own and is as smooth as the commanded position.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from bt_dualarm.control.kernel_rows import (
    ANGLE_ERROR,
    DAMPING,
    DISPLACEMENT,
    HOLD_A,
    HOLD_BANDWIDTH,
    INVERSE,
    LOST_RAD,
    PLANE_LIMITS,
    PLANE_RATES,
    VELOCITY,
    PlaneLimits,
)
from bt_dualarm.control.planar_servo import SLACK_M, PlanarServo, PlaneTarget, TargetOf
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.robots.robot import JointLimits
from bt_dualarm.trajectory.set_points import SetPoint

_WORLD_UP = np.array((0.0, 0.0, 1.0))
_STEEP = 0.87  # cosine of 30°: a steeper optical axis has no roll about it by the vertical
_LEAST_SINE = 0.25  # 15° between the optical axis and `Facing.up`, where roll becomes fast
_NEAREST = 0.25  # of the initial distance from the pivot, where turning becomes fast


@dataclass(frozen=True, eq=False)
class Facing:
    """Orientation of a camera as a function of its position, all in the camera frame at the start.

    Attributes:
        pivot: Depth of the pivot behind the camera at the start, m, positive.
        up: Unit vector that stays in the image's vertical plane, of shape (3,): the world's
            vertical, or the initial image's, if the camera looks up or down by more than 60°.
        distance: Distance from the target, m.
    """

    pivot: float
    up: Vector
    distance: float

    @classmethod
    def of_arm(cls, kinematics: Kinematics, q: Vector, camera: Pose, distance: float) -> Facing:
        """With the pivot beside the arm's shoulder, but at least ``distance`` behind the camera.

        Args:
            kinematics: Kinematics of the arm.
            q: Configuration at the start, of shape (dof,), rad.
            camera: Pose of the camera there, in the world.
            distance: Distance from the target, m.
        """
        rotation = camera.rotation_matrix
        ahead = rotation[:, 2]
        behind = float((camera.position - _shoulder(kinematics, q)) @ ahead)
        is_steep = abs(float(ahead @ _WORLD_UP)) > _STEEP
        up = np.array((0.0, -1.0, 0.0)) if is_steep else rotation.T @ _WORLD_UP
        return cls(max(behind, distance), up, distance)

    def rotation(self, position: Vector) -> Matrix:
        """Rotation from the camera frame at a position, of shape (3,), to that at the start."""
        start = _look(np.array((0.0, 0.0, 1.0)), self.up)
        turned: Matrix = _look(self._from_pivot(position), self.up) @ start.T
        return turned

    def rates(self, position: Vector) -> Matrix:
        """Angular velocity per unit of velocity of the camera, of shape (3, 3), rad/m."""
        arm = self._from_pivot(position)
        length = math.sqrt(arm @ arm)
        right, down, ahead = _look(arm, self.up).T
        sine = math.sqrt(max(1.0 - float(ahead @ self.up) ** 2, _LEAST_SINE**4))
        # By the derivatives of `_look`: the axis turns across, and roll keeps `right` level.
        roll = np.cross(self.up, down) / sine
        across = np.outer(down, right) - np.outer(right, down)
        return (across + np.outer(ahead, roll - ahead * (ahead @ roll))) / length

    def allows(self, position: Vector) -> bool:
        """Whether the camera may be there: not near the pivot, nor looking along ``up``."""
        arm = self._from_pivot(position)
        length = math.sqrt(arm @ arm)
        if length < _NEAREST * self.pivot:
            return False
        return float(arm @ self.up) ** 2 <= (1.0 - _LEAST_SINE**2) * length**2

    def camera_motion(self, target: PlaneTarget) -> PlaneTarget:
        """Motion of a camera that faces a target at ``distance``.

        Args:
            target: Motion of the target relative to the point at ``distance`` in front of the
                camera at the start.
        """
        away = self._from_pivot(target.position)
        away[2] += self.distance
        r = math.sqrt(away @ away)
        u = away / r
        speed = float(u @ target.velocity)
        turning = (target.velocity - speed * u) / r
        across = target.acceleration - (u @ target.acceleration) * u
        bending = (across - 2.0 * speed * turning) / r - (turning @ turning) * u
        d = self.distance
        return PlaneTarget(
            target.position + np.array((0.0, 0.0, d)) - d * u,
            target.velocity - d * turning,
            target.acceleration - d * bending,
        )

    def _from_pivot(self, position: Vector) -> Vector:
        return np.array((position[0], position[1], position[2] + self.pivot))


class FacingServo(PlanarServo):
    """`PlanarServo` in space, of the camera instead of the tool, which turns as `Facing` says.

    Args:
        kinematics: Kinematics of the arm.
        limits: Joint limits, already scaled by the allowed speed.
        period: Seconds between set-points.
        start: The last set-point that was sent.
        camera: Pose of the camera there, in the world.
        facing: Orientation by position.
        target: Motion of the camera relative to its start, in its frame there.
        bandwidth: As for `PlanarServo`.
        slack: As for `PlanarServo`.
    """

    def __init__(
        self,
        kinematics: Kinematics,
        limits: JointLimits,
        period: float,
        start: SetPoint,
        camera: Pose,
        facing: Facing,
        target: TargetOf,
        bandwidth: float,
        slack: float = SLACK_M,
    ) -> None:
        rotation = camera.rotation_matrix
        super().__init__(
            kinematics, limits, period, start, rotation.T.copy(), target, bandwidth, slack
        )
        self._facing = facing
        self._limits = limits
        self._rotation = rotation
        frames = self._arm[1]
        mount = np.linalg.inv(kinematics.matrix(start.q)) @ camera.matrix
        frames[2, 9:] += frames[2, :9].reshape(3, 3) @ mount[:3, 3]
        frames[2, :9] = (frames[2, :9].reshape(3, 3) @ mount[:3, :3]).ravel()
        frames[:2, :9] = rotation.ravel()
        frames[:2, 9:] = camera.position
        # Twice: the first call still sees the Jacobian of the tool as the one before.
        self._observe_from(start)
        self._observe_from(start)
        self._turn()

    def __call__(self, time: float) -> SetPoint:
        """The set-point for ``time``.

        Raises:
            Failure: ``UNREACHABLE`` when the arm can no longer keep the orientation.
        """
        sent = super().__call__(time)
        self._turn()
        return sent

    def _turn(self) -> None:
        """Let the observed tool, which kept its orientation, turn with its position instead."""
        work, seen, frames = self._work, self._seen, self._arm[1]
        position = seen[DISPLACEMENT : DISPLACEMENT + 3]
        velocity = seen[VELOCITY : VELOCITY + 3]
        inverse = work[INVERSE + 3 : INVERSE + 6]
        rates = self._rotation @ self._facing.rates(position)
        later = self._rotation @ self._facing.rates(position + velocity * self._period)
        desired = self._rotation @ self._facing.rotation(position)
        turn = desired @ frames[1, :9].reshape(3, 3).T
        error = 0.5 * np.array(
            (turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1])
        )
        w = HOLD_BANDWIDTH
        # The kernel held the orientation of the previous set-point, at rest.
        wanted = w * w * (error - seen[ANGLE_ERROR : ANGLE_ERROR + 3])
        wanted += 2.0 * w * (rates @ velocity) + (later - rates) @ velocity / self._period
        work[HOLD_A] += wanted @ inverse
        work[PLANE_RATES : PLANE_RATES + 3] += rates.T @ inverse
        allowed = _limits(work[PLANE_RATES : PLANE_RATES + 3], self._limits)
        seen[PLANE_LIMITS : PLANE_LIMITS + 2] = allowed
        seen[ANGLE_ERROR : ANGLE_ERROR + 3] = error
        frames[0, :9] = desired.ravel()
        self._is_held = bool(np.abs(error).max() <= LOST_RAD)


def facing_limits(
    kinematics: Kinematics, limits: JointLimits, q: Vector, camera: Pose, facing: Facing, at: Vector
) -> PlaneLimits:
    """Acceleration and jerk that the joints allow a facing camera in any direction.

    Args:
        kinematics: Kinematics of the arm.
        limits: Joint limits.
        q: Configuration of shape (dof,), rad.
        camera: Pose of the camera at ``q``, in the world.
        facing: Orientation by position.
        at: Position of the camera there, in its frame at the start, of shape (3,), m.
    """
    jacobian = kinematics.jacobian(q)
    tool = kinematics.matrix(q)[:3, 3]
    jacobian[:3] += np.cross(jacobian[3:].T, camera.position - tool).T
    inverse = np.linalg.solve(jacobian @ jacobian.T + DAMPING * np.eye(6), jacobian)
    axes = camera.rotation_matrix @ facing.rotation(at).T
    rates = axes.T @ inverse[:3] + (axes @ facing.rates(at)).T @ inverse[3:]
    return _limits(rates, limits)


def _limits(rates: Matrix, limits: JointLimits) -> PlaneLimits:
    """Limits of joints with rates, of shape (3, dof), per unit of velocity along each axis."""
    per_unit = np.maximum(np.sqrt(np.square(rates).sum(axis=0)), 1e-6)
    return PlaneLimits(
        float((limits.acceleration / per_unit).min()), float((limits.jerk / per_unit).min())
    )


def _look(direction: Vector, up: Vector) -> Matrix:
    """Rotation of a camera (x right, y down, z forward) that looks along a direction."""
    ahead = direction / math.sqrt(direction @ direction)
    right = np.cross(ahead, up)
    right /= max(math.sqrt(right @ right), _LEAST_SINE**2)
    return np.column_stack((right, np.cross(ahead, right), ahead))


def _shoulder(kinematics: Kinematics, q: Vector) -> Vector:
    """Point of the first joint's axis that is nearest to the second's, in the world, shape (3,)."""
    jacobian = kinematics.jacobian(q)
    tool = kinematics.matrix(q)[:3, 3]
    (one, two) = jacobian[3:, :2].T
    (first, second) = (tool - np.cross(jacobian[:3, i], jacobian[3:, i]) for i in (0, 1))
    normal = np.cross(one, two)
    square = float(normal @ normal)
    if square < 1e-6:  # parallel axes
        return first
    along = float(np.cross(second - first, two) @ normal) / square
    point: Vector = first + along * one
    return point
