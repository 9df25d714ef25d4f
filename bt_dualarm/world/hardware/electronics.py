"""Sensors, drives and friction of all arms: side by side, so that each acts in one call."""

from __future__ import annotations

from collections.abc import Mapping

import mujoco

from bt_dualarm.pose import Vector
from bt_dualarm.spec.reality import RealityErrors
from bt_dualarm.world.hardware.arm_hardware import ArmHardware
from bt_dualarm.world.hardware.drawn_arm import DrawnArm, stream
from bt_dualarm.world.hardware.drives import ArmDrives, Drives
from bt_dualarm.world.hardware.encoders import Encoders
from bt_dualarm.world.hardware.plant_arm import PlantArm, parts_of
from bt_dualarm.world.hardware.rubbing import Rubbing


class Electronics:
    """What the joints of all arms are sensed and driven by, and how they rub.

    Args:
        errors: What sensors and drives do to what goes through them, by arm that may come.
        drawn: The robot of the batch that each of them is.
        efforts: Effort limits of their joints, of shape (dof,) each, N m.
        timestep: Seconds of one physics step.
    """

    def __init__(
        self,
        errors: Mapping[str, RealityErrors],
        drawn: Mapping[str, DrawnArm],
        efforts: Mapping[str, Vector],
        timestep: float,
    ) -> None:
        self._parts = parts = parts_of({name: len(effort) for name, effort in efforts.items()})
        encoders = {name: one.encoder for name, one in errors.items()}
        self._encoders = Encoders(encoders, parts, timestep)
        drives = {
            name: ArmDrives(one.drive, drawn[name].gain, efforts[name])
            for name, one in errors.items()
        }
        self._drives = Drives(drives, parts, timestep)
        self._rubbing = Rubbing({name: one.friction for name, one in drawn.items()}, parts)

    def begin(self, name: str, seed: int) -> ArmHardware:
        """The sensors and drives of an arm that comes, whose noise a seed draws."""
        self._encoders.begin(name, stream(seed, f"{name}:encoders"))
        self._drives.begin(name)
        self._rubbing.begin(name)
        return ArmHardware(self._encoders, self._parts[name], self._drives, name)

    def end(self, name: str) -> None:
        """Forget an arm that goes."""
        self._encoders.end(name)

    def connect(
        self, model: mujoco.MjModel, data: mujoco.MjData, arms: Mapping[str, PlantArm]
    ) -> None:
        """Belong to the arms of the plant that are there; anew after each recompilation."""
        self._encoders.connect(data, arms)
        self._drives.connect(data, arms)
        self._rubbing.connect(model, data, arms)

    def sense(self, time: float) -> None:
        """Read the sensors at a simulated time in s, instead of what they read at this moment."""
        self._encoders.read(time)

    def drive(self) -> None:
        """Let the drives act during the next step of physics."""
        self._drives.drive()

    def rub(self) -> None:
        """Set the joints' friction for the velocities that the plant has now."""
        self._rubbing.act()
