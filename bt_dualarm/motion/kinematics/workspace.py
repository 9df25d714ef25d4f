"""Where an arm's tool can get, whichever way it is turned."""

from __future__ import annotations

import numpy as np

from bt_dualarm.motion.kinematics.chain import TOOL, Chain
from bt_dualarm.motion.kinematics.gauss_newton import capped_solver
from bt_dualarm.pose import Pose, Vector
from bt_dualarm.world.robots.robot import Robot

_STARTS = 8
_ITERATIONS = 40
_STEP = 0.4  # rad: most that a joint moves in one iteration
_DAMPING = 1e-3  # m²/rad²: keeps steps short where the arm is stretched
_REACHED = 1e-4  # m
_GAIN = 1e-5  # m nearer in one step: less is the end of a descent
_STALLED = 1e-4  # rad
_CLIMBED = 1e-9  # m: less is no progress


class Workspace(Chain):
    """One arm's tool, with its orientation left free.

    Args:
        robot: Robot that the arm is.
        base: Pose of its base link in the world.
    """

    def __init__(self, robot: Robot, base: Pose) -> None:
        super().__init__(robot, base)
        scatter = np.random.default_rng(0).uniform(0.2, 0.8, (_STARTS, self.dof))
        spread = np.clip(self.upper - self.lower, 0.0, 2 * np.pi)
        middle = np.clip(0.0, self.lower + spread / 2, self.upper - spread / 2)
        self._solver = capped_solver(self, _STEP, _DAMPING)
        self._task = self._solver.add_position_task(TOOL, np.zeros(3))
        self._task.configure("tool", "soft", 1.0)
        self._starts = [*robot.postures.values(), *(middle + (scatter - 0.5) * spread)]

    def gap(self, point: Vector) -> float:
        """Distance in metres, 0 where it is reached, from the tool to a point of shape (3,)."""
        nearest = float("inf")
        for start in self._starts:
            nearest = min(nearest, self._descend(point, start))
            if nearest < _REACHED:
                return 0.0
        return nearest

    def farthest(self) -> float:
        """The tool's largest distance in m from the first joint, whose joints keep their limits.

        The best of several ascents of the distance: in practice the largest, to a millimetre.
        """
        centre, _ = self.bounding_ball
        return max(self._ascend(centre, start) for start in self._starts)

    def _ascend(self, centre: Vector, q: Vector) -> float:
        """Distance that steps along its gradient, halved where they do not help, lead to."""
        away, slope = self._distance(centre, q)
        step = _STEP
        while step > _STALLED:
            blocked = ((q >= self.upper) & (slope > 0)) | ((q <= self.lower) & (slope < 0))
            slope = np.where(blocked, 0.0, slope)
            steepest = float(np.abs(slope).max())
            if steepest == 0.0:
                break
            moved = np.clip(q + step * slope / steepest, self.lower, self.upper)
            farther, there = self._distance(centre, moved)
            if farther > away + _CLIMBED:
                q, away, slope = moved, farther, there
            else:
                step /= 2
        return away

    def _distance(self, centre: Vector, q: Vector) -> tuple[float, Vector]:
        """From the centre, of shape (3,), to the tool, and its gradient, of shape (dof,)."""
        matrix, jacobian = self.tool(q)
        arm = matrix[:3, 3] - centre
        away = float(np.linalg.norm(arm))
        return away, jacobian[:3].T @ arm / away

    def _descend(self, point: Vector, q: Vector) -> float:
        """Distance in metres to which PlaCo's position task brings the tool from ``q``."""
        self.set_state(np.clip(q, self.lower, self.upper))
        self._task.target_world = point
        gap = float("inf")
        for _ in range(_ITERATIONS):
            self._solver.solve(True)
            self.placo.update_kinematics()
            last, gap = gap, float(self._task.error_norm())
            if gap < _REACHED or abs(last - gap) < _GAIN:
                break
        return gap
