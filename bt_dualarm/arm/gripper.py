"""The gripper of an arm as its skills see it: what it can do, what it senses, what it is told."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import numpy as np

from bt_dualarm.arm.hold_signs import is_lost
from bt_dualarm.arm.lease import Leaseholder
from bt_dualarm.errors import Failure
from bt_dualarm.pose import Pose
from bt_dualarm.world.grippers.drive import SPEED_S, GripperCommand, GripperHardware
from bt_dualarm.world.grippers.gripper import Gripper
from bt_dualarm.world.world import World

_STILL: Final = 0.003
"""m/s; of fingers that stand; or what some steps of the encoder are in its time for a speed."""

_STEPS: Final = 2.5
_OPEN_M: Final = 1e-3  # besides a step of the encoder
_NO_VACUUM: Final = 0.01
_PATIENCE_S: Final = 1.0  # besides twice the time that fingers take to open
_PRESSING: Final = 0.8  # share of the force that was asked for


class ArmGripper:
    """A gripper with two fingers, or a suction cup.

    Args:
        world: World that the arm is in.
        arm: Name of the arm.
        lease: Lease of the arm, as the leaf holds it.
    """

    def __init__(self, world: World, arm: str, lease: Leaseholder) -> None:
        self._world, self._arm, self._lease = world, arm, lease

    @property
    def page(self) -> Gripper:
        """Page of the catalogue: stroke, force, speed, tool frame."""
        return self._hardware.gripper

    @property
    def width(self) -> float:
        """Opening between the pads by the encoder, m; 0 of a cup."""
        return self._hardware.width

    @property
    def speed(self) -> float:
        """Speed of the opening, positive where it opens, m/s."""
        return self._hardware.speed

    @property
    def force(self) -> float:
        """Force of a pad as the motor tells, positive where it closes, or of a cup's vacuum, N."""
        return self._hardware.force

    @property
    def vacuum(self) -> float:
        """Share of the full vacuum that a cup senses, from 0 to 1; 0 of fingers."""
        return self._hardware.vacuum

    @property
    def commanded(self) -> GripperCommand:
        """What it was asked for last."""
        return self._hardware.commanded

    @property
    def at_rest(self) -> bool:
        """Whether its fingers stand, or its vacuum has built up or gone."""
        return abs(self.speed) < max(_STILL, _STEPS * self.page.resolution / SPEED_S)

    @property
    def closed_width(self) -> float:
        """Opening in m below which nothing is between the fingers."""
        return self.page.closed_width

    @property
    def holding(self) -> bool:
        """Whether it holds something, by what it senses.

        Fingers: they are pressed together with the force that was asked for, stand, and are not
        closed. A cup: it sucks and seals.
        """
        wanted = self.commanded.force
        if not self.page.fingers:
            return self.commanded.width <= 0.0 and self.force >= _PRESSING * wanted
        return self.at_rest and self.force >= _PRESSING * wanted and self.width > self.closed_width

    @property
    def is_lost(self) -> bool:
        """Whether what it held is gone, by what it senses: fingers have shut, a cup leaks."""
        return is_lost(self.page, self.width, self.vacuum, self.commanded.force)

    @property
    def held(self) -> tuple[str, ...]:
        """Objects that it is believed to hold."""
        return tuple(one.object for one in self._world.attachments.gripped_by(self._arm))

    def command(
        self, width: float | None = None, speed: float | None = None, force: float | None = None
    ) -> None:
        """Go to an opening, or close where none is given; holds until the next command.

        The fingers go at the speed until what they meet takes the force, and then hold that force.
        A cup sucks where the width is 0 or not given, and lets go where it is not 0.

        Args:
            width: Opening to go to, m; None to close with the force.
            speed: Speed of the opening, m/s; by default the fastest.
            force: Most force of each pad, N; by default the most.

        Raises:
            Failure: ``INVALID_TARGET`` where one of them is beyond what the gripper can do.
            SkillError: Another thread than that of the leaf asks.
        """
        self._lease.refuse_other_threads()
        page = self.page
        _refuse_beyond(page, width, speed, force)
        self._hardware.command(
            GripperCommand(
                0.0 if width is None else width,
                page.speed.most if speed is None else speed,
                page.force.most if force is None else force,
            )
        )

    def until_open(self, settle: float = 0.0) -> Iterator[float]:
        """Wait until fingers stand where they were told to go, or a cup's vacuum is gone.

        Yields the progress once a tick. ``settle`` is for how many seconds it has to be open.

        Raises:
            Failure: ``NOT_OPEN``: something is in the fingers' way.
        """
        began, asked = self._world.time, self.commanded
        way = abs(asked.width - self.width) if self.page.fingers else 0.0
        longest = _PATIENCE_S + 2.0 * way / max(asked.speed, 1e-3) + settle
        since: float | None = None
        while True:
            now = self._world.time
            since = None if not self._is_open else now if since is None else since
            if since is not None and now - since >= settle:
                return
            if now - began > longest:
                apart = f"the fingers stand {1e3 * self.width:.1f} mm apart"
                raise Failure("NOT_OPEN", apart, width_m=self.width, force_n=self.force)
            yield (now - began) / longest

    @property
    def _is_open(self) -> bool:
        if not self.page.fingers:
            return self.vacuum < _NO_VACUUM
        off = abs(self.width - self.commanded.width)
        return self.at_rest and off <= _OPEN_M + self.page.resolution

    def between_the_pads(self, pose: Pose, meant: Pose | None = None) -> Pose:
        """Where something is between pads that have closed on it: they have moved it to there.

        Args:
            pose: Pose in the world that it was believed to have before.
            meant: Pose of the tool in its frame that was gone to; by default pads close on its
                middle.

        Returns:
            That pose, moved along the way of the fingers; of a cup the same.
        """
        if not self.page.fingers:
            return pose
        q = self._world.hardware[self._arm].q
        tool = self._world.nominal[self._arm].tool_pose_at(q)
        in_tool = tool.inverse @ pose
        along = 0.0 if meant is None else float(meant.inverse.position[1])
        x, _, z = in_tool.position
        return tool @ Pose(np.array((x, along, z)), in_tool.quaternion)

    def hold(
        self, thing: str, pose: Pose, most_force: float = math.inf, *, told: bool = True
    ) -> None:
        """Believe that it holds an object: from now on that moves with the tool.

        Args:
            thing: Name of the object.
            pose: Pose in the world that the object is believed to have now.
            most_force: Force in N of each pad, or of a cup, that the object bears.
            told: Whether its mass counts that the file tells, where arms are told any.
        """
        self._lease.refuse_other_threads()
        self._world.hold(self._arm, thing, pose, most_force, told=told)

    def let_go(self, thing: str) -> bool:
        """Believe no longer that it holds an object; whether it was believed to."""
        self._lease.refuse_other_threads()
        return thing in self.held and self._world.attachments.detach(self._arm, thing)

    @property
    def _hardware(self) -> GripperHardware:
        return self._world.grippers[self._arm]


def _refuse_beyond(
    page: Gripper, width: float | None, speed: float | None, force: float | None
) -> None:
    """Look whether a gripper can do what it is asked for."""
    if page.fingers:
        _refuse("width", width, 0.0, page.stroke, "m", page.name)
        _refuse("speed", speed, page.speed.least, page.speed.most, "m/s", page.name)
    _refuse("force", force, page.force.least, page.force.most, "N", page.name)


def _refuse(
    what: str, given: float | None, least: float, most: float, unit: str, name: str
) -> None:
    if given is not None and not least - 1e-9 <= given <= most + 1e-9:
        raise Failure(
            "INVALID_TARGET",
            f"{what} {given:g} {unit}: {name} can do {least:g} to {most:g} {unit}",
            asked=given,
            least=least,
            most=most,
        )
