"""Workspace of an arm with free orientation of the tool: reachable points, and the reach."""

from __future__ import annotations

import numpy as np

from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.kinematics.chain import TOOL, Chain
from bt_dualarm.kinematics.solver import capped_solver
from bt_dualarm.robots.robot import Robot

_STARTS = 8
"""Number of random starts besides the robot's postures."""

_ITERATIONS = 40
"""Maximum number of iterations from one start."""

_STEP = 0.4
"""Maximum motion of a joint per iteration, rad."""

_DAMPING = 1e-3
"""Weight of joint motion, m²/rad²: keeps steps short near a stretched arm, which is singular."""

_REACHED = 1e-4
"""Distance at which a point counts as reached, m."""

_GAIN = 1e-5
"""Gain of an iteration below which a descent ends, m."""

_STALLED = 1e-4
"""Step below which an ascent ends, rad."""

_CLIMBED = 1e-9
"""Least gain of a step of an ascent, m."""


class Workspace(Chain):
    """Reach of one arm's tool with free orientation.

    Args:
        robot: Robot description.
        base: Pose of its base link in the world.
    """

    def __init__(self, robot: Robot, base: Pose) -> None:
        super().__init__(robot, base)
        # Starts away from the limits, and within one turn of joints that have several.
        scatter = np.random.default_rng(0).uniform(0.2, 0.8, (_STARTS, self.dof))
        spread = np.clip(self.upper - self.lower, 0.0, 2 * np.pi)
        middle = np.clip(0.0, self.lower + spread / 2, self.upper - spread / 2)
        self._solver = capped_solver(self, _STEP, _DAMPING)
        self._task = self._solver.add_position_task(TOOL, np.zeros(3))
        self._task.configure("tool", "soft", 1.0)
        self._starts = [*robot.postures.values(), *(middle + (scatter - 0.5) * spread)]

    def gap(self, point: Vector) -> float:
        """Least distance in m from the tool to a point of shape (3,); 0 if it can be reached."""
        nearest = float("inf")
        for start in self._starts:
            nearest = min(nearest, self._descend(point, start))
            if nearest < _REACHED:
                return 0.0
        return nearest

    def farthest(self) -> float:
        """Largest distance of the tool from the first joint within the position limits, m.

        The best of several local ascents: in practice the global maximum, to a millimeter.
        """
        center, _ = self.bounding_ball
        return max(self._ascend(center, start) for start in self._starts)

    def _ascend(self, center: Vector, q: Vector) -> float:
        """Local maximum of the distance in m, by gradient steps halved when they do not help."""
        away, slope = self._distance(center, q)
        step = _STEP
        while step > _STALLED:
            # Joints at a limit that the gradient pushes against are left out of the step.
            blocked = ((q >= self.upper) & (slope > 0)) | ((q <= self.lower) & (slope < 0))
            slope = np.where(blocked, 0.0, slope)
            steepest = float(np.abs(slope).max())
            if steepest == 0.0:
                break
            moved = np.clip(q + step * slope / steepest, self.lower, self.upper)
            farther, there = self._distance(center, moved)
            if farther > away + _CLIMBED:
                q = moved
                away = farther
                slope = there
            else:
                step /= 2
        return away

    def _distance(self, center: Vector, q: Vector) -> tuple[float, Vector]:
        """Distance in m of the tool from the center; its gradient, of shape (dof,), m/rad."""
        matrix, jacobian = self.tool(q)
        arm = matrix[:3, 3] - center
        away = float(np.linalg.norm(arm))
        return away, jacobian[:3].T @ arm / away

    def _descend(self, point: Vector, q: Vector) -> float:
        """Distance in m from the point that PlaCo's position task reaches from ``q``."""
        self.set_state(np.clip(q, self.lower, self.upper))
        self._task.target_world = point
        gap = float("inf")
        for _ in range(_ITERATIONS):
            self._solver.solve(True)
            self.placo.update_kinematics()
            last = gap
            gap = float(self._task.error_norm())
            if gap < _REACHED or abs(last - gap) < _GAIN:
                break
        return gap
