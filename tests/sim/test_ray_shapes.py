"""Closed forms of ray casting agree with MuJoCo's own ray casting."""

from __future__ import annotations

import copy
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bt_dualarm.sim import renderers
from bt_dualarm.sim.kernel_arrays import CAPSULE, CYLINDER, PLANE, SPHERE, Fan, Hits
from bt_dualarm.sim.ray_intersection_kernels import box_of, contains, in_camera
from bt_dualarm.sim.renderers import RayScene, box, camera_rays

ROWS = 24
COLUMNS = 32

ROCK = np.random.default_rng(2).normal(size=(24, 3)) * (0.1, 0.15, 0.08)


def model_of(*geoms: dict[str, Any]) -> tuple[Any, Any]:
    """Model and data of geoms; meshes are the convex hull of ROCK."""
    spec = mujoco.MjSpec()
    spec.add_mesh(
        name="rock", uservert=ROCK.ravel(), inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX,
        userface=_hull_faces().ravel(),
    )  # fmt: skip
    for geom in geoms:
        spec.worldbody.add_geom(**geom)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def _hull_faces() -> Any:
    """Outward triangles of ROCK's convex hull, of shape (f, 3)."""
    from scipy.spatial import ConvexHull

    hull = ConvexHull(ROCK)
    faces = []
    for simplex, plane in zip(hull.simplices, hull.equations, strict=True):
        a, b, c = ROCK[simplex]
        faces.append(simplex if np.cross(b - a, c - a) @ plane[:3] > 0 else simplex[::-1])
    return np.array(faces)


def fan_toward(target: Any, eye: Any, roll: float = 0.0) -> Fan:
    """A camera of 50 degrees at ``eye`` that looks at ``target``."""
    back = (np.asarray(eye) - target) / np.linalg.norm(np.asarray(eye) - target)
    turn, _ = Rotation.align_vectors([back], [[0.0, 0.0, 1.0]])
    axes = (turn * Rotation.from_euler("z", roll)).as_matrix()
    spacing = 2.0 * np.tan(np.radians(25.0)) / ROWS
    rays = camera_rays(COLUMNS, ROWS, 50.0, 1).copy()
    return Fan(np.asarray(eye, dtype=float), axes, rays, spacing, (COLUMNS / 2, ROWS / 2))


def by_mujoco(model: Any, data: Any, fan: Fan) -> Hits:
    hits = Hits.none(fan)
    everything = copy.copy(model)
    everything.geom_group[:] = 0
    renderers._cast(everything, data, fan, hits)
    return hits


def assert_same(mine: Hits, oracle: Hits) -> None:
    assert (mine.geoms == oracle.geoms).all()
    seen = mine.geoms >= 0
    assert mine.distances[seen] == pytest.approx(oracle.distances[seen], rel=1e-9)
    assert np.abs(mine.normals - oracle.normals)[:, seen].max(initial=0.0) < 1e-6
    assert np.isinf(mine.distances[~seen]).all()
    assert not mine.normals[:, ~seen].any()


SHAPES = {
    "sphere": {"type": mujoco.mjtGeom.mjGEOM_SPHERE, "size": (0.2, 0, 0)},
    "cylinder": {"type": mujoco.mjtGeom.mjGEOM_CYLINDER, "size": (0.1, 0.2, 0)},
    "capsule": {"type": mujoco.mjtGeom.mjGEOM_CAPSULE, "size": (0.08, 0.15, 0)},
    "box": {"type": mujoco.mjtGeom.mjGEOM_BOX, "size": (0.1, 0.2, 0.05)},
    "mesh": {"type": mujoco.mjtGeom.mjGEOM_MESH, "meshname": "rock"},
    "plane": {"type": mujoco.mjtGeom.mjGEOM_PLANE, "size": (0.5, 0.3, 0.1)},
    "ground": {"type": mujoco.mjtGeom.mjGEOM_PLANE, "size": (0, 0, 0.1)},
}
angles = st.floats(-3.1, 3.1)


@given(azimuth=angles, height=st.floats(-0.8, 0.8), roll=angles, offset=st.floats(-0.2, 0.2))
@settings(max_examples=25, deadline=None)
@pytest.mark.parametrize("kind", SHAPES)
def test_rays_hit_each_shape_as_in_mujoco(
    kind: str, azimuth: float, height: float, roll: float, offset: float
) -> None:
    """Every ray has the same geom, distance and normal, from any viewpoint."""
    model, data = model_of({**SHAPES[kind], "quat": (0.8, 0.2, 0.5, 0.1), "pos": (0.1, 0.2, 0.3)})
    eye = np.array([0.1 + np.cos(azimuth), 0.2 + np.sin(azimuth), 0.3 + height])
    fan = fan_toward(np.array([0.1, 0.2 + offset, 0.3 + offset]), eye, roll)
    scene = RayScene(model, (0,))
    assert scene._others is None
    assert_same(scene.trace(data, fan), by_mujoco(model, data, fan))


