"""Grip harder what is pulled at, as soon as the joints feel the pull."""

from __future__ import annotations

import math
from collections import deque
from typing import Final

import numpy as np

from bt_dualarm.arm.state import ArmState
from bt_dualarm.errors import Failure
from bt_dualarm.pose import Vector
from bt_dualarm.world.attachments import Attachment
from bt_dualarm.world.grippers.drive import GripperCommand, GripperHardware

FIRMER: Final = 3.0
"""Factor of the force at each sign of a slip, up to what gripper and object bear."""

_RISE_S: Final = 0.03  # over which a change of the felt torques counts
_RISE: Final = 0.06  # share of a joint's effort; fast carrying alone makes up to 0.052
_RISE_UNSURE: Final = 0.09  # of one that has just turned, or where the load is only weighed
_RISE_UNKNOWN: Final = 0.16  # where nobody knows what the load weighs yet
_TURNING_S: Final = 0.15
_TURNING: Final = 0.1  # rad/s
_STANDS: Final = 1e-4  # rad/s
_SHRUNK_M: Final = 0.0015  # of the opening, before it counts as lost
_STEPS: Final = 1.5  # of the encoder
_LEAKS: Final = 0.9  # share of a vacuum that has built up
_LOST_S: Final = 0.04  # that nothing has to be sensed for
_PAUSE_S: Final = 0.05  # from one response to the next


class SlipResponse:
    """The watch over what an arm's gripper holds, while the arm moves.

    A pull is told by the torques that the model does not explain: their change within 30 ms, as
    a share of each joint's effort. A joint that has just turned counts for less, as its
    dry friction changes sides then, and so do all where the load's mass is not told.
    What fingers or a cup sense themselves comes on top.

    Args:
        arm: State of the arm.

    Attributes:
        felt: How often it has gripped harder.
        felt_at: Simulated time of the last time, s; minus infinity before.
    """

    def __init__(self, arm: ArmState) -> None:
        self._arm = arm
        self._rise = _RISE
        self._past: deque[tuple[float, Vector, Vector]] = deque()
        self._held: Attachment | None = None
        self._loads: object = None
        self._width, self._full, self._sensed_at = 0.0, 0.0, 0.0
        self.may_touch = False
        self.felt, self.felt_at = 0, -math.inf

    def refuse_lost(self) -> None:
        """Look whether what was held is still there.

        Raises:
            Failure: ``DROPPED`` where fingers that hold something have shut, or a cup no longer
                seals; what was held is let go of then.
        """
        self.look()
        hardware = self._arm.world.grippers.get(self._arm.name)
        if hardware is not None and self._held is not None:
            self._refuse_lost(self._held, hardware)

    def look(self) -> None:
        """Look once at what is sensed; a second time at the same moment changes nothing."""
        hardware = self._arm.world.grippers.get(self._arm.name)
        if hardware is None:
            return
        held = next(iter(self._arm.world.attachments.gripped_by(self._arm.name)), None)
        if held is None or hardware.commanded.width > 0.0:
            self._held = None
            return
        now = self._arm.time
        if held is not self._held:
            self._begin(held, hardware)
        if self._past and now <= self._past[-1][0]:
            return
        pulled = self._is_pulled(now) and not self.may_touch
        if (pulled or self._gives(hardware)) and now - self.felt_at > _PAUSE_S:
            self._grip(held, hardware)

    def _begin(self, held: Attachment, hardware: GripperHardware) -> None:
        self._held, self._width, self._full = held, hardware.width, 0.0
        self._sensed_at = self._arm.time
        self._past.clear()

    def _is_pulled(self, now: float) -> bool:
        arm, loads = self._arm, self._arm.payload
        if loads is not self._loads:  # another load explains other torques
            self._loads = loads
            told = all(load.is_told for load in loads)
            known = all(load.mass is not None for load in loads)
            self._rise = _RISE if told else _RISE_UNSURE if known else _RISE_UNKNOWN
            self._past.clear()
        past = self._past
        past.append((now, arm.external_torque.copy(), arm.setpoint.v.copy()))
        while now - past[0][0] > _TURNING_S:
            past.popleft()
        before = [torque for at, torque, _ in past if now - at >= _RISE_S - 1e-9]
        if not before:
            return False
        speeds = np.abs([v for *_, v in past])
        turning = (speeds.min(axis=0) < _TURNING) & (speeds.max(axis=0) > _STANDS)
        unsure = turning | (now - past[0][0] < _RISE_S + _PAUSE_S)
        rise = np.abs(past[-1][1] - before[-1]) / arm.robot.limits.effort
        return bool((rise > np.where(unsure, max(_RISE_UNSURE, self._rise), self._rise)).any())

    def _gives(self, hardware: GripperHardware) -> bool:
        """Whether the fingers come together, or the vacuum falls."""
        page = hardware.gripper
        if page.fingers:
            fallen = self._width - hardware.width
            return fallen > max(_SHRUNK_M, _STEPS * page.resolution)
        self._full = max(self._full, hardware.vacuum)
        return hardware.vacuum < _LEAKS * self._full

    def _grip(self, held: Attachment, hardware: GripperHardware) -> None:
        asked = hardware.commanded
        most = min(hardware.gripper.force.most, held.most_force)
        firmer = min(FIRMER * asked.force, most)
        self.felt, self.felt_at = self.felt + 1, self._arm.time
        if firmer > asked.force:
            speed = hardware.gripper.speed.most
            hardware.command(GripperCommand(asked.width, speed, firmer))

    def _refuse_lost(self, held: Attachment, hardware: GripperHardware) -> None:
        page, asked = hardware.gripper, hardware.commanded
        if page.fingers:
            lost = hardware.width <= page.closed_width
        else:
            lost = hardware.vacuum < 0.5 * asked.force / page.force.most
        if not lost:
            self._sensed_at = self._arm.time
        elif self._arm.time - self._sensed_at > _LOST_S:
            self._arm.world.attachments.detach(self._arm.name, held.object)
            raise Failure(
                "DROPPED",
                f"{held.object!r} is no longer held",
                width_m=hardware.width,
                width_before_m=self._width,
                force_n=hardware.force,
            )
