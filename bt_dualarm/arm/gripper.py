"""The gripper of an arm as its skills see it: what it can do, what it senses, what it is told."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import numpy as np

from bt_dualarm.arm.hold_signs import is_lost
from bt_dualarm.arm.lease import Leaseholder
from bt_dualarm.arm.measured_gripper import jaw_measures
from bt_dualarm.errors import Failure
from bt_dualarm.motion.grasping.jaw_grasps import least_width
from bt_dualarm.motion.grasping.solids import solid_of
from bt_dualarm.pose import Pose
from bt_dualarm.world.grippers.drive import SPEED_S, GripperCommand, GripperHardware
from bt_dualarm.world.grippers.gripper import Gripper
from bt_dualarm.world.world import World

OTHER_WIDTH_M: Final = 0.006
"""By how much the opening of fingers may differ from the width of an object: more is another."""

_AWAY_M: Final = 0.015  # between pads or cup and an object that they are said to hold
_PAD_POINTS: Final = 5  # along each edge of a pad, between which an object is looked for
_CHORD_M: Final = 5e-4  # steps from one pad to the other

_STILL: Final = 0.003
"""m/s; of fingers that stand; or what some steps of the encoder are in its time for a speed."""

_STEPS: Final = 2.5
_OPEN_M: Final = 1e-3  # besides a step of the encoder
_NO_VACUUM: Final = 0.01
_PATIENCE_S: Final = 1.0  # besides twice the time that fingers take to open
_DECIDED_S: Final = 1.0  # that fingers may take to open or to press
_FELT: Final = 0.1  # share of the least force that it can be asked for; fingers alone need none
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

    def until_decided(self) -> Iterator[None]:
        """Wait until what it is believed to hold is held, or gone; yields once a tick.

        A leaf that was halted may have left fingers on their way, and fingers that were just told
        to press harder do not hold until they do.
        """
        began = self._world.time
        while self.held and not self.holding and self._world.time - began < _DECIDED_S:
            if self._is_open and self.commanded.width > 0.0:
                break
            yield None
        self.forget_released()

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

    def why_not(self, thing: str, pose: Pose) -> str | None:
        """Why what it holds cannot be an object, by where that is and by how wide it is.

        Args:
            thing: Name of an object in the world.
            pose: Pose of it in the world as it is believed to be; the fingers may have moved it
                along their way.

        Returns:
            A sentence; None where it may well be this object.
        """
        declared = self._world.objects[thing]
        solid = solid_of(declared.shape, declared.size)
        q = self._world.hardware[self._arm].q
        in_tool = self._world.nominal[self._arm].tool_pose_at(q).inverse @ pose
        if not self.page.fingers:
            away = float(solid.distance(in_tool.inverse.apply(np.zeros((1, 3))))[0])
            return _too_far(thing, away, "cup")
        jaw = jaw_measures(self.page, declared.friction)
        across, between, along = (
            np.linspace(-0.5, 0.5, count) * length
            for count, length in (
                (_PAD_POINTS, jaw.pad_width),
                (round(self.page.stroke / _CHORD_M) + 1, self.page.stroke),
                (_PAD_POINTS, jaw.pad_length),
            )
        )
        grid = np.stack(np.meshgrid(across, along + jaw.pad_center, between, indexing="ij"), -1)
        points = in_tool.inverse.apply(grid[..., [0, 2, 1]].reshape(-1, 3))
        distances = solid.distance(points)
        too_far = _too_far(thing, float(distances.min()), "pads")
        if too_far is not None:
            return too_far
        closing = in_tool.rotation_matrix.T[:, 1]
        most = solid.reach(closing) + solid.reach(-closing)
        inside = distances.reshape(-1, len(between)) < 0.0
        least = min(least_width(solid), float(inside.sum(axis=1).max()) * _CHORD_M)
        if least - OTHER_WIDTH_M <= self.width <= most + OTHER_WIDTH_M:
            return None
        return (
            f"the fingers stand {1e3 * self.width:.1f} mm apart; between them {thing!r} would be "
            f"{1e3 * least:.0f} to {1e3 * most:.0f} mm wide"
        )

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

    def refuse_other(self, wanted: str | None = None) -> None:
        """Look whether it holds another object than the one named; what it has lost counts no more.

        Args:
            wanted: Name of an object that it may have between its fingers already.

        Raises:
            Failure: ``GRIPPER_FULL``, by what is believed or, where nothing is, by what is sensed.
        """
        self.forget_lost()
        held = self.held
        if held and held != (wanted,):
            other = next(name for name in held if name != wanted)
            raise self._full(f"{self.page.name} holds {other!r}: `place` or `release` it first")
        if self.holding and not held:
            what = f"something {1e3 * self.width:.1f} mm wide" if self.page.fingers else "something"
            raise self._full(f"{self.page.name} holds {what} without a name: `release` it first")

    def refuse_full(self, wanted: str | None = None) -> None:
        """As `refuse_other`; neither may anything be attached to the tool.

        Args:
            wanted: Name of an object that it may have between its fingers already.

        Raises:
            Failure: ``GRIPPER_FULL``.
        """
        self.refuse_other(wanted)
        for one in self._world.attachments:
            if one.arm == self._arm and not one.by_gripper:
                raise self._full(f"{one.object!r} is attached to the tool: `detach` it first")

    def _full(self, sentence: str) -> Failure:
        return Failure("GRIPPER_FULL", sentence, width_m=self.width, force_n=self.force)

    def forget_lost(self) -> None:
        """Believe no longer in what is gone, by what is sensed: fingers have shut, a cup leaks."""
        if self.is_lost:
            self.forget_released()

    def forget_released(self) -> None:
        """Believe no longer in what it was to let go of, unless something is still between pads."""
        felt = self.page.fingers and self.force > _FELT * self.page.force.least
        if self.is_lost or not (self.holding or felt):
            for thing in self.held:
                self.let_go(thing)

    def let_go(self, thing: str) -> bool:
        """Believe no longer that it holds an object; whether it was believed to."""
        self._lease.refuse_other_threads()
        return thing in self.held and self._world.attachments.detach(self._arm, thing)

    @property
    def _hardware(self) -> GripperHardware:
        return self._world.grippers[self._arm]


def _too_far(thing: str, away: float, what: str) -> str | None:
    if away <= _AWAY_M:
        return None
    return f"{thing!r} is {1e3 * away:.0f} mm from the {what}"


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
