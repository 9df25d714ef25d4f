"""The iteration below inverse kinematics: PlaCo's solver, with every joint's step capped."""

from __future__ import annotations

import numpy as np

from bt_dualarm.motion.chain import TOOL, Chain
from bt_dualarm.pose import Matrix, Vector

_DAMPING = 1e-8
"""Weight of a joint's step against the tool's error: redundant joints move as little as they can,
and an answer is still exact to 1e-12 m after six iterations."""

_PULL = 1e-7
"""Weight of the distance to a posture; moves the tool by less than 1e-6 m."""

_CONVERGED = 1e-6
"""Error in m + rad before a step that leaves nothing to gain: convergence is quadratic."""

_STALLED = 1e-4
"""Largest step in rad below which a start that is not on its target has got stuck."""


class Descent:
    """Gauss-Newton steps of an arm to a target, within its position limits.

    Args:
        chain: The arm.
        step: Most that a joint moves in one iteration, rad, so that far starts do not overshoot.
    """

    def __init__(self, chain: Chain, step: float) -> None:
        self._chain = chain
        self._robot = chain.placo
        self._solver = chain.placo.make_solver()
        self._solver.mask_fbase(True)
        self._solver.dt = 1.0
        self._robot.set_velocity_limits(step)
        self._solver.enable_velocity_limits(True)
        self._task = self._solver.add_frame_task(TOOL, np.eye(4))
        self._task.configure("tool", "soft", 1.0, 1.0)
        self._solver.add_regularization_task(_DAMPING)
        self._errors = (self._task.position(), self._task.orientation())

    def run(self, target: Matrix, start: Vector, iterations: int) -> Vector:
        """Where the steps lead, of shape (dof,): close to the target or not.

        Args:
            target: Tool in the world, of shape (4, 4).
            start: Within the position limits, of shape (dof,).
            iterations: Most steps to take.
        """
        chain, robot, solver = self._chain, self._robot, self._solver
        position, angle = self._errors
        self._task.T_world_frame = target
        chain.set_state(start)
        for i in range(iterations):
            step = solver.solve(True)
            robot.update_kinematics()
            error = position.error_norm() + angle.error_norm()
            if error < _CONVERGED:
                break
            # Looking at the step takes as long as half a step.
            if i % 4 == 3 and np.abs(step).max() < _STALLED < error:
                break
        return np.clip(chain.state, chain.lower, chain.upper)


class PulledDescent(Descent):
    """A descent whose redundant joints go to a posture instead of staying where they are.

    It gains a digit an iteration, and ends up to 1e-6 m beside the target: descend from there.
    """

    def __init__(self, chain: Chain, step: float) -> None:
        super().__init__(chain, step)
        self._joints = chain.robot.joints
        self._posture = self._solver.add_joints_task()
        self._posture.configure("posture", "soft", _PULL)

    def pull_to(self, posture: Vector) -> None:
        """Set the posture, of shape (dof,)."""
        self._posture.set_joints(dict(zip(self._joints, posture.tolist(), strict=True)))
