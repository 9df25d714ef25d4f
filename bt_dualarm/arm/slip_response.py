"""Grip harder what is pulled at, as soon as pads or joints feel the pull."""

from __future__ import annotations

import math
from typing import Final

from bt_dualarm.arm.grip_limit import force_for, least_force
from bt_dualarm.arm.hold_signs import LOST_S, gives, has_slid, is_lost, leaks
from bt_dualarm.arm.pull_sense import JointSense, PadSense
from bt_dualarm.arm.state import ArmState
from bt_dualarm.errors import Failure
from bt_dualarm.world.attachments import Attachment
from bt_dualarm.world.grippers.drive import GripperCommand, GripperHardware
from bt_dualarm.world.nominal.nominal_load import NominalLoad

FIRMER: Final = 3.0
"""Factor of the force at each sign of a slip, up to what gripper and object bear."""

_PAUSE_S: Final = 0.05  # from one response to the next
_LIFT_S: Final = 0.3  # of motion after a grasp, in which what lay on something presses on the pads
_SURE: Final = 2.0  # deviations by which a weight has to be beyond what may be carried
_PRESSES: Final = 0.3  # share of the force that was asked for; less is friction of the drive
_NO_VACUUM: Final = 0.01
_SHAKE: Final = 8.0  # m/s²; that the grip on what was weighed is to bear, as that of `grasp`


