"""Keeping a transform to the tool of another arm, from the set-points that this arm is sent.

The pose to keep is that of the other tool, composed with a constant transform. Inverse kinematics
turns it into a joint reference with its velocity and acceleration, which the follower's set-points
meet as long as its joint limits allow. The other arm's set-points serve instead of its encoders:
both arms then lag behind their set-points by the same few milliseconds, and no noise is followed.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np

from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.kinematics.solver import Chain
from bt_dualarm.robots.robot import JointLimits
from bt_dualarm.trajectory.set_points import SetPoint, SetPointLimiter, sampled_at
from bt_dualarm.trajectory.trajectory import Trajectory

_DAMPING: Final = 1e-6
"""Weight of joint motion in a step of the inverse kinematics: negligible where the arm is not
singular (smallest singular values are about 0.1), and finite steps where it is."""

_STEP_RAD: Final = 0.05
"""Largest joint motion of one such step, rad."""

_STEPS: Final = 3
"""Steps per set-point at most. Convergence is quadratic, and targets move by millimeters."""

_EXACT: Final = 1e-7
"""Residual in m + rad below which no further step is taken."""

_PULL: Final = 0.2
"""Rate at which redundant joints return to their posture at the start, 1/s."""

_ROWS: Final = 400
"""Number of set-points of a motion that are examined to compute its pace, at most."""

_SHARE: Final = 0.95
"""Fraction of the follower's velocity and acceleration limits that a paced motion may use: the rest
lets the follower catch up."""

_LAG_M: Final = 1e-4
"""Distance in m by which the follower may lag behind at the pace of a motion. Where the other arm
has more jerk than the follower, some lag cannot be avoided."""

_SLOWER: Final = 0.85
"""Factor by which the pace is reduced until the follower keeps up."""

_SLOWEST: Final = 0.02
"""Minimum pace: a motion that needs a lower one passes a singularity of the follower."""

_MISSED_M: Final = 1e-3
"""Residual in m above which a pose counts as out of reach."""


class ToolMotion(NamedTuple):
    """Motion of a tool in the world.

    Attributes:
        matrix: Homogeneous transform of the tool, of shape (4, 4).
        twist: Linear velocity in m/s, then angular velocity in rad/s, of shape (6,).
        acceleration: Their time derivatives, of shape (6,).
    """

    matrix: Matrix
    twist: Vector
    acceleration: Vector

    def at(self, offset: Matrix) -> ToolMotion:
        """Motion of a frame that is fixed to the tool, at a pose of shape (4, 4) in it."""
        matrix = self.matrix @ offset
        lever = matrix[:3, 3] - self.matrix[:3, 3]
        turn = self.twist[3:]
        twist = self.twist.copy()
        twist[:3] += np.cross(turn, lever)
        acceleration = self.acceleration.copy()
        acceleration[:3] += np.cross(acceleration[3:], lever) + np.cross(
            turn, np.cross(turn, lever)
        )
        return ToolMotion(matrix, twist, acceleration)


def tool_motion(chain: Chain, state: SetPoint, period: float) -> ToolMotion:
    """Motion of an arm's tool in a state of its joints.

    Args:
        chain: Kinematic chain of the arm.
        state: Positions, velocities and accelerations of the joints.
        period: Time in s over which the Jacobian's change is evaluated.
    """
    matrix, jacobian = chain.tool(state.q)
    acceleration = jacobian @ state.a
    if state.v.any():
        change = chain.jacobian(state.q + period * state.v) - jacobian
        acceleration = acceleration + change @ state.v / period
    return ToolMotion(matrix, jacobian @ state.v, acceleration)


class _Solution(NamedTuple):
    """Joint state with the tool in a given motion.

    Attributes:
        state: The joint state.
        jacobian: Jacobian of the tool there, of shape (6, dof).
        residual_m: Distance by which the tool misses the pose, m.
    """

    state: SetPoint
    jacobian: Matrix
    residual_m: float


class ToolFollowing:
    """Stream of set-points that keeps a transform to another arm's tool.

    Args:
        chain: Kinematic chain of the follower.
        limits: Joint limits of the follower, already scaled by the allowed speed.
        period: Seconds between set-points.
        start: Last set-point of the follower.
        leader: Kinematic chain of the other arm.
        commanded: Set-point of the other arm for a simulated time in s.
        offset: Pose of the follower's tool in that of the other arm.
        refuse: Raises `Failure` if the follower would touch something on a motion of its own,
            which need not keep its limits.

    Attributes:
        refusal: Why the follower cannot follow a motion of the other arm that has begun, if so.
        residual_m: Distance in m by which the last reference misses the transform: the arm cannot
            reach it.
        behind_rad: Largest joint distance of the last set-point from the reference, rad: limits
            that the arm would have to exceed.
        behind_joint: Name of that joint.
    """

    def __init__(
        self,
        chain: Chain,
        limits: JointLimits,
        period: float,
        start: SetPoint,
        leader: Chain,
        commanded: Callable[[float], SetPoint],
        offset: Pose,
        refuse: Callable[[Trajectory], None],
    ) -> None:
        self.refusal: Failure | None = None
        self.residual_m = 0.0
        self.behind_rad = 0.0
        self.behind_joint = chain.joints[0]
        self._chain = chain
        self._limits = limits
        self._period = period
        self._leader = leader
        self._commanded = commanded
        self._offset = offset.matrix
        self._refuse = refuse
        self._posture = start.q
        self._reference = SetPoint(start.q.copy(), np.zeros_like(start.q), np.zeros_like(start.q))
        self._limiter = SetPointLimiter(limits, period, start.q)
        self._limiter.sent = start

    def __call__(self, time: float) -> SetPoint:
        """The set-point for a simulated time in s."""
        goal = tool_motion(self._leader, self._commanded(time), self._period).at(self._offset)
        before = self._reference
        # Extrapolated, the start is so close that one iteration is enough nearly always.
        near = before.q + self._period * (before.v + 0.5 * self._period * before.a)
        solution = self._solved(goal, near, self._period)
        self._reference = reference = solution.state
        self.residual_m = solution.residual_m
        sent = self._limiter.send(reference)
        behind = np.abs(reference.q - sent.q)
        worst = int(behind.argmax())
        self.behind_rad = float(behind[worst])
        self.behind_joint = self._chain.joints[worst]
        return sent

    def time_scale_of(self, motion: Trajectory) -> float:
        """Time scale, above 0 to 1, at which the follower can keep up with a motion of the other.

        If there is none, the reason is in `refusal`, and the follower slows the other no more.

        Args:
            motion: Motion of the other arm from its last set-point on, from rest to rest.
        """
        if self.refusal is None:
            try:
                return self._possible_time_scale(motion)
            except Failure as refusal:
                self.refusal = refusal.with_traceback(None)
        return 1.0

    def _possible_time_scale(self, motion: Trajectory) -> float:
        """As `time_scale_of`.

        Raises:
            Failure: ``UNREACHABLE`` or ``SINGULAR``; as ``refuse``.
        """
        stride = max(1, math.ceil(len(motion) / _ROWS))
        index = np.unique(np.append(np.arange(0, len(motion), stride), len(motion) - 1))
        if len(index) < 3:
            return 1.0
        states = [SetPoint(*row) for row in zip(*motion.rows(index), strict=True)]
        path: list[SetPoint] = []
        levers: list[Matrix] = []
        q = self._reference.q
        for state in states:
            goal = tool_motion(self._leader, state, self._period).at(self._offset)
            solution = self._solved(goal, q, 0.0)
            if solution.residual_m > _MISSED_M:
                raise Failure(
                    "UNREACHABLE",
                    f"the transform is out of reach after {len(path) / len(states):.0%} of the "
                    "motion that the other arm has begun",
                    residual_m=solution.residual_m,
                )
            q = solution.state.q
            path.append(solution.state)
            levers.append(solution.jacobian[:3])
        followed = Trajectory(
            stride * motion.dt, *(np.array(rows) for rows in zip(*path, strict=True))
        )
        self._refuse(followed)
        limits = self._limits
        # At time scale s velocities shrink by s and accelerations by s², hence the square root.
        needed = max(
            float((np.abs(followed.v) / limits.velocity).max()),
            math.sqrt(float((np.abs(followed.a) / limits.acceleration).max())),
        )
        scale = min(_SHARE / max(needed, 1e-9), 1.0)
        # Jerk is not in this estimate, and the limiter adds a lag of its own: simulate it.
        while scale > _SLOWEST and self._lag(followed, scale, np.array(levers)) > _LAG_M:
            scale *= _SLOWER
        if scale > _SLOWEST:
            return scale
        raise Failure(
            "SINGULAR",
            "the other arm's current motion leads this one through a singularity: it "
            f"would need {needed:.1f} times the speed of its joints",
        )

    def _lag(self, path: Trajectory, scale: float, levers: Matrix) -> float:
        """Largest distance in m of the tool from its path at a time scale.

        Args:
            path: Motion of the follower that keeps the transform exactly.
            scale: Time scale.
            levers: Jacobians of the tool's position at its set-points, of shape (n, 3, dof).
        """
        count = math.ceil(path.duration / (scale * self._period)) + 1
        parameters = np.tile((0.0, scale, 0.0), (count, 1))
        parameters[:, 0] = np.minimum(np.arange(count) * scale * self._period, path.duration)
        rows = sampled_at(path, parameters)
        nearest = np.rint(parameters[:, 0] / path.dt).astype(int)
        limiter = SetPointLimiter(self._limits, self._period, path.start)
        lag = 0.0
        for q, v, a, i in zip(rows.q, rows.v, rows.a, nearest.tolist(), strict=True):
            behind = q - limiter.send(SetPoint(q, v, a)).q
            lag = max(lag, float(np.linalg.norm(levers[min(i, len(levers) - 1)] @ behind)))
        return lag

    def _solved(self, goal: ToolMotion, near: Vector, period: float) -> _Solution:
        """Joint state, nearest to a configuration, with the tool in a given motion.

        Args:
            goal: Motion of the tool.
            near: Configuration of shape (dof,), rad.
            period: Time in s for which redundant joints return to their posture.
        """
        chain = self._chain
        limits = self._limits
        q = near
        for _ in range(_STEPS):
            matrix, jacobian = chain.tool(q)
            error = pose_error(matrix, goal.matrix)
            if np.abs(error).sum() < _EXACT:
                break
            step = _least_squares(jacobian, error)
            largest = float(np.abs(step).max())
            q = np.clip(
                q + step * min(1.0, _STEP_RAD / max(largest, 1e-12)), limits.lower, limits.upper
            )
        else:
            matrix, jacobian = chain.tool(q)
            error = pose_error(matrix, goal.matrix)
        v = _least_squares(jacobian, goal.twist)
        if len(q) > 6 and period > 0.0:  # redundant joints must not drift away
            pull = _PULL * (self._posture - q)
            v = v + pull - _least_squares(jacobian, jacobian @ pull)
        curve = np.zeros(6)
        if v.any():
            h = self._period
            curve = (chain.jacobian(q + h * v) - jacobian) @ v / h
        state = SetPoint(q, v, _least_squares(jacobian, goal.acceleration - curve))
        return _Solution(state, jacobian, float(np.linalg.norm(error[:3])))


def pose_error(matrix: Matrix, goal: Matrix) -> Vector:
    """Distance in m and small rotation in rad, in world axes, from a frame to a goal, (6,)."""
    turn = goal[:3, :3] @ matrix[:3, :3].T
    skew = 0.5 * np.array(
        (turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1])
    )
    sine = float(np.linalg.norm(skew))
    angle = float(np.arctan2(sine, 0.5 * (np.trace(turn) - 1.0)))
    return np.concatenate(
        (goal[:3, 3] - matrix[:3, 3], skew * (angle / sine if sine > 1e-9 else 1))
    )


def _least_squares(jacobian: Matrix, task: Vector) -> Vector:
    """Smallest joint rates that cause rates of the tool, damped, of shape (dof,)."""
    square = jacobian @ jacobian.T
    square.flat[:: len(square) + 1] += _DAMPING
    rates: Vector = jacobian.T @ np.linalg.solve(square, task)
    return rates
