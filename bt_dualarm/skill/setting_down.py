"""Setting down by touch what a gripper holds, and letting go of it."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from typing import Final

import numpy as np

from bt_dualarm.arm.arm import Arm
from bt_dualarm.errors import Failure
from bt_dualarm.pose import Pose
from bt_dualarm.skill.grip import Grip
from bt_dualarm.skill.guarded_descent import guarded_descent
from bt_dualarm.world.attachments import Attachment

_HIGH_M: Final = 0.05  # above the goal, from where it is lowered
_FREE_M: Final = 0.006  # above the goal, down to where nothing may be in the way
_SEARCHED_M: Final = 0.015  # below it: the ground may lie lower
_TOUCH_N: Final = 7.0
_LOWERING: Final = 0.3  # of the speed, down to there
_SLOWLY: Final = 0.003  # share of the limits where it may touch
_ROOM_M: Final = 0.01  # that the fingers open beside the object at least
_BACK_M: Final = 0.08
_OPENING_S: Final = 2.0


class SettingDown:
    """One thing being set down.

    Args:
        arm: Arm whose gripper holds it.
        held: What it holds.
        goal: Pose in the world at which it is to stand.
        speed: Share of the arm's limits on the way there, above 0 to 1.
    """

    def __init__(self, arm: Arm, held: Attachment, goal: Pose, speed: float) -> None:
        self._arm, self._thing, self._speed = arm, held.object, speed
        self._in_tool = arm.robot.tool.inverse @ held.relative
        self._tool = goal @ self._in_tool.inverse

    def through(self) -> Generator[float | None, None, Pose]:
        """Go above, lower until it touches, open, go back; yields the progress once a tick.

        Returns:
            The pose in the world at which it was let go, by what the arm believes.

        Raises:
            Failure: ``NO_CONTACT``, ``NOT_OPEN``, ``SLIPPED``, ``DROPPED``; what motions raise.
        """
        arm, grip = self._arm, Grip(self._arm, self._thing)
        grip.look()
        above = _raised(self._tool, _HIGH_M)
        arm.refuse_collision_along(arm.line(above, _raised(self._tool, _FREE_M)))
        try:
            yield from self._go_above(above, grip)
            yield from self._lower(grip)
        except Failure as failure:
            if failure.code == "SLIPPED":
                yield from grip.judge(failure)
            raise
        lies = arm.tool_pose @ self._in_tool
        yield from self._release()
        return lies

    def _go_above(self, above: Pose, grip: Grip) -> Iterator[float]:
        arm = self._arm
        goals = arm.kinematics.solutions(above, arm.setpoint.q)
        for progress in arm.travel(goals, self._speed):
            yield 0.5 * (progress or 0.0)
            grip.look()

    def _lower(self, grip: Grip) -> Iterator[float | None]:
        """Go down until the ground is felt."""
        arm = self._arm
        way = arm.line(arm.commanded_tool_pose, _raised(self._tool, _FREE_M))
        for progress in arm.follow(arm.time_path(way, _LOWERING * self._speed)):
            yield 0.5 + 0.1 * progress
            grip.look()
        low, force = _raised(self._tool, -_SEARCHED_M), grip.firm_for(_TOUCH_N)
        felt, _ = yield from guarded_descent(arm, low, _SLOWLY, force, grip.look)
        if not felt:
            yield from arm.settle()
            raise Failure("NO_CONTACT", f"nothing is felt below {self._thing!r}")

    def _release(self) -> Iterator[float | None]:
        """Open, and go back out of the fingers' way."""
        arm, gripper = self._arm, self._arm.gripper
        page, touching = gripper.page, frozenset({self._thing})
        wide = gripper.width + 2.0 * _ROOM_M
        gripper.command(min(wide, page.stroke) if page.fingers else 1.0)
        began = arm.time
        while not self._is_open():
            yield 0.85
            if arm.time - began > _OPENING_S:
                raise Failure("NOT_OPEN", "the fingers did not open", width_m=gripper.width)
        gripper.let_go(self._thing)
        back = arm.commanded_tool_pose @ Pose.from_rpy((0, 0, -_BACK_M))
        rows = arm.line(arm.commanded_tool_pose, back)
        arm.refuse_collision_along(rows, ignore=touching)
        for progress in arm.follow(arm.time_path(rows, _LOWERING * self._speed), touching):
            yield 0.85 + 0.15 * progress

    def _is_open(self) -> bool:
        gripper = self._arm.gripper
        if not gripper.page.fingers:
            return gripper.vacuum < 0.02
        return gripper.at_rest and abs(gripper.width - gripper.commanded.width) < 2e-3


def _raised(pose: Pose, height: float) -> Pose:
    return Pose(pose.position + np.array((0.0, 0.0, height)), pose.quaternion)
