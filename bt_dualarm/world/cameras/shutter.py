"""A shutter that is open for a while: what moves meanwhile is smeared."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final, TypeAlias

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.world.cameras.frame import focal_length_px
from bt_dualarm.world.rendering.renderer import Exposure, Image

SHARP_PX: Final = 0.5
"""Motion during an exposure that no picture shows: it is drawn once."""

MOST_PICTURES: Final = 8
"""Pictures that an exposure is the mean of, at most: farther apart than a pixel only beyond it."""

_NEAREST_M: Final = 1e-3

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
        left, top, right, bottom = exposure.clipped
        part = slice(top, bottom), slice(left, right)
        total = np.full((bottom - top, right - left, 3), count // 2, np.uint16)
        for offset in (np.arange(count) + 0.5) / count - 0.5:
            image = draw(self._state(model, data, float(offset) * self._open_s), exposure)
            total += image[part]
        image[part] = total // count  # the rest of the last one is as black as that of all
        return image

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
        camera = exposure.camera_id
        axes, eye = data.cam_xmat[camera].reshape(3, 3), data.cam_xpos[camera]
        focal_px = focal_length_px(exposure.height, math.radians(float(model.cam_fovy[camera])))
        fastest, own = 0.0, np.zeros(6)
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_CAMERA, camera, own, 1)
        turn, drift = own[:3].tolist(), own[3:].tolist()
        places = ((data.xpos[self._things] - eye) @ axes).tolist()
        for body, place, radius in zip(self._things.tolist(), places, self._radii, strict=True):
            if _is_shown(exposure, focal_px, place, radius):
                (x, y, z), velocity = place, np.zeros(6)
                mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, body, velocity, 0)
                u, v, w = (velocity[3:] @ axes).tolist()
                u -= drift[0] + turn[1] * z - turn[2] * y
                v -= drift[1] + turn[2] * x - turn[0] * z
                w -= drift[2] + turn[0] * y - turn[1] * x
                across = math.hypot(u - x * w / z, v - y * w / z)
                fastest = max(fastest, focal_px * across / -z)
        return fastest


def _things(model: mujoco.MjModel) -> tuple[npt.NDArray[np.int64], list[float]]:
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
    return np.array(things, dtype=np.int64), extents


def _is_shown(exposure: Exposure, focal_px: float, place: Sequence[float], radius: float) -> bool:
    """Whether a thing at a place in the camera's axes can be in the region that is exposed."""
    x, y, z = place
    if z > -_NEAREST_M:
        return False
    left, top, right, bottom = exposure.clipped
    scale = focal_px / -z
    column, row, room = (
        exposure.width / 2 + x * scale,
        exposure.height / 2 - y * scale,
        radius * scale,
    )
    return left - room < column < right + room and top - room < row < bottom + room
