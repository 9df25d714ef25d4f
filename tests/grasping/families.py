"""Families of shapes, poses, loads and grippers for tests of grasps."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st

from bt_dualarm.core.pose import Pose
from bt_dualarm.grasping.grasp import CupMeasures, JawMeasures, Load, MeshSolid, Solid, solid_of

JAW = JawMeasures(0.0, 0.085, 0.03, 0.022, 0.056, 0.015, 0.016, 20.0, 235.0, 0.8)
NARROW = JawMeasures(0.0, 0.080, 0.0185, 0.0175, 0.045, 0.009, 0.015, 5.0, 70.0, 0.8)
CUP = CupMeasures(0.020, 0.004, 60.0, 0.5)

JAWS = st.sampled_from([JAW, NARROW])
SIZES = st.floats(0.020, 0.070)


@st.composite
def poses(draw: st.DrawFn) -> Pose:
    parts = st.floats(-1.0, 1.0)
    quaternion = np.array([draw(parts) for _ in range(4)]) + np.array([1e-3, 0.0, 0.0, 0.0])
    position = np.array([draw(parts) for _ in range(3)])
    return Pose(position, quaternion / np.linalg.norm(quaternion))


@st.composite
def primitives(draw: st.DrawFn) -> Solid:
    shape = draw(st.sampled_from(["box", "cylinder", "capsule", "sphere"]))
    edge = draw(SIZES)
    other = draw(SIZES)
    third = draw(SIZES)
    sizes = {
        "box": (edge, other, third),
        "cylinder": (edge / 2, other),
        "capsule": (edge / 2, other),
        "sphere": (edge / 2,),
    }
    return solid_of(shape, sizes[shape])


@st.composite
def hulls(draw: st.DrawFn) -> MeshSolid:
    rng = np.random.default_rng(draw(st.integers(0, 999)))
    edge = draw(SIZES)
    return MeshSolid.hull_of(rng.uniform(-edge / 2, edge / 2, (30, 3)))


@st.composite
def loads(draw: st.DrawFn) -> Load:
    gravity = draw(poses()).turn(np.array([0.0, 0.0, -9.81]))
    return Load(draw(st.floats(0.05, 1.5)), gravity, 8.0, np.zeros(3))


def mesh_box(half: float) -> MeshSolid:
    corners = [[x, y, z] for x in (-half, half) for y in (-half, half) for z in (-half, half)]
    return MeshSolid.hull_of(np.array(corners))
