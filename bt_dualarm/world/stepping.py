"""One physics step, and the proof that it led to numbers."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

import mujoco
import numpy as np

from bt_dualarm.errors import DivergenceError

_ABSURD_SPEED = 1e4  # rad/s or m/s: nothing on a table moves like this


class Stepping:
    """Makes the steps of a world, until it is compiled anew.

    Args:
        model: Compiled world.
        data: State of it.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        self._model, self._data = model, data
        # Views: looking a field up costs more than what is done with it.
        self._torque, self._speed, self._place = data.ctrl, data.qvel, data.qpos

    def advance(self, between: Iterable[Callable[[], None]] = ()) -> float:
        """Advance by one step; positions, contacts and inertias are then those of now.

        ``mj_step`` would leave them as they were before the step, 2 ms old: its two halves are
        called in the other order.

        Args:
            between: Functions that are called when velocities are those of now, and forces that
                hang on them are not; contacts are those of before, with the forces that they had in
                the step.

        Returns:
            Simulated time in s.

        Raises:
            DivergenceError: A torque or the state is not finite, or time did not advance.
        """
        model, data, torque = self._model, self._data, self._torque
        if not math.isfinite(torque.dot(torque)):  # MuJoCo would take all torques for zero
            raise DivergenceError(_diagnosis(model, data, "is driven by what is not a number"))
        before = data.time
        mujoco.mj_step2(model, data)
        speed, place = self._speed, self._place
        # Squares, because one product of vectors costs a tenth of looking at each element.
        if not (speed.dot(speed) < _ABSURD_SPEED**2 and math.isfinite(place.dot(place))):
            raise DivergenceError(_diagnosis(model, data, "moves absurdly fast or is not a number"))
        for look in between:
            look()
        mujoco.mj_step1(model, data)
        now: float = data.time
        if now <= before:
            raise DivergenceError(f"simulated time went from {before} s back to {now} s")
        return now


def _diagnosis(model: mujoco.MjModel, data: mujoco.MjData, what: str) -> str:
    return f"the simulation diverged at {data.time:.3f} s: {_culprit(model, data)} {what}"


def _culprit(model: mujoco.MjModel, data: mujoco.MjData) -> str:
    """What has a force or position that is not finite, else the fastest joint."""
    if not np.isfinite(data.ctrl).all():
        actuator = int(np.argmin(np.isfinite(data.ctrl)))
        turns = model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT  # else a gripper's
        return f"{'joint' if turns else 'drive'} {model.actuator(actuator).name!r}"
    if not np.isfinite(data.qpos).all():
        address = int(np.argmin(np.isfinite(data.qpos)))
        joint = int(np.searchsorted(model.jnt_qposadr, address, "right")) - 1
        return f"joint {model.joint(joint).name!r}"
    fastest = int(np.argmax(np.nan_to_num(np.abs(data.qvel), nan=np.inf)))
    return f"joint {model.joint(model.dof_jntid[fastest]).name!r}"
