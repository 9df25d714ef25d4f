"""A shutter that is open for a while: what moves meanwhile is smeared."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from types import ModuleType
from typing import Final, TypeAlias

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.pose import Vector
from bt_dualarm.world.cameras.frame import focal_length_px
from bt_dualarm.world.rendering.renderer import Exposure, Image

SHARP_PX: Final = 0.5
"""Motion during an exposure that no picture shows: it is drawn once."""

MOST_PICTURES: Final = 8
"""Pictures that an exposure is the mean of, at most: farther apart than a pixel only beyond it."""

Draw: TypeAlias = Callable[[mujoco.MjData, Exposure], Image]
"""Draws a camera's picture of a state whose kinematics are up to date."""


class Shutter:
    """Takes the mean of pictures at even times, the stamp in their middle.

    How many there are hangs on how far things in the picture that are not an arm's links move
    across it: one for each pixel. Where they do not, all of it is drawn once.

    Args:
        exposure_s: Seconds for which it is open.
    """

    def __init__(self, exposure_s: float) -> None:
        self._open_s = exposure_s
        self._model: mujoco.MjModel | None = None

    def picture(
        self, model: mujoco.MjModel, data: mujoco.MjData, exposure: Exposure, draw: Draw
    ) -> Image:
        """The picture of an exposure that has its middle now.

        Velocities are taken to be those of now; ``data`` stays as it is.
        """
        motion = self._open_s * self._speed_px(model, data, exposure)
        if motion < SHARP_PX:
            return draw(data, exposure)
        count = min(1 + math.ceil(motion), MOST_PICTURES)
        total = np.array(count // 2, np.uint16)
        for number in range(count):
            offset = (number + 0.5) / count - 0.5
            total = total + draw(self._state(model, data, offset * self._open_s), exposure)
        return (total // np.uint16(count)).astype(np.uint8)

    def _state(self, model: mujoco.MjModel, data: mujoco.MjData, later: float) -> mujoco.MjData:
        """What everything is in, so many seconds later."""
        scratch = self._scratch
        scratch.qpos[:], scratch.mocap_pos[:] = data.qpos, data.mocap_pos
        scratch.mocap_quat[:] = data.mocap_quat
        mujoco.mj_integratePos(model, scratch.qpos, data.qvel, later)
        mujoco.mj_kinematics(model, scratch)
        mujoco.mj_camlight(model, scratch)
        return scratch

    def _speed_px(self, model: mujoco.MjModel, data: mujoco.MjData, exposure: Exposure) -> float:
        """Highest speed of a thing across the picture, in pixels a second."""
        if self._model is not model:
            self._model, self._scratch = model, mujoco.MjData(model)
            self._things, self._radii = _things(model)
            self._roots = model.body_rootid.copy()
        camera = exposure.camera_id
        kernels, size = _kernels(), (exposure.width, exposure.height)
        focal_px = focal_length_px(exposure.height, math.radians(float(model.cam_fovy[camera])))
        speed: float = kernels.fastest(
            self._things, self._radii, int(model.cam_bodyid[camera]),
            kernels.Bodies(data.xpos, data.cvel, data.subtree_com, self._roots),
            data.cam_xpos[camera], data.cam_xmat[camera].reshape(3, 3), focal_px,
            size, exposure.clipped,
        )  # fmt: skip
        return speed


def _things(model: mujoco.MjModel) -> tuple[npt.NDArray[np.int64], Vector]:
    """Bodies that are no link of an arm, the world left out, and how far they extend, in m."""
    things = [body for body in range(1, model.nbody) if "/" not in model.body(body).name]
    extents = [
        max(
            (
                float(np.linalg.norm(model.geom_pos[geom]) + model.geom_rbound[geom])
                for geom in np.flatnonzero(model.geom_bodyid == body)
            ),
            default=0.0,
        )
        for body in things
    ]
    return np.array(things, dtype=np.int64), np.array(extents)


@cache
def _kernels() -> ModuleType:
    """The kernel of motion: an import statement costs as much as it does."""
    from bt_dualarm.world.cameras import motion_kernels

    return motion_kernels


def move_past_something() -> None:
    """Have the kernel of motion compiled."""
    spec = mujoco.MjSpec()
    spec.worldbody.add_camera()
    spec.worldbody.add_body(name="thing").add_geom(size=(0.1, 0.1, 0.1))
    model = spec.compile()
    data = mujoco.MjData(model)
    Shutter(1.0).picture(model, data, Exposure(0, 2, 2), lambda *_: np.zeros((2, 2, 3), np.uint8))
