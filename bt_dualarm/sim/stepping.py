"""One physics step of a compiled world, checked for divergence."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import mujoco
import numpy as np

from bt_dualarm.core.errors import DivergenceError
from bt_dualarm.sim.arm_devices import ArmDevices


class Stepping:
    """Steps one compiled model and detects divergence.

    Args:
        model: Compiled world.
        data: Its state.
        devices: Sensors and drives of its arms.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, devices: ArmDevices) -> None:
        self._model = model
        self._data = data
        self._devices = devices

    def advance(self, between: Iterable[Callable[[], None]]) -> None:
        """Drive, advance by one step, bring positions and contacts up to date, and sense.

        ``mj_step`` leaves the derived quantities at the state before the step, 2 ms old. Calling
        its two halves in reverse order (``mj_step2``, then ``mj_step1``) avoids that.

        Args:
            between: Functions called between the halves: velocities are new, while contacts and
                their forces are still those of the step.

        Raises:
            DivergenceError: A torque or the state is not finite, or time did not advance.
        """
        model = self._model
        data = self._data
        devices = self._devices
        if not devices.drive():
            raise DivergenceError(_divergence(model, data, "has a command that is not finite"))
        before = data.time
        mujoco.mj_step2(model, data)
        if not devices.pass_between():
            raise DivergenceError(
                _divergence(model, data, "moves impossibly fast or has a state that is not finite")
            )
        for callback in between:
            callback()
        mujoco.mj_step1(model, data)
        now = data.time
        if now <= before:
            raise DivergenceError(f"simulated time went from {before} s back to {now} s")
        devices.sense(now)


def _divergence(model: mujoco.MjModel, data: mujoco.MjData, what: str) -> str:
    return f"the simulation diverged at {data.time:.3f} s: {_culprit(model, data)} {what}"


def _culprit(model: mujoco.MjModel, data: mujoco.MjData) -> str:
    """Name the actuator or joint with a non-finite value, otherwise the fastest joint."""
    if not np.isfinite(data.ctrl).all():
        actuator = int(np.argmin(np.isfinite(data.ctrl)))
        is_joint = model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT  # or a gripper
        return f"{'joint' if is_joint else 'drive'} {model.actuator(actuator).name!r}"
    if not np.isfinite(data.qpos).all():
        address = int(np.argmin(np.isfinite(data.qpos)))
        joint = int(np.searchsorted(model.jnt_qposadr, address, "right")) - 1
        return f"joint {model.joint(joint).name!r}"
    fastest = int(np.argmax(np.nan_to_num(np.abs(data.qvel), nan=np.inf)))
    return f"joint {model.joint(model.dof_jntid[fastest]).name!r}"
