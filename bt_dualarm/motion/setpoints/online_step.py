"""One step after a moving reference, within velocity, acceleration and jerk limits, by Ruckig."""

from __future__ import annotations

import numpy as np
import ruckig

from bt_dualarm.errors import DivergenceError, Failure
from bt_dualarm.motion.timing.ruckig_solver import answer
from bt_dualarm.pose import Matrix
from bt_dualarm.world.robots.robot import JointLimits

_HEADROOM = 0.9  # share of the limits that a reference may take, so that it can be caught up with


class OnlineStep:
    """Time-optimal steps of each joint by itself.

    States are of shape (3, dof): position, velocity and acceleration in rad, rad/s, rad/s².

    Args:
        limits: Limits of the arm; those of position are not looked at.
        period: Seconds of one step.
    """

    def __init__(self, limits: JointLimits, period: float) -> None:
        self._limits = limits
        self._period = period
        dof = len(limits.velocity)
        self._solver = ruckig.Ruckig(dof)

    def towards(self, reference: Matrix, now: Matrix) -> Matrix:
        """The state one period after ``now``, on its way to where ``reference`` will be.

        The reference, the state wanted one period after ``now``, is taken to go on with its
        acceleration: seen from it, the goal is to be at rest. Ruckig's goal in the world would be
        a place that the reference has left by the time the joint arrives.
        """
        limits, dt = self._limits, self._period
        goal = reference.copy()
        goal[1] = np.clip(goal[1], -_HEADROOM * limits.velocity, _HEADROOM * limits.velocity)
        goal[2] = np.clip(
            goal[2], -_HEADROOM * limits.acceleration, _HEADROOM * limits.acceleration
        )
        before = goal.copy()
        before[0] -= (goal[1] - 0.5 * goal[2] * dt) * dt
        before[1] -= goal[2] * dt
        request = self._request(now - before)
        request.target_position = request.target_velocity
        request.max_velocity = (limits.velocity - goal[1]).tolist()
        request.min_velocity = (-limits.velocity - goal[1]).tolist()
        request.max_acceleration = (limits.acceleration - goal[2]).tolist()
        request.min_acceleration = (-limits.acceleration - goal[2]).tolist()
        return goal + self._step(request)

    def to_rest(self, now: Matrix) -> Matrix:
        """The state one period after ``now``, braking as hard as the limits allow."""
        request = self._request(now)
        request.control_interface = ruckig.ControlInterface.Velocity
        return self._step(request)

    def _request(self, now: Matrix) -> ruckig.InputParameter:
        limits = self._limits
        rest = [0.0] * len(limits.jerk)
        request = ruckig.InputParameter(len(rest))
        request.synchronization = ruckig.Synchronization.No
        request.current_position, request.current_velocity, request.current_acceleration = (
            now.tolist()
        )
        request.target_velocity = request.target_acceleration = rest
        request.max_velocity = limits.velocity.tolist()
        request.max_acceleration = limits.acceleration.tolist()
        return request

    def _step(self, request: ruckig.InputParameter) -> Matrix:
        """The state one period later.

        Raises:
            DivergenceError: Ruckig finds no way on.
        """
        try:
            motion = answer(request, self._limits.jerk, self._solver)
        except Failure as refusal:
            raise DivergenceError(f"a motion cannot be continued: {refusal.reason}") from refusal
        return np.array(motion.at_time(self._period))
