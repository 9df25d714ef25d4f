"""Control of an arm from outside its tree: actions become set-points, through the safety gate.

An action moves a goal of the joints by an increment. Set-points are the goal behind a critically
damped low-pass filter, the same for all joints, so that they do not overshoot and a tool keeps its
direction. Its bandwidth is what acceleration and jerk limits allow at full speed. Then they pass
the gates that every motion passes: the limiter, the guard against other arms, collision detection
and the arm's force limit.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Final, Literal, TypeAlias

import numpy as np

from bt_dualarm.arm.arm import Arm
from bt_dualarm.control.tool_following import pose_error
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.sim.frame import Frame, Image
from bt_dualarm.skill.skill import Skill, Ticks
from bt_dualarm.trajectory.set_points import SetPoint, SetPointLimiter

ActionKind: TypeAlias = Literal["joints", "tool"]

TOOL_SPEED: Final = 0.5
"""Largest speed of the tool along each axis at speed 1, m/s."""

TOOL_TURN: Final = 2.0
"""Largest angular velocity of the tool about each axis at speed 1, rad/s."""

_DAMPING: Final = 1e-4
"""Weight of joint motion in the inverse kinematics: keeps steps finite near singularities."""

_ITERATIONS: Final = 3
_LEAD: Final = 1.5
"""Factor of the largest lag of the filter by which the goal may lead the set-points: it does not
run away from an arm that is slowed down."""


class Stick:
    """What an arm's actions command: like a joystick, it is read whenever a set-point is due.

    Args:
        kind: Whether actions move joints or the tool.
        speed: Fraction of the joints' largest velocities, above 0 to 1.
        step_s: Duration of an action, s.

    Attributes:
        grip: Commanded opening as a fraction of the stroke, from 0 to 1; None before the first
            action.
        stopped: Code of the failure that has stopped the arm, until the next action that it can
            execute; or empty.
        frame: Latest frame of the arm's camera.
        torque: Returns the estimated external joint torques, of shape (dof,), N m.
        time_scale: Fraction of its speed that the guard allows, from 0 to 1.
    """

    def __init__(self, kind: ActionKind, speed: float, step_s: float) -> None:
        self.kind = kind
        self.grip: float | None = None
        self.stopped = ""
        self.frame: Image | None = None
        self.torque: Callable[[], Vector] | None = None
        self.time_scale = 1.0
        self._speed = speed
        self._step_s = step_s
        self._arm: Arm | None = None

    def connect(self, arm: Arm) -> None:
        """Take over an arm at rest, and begin the stream of its set-points."""
        self._arm = arm
        full = arm.limits(1.0)
        self._limits = limits = replace(full, velocity=self._speed * full.velocity)
        self._goal = arm.setpoint.q.copy()
        self._ramp = self._goal.copy()
        self._left_s = 0.0
        self._q = self._goal.copy()
        self._v = np.zeros_like(self._q)
        # The response to a step of the velocity v has the largest acceleration v w / e, and begins
        # with the jerk v w².
        by_acceleration = np.e * limits.acceleration / limits.velocity
        by_jerk = np.sqrt(limits.jerk / limits.velocity)
        self._bandwidth = float(np.minimum(by_acceleration, by_jerk).min())
        self._limiter = SetPointLimiter(limits, arm.period, self._goal)
        self.time_scale = 1.0
        arm.stream(self)

    def disconnect(self, code: str = "") -> None:
        """Lose the arm, which a failure with this code has stopped; actions wait meanwhile."""
        self.stopped = code
        self._arm = None

    def forget(self) -> None:
        """Return to the state before the first run."""
        self.grip = None
        self.stopped = ""
        self.frame = None
        self.torque = None
        self._arm = None

    def push(self, action: Vector) -> None:
        """Begin an action.

        Args:
            action: Fractions of the largest increments, from -1 to 1, of shape (dof,) for joints,
                (6,) for the tool: along and about the axes of the world.
        """
        if self._arm is None:
            return
        self.stopped = ""
        limits = self._limits
        most = limits.velocity * self._step_s
        if self.kind == "joints":
            change = action * most
        else:
            change = self._joint_change(action)
            change *= min(1.0, 1.0 / max(float((np.abs(change) / most).max()), 1e-9))
        lead = _LEAD * (most + 2.0 * limits.velocity / self._bandwidth)
        lower = np.maximum(limits.lower, self._q - lead)
        upper = np.minimum(limits.upper, self._q + lead)
        room = np.where(change > 0.0, upper - self._goal, self._goal - lower)
        share = np.clip(room / np.maximum(np.abs(change), 1e-12), 0.0, 1.0)
        # Joints move one by one, but a tool keeps its direction.
        self._goal = self._goal + change * (share if self.kind == "joints" else share.min())
        self._left_s = self._step_s

    def _joint_change(self, action: Vector) -> Vector:
        """Joint motion, of shape (dof,), rad, that moves the tool as an action requests."""
        arm = self._arm
        if arm is None:
            raise RuntimeError("not connected")
        scale = self._speed * self._step_s
        start = arm.kinematics.forward(self._goal)
        half = 0.5 * action[3:] * TOOL_TURN * scale
        angle = float(np.linalg.norm(half))
        # sinc(x / pi) is sin(x) / x, which has a value at 0.
        quaternion = np.array([np.cos(angle), *(half * np.sinc(angle / np.pi))])
        goal = np.eye(4)
        goal[:3, :3] = Pose(np.zeros(3), quaternion).rotation_matrix @ start.rotation_matrix
        goal[:3, 3] = start.position + action[:3] * TOOL_SPEED * scale
        q = self._goal
        for _ in range(_ITERATIONS):
            matrix, jacobian = arm.kinematics.tool(q)
            square = jacobian @ jacobian.T
            square.flat[:: len(square) + 1] += _DAMPING
            q = q + jacobian.T @ np.linalg.solve(square, pose_error(matrix, goal))
        change: Vector = q - self._goal
        return change

    def __call__(self, time: float) -> SetPoint:  # noqa: ARG002 - set-points follow one another
        """The next set-point."""
        arm = self._arm
        if arm is None:
            raise RuntimeError("not connected")
        dt = arm.period * self.time_scale
        if self._left_s > 0.0:
            self._ramp = self._ramp + min(1.0, dt / self._left_s) * (self._goal - self._ramp)
            self._left_s -= dt
        w = self._bandwidth
        a = w * w * (self._ramp - self._q) - 2.0 * w * self._v
        self._v = self._v + dt * a
        self._q = self._q + dt * self._v
        scale = self.time_scale
        return self._limiter.send(SetPoint(self._q, scale * self._v, scale**2 * a))


class ExternalControl(Skill):
    """Let a program outside of the tree move the arm, until the run ends."""

    example = "external_control"
    failures = {}  # noqa: RUF012 - `Skill` declares it a ClassVar
    stick: Stick
    """Source of the actions; a subclass of its own for each arm has it."""

    def run(self) -> Ticks:
        """Keep the stream alive; after a failure of the motion take over again at rest."""
        unsubscribe = None
        if self.arm.camera is not None:
            unsubscribe = self.arm.camera.subscribe(self._see)
        try:
            self.stick.torque = lambda: self.arm.external_torque
            while True:
                try:
                    self.stick.connect(self.arm)
                    while True:
                        yield
                        self._grip()
                except Failure as failure:
                    # A contact, another arm in the way: the arm stops, and the next action counts.
                    self.stick.disconnect(failure.code)
                    while self.arm.controller.motion is not None:
                        with suppress(Failure):  # of the motion that has ended
                            yield
        finally:
            if unsubscribe is not None:
                unsubscribe()

    def _see(self, frame: Frame) -> None:
        self.stick.frame = frame.image

    def _grip(self) -> None:
        """Pass a new command to the gripper."""
        grip = self.stick.grip
        if grip is None:
            return
        self.stick.grip = None
        gripper = self.arm.gripper
        description = gripper.description
        if not description.fingers:
            width = None if grip < 0.5 else 1.0
        else:
            width = grip * description.stroke
            width = None if width <= gripper.closed_width else width
        commanded = gripper.commanded.width
        if abs((0.0 if width is None else width) - commanded) > 1e-9:
            gripper.command(width)
