"""Does something pull at what a gripper holds? By its pads where they feel, else by the joints."""

from __future__ import annotations

from collections import deque
from math import hypot
from typing import Final

from bt_dualarm.arm.state import ArmState
from bt_dualarm.motion.hits.collision_watch import CollisionWatch
from bt_dualarm.pose import Matrix
from bt_dualarm.world.grippers.drive import GripperHardware
from bt_dualarm.world.nominal.nominal_load import NominalLoad

NEAR_SLIDING: Final = 0.9
"""Share of the friction of a pad that is in use where what it holds is about to slide. No motion is
planned that takes more than 1 / 1.2 of it, see `grip_limit`."""

_DEVIATIONS: Final = 3.0  # of a pad's reading
_EASED: Final = 0.4  # share of the force asked for, below which something presses a pad open
_LAST: Final = 3  # readings that are looked at; what is torn loose bounces, and
_TWICE: Final = 2  # of them have to say so
_OF_A_HIT: Final = 0.65  # share of the torques that count as a hit: quick carrying makes up to 0.54


class PadSense:
    """Tells that what pads hold slides, or is about to, by the force on each of them.

    A pad bears along itself no more than friction times what presses on it (Coulomb): near that it
    slides. A pull across the pads takes the pressure from one of them.
    """

    def __init__(self) -> None:
        self._stamp = -1.0
        self._slid: deque[bool] = deque(maxlen=_LAST)
        self._slides = False

    def forget(self) -> None:
        """Begin anew: something else is held."""
        self._slid.clear()
        self._slides = False

    def feels(self, hardware: GripperHardware, friction: float) -> bool:
        """Whether the last readings say so.

        Args:
            hardware: Gripper whose pads feel.
            friction: Coefficient of friction between pads and what they hold.
        """
        sensors, felt = hardware.tactile, hardware.gripper.tactile
        if sensors is None or felt is None:
            return False
        if sensors.stamp != self._stamp:
            self._stamp = sensors.stamp
            doubt, least = _DEVIATIONS * felt.noise, _EASED * hardware.commanded.force
            self._slid.append(_slides(sensors.forces, friction, doubt, least))
            self._slides = sum(self._slid) >= _TWICE
        return self._slides


class JointSense:
    """Tells a pull as `CollisionWatch` tells a hit, sooner: by torques that come fast.

    Args:
        arm: State of the arm.
    """

    def __init__(self, arm: ArmState) -> None:
        self._controller, self._nominal = arm.controller, arm.world.nominal[arm.name]
        self._loads = arm.payload
        self._watch = CollisionWatch(self._nominal.friction, _OF_A_HIT)

    def feels(self) -> bool:
        """Take up a control period; whether something pulls."""
        loads, touch = self._nominal.loads, self._controller.touch
        if loads is not self._loads:  # another load explains other torques
            taken = _names(loads) != _names(self._loads)
            self._loads = loads
            self._watch.forget(grace=taken)
        return self._watch.take(touch.inertia, self._controller.setpoint, touch.disturbing)


def _slides(forces: Matrix, friction: float, doubt: float, least: float) -> bool:
    """Whether a pad bears nearly what friction allows, or is hardly pressed on any more."""
    for across, pressing, out in forces.tolist():
        pressed = abs(pressing)
        if pressed < least or hypot(across, out) > NEAR_SLIDING * friction * pressed + doubt:
            return True
    return False


def _names(loads: tuple[NominalLoad, ...]) -> tuple[str, ...]:
    return tuple(load.object for load in loads)
