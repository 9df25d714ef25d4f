"""The iteration below inverse kinematics: PlaCo's solver, with every joint's step capped."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bt_dualarm.motion.kinematics.placo_model import Mechanism, placo
from bt_dualarm.pose import Matrix, Vector

_DAMPING = 1e-8
"""Weight of a joint's step against the frames' errors: redundant joints move as little as they can,
and an answer is still exact to 1e-12 m after six iterations."""

_PULL = 1e-7
"""Weight of the distance to a posture; moves a frame by less than 1e-6 m."""

_CONVERGED = 1e-6
"""Error in m + rad before a step that leaves nothing to gain: convergence is quadratic."""

_STALLED = 1e-4
"""Largest step in rad below which a start that is not on its target has got stuck."""

_LATE, _FAR = 15, 0.05
"""A start whose error is above so many m + rad at this step is given up: one in forty would still
get there, and a third of all steps is saved."""

_STILL = 2e-3
"""Largest step in rad below which redundant joints are where they were pulled to."""


@dataclass(frozen=True)
class FrameTask:
    """A frame that is to be on a target: in the world, or seen from another frame."""

    frame: str
    seen_from: str | None = None


def capped_solver(mechanism: Mechanism, step: float, damping: float) -> placo.KinematicsSolver:
    """PlaCo's solver of a mechanism without tasks, within its position limits.

    Args:
        mechanism: Mechanism that moves.
        step: Most that a joint moves in one iteration, rad, so that far starts do not overshoot.
        damping: Weight of a joint's step against the errors of the tasks, m²/rad².
    """
    solver = mechanism.placo.make_solver()
    solver.mask_fbase(True)
    solver.dt = 1.0
    mechanism.placo.set_velocity_limits(step)
    solver.enable_velocity_limits(True)
    solver.add_regularization_task(damping)
    return solver


class Descent:
    """Gauss-Newton steps of a mechanism to its targets, within its position limits.

    Args:
        mechanism: Mechanism that moves.
        step: Most that a joint moves in one iteration, rad.
        tasks: Frames that have targets.
    """

    def __init__(self, mechanism: Mechanism, step: float, tasks: Sequence[FrameTask]) -> None:
        self._mechanism = mechanism
        self._robot = mechanism.placo
        self._solver = capped_solver(mechanism, step, _DAMPING)
        self._world, self._relative, parts = [], [], []
        for number, one in enumerate(tasks):
            if one.seen_from is None:
                task = self._solver.add_frame_task(one.frame, np.eye(4))
                self._world.append((number, task))
            else:
                task = self._solver.add_relative_frame_task(one.seen_from, one.frame, np.eye(4))
                self._relative.append((number, task))
            task.configure(f"frame {number}", "soft", 1.0, 1.0)
            parts += [task.position(), task.orientation()]
        self._norms = [part.error_norm for part in parts]

    def run(self, targets: Sequence[Matrix], start: Vector, iterations: int) -> Vector:
        """Where the steps lead, of shape (dof,): close to the targets or not.

        Args:
            targets: Target of each frame, of shape (4, 4).
            start: Configuration within the position limits, of shape (dof,), rad.
            iterations: Most steps to take.
        """
        robot, solver = self._robot, self._solver
        self._set(targets, start)
        for i in range(iterations):
            step = solver.solve(True)
            robot.update_kinematics()
            error = 0.0
            for norm in self._norms:
                error += norm()
            if error < _CONVERGED:
                break
            if i == _LATE and error > _FAR:
                break
            # Looking at the step takes as long as half a step.
            if i % 4 == 3 and np.abs(step).max() < _STALLED < error:
                break
        return self._state()

    def _set(self, targets: Sequence[Matrix], start: Vector) -> None:
        """Begin at a start, of shape (dof,), with these targets."""
        for number, task in self._world:
            task.T_world_frame = targets[number]
        for number, task in self._relative:
            task.T_a_b = targets[number]
        self._mechanism.set_state(start)

    def _state(self) -> Vector:
        mechanism = self._mechanism
        return _within(mechanism, mechanism.state)


class PulledDescent(Descent):
    """A descent whose redundant joints go to a posture instead of staying where they are.

    It gains a digit an iteration, and ends up to 1e-6 m beside the target: descend from there.
    """

    def __init__(self, mechanism: Mechanism, step: float, tasks: Sequence[FrameTask]) -> None:
        super().__init__(mechanism, step, tasks)
        self._joints = mechanism.joints
        self._posture = self._solver.add_joints_task()
        self._posture.configure("posture", "soft", _PULL)

    def nearest(self, targets: Sequence[Matrix], start: Vector, iterations: int) -> Vector:
        """From a start on the targets on to where the posture is nearest, of shape (dof,)."""
        self._set(targets, start)
        for _ in range(iterations):
            step = self._solver.solve(True)
            self._robot.update_kinematics()
            if np.abs(step).max() < _STILL:
                break
        return self._state()

    def pull_to(self, posture: Vector) -> None:
        """Set the posture, of shape (dof,)."""
        self._posture.set_joints(dict(zip(self._joints, posture.tolist(), strict=True)))


class Continuation:
    """From an answer to that for targets close by, where redundant joints stay near a posture.

    Args:
        mechanism: Mechanism that moves.
        step: Most that a joint moves in one iteration, rad.
        tasks: Frames that have targets.
        redundant: Whether the tasks leave joints free.
    """

    def __init__(
        self, mechanism: Mechanism, step: float, tasks: Sequence[FrameTask], *, redundant: bool
    ) -> None:
        self.mechanism = mechanism
        self._exact = Descent(mechanism, step, tasks)
        self._pulled = PulledDescent(mechanism, step, tasks) if redundant else None

    def pull_to(self, posture: Vector) -> None:
        """Where redundant joints go, of shape (dof,)."""
        if self._pulled is not None:
            self._pulled.pull_to(posture)

    def nearest(self, targets: Sequence[Matrix], q: Vector, *, steps: int) -> Vector:
        """From ``q`` on the targets, of shape (dof,), to the answer next to the posture."""
        if self._pulled is None:
            return q
        q = self._pulled.nearest(targets, q, steps)
        return self._exact.run(targets, q, 8)

    def on(
        self, targets: Sequence[Matrix], q: Vector, *, pulled: int = 6, exact: int = 8
    ) -> Vector:
        """From ``q``, of shape (dof,), on to the targets; at most so many steps of each kind."""
        q = _within(self.mechanism, q)
        if self._pulled is not None and pulled:
            q = self._pulled.run(targets, q, pulled)
        return self._exact.run(targets, q, exact)


def _within(mechanism: Mechanism, q: Vector) -> Vector:
    """The nearest configuration, of shape (dof,), within the position limits."""
    # Minimum and maximum: a clip costs three times as much.
    nearest: Vector = np.minimum(np.maximum(q, mechanism.lower), mechanism.upper)
    return nearest
