"""Welds of two bodies in the MjSpec of a world."""

from __future__ import annotations

import mujoco

from bt_dualarm.pose import Pose

_WELD_SOLREF = (0.004, 1.0)  # s, damping ratio: as good as rigid at a 2 ms step
_WELD_SOLIMP = (0.9999, 0.9999, 0.001)
"""Share of what would pull a weld apart that it takes back at once. With MuJoCo's 0.9 a tenth of a
wrist's torque turns the wrist alone, and a wide load shakes it: its own inertia is a hundredth."""


def add_weld(spec: mujoco.MjSpec, name: str, body1: str, body2: str, relative: Pose) -> None:
    """Weld two bodies; ``relative`` is the pose of body2 in body1."""
    weld = spec.add_equality(
        name=name,
        type=mujoco.mjtEq.mjEQ_WELD,
        objtype=mujoco.mjtObj.mjOBJ_BODY,
        name1=body1,
        name2=body2,
    )
    weld.solref = _WELD_SOLREF
    weld.solimp[:3] = _WELD_SOLIMP
    # anchor in body2, relative pose, share of torque against force (mjEQ_WELD's eq_data)
    weld.data[:11] = [0, 0, 0, *relative.position, *relative.quaternion, 1]
    spec.add_exclude(name=name, bodyname1=body1, bodyname2=body2)


def remove_weld(spec: mujoco.MjSpec, name: str) -> None:
    """Undo :func:`add_weld`."""
    spec.delete(spec.equality(name))
    spec.delete(spec.exclude(name))
