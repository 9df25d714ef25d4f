"""What a page shows of a world at one moment: where bodies are, what touches what, how hard."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from typing import Final

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.live.places import Places
from bt_dualarm.spec.source import Json

MOST_CONTACTS: Final = 60
_LEAST_N: Final = 0.05
"""Force in N from which on a contact is shown: less is the solver's trembling."""


def bodies(data: mujoco.MjData) -> str:
    """Position and quaternion of all bodies, seven 32-bit numbers each, as base64."""
    return as_text(np.hstack((data.xpos, data.xquat)))


def contacts(model: mujoco.MjModel, data: mujoco.MjData) -> list[Json]:
    """Where bodies press on each other: point in m, force on the second one in N, their names."""
    found, force = [], np.zeros(6)
    for number in range(min(data.ncon, 4 * MOST_CONTACTS)):
        contact = data.contact[number]
        if contact.efc_address < 0:
            continue
        mujoco.mj_contactForce(model, data, number, force)
        pushed = force[:3] @ contact.frame.reshape(3, 3)
        if float(np.linalg.norm(pushed)) < _LEAST_N:
            continue
        between = [_owner(model, int(geom)) for geom in contact.geom]
        point, newton = contact.pos.round(4).tolist(), pushed.round(2).tolist()
        found.append({"point": point, "force": newton, "between": between})
    hardest = sorted(found, key=lambda each: -float(np.linalg.norm(each["force"])))
    return hardest[:MOST_CONTACTS]


def cameras(model: mujoco.MjModel, data: mujoco.MjData, arms: Mapping[str, Places]) -> list[Json]:
    """The arms' cameras: place in m, axes (right, up, backward), view angles as tangents."""
    found: list[Json] = []
    for name, arm in arms.items():
        if arm.camera >= 0:
            width, height = model.cam_resolution[arm.camera].tolist()
            up = float(np.tan(np.radians(model.cam_fovy[arm.camera]) / 2.0))
            found.append(
                {
                    "arm": name,
                    "eye": data.cam_xpos[arm.camera].round(4).tolist(),
                    "axes": data.cam_xmat[arm.camera].round(4).tolist(),
                    "half": [round(up * width / height, 4), round(up, 4)],
                    "size": [width, height],
                }
            )
    return found


def arm_numbers(row: Sequence[float]) -> Json:
    """Where an arm's tool is in m, and its error in degrees and share of torque, of a sample."""
    place, error, share = row[1:4], row[4], row[5]
    return {
        "tool": [round(x, 4) for x in place],
        "error_deg": round(error, 4),
        "torque": round(share, 4),
    }


def gripper(
    model: mujoco.MjModel, data: mujoco.MjData, arm: Places, name: str, force: float
) -> Json:
    """A gripper: its name, opening in m, force in N, and what it truly holds.

    Opening and force are None where there is none, or it is not known.
    """
    opening = arm.opening(data.qpos)
    return {
        "name": name,
        "opening_m": round(opening, 5) if np.isfinite(opening) else None,
        "force_n": round(force, 2) if np.isfinite(force) else None,
        "holds": arm.held(model, data),
    }


def as_text(array: npt.NDArray[np.floating]) -> str:
    """Numbers with 32 bits each, as base64."""
    return base64.b64encode(np.ascontiguousarray(array, np.float32).tobytes()).decode("ascii")


def _owner(model: mujoco.MjModel, geom: int) -> str:
    """Body of a shape; of what is fixed to the world, the shape's own name."""
    body = int(model.geom_bodyid[geom])
    name = model.body(body).name if body else model.geom(geom).name
    return str(name or "the scene")
