"""Convex hulls and parts of meshes: they contain the mesh, and little else."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.robots import meshes
from bt_dualarm.robots.meshes import LOSS_M, Hull, MeshShapes, as_stl, stl_triangles
from bt_dualarm.robots.robot_description import load_robot, robot_names
from bt_dualarm.robots.urdf_arm import robot_data_dir
from tests.families import some
from tests.sim.worlds import ROBOTS, world_with

UR5_BASE = robot_data_dir() / "ur_description/meshes/ur5/collision/base.stl"
ONE = (1.0, 1.0, 1.0)

CORNERS = np.array(list(itertools.product((0.0, 1.0), repeat=3)))
FACES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))


def collision_meshes() -> list[tuple[Path, tuple[float, ...]]]:
    """Every mesh that the catalog uses for contacts, with its scale."""
    found: dict[tuple[Path, tuple[float, ...]], None] = {}
    for name in robot_names():
        robot = load_robot(name)
        for link in robot.model.links:
            for shape in robot.model.shapes(link, "collision"):
                if shape.mesh is not None:
                    found[shape.mesh, shape.size] = None
    return list(found)


MESHES = collision_meshes()


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache for this test."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    meshes.mesh_shapes.cache_clear()
    return tmp_path / "cache" / "bt_dualarm"


def triangles_of(path: Path, scale: tuple[float, ...]) -> Matrix:
    triangles: Matrix = stl_triangles(as_stl(path)) * np.asarray(scale)
    return triangles


def distance_outside(points: Matrix, hull: Hull) -> Vector:
    """How far each point is outside the planes of a hull, meters; negative inside."""
    planes = ConvexHull(hull.vertices).equations
    distances: Vector = (points @ planes[:, :3].T + planes[:, 3]).max(axis=1)
    return distances


def points_on_faces(triangles: Matrix, rng: np.random.Generator) -> Matrix:
    """Corners, and random points of every triangle, of shape (n, 3)."""
    weights = rng.dirichlet(np.ones(3), (len(triangles), 3))
    inner = np.einsum("nkc,ncx->nkx", weights, triangles)
    points: Matrix = np.concatenate((triangles, inner), axis=1).reshape(-1, 3)
    return points


def boxes(*pairs: tuple[tuple[float, float, float], tuple[float, float, float]]) -> Matrix:
    """Triangles of boxes given by two corners, of shape (n, 3, 3); boxes may overlap."""
    found = []
    for low, high in np.array(pairs):
        corners = low + CORNERS * (high - low)
        found += [corners[list(three)] for a, b, c, d in FACES for three in ((a, b, c), (a, c, d))]
    return np.array(found)


def volume(points: Matrix) -> float:
    return float(ConvexHull(points).volume)


@pytest.mark.parametrize(
    ("path", "scale"), some(MESHES, 4), ids=lambda part: getattr(part, "stem", "")
)
def test_outline_and_parts_contain_the_mesh(path: Path, scale: tuple[float, ...]) -> None:
    """Corners are few and in the mesh's hull; no more than LOSS_M of the mesh is outside."""
    triangles = triangles_of(path, scale)
    shapes = meshes.mesh_shapes(path, scale)
    points = points_on_faces(triangles, np.random.default_rng(0))
    outside = np.min([distance_outside(points, part) for part in shapes.parts], axis=0)
    assert outside.max() <= LOSS_M
    assert distance_outside(points, shapes.outline).max() <= LOSS_M
    whole = Hull(triangles.reshape(-1, 3), np.zeros((0, 3), int))
    for hull in (shapes.outline, *shapes.parts):
        # Round and large: TIAGo's base, half a meter wide, needs 101 corners, any arm's link 96.
        assert len(hull.vertices) <= 101
        assert hull.triangles.max() < len(hull.vertices)
        assert distance_outside(hull.vertices, whole).max() < 1e-9


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("kind", ["bent", "thick at its ends", "fork"])
def test_a_link_that_is_not_convex_is_cut_where_it_is_thin(kind: str, seed: int) -> None:
    """The cuts remove most of the volume that its hull adds."""
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(0.03, 0.05, 2)
    long = rng.uniform(0.25, 0.4)
    made = {
        "bent": (((0, 0, 0), (a, a, long)), ((0, 0, 0), (long, a, b))),
        "thick at its ends": (
            ((0, 0, 0), (3 * a, 3 * a, 3 * a)),
            ((a, a, 0), (2 * a, 2 * a, long)),
            ((0, 0, long), (3 * a, 3 * a, long + 3 * a)),
        ),
        "fork": (
            ((0, 0, 0), (long, a, a)),
            ((0, 0, 0), (a, a, long)),
            ((long - a, 0, 0), (long, a, long)),
        ),
    }[kind]
    order = rng.permutation(3)  # whichever axes it is drawn along
    triangles = boxes(*made)[:, :, order]
    parts = meshes.convex_parts(triangles)
    solid = sum(volume(boxes(box).reshape(-1, 3)) for box in made)
    assert len(parts) <= 4
    added = volume(triangles.reshape(-1, 3)) - solid
    assert added > 0.1 * solid
    assert sum(map(volume, parts)) - solid < 0.4 * added