@given(seed=st.integers(0, 10_000))
@settings(max_examples=25, deadline=None)
@pytest.mark.parametrize("kind", ["sphere", "cylinder", "capsule", "box", "mesh"])
def test_rays_hit_shapes_that_extend_behind_the_eye_as_in_mujoco(kind: str, seed: int) -> None:
    """Shapes close to the eye, on any side of it."""
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=3)
    place = direction / np.linalg.norm(direction) * rng.uniform(0.3, 0.45)
    model, data = model_of({**SHAPES[kind], "quat": rng.normal(size=4), "pos": place})
    fan = fan_toward(np.array((1.0, 0.0, 0.0)), np.zeros(3))
    mine = RayScene(model, (0,)).trace(data, fan)
    if surrounds(model, data, fan):
        assert (mine.geoms == -1).all()
    else:
        assert_same(mine, by_mujoco(model, data, fan))


def surrounds(model: Any, data: Any, fan: Fan) -> bool:
    """Whether the eye is inside the only shape: then MuJoCo's rays leave it through any side."""
    rays = np.concatenate([np.eye(3), -np.eye(3)])
    normal = np.zeros(3)
    out = [
        mujoco.mj_ray(model, data, fan.eye, ray, None, True, -1, np.zeros(1, np.int32), normal) >= 0
        and normal @ ray > 0
        for ray in rays
    ]
    return all(out)


def test_shape_beside_the_eye_needs_no_rays() -> None:
    fan = fan_toward(np.zeros(3), (0.0, 0.0, 1.0))
    corners = box(np.full(3, 0.1)).corners

    def cells(*place: float) -> tuple[int, int, int, int]:
        points = in_camera(corners + place, np.zeros(3), np.eye(3), fan)
        return box_of(fan, points)

    for x, y in ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)):
        assert cells(0.3 * x, 0.3 * y, 0.0) == (0, 0, 0, 0)
    assert cells(0.0, 0.0, 0.2) == (0, 0, 0, 0)
    assert cells(0.1, 0.0, 0.0) == (0, ROWS, 0, COLUMNS)


@given(seed=st.integers(0, 10_000))
@settings(max_examples=25, deadline=None)
def test_nearest_of_many_shapes_is_hit(seed: int) -> None:
    """A heap of shapes, one of them without a closed form, above a floor."""
    rng = np.random.default_rng(seed)
    kinds = ["sphere", "cylinder", "box", "mesh", "capsule", "egg", "box", "cylinder"]
    egg = {"type": mujoco.mjtGeom.mjGEOM_ELLIPSOID, "size": (0.08, 0.15, 0.1)}
    heap = [
        {**SHAPES.get(k, egg), "pos": rng.uniform(-0.4, 0.4, 3), "quat": rng.normal(size=4)}
        for k in kinds
    ]
    model, data = model_of({**SHAPES["ground"], "pos": (0, 0, -0.5)}, *heap)
    fan = fan_toward(np.zeros(3), rng.normal(size=3) * 0.1 + (1.5, 0.0, 0.3))
    scene = RayScene(model, (0,))
    assert scene._others is not None
    assert_same(scene.trace(data, fan), by_mujoco(model, data, fan))


def test_nonconvex_mesh_is_left_to_mujoco() -> None:
    spec = mujoco.MjSpec()
    cube = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    dented = np.vstack([cube, [[0.0, 0.0, 0.2]]])
    faces = [
        (0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1),
        (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 8), (5, 7, 8), (7, 3, 8), (3, 1, 8),
    ]  # fmt: skip
    spec.add_mesh(name="bowl", uservert=dented.ravel(), userface=np.array(faces).ravel())
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="bowl")
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    scene = RayScene(model, (0,))
    assert scene._others is not None
    fan = fan_toward(np.zeros(3), (0.5, 0.5, 5.0))
    assert_same(scene.trace(data, fan), by_mujoco(model, data, fan))


def test_transparent_geoms_and_other_groups_are_not_hit() -> None:
    ball = SHAPES["sphere"]
    model, data = model_of({**ball, "rgba": (1, 0, 0, 0)}, {**ball, "group": 4})
    fan = fan_toward(np.zeros(3), (1.0, 0.0, 0.0))
    assert (RayScene(model, (0, 1, 3)).trace(data, fan).geoms == -1).all()
    assert (RayScene(model, (4,)).trace(data, fan).geoms == 1).any()


@pytest.mark.parametrize("kind", [PLANE, SPHERE, CYLINDER, CAPSULE])
def test_contains_tells_inside_from_outside(kind: int) -> None:
    """It serves cameras inside of a shape, which see through it, as in OpenGL."""
    size = np.array([0.1, 0.2, 0.0])
    assert contains(kind, size, np.array([0.02, 0.01, -0.01]))
    assert not contains(kind, size, np.array([0.5, 0.5, 0.5]))


def test_capsule_has_spherical_ends() -> None:
    size = np.array([0.1, 0.2, 0.0])
    assert contains(CAPSULE, size, np.array([0.0, 0.0, -0.29]))
    assert not contains(CAPSULE, size, np.array([0.09, 0.0, -0.29]))


def test_camera_inside_its_housing_sees_through_it() -> None:
    model, data = model_of(
        {**SHAPES["sphere"], "pos": (1.0, 0.0, 0.0)}, {**SHAPES["box"], "pos": (0, 0, 0)}
    )
    fan = fan_toward(np.zeros(3), (1.0, 0.0, 0.0))
    geoms = RayScene(model, (0,)).trace(data, fan).geoms
    assert (geoms == 1).any()
    assert not (geoms == 0).any()
