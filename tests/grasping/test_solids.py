from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_dualarm.grasping.grasp import Capsule, Cylinder, MeshSolid, Solid, solid_of
from tests.grasping.families import hulls, mesh_box, poses, primitives

DIRECTIONS = poses().map(lambda pose: pose.turn(np.array([0.0, 0.0, 1.0])))


@given(st.one_of(primitives(), hulls()), DIRECTIONS)
def test_solid_has_no_point_beyond_its_reach(solid: Solid, direction: np.ndarray) -> None:
    """A plane 10 mm beyond the reach is at least 10 mm from the solid."""
    across = np.cross(direction, np.eye(3)[int(np.abs(direction).argmin())])
    across /= np.linalg.norm(across)
    grid = np.linspace(-0.15, 0.15, 41)
    u, v = np.meshgrid(grid, grid)
    plane = u.reshape(-1, 1) * across + v.reshape(-1, 1) * np.cross(direction, across)
    beyond = plane + (solid.reach(direction) + 0.01) * direction
    least = float(solid.distance(beyond).min())
    assert least > 0.0
    assert least >= 0.01 - 1e-9 or isinstance(solid, MeshSolid)


@given(primitives(), poses())
def test_distances_are_lipschitz(solid: Solid, pose: np.ndarray) -> None:
    """Distances of two points differ by no more than the distance between the points."""
    rng = np.random.default_rng(0)
    points = rng.uniform(-0.08, 0.08, (200, 3))
    steps = rng.uniform(-0.01, 0.01, (200, 3))
    change = np.abs(solid.distance(points + steps) - solid.distance(points))
    assert np.all(change <= np.linalg.norm(steps, axis=1) + 1e-12)


def test_mesh_of_a_box_has_the_distances_of_the_box() -> None:
    mesh = mesh_box(0.025)
    box = solid_of("box", (0.05, 0.05, 0.05))
    inside = np.random.default_rng(0).uniform(-0.025, 0.025, (100, 3))
    assert mesh.distance(inside) == pytest.approx(box.distance(inside))
    assert mesh.is_convex


def test_distances_of_a_mesh_that_is_not_convex() -> None:
    """The mesh is two separate cubes, and the space between them is outside."""
    aside = np.array([0.02, 0.0, 0.0])
    left = mesh_box(0.01).corners - aside
    right = mesh_box(0.01).corners + aside
    both = MeshSolid(np.vstack((left, right)))
    points = np.array([[0.0, 0, 0], [0.02, 0, 0], [-0.02, 0.005, 0], [0.05, 0, 0]])
    assert not both.is_convex
    assert both.distance(points) == pytest.approx([0.01, -0.01, -0.005, 0.02])


@given(hulls(), st.integers(0, 99))
def test_inward_ray_exits_on_the_other_side(mesh: MeshSolid, seed: int) -> None:
    points, normals = mesh.sample(8, np.random.default_rng(seed))
    assert np.abs(mesh.distance(points)).max() < 1e-9
    for point, normal in zip(points, normals, strict=True):
        found = mesh.farthest_hit(point, -normal)
        if found is not None:
            assert abs(float(mesh.distance(found[0][None])[0])) < 1e-9
            assert found[1] @ -normal > 0.0


def test_unknown_shape_is_refused() -> None:
    assert isinstance(solid_of("cylinder", (0.02, 0.05)), Cylinder)
    assert isinstance(solid_of("sphere", (0.02,)), Capsule)
    with pytest.raises(ValueError, match="'torus' cannot be grasped"):
        solid_of("torus", (0.1,))


@pytest.mark.parametrize("sides", [3, 5, 6, 8])
def test_long_edges_of_a_prism_are_sharp(sides: int) -> None:
    """Edges along the axis are sharp; the short edges of the ends are not."""
    turns = np.arange(sides) * 2.0 * np.pi / sides
    ring = 0.02 * np.column_stack((np.cos(turns), np.sin(turns)))
    ends = [np.column_stack((ring, np.full(sides, z))) for z in (-0.05, 0.05)]
    solid = MeshSolid.hull_of(np.vstack(ends))
    middles, outward = solid.edges
    assert len(middles) == sides
    assert np.allclose(middles[:, 2], 0.0)
    assert np.allclose(middles, 0.02 * outward)


def test_smooth_and_inner_edges_do_not_count() -> None:
    heights = np.linspace(-1.0, 1.0, 600)
    turns = np.arange(600) * np.pi * (3.0 - np.sqrt(5.0))  # a spiral of almost equal distances
    flat = np.sqrt(1.0 - heights**2)
    ball = np.column_stack((flat * np.cos(turns), flat * np.sin(turns), heights))
    assert len(MeshSolid.hull_of(0.03 * ball).edges[0]) == 0
    assert len(mesh_box(0.025).edges[0]) == 12