@pytest.mark.parametrize("seed", range(4))
def test_a_convex_body_is_not_cut(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(40, 3)) * rng.uniform(0.02, 0.2, 3)
    triangles = points[ConvexHull(points).simplices]
    (part,) = meshes.convex_parts(triangles)
    assert volume(part) == pytest.approx(volume(points))


def test_the_panda_s_convex_meshes_are_not_cut() -> None:
    shipped = [(path, scale) for path, scale in MESHES if "panda_description" in path.parts]
    assert len(shipped) >= 9
    assert {len(meshes.mesh_shapes(*mesh).parts) for mesh in shipped} == {1}


def test_the_triangles_of_a_hull_face_outward() -> None:
    """Renderers and MuJoCo's volumes require it: the signed volume is the hull's."""
    shapes = meshes.mesh_shapes(UR5_BASE, ONE)
    for hull in (shapes.outline, *shapes.parts):
        corners = hull.vertices[hull.triangles]
        cross = np.cross(corners[:, 1], corners[:, 2])
        signed = np.einsum("ij,ij->i", corners[:, 0], cross).sum() / 6
        assert signed == pytest.approx(volume(hull.vertices))


@pytest.mark.parametrize("robot", ROBOTS)
def test_cameras_use_one_hull_per_mesh_and_contacts_its_parts(robot: str) -> None:
    """Every ray tests every visible shape, so these are few; contacts are with visible shapes."""
    world = world_with(robot)
    arm = world.arms["arm1"]
    model = world.model
    source = load_robot(world.declared_arms["arm1"].robot, Path(__file__).parents[1])
    links = source.model.links
    shapes = [shape for link in links for shape in source.model.shapes(link, "collision")]
    own = [
        geom
        for geom in range(model.ngeom)
        if model.body(model.geom_bodyid[geom]).name.startswith("arm1/")
        and not model.geom(geom).name.endswith(("/pedestal", "/tool"))
    ]
    seen = [geom for geom in own if model.geom_group[geom] == 3]
    assert len(seen) == len(shapes)
    touching = [geom for geom in own if geom in arm.geom_ids]
    parts = [
        1 if shape.mesh is None else len(meshes.mesh_shapes(shape.mesh, shape.size).parts)
        for shape in shapes
    ]
    assert len(touching) == sum(parts)
    assert {int(model.geom_group[geom]) for geom in touching} <= {3, 4}


def are_same(first: MeshShapes, second: MeshShapes) -> bool:
    pairs = zip((first.outline, *first.parts), (second.outline, *second.parts), strict=True)
    return all(
        np.array_equal(a.vertices, b.vertices) and np.array_equal(a.triangles, b.triangles)
        for a, b in pairs
    )


def test_shapes_are_computed_once_and_again_if_their_file_is_damaged(
    cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The user's cache directory stores them exactly; half a file does not count."""
    first = meshes.mesh_shapes(UR5_BASE, ONE)
    assert len(first.parts) > 1
    (cached,) = (cache / "hulls").iterdir()

    def computed(mesh: Path, scale: tuple[float, ...]) -> None:
        raise AssertionError(mesh)

    meshes.mesh_shapes.cache_clear()
    with monkeypatch.context() as patched:
        patched.setattr(meshes, "_computed_hulls", computed)
        assert are_same(meshes.mesh_shapes(UR5_BASE, ONE), first)
    cached.write_bytes(cached.read_bytes()[:100])
    meshes.mesh_shapes.cache_clear()
    assert are_same(meshes.mesh_shapes(UR5_BASE, ONE), first)
    assert len(cached.read_bytes()) > 100


def test_shapes_need_no_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """They are computed where the cache directory cannot be created."""
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    meshes.mesh_shapes.cache_clear()
    assert len(meshes.mesh_shapes(UR5_BASE, ONE).parts) > 1
