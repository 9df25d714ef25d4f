"""Where the motion that an arm follows will lead its tool."""

from __future__ import annotations

from typing import Final

import mujoco
import numpy as np

from bt_dualarm.live.physics import as_text
from bt_dualarm.live.places import Places
from bt_dualarm.motion.control.controller import JointController
from bt_dualarm.motion.setpoints.trajectory_source import TrajectorySource
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.runtime.parts import Controller

_POINTS: Final = 60


class WayAhead:
    """Works a motion's way out once, and gives what is left of it.

    Args:
        model: The compiled world; nothing of it is changed.
        arm: The arm in it.
    """

    def __init__(self, model: mujoco.MjModel, arm: Places) -> None:
        self._model, self._arm = model, arm
        self._scratch: mujoco.MjData | None = None
        self._of: TrajectorySource | None = None
        self._times: Vector = np.empty(0)
        self._points: Matrix = np.empty((0, 3))

    def of(self, controller: Controller, data: mujoco.MjData) -> str:
        """Points of the tool's way to come in m, three 32-bit numbers each, as base64.

        None while the arm holds still, or follows a stream, whose way nobody knows.
        """
        motion = controller.motion if isinstance(controller, JointController) else None
        if not isinstance(motion, TrajectorySource):
            self._of = None
            return ""
        if motion is not self._of:
            self._of = motion
            self._times = np.linspace(0.0, motion.trajectory.duration, _POINTS)
            self._points = self._traced(motion, data)
        left = self._points[self._times >= motion.parameter.s]
        return as_text(np.vstack((data.site_xpos[self._arm.tool], left)))

    def _traced(self, motion: TrajectorySource, data: mujoco.MjData) -> Matrix:
        if self._scratch is None:
            self._scratch = mujoco.MjData(self._model)
        scratch, points = self._scratch, np.empty((_POINTS, 3))
        scratch.qpos[:] = data.qpos
        for number, s in enumerate(self._times.tolist()):
            scratch.qpos[self._arm.qpos] = motion.configuration(s)
            mujoco.mj_kinematics(self._model, scratch)
            points[number] = scratch.site_xpos[self._arm.tool]
        return points
