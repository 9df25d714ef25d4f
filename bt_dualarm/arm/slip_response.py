"""Slip detection and response: the grip becomes firmer as soon as pads or joints sense a slip."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from math import hypot
from typing import Final

from bt_dualarm.arm.gripper import LOST_S, gives, has_slipped, is_lost, leaks
from bt_dualarm.arm.known_objects import KnownObjects
from bt_dualarm.arm.payload import grip_force_for, min_grip_force
from bt_dualarm.control.collision_detection import CollisionDetector
from bt_dualarm.control.controller import JointController
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Matrix
from bt_dualarm.robots.robot import Robot
from bt_dualarm.sim.arm_models import NominalLoad
from bt_dualarm.sim.grippers import Attachment, GripperCommand, GripperHardware
from bt_dualarm.sim.world import World

FIRMER: Final = 3.0
"""Factor by which the force grows at each slip, up to what gripper and object withstand."""

_PAUSE_S: Final = 0.05  # minimum time between two responses
_LIFT_S: Final = 0.3  # motion time after a grasp while the load is transferred to the pads
_SURE: Final = 2.0  # an estimated mass must exceed a payload by this many standard deviations
_PRESSES: Final = 0.3  # fraction of the commanded force; less is friction of the drive
_NO_VACUUM: Final = 0.01
_UNWATCHED_S: Final = 0.2  # time since the last check of a leaf after which none is checking
_SHAKE: Final = 8.0  # m/s² that the grip on an estimated load must withstand, as in `grasp`

NEAR_SLIDING: Final = 0.9
"""Fraction of a pad's friction cone beyond which a slip is imminent. Planned motions use at most
1 / 1.2 of it, see `payload.IN_HAND`."""

_DEVIATIONS: Final = 3.0  # noise margin of a pad, standard deviations
_EASED: Final = 0.4  # below this fraction of the commanded force, something pulls a pad open
_READINGS: Final = 3  # last readings of a pad that count,
_CONFIRMED: Final = 2  # and how many of them have to show a slip: a loosened object bounces
_OF_A_COLLISION: Final = 0.65  # fraction of the collision thresholds; fast carrying reaches 0.54


@dataclass
class _Grip:
    """An object that the gripper holds, since the response has begun for it.

    Attributes:
        held: Attachment of the object.
        width: Opening of the fingers at the beginning, m.
        friction: Coefficient of friction between pads and object.
        sensed_at: Simulated time at which the gripper has sensed it last, s.
        lift_s: Motion time left in which the load is transferred to the pads, s.
        full: Highest vacuum so far.
    """

    held: Attachment
    width: float
    friction: float
    sensed_at: float
    lift_s: float = _LIFT_S
    full: float = 0.0


@dataclass
class _Taken:
    """What is in the gripper, until its opened fingers have left it.

    Attributes:
        held: Attachment of the object; None if there is nothing.
        width: Opening of the fingers when it was taken, m.
        left_since: Simulated time since which they no longer touch it, s; None while they do.
    """

    held: Attachment | None = None
    width: float = 0.0
    left_since: float | None = None


class SlipResponse:
    """Slip response of an arm's gripper, evaluated at every set-point.

    Slip is detected by the pads if they have tactile sensors, otherwise by joint torques that the
    model does not explain; in both cases also by the opening of the fingers or a cup's vacuum.

    Args:
        world: World that the arm is in.
        name: Name of the arm in the tree file.
        controller: Controller that follows the motions of the skills.
        known: Where the arm believes objects to be.

    Attributes:
        felt: Number of slips to which it responded, or would have if a firmer grip were possible.
        felt_at: Simulated time of the last one, s; minus infinity before.
        may_touch: Whether contact of the held object is intended, so that no pull counts as a slip.
    """

    def __init__(
        self, world: World, name: str, controller: JointController, known: KnownObjects
    ) -> None:
        # Not the arm itself, which keeps this response: the world of a run is freed with the run.
        self._world = world
        self._name = name
        self._controller = controller
        self._known = known
        self._pads = PadSlipDetector()
        self._joints = JointSlipDetector(world, name, controller)
        self._grip: _Grip | None = None
        self._taken = _Taken()
        self._gripped_first: Attachment | None = None
        self._is_shared = False
        self._generation = -1
        self._nominal = world.nominal[name]
        self._loads = self._nominal.loads
        self._weighed = self._loads
        self._too_heavy: Failure | None = None
        self._refused: frozenset[str] = frozenset()
        self._checked_at = -math.inf
        self.may_touch = False
        self.felt = 0
        self.felt_at = -math.inf

    def refuse_lost(self) -> None:
        """Check that the held object is still held.

        Raises:
            Failure: ``DROPPED`` if the fingers have shut, or the cup no longer seals; the object
                is detached then. ``OVERLOADED`` where its estimated mass exceeds a payload, or
                needs more force than gripper and object withstand.
        """
        if self._too_heavy is not None and not self.may_touch:  # placing it remains possible
            failure = self._too_heavy
            self._too_heavy = None
            raise failure
        self._checked_at = self._world.time
        self._drop_lost()
        self._known.refuse_dropped()

    def _drop_lost(self) -> None:
        """Detach the held object if the gripper has lost it, and prepare the failure."""
        hardware = self._world.grippers.get(self._name)
        grip = self._grip
        if hardware is None or grip is None or self._world.time - grip.sensed_at <= LOST_S:
            return
        self._grip = None
        name = grip.held.object
        self._world.attachments.detach(self._name, name)
        self._known.dropped = Failure(
            "DROPPED",
            f"{name!r} is no longer held",
            width_m=hardware.width,
            width_before_m=grip.width,
            force_n=hardware.force,
        )

    def look(self) -> None:
        """Evaluate the sensors and respond; to be called once per control period."""
        self._check_payload()
        hardware = self._world.grippers.get(self._name)
        if hardware is None:
            return
        pulled = self._joints.feels() if hardware.tactile is None else False
        held = self._gripped()
        if held is not self._taken.held:
            self._taken = _Taken(held, hardware.width)
        if held is None:
            self._grip = None
            return
        if hardware.commanded.width > 0.0:
            self._grip = None
            self._detach_released(held, hardware)
            return
        grip = self._grip
        if grip is None or held is not grip.held:
            grip = self._grip = self._begin(held, hardware)
        if self._nominal.loads is not self._loads:
            self._loads = self._nominal.loads
            self._hold_estimated_load(grip, hardware)
        pulled = self._pads.feels(hardware, grip.friction) or pulled
        if grip.lift_s > 0.0:
            pulled = False
            grip.lift_s -= self._controller.period * bool(self._controller.setpoint.v.any())
        now = self._world.time
        asked = hardware.commanded
        if not is_lost(hardware.gripper, hardware.width, hardware.vacuum, asked.force):
            grip.sensed_at = now
        elif now - self._checked_at > _UNWATCHED_S:
            # A controller that counts on the inertia of an object which is gone is unstable.
            self._drop_lost()
            if self._grip is None:
                return
        # A partner that takes or carries the object pulls at it by design.
        pulled = (pulled and not (self.may_touch or self._is_shared)) or _gives(grip, hardware)
        if pulled and now - self.felt_at > _PAUSE_S:
            self.felt += 1
            self.felt_at = now
            most = min(hardware.gripper.force.most, held.most_force)
            _ask(hardware, min(FIRMER * asked.force, most))

    def _gripped(self) -> Attachment | None:
        """First object in the gripper; looked up again only when the world has changed."""
        world = self._world
        if self._generation != world.generation:
            self._generation = world.generation
            gripped = world.attachments.gripped_by(self._name)
            self._gripped_first = first = next(iter(gripped), None)
            self._is_shared = first is not None and any(
                one.object == first.object for one in world.attachments.shared_grasps(self._name)
            )
        return self._gripped_first

    def _begin(self, held: Attachment, hardware: GripperHardware) -> _Grip:
        self._pads.forget()
        self._too_heavy = None
        declared = self._world.objects[held.object]
        friction = max(hardware.gripper.friction, declared.friction)
        return _Grip(held, hardware.width, friction, self._world.time)

    def _check_payload(self) -> None:
        """Prepare one failure if an estimated mass surely exceeds a payload of arm or gripper."""
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
        if names == self._refused or all(load.mass_declared for load in known):
            return
        mass = sum(load.borne or 0.0 for load in known)
        doubt = math.sqrt(sum((load.share * load.mass_doubt) ** 2 for load in known))
        robot = self._world.robots[self._name]
        if robot.payload is not None and mass - _SURE * doubt > robot.payload:
            self._refused = names
            self._too_heavy = _overload(loads, mass, doubt, robot)

    def _hold_estimated_load(self, grip: _Grip, hardware: GripperHardware) -> None:
        """Increase the force if an object of undeclared mass is heavier than assumed."""
        held = grip.held
        weighed = [
            one for one in self._loads if one.object == held.object and not one.mass_declared
        ]
        for load in weighed:
            most = min(hardware.gripper.force.most, held.most_force)
            if min_grip_force(hardware.gripper, grip.friction, load) > most:
                self._too_heavy = _too_heavy(load, most)
                return
            needed = min(grip_force_for(self._world, held, load, _SHAKE), most)
            _ask(hardware, needed)

    def _detach_released(self, held: Attachment, hardware: GripperHardware) -> None:
        """Detach an object that the opened fingers no longer touch, by whatever cause.

        They are wider open than around the object and no longer press; a cup has no vacuum.
        """
        description = hardware.gripper
        taken = self._taken
        now = self._world.time
        if description.fingers:
            wider = has_slipped(description, hardware.width - taken.width)
            has_left = wider and hardware.force < _PRESSES * hardware.commanded.force
        else:
            has_left = hardware.vacuum < _NO_VACUUM
        if not has_left:
            taken.left_since = None
        elif taken.left_since is None:
            taken.left_since = now
        elif now - taken.left_since > LOST_S:
            self._known.left(held.object)
            self._world.attachments.detach(self._name, held.object)


def _gives(grip: _Grip, hardware: GripperHardware) -> bool:
    """Whether the fingers approach each other, or the vacuum falls."""
    if hardware.gripper.fingers:
        return gives(hardware.gripper, grip.width - hardware.width)
    grip.full = max(grip.full, hardware.vacuum)
    return leaks(hardware.vacuum, grip.full)


def _ask(hardware: GripperHardware, force: float) -> None:
    """Command a force in N, if that is more than the current one."""
    asked = hardware.commanded
    if force > asked.force:
        speed = hardware.gripper.speed.most
        hardware.command(GripperCommand(asked.width, speed, force))


class PadSlipDetector:
    """Slip detection by tactile pads: the held object slides, or is about to.

    A pad bears a tangential force of up to friction times normal force (Coulomb) and slides beyond.
    A pull normal to the pads unloads one of them.
    """

    def __init__(self) -> None:
        self._stamp = -1.0
        self._slid: deque[bool] = deque(maxlen=_READINGS)
        self._slides = False

    def forget(self) -> None:
        """Reset for another object."""
        self._slid.clear()
        self._slides = False

    def feels(self, hardware: GripperHardware, friction: float) -> bool:
        """Whether the last readings show a slip; never without tactile sensors.

        Args:
            hardware: Gripper with its sensors.
            friction: Coefficient of friction between pads and object.
        """
        sensors = hardware.tactile
        tactile = hardware.gripper.tactile
        if sensors is None or tactile is None:
            return False
        if sensors.stamp != self._stamp:
            self._stamp = sensors.stamp
            doubt = _DEVIATIONS * tactile.noise
            least = _EASED * hardware.commanded.force
            self._slid.append(_slides(sensors.forces, friction, doubt, least))
            self._slides = sum(self._slid) >= _CONFIRMED
        return self._slides


class JointSlipDetector:
    """Slip detection by joint torques: a `CollisionDetector` with lower thresholds.

    Args:
        world: World that the arm is in.
        name: Name of the arm in the tree file.
        controller: Controller that follows the motions of the skills.
    """

    def __init__(self, world: World, name: str, controller: JointController) -> None:
        self._controller = controller
        self._nominal = world.nominal[name]
        self._loads = self._nominal.loads
        self._watch = CollisionDetector(self._nominal.friction, _OF_A_COLLISION)

    def feels(self) -> bool:
        """Process one control period; returns whether something pulls at the tool."""
        loads = self._nominal.loads
        touch = self._controller.touch
        if loads is not self._loads:  # the nominal model explains other torques now
            taken = _names(loads) != _names(self._loads)
            self._loads = loads
            self._watch.reset(grace=taken)
        sent = self._controller.setpoint
        return self._watch.update(touch.inertia, sent, touch.disturbance_torque)


def _slides(forces: Matrix, friction: float, doubt: float, least: float) -> bool:
    """Whether a pad is near its friction limit, or hardly loaded any more."""
    for across, normal, out in forces.tolist():
        pressure = abs(normal)
        if pressure < least or hypot(across, out) > NEAR_SLIDING * friction * pressure + doubt:
            return True
    return False


def _names(loads: tuple[NominalLoad, ...]) -> tuple[str, ...]:
    return tuple(load.object for load in loads)


def _too_heavy(load: NominalLoad, most: float) -> Failure:
    mass = load.mass or 0.0
    return Failure(
        "OVERLOADED",
        f"{load.object!r} weighs {mass:.2f} kg: {most:.0f} N, the largest allowed grip force, "
        "cannot hold it",
        mass_kg=mass,
        most_force_n=most,
    )


def _overload(loads: tuple[NominalLoad, ...], mass: float, doubt: float, robot: Robot) -> Failure:
    names = ", ".join(repr(load.object) for load in loads)
    most = robot.payload or 0.0
    return Failure(
        "OVERLOADED",
        f"{names}: {mass:.2f} kg, known to {doubt:.2f} kg; "
        f"the payload of {robot.full_name} is {most:g} kg",
        mass_kg=mass,
        mass_doubt_kg=doubt,
        payload_kg=most,
    )
