"""What a gripper's pads feel: the force on each of them, as sensors under them tell it."""

from __future__ import annotations

from typing import Final

import mujoco
import numpy as np

from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.spec.reality import RealityErrors
from bt_dualarm.world.grippers.gripper import FINGERS, PALM, Gripper, Tactile
from bt_dualarm.world.grippers.mjspec import FELT

_FORCE: Final = 3  # numbers of a reading


class TactileSensors:
    """The sensors under both pads of one gripper, for as long as its arm is in the world.

    They feel what presses on the pads and what rubs along them: the force of the last step of
    physics, in the axes of the tool frame, which the fingers keep. With an ideal encoder they are
    exact; else each pad's reading has the noise of its page, and a gain that the seed draws.

    Args:
        gripper: Page of the gripper.
        tactile: What the page says of them.
        errors: What sensors do to what goes through them.
        rng: Source of their gains and noise.
        timestep: Seconds of one physics step.

    Attributes:
        forces: Force of what is held on each pad, in the axes of the tool frame, of shape (2, 3),
            N; a new array with each reading.
        stamp: Simulated time of the reading, s; minus one before the first.
    """

    def __init__(
        self,
        gripper: Gripper,
        tactile: Tactile,
        errors: RealityErrors,
        rng: np.random.Generator,
        timestep: float,
    ) -> None:
        self.forces: Matrix = np.zeros((len(FINGERS), _FORCE))
        self.stamp = -1.0
        self._rng, self._turn = rng, gripper.tool.rotation_matrix
        is_ideal = not (errors.encoder.resolution or errors.encoder.noise)
        self._noise = 0.0 if is_ideal else tactile.noise
        spread = 0.0 if is_ideal else tactile.gain
        self._gains = 1.0 + rng.uniform(-spread, spread, (len(FINGERS), 1))
        self._every = max(1.0 / tactile.rate - 0.5 * timestep, 0.0)

    def connect(self, model: mujoco.MjModel, data: mujoco.MjData, arm: str) -> None:
        """Belong to the gripper of an arm of the plant; anew after each recompilation."""
        first = int(model.sensor(f"{arm}/{FINGERS[0]}/{FELT}").adr[0])
        second = int(model.sensor(f"{arm}/{FINGERS[1]}/{FELT}").adr[0])
        self._felt = (data.sensordata[first : first + 3], data.sensordata[second : second + 3])
        self._palm: Vector = data.xmat[model.body(f"{arm}/{PALM}").id]

    def sense(self, time: float) -> None:
        """Take a reading if one is due.

        Args:
            time: Simulated time, s.
        """
        if time - self.stamp < self._every:
            return
        self.stamp = time
        to_tool = self._palm.reshape(3, 3) @ self._turn
        forces = -self._gains * (np.array(self._felt) @ to_tool)  # MuJoCo's are those of the pads
        if self._noise:
            forces += self._noise * self._rng.standard_normal(forces.shape)
        self.forces = forces


def tactile_sensors(
    gripper: Gripper, errors: RealityErrors, rng: np.random.Generator, timestep: float
) -> TactileSensors | None:
    """The sensors that the page of a gripper declares; None where it declares none.

    Args:
        gripper: Page of the gripper.
        errors: What sensors do to what goes through them.
        rng: Source of a stream of their own.
        timestep: Seconds of one physics step.
    """
    tactile = gripper.tactile
    if tactile is None:
        return None
    return TactileSensors(gripper, tactile, errors, rng.spawn(1)[0], timestep)
