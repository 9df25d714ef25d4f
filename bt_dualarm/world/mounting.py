"""What an arm's base stands on, or hangs from."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from bt_dualarm.pose import Pose, Vector

_TOUCHING = 0.02  # m: a base this close to a surface is mounted on it
_UPRIGHT = np.cos(np.radians(5))  # a pedestal is built below bases that stand this straight


@dataclass(frozen=True)
class MountingSurface:
    """The surface under a base.

    Attributes:
        body: Name of the MuJoCo body that the surface belongs to.
        gap: Distance from the base to the surface in metres, against the base's z axis.
        pedestal: Whether the gap needs a pedestal.
    """

    body: str
    gap: float
    pedestal: bool


def surface_below(model: mujoco.MjModel, data: mujoco.MjData, base: Pose) -> MountingSurface | None:
    """What is under a base, None if there is nothing."""
    up: Vector = base.rotation_matrix[:, 2]
    geom = np.array([-1], dtype=np.int32)
    start = base.position + _TOUCHING * up  # a base may be sunk into its surface a little
    distance = mujoco.mj_ray(model, data, start, -up, None, 1, -1, geom)
    if distance < 0:
        return None
    gap = distance - _TOUCHING
    body = model.body(model.geom_bodyid[geom[0]]).name
    return MountingSurface(body, gap, pedestal=bool(gap > _TOUCHING and up[2] > _UPRIGHT))