class SlipResponse:
    """The watch over what an arm's gripper holds, at every set-point.

    A pull is told by the pads, where the gripper's page says that they feel; else by the torques
    that the model does not explain. The opening of the fingers, or a cup's vacuum, comes on top.

    Args:
        arm: State of the arm.

    Attributes:
        felt: How often it has gripped harder, or would have where it could not.
        felt_at: Simulated time of the last time, s; minus infinity before.
        may_touch: Whether what is held is meant to touch something: no pull counts then.
    """

    def __init__(self, arm: ArmState) -> None:
        self._arm = arm
        self._pads, self._joints = PadSense(), JointSense(arm)
        self._held: Attachment | None = None
        self._gripped_first: Attachment | None = None
        self._generation = -1
        self._nominal = arm.world.nominal[arm.name]
        self._friction, self._loads = 0.0, arm.payload
        self._too_heavy: Failure | None = None
        self._lift_s = 0.0
        self._width, self._full, self._sensed_at = 0.0, 0.0, 0.0
        self._taken: Attachment | None = None
        self._taken_width = 0.0
        self._left_since: float | None = None
        self._weighed = arm.payload
        self._refused: frozenset[str] = frozenset()
        self.may_touch = False
        self.felt, self.felt_at = 0, -math.inf

    def refuse_lost(self) -> None:
        """Look whether what was held is still there.

        Raises:
            Failure: ``DROPPED`` where fingers that hold something have shut, or a cup no longer
                seals; what was held is let go of then. ``OVERLOADED`` where it was weighed, and no
                force that gripper and object bear holds it.
        """
        if self._too_heavy is not None and not self.may_touch:  # it may be set down
            failure, self._too_heavy = self._too_heavy, None
            raise failure
        hardware = self._arm.world.grippers.get(self._arm.name)
        held = self._held
        if hardware is None or held is None:
            return
        if self._arm.time - self._sensed_at > LOST_S:
            self._held = None
            self._arm.world.attachments.detach(self._arm.name, held.object)
            raise Failure(
                "DROPPED",
                f"{held.object!r} is no longer held",
                width_m=hardware.width,
                width_before_m=self._width,
                force_n=hardware.force,
            )

    def look(self) -> None:
        """Look at what is sensed, and answer it; to be called once a control period."""
        self._refuse_weighed()
        hardware = self._arm.world.grippers.get(self._arm.name)
        if hardware is None:
            return
        pulled = self._joints.feels() if hardware.tactile is None else False
        held = self._gripped()
        if held is not self._taken:
            self._taken, self._taken_width, self._left_since = held, hardware.width, None
        if held is None:
            self._held = None
            return
        if hardware.commanded.width > 0.0:
            self._held = None
            self._let_go_of_what_left(held, hardware)
            return
        if held is not self._held:
            self._begin(held, hardware)
        if self._nominal.loads is not self._loads:
            self._loads = self._nominal.loads
            self._hold_what_it_weighs(held, hardware)
        pulled = self._pads.feels(hardware, self._friction) or pulled
        if self._lift_s > 0.0:
            pulled = False
            self._lift_s -= self._arm.period * bool(self._arm.setpoint.v.any())
        now, asked = self._arm.time, hardware.commanded
        if not is_lost(hardware.gripper, hardware.width, hardware.vacuum, asked.force):
            self._sensed_at = now
        pulled = (pulled and not self.may_touch) or self._gives(hardware)
        if pulled and now - self.felt_at > _PAUSE_S:
            self._grip(held, hardware)

    def _gripped(self) -> Attachment | None:
        """What it holds, the first that was taken: looked up when the world has changed."""
        world = self._arm.world
        if self._generation != world.generation:
            self._generation = world.generation
            gripped = world.attachments.gripped_by(self._arm.name)
            self._gripped_first = next(iter(gripped), None)
        return self._gripped_first

    def _begin(self, held: Attachment, hardware: GripperHardware) -> None:
        self._held, self._width, self._full = held, hardware.width, 0.0
        thing = self._arm.world.objects[held.object]
        self._friction = max(hardware.gripper.friction, thing.friction)
        self._sensed_at = self._arm.time
        self._pads.forget()
        self._too_heavy, self._lift_s = None, _LIFT_S

    def _refuse_weighed(self) -> None:
        """Note once that what was weighed is more than arm or gripper may carry, beyond doubt."""
        loads = self._nominal.loads
        if loads is self._weighed:
            return
        self._weighed = loads
        names = frozenset(load.object for load in loads)
        if not names <= self._refused:
            self._refused = frozenset()
        if not names:
            self._too_heavy = None
        known = [load for load in loads if load.mass is not None]
        if names == self._refused or all(load.is_told for load in known):
            return
        mass = sum(load.mass or 0.0 for load in known)
        doubt = math.sqrt(sum(load.mass_doubt**2 for load in known))
        hardware, robot = self._arm.world.grippers.get(self._arm.name), self._arm.robot
        limits = [(robot.payload, robot.name)]
        if hardware is not None and self._gripped() is not None:
            limits.append((hardware.gripper.payload, hardware.gripper.name))
        for most, name in limits:
            if most is not None and mass - _SURE * doubt > most:
                self._refused, self._too_heavy = names, _overload(loads, mass, doubt, most, name)
                return

    def _hold_what_it_weighs(self, held: Attachment, hardware: GripperHardware) -> None:
        """Press more firmly if what nobody told the mass of is heavier than was reckoned with."""
        weighed = [one for one in self._loads if one.object == held.object and not one.is_told]
        for load in weighed:
            most = min(hardware.gripper.force.most, held.most_force)
            if least_force(hardware.gripper, self._friction, load) > most:
                self._too_heavy = _too_heavy(load, most)
                return
            needed = min(force_for(self._arm.world, held, load, _SHAKE), most)
            self._ask(hardware, needed)

    def _let_go_of_what_left(self, held: Attachment, hardware: GripperHardware) -> None:
        """Believe no longer that it holds what its fingers have come off, whoever opened them.

        They stand wider than they did around it, and no longer press; a cup has no vacuum.
        """
        page, now = hardware.gripper, self._arm.time
        if page.fingers:
            wider = has_slid(page, hardware.width - self._taken_width)
            has_left = wider and hardware.force < _PRESSES * hardware.commanded.force
        else:
            has_left = hardware.vacuum < _NO_VACUUM
        if not has_left:
            self._left_since = None
        elif self._left_since is None:
            self._left_since = now
        elif now - self._left_since > LOST_S:
            self._arm.world.attachments.detach(self._arm.name, held.object)

    def _gives(self, hardware: GripperHardware) -> bool:
        """Whether the fingers come together, or the vacuum falls."""
        if hardware.gripper.fingers:
            return gives(hardware.gripper, self._width - hardware.width)
        self._full = max(self._full, hardware.vacuum)
        return leaks(hardware.vacuum, self._full)

    def _grip(self, held: Attachment, hardware: GripperHardware) -> None:
        most = min(hardware.gripper.force.most, held.most_force)
        self.felt, self.felt_at = self.felt + 1, self._arm.time
        self._ask(hardware, min(FIRMER * hardware.commanded.force, most))

    def _ask(self, hardware: GripperHardware, force: float) -> None:
        """Press with a force in N, if that is more than was asked for."""
        asked = hardware.commanded
        if force > asked.force:
            speed = hardware.gripper.speed.most
            hardware.command(GripperCommand(asked.width, speed, force))


def _too_heavy(load: NominalLoad, most: float) -> Failure:
    mass = load.mass or 0.0
    return Failure(
        "OVERLOADED",
        f"{load.object!r} weighs {mass:.2f} kg: {most:.0f} N, the most that it may be held with, "
        "do not hold it",
        mass_kg=mass,
        most_force_n=most,
    )


def _overload(
    loads: tuple[NominalLoad, ...], mass: float, doubt: float, most: float, name: str
) -> Failure:
    names = ", ".join(repr(load.object) for load in loads)
    return Failure(
        "OVERLOADED",
        f"{names}: {mass:.2f} kg, known to {doubt:.2f} kg; the payload of {name} is {most:g} kg",
        mass_kg=mass,
        mass_doubt_kg=doubt,
        payload_kg=most,
    )
