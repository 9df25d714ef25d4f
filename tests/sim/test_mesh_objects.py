"""Objects from mesh files: located below the tree's folder, decomposed, checked and limited."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bt_dualarm as bt
from bt_dualarm.core.pose import Matrix, Pose
from bt_dualarm.perception.known_shape import KnownShape
from bt_dualarm.replay.record import Record
from bt_dualarm.replay.rerun import check_record
from bt_dualarm.robots import meshes
from bt_dualarm.sim.object_body import body_of
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.document import ObjectSpec

BOX_FACES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))


def box_mesh(size: tuple[float, float, float], center: tuple[float, float, float]) -> Matrix:
    """Triangles of a box, of shape (12, 3, 3)."""
    signs = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    corners = signs * size + center
    quads = [corners[list(face)] for face in BOX_FACES]
    triangles: Matrix = np.array([quad[[0, i, i + 1]] for quad in quads for i in (1, 2)])
    return triangles


BRACKET = np.vstack((box_mesh((80, 30, 10), (0, 0, -25)), box_mesh((10, 30, 50), (35, 0, 5))))
"""An L-shaped bracket of two plates, in millimeters."""


def star_mesh(tips: int, inner: float) -> Matrix:
    """Triangles of a star of 70 mm, 40 mm high, in millimeters; ``inner`` is a share of 35 mm."""
    around = np.arange(2 * tips) * np.pi / tips
    radius = 35.0 * np.where(np.arange(2 * tips) % 2, inner, 1.0)
    rim = np.column_stack((radius * np.cos(around), radius * np.sin(around)))
    found = []
    for one, other in zip(rim, np.roll(rim, -1, axis=0), strict=True):
        low, high = ([(*point, z) for point in (one, other)] for z in (-20.0, 20.0))
        found += [[(0.0, 0.0, 20.0), *high], [(0.0, 0.0, -20.0), low[1], low[0]]]
        found += [[low[0], low[1], high[1]], [low[0], high[1], high[0]]]
    return np.array(found)


def write_obj(path: Path, triangles: Matrix) -> None:
    lines = [f"v {x:g} {y:g} {z:g}" for x, y, z in triangles.reshape(-1, 3).tolist()]
    lines += [f"f {i} {i + 1} {i + 2}" for i in range(1, len(lines) + 1, 3)]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def file_with(obj: dict[str, Any], *tree: Any) -> dict[str, Any]:
    return {
        "bt_dualarm": 1,
        "name": "bracket",
        "world": {"scene": "table", "reality": "lab", "time_limit": 90},
        "objects": {"bracket": {"mass": 0.2, "color": "yellow"} | obj},
        "arms": {
            "arm1": {
                "robot": "ur5",
                "gripper": "robotiq_2f85",
                "base": {"xyz": [0, 0, 0.4]},
                "tree": {"sequence": [*tree] or ["stop"]},
            }
        },
    }


MESH = {"shape": "mesh", "file": "parts/bracket.obj", "scale": 0.001}
AT_REST = {"pose": {"xyz": [0.40, -0.40, 0.4305], "rpy": [0, 0, 30]}}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    write_obj(tmp_path / "parts" / "bracket.obj", BRACKET)
    return tmp_path


def test_bracket_is_decomposed_into_two_convex_parts(folder: Path) -> None:
    obj = ObjectSpec(**MESH, mass=0.2)  # type: ignore[arg-type]  # as in a file
    obj.look_in(folder)
    body = body_of(obj)
    assert len(body.parts) == 2
    assert sum(part.weight for part in body.parts) == pytest.approx(39e-6, rel=1e-3)  # m³
    assert body.ray(np.array((0.0, 0.0, 0.02)), np.array((1.0, 0.0, 0.0))) == pytest.approx(0.03)


@pytest.mark.parametrize(("tips", "inner"), [(3, 0.45), (4, 0.9), (5, 0.45), (6, 0.9)])
def test_star_is_the_same_after_a_turn_to_its_next_tip(
    tips: int, inner: float, folder: Path
) -> None:
    """Its convex parts are not: planes across the axes of the mesh cut them."""
    write_obj(folder / "star.obj", star_mesh(tips, inner))
    obj = ObjectSpec(shape="mesh", file="star.obj", scale=0.001, mass=0.1)
    obj.look_in(folder)
    assert body_of(obj).folds[2] == tips
    shape = KnownShape.of(obj)
    here = Pose.identity()
    for share, angle in ((1.0, 0.0), (0.5, 0.5)):
        there = Pose.from_rpy((0.0, 0.0, 0.0), (0.0, 0.0, share * 2.0 * np.pi / tips))
        assert shape.angle(here, there) == pytest.approx(angle * 2.0 * np.pi / tips, abs=1e-6)


def test_decomposition_is_cached(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = meshes.object_hulls(folder / "parts" / "bracket.obj", 0.00099)

    def refuse(*_: object) -> None:
        raise AssertionError

    monkeypatch.setattr(meshes, "convex_parts", refuse)
    again = meshes.object_hulls(folder / "parts" / "bracket.obj", 0.00099)
    assert all((one == other).all() for one, other in zip(first, again, strict=True))


def test_mesh_file_may_have_the_longest_name(folder: Path) -> None:
    """Names in the cache have a digest besides; 255 bytes is what file systems allow."""
    file = folder / ("é" * 125 + "x.obj")
    (folder / "parts" / "bracket.obj").rename(file)
    assert len(meshes.object_hulls(file, 0.001)) == 2


@pytest.mark.usefixtures("without_plots")
def test_mesh_object_is_picked_carried_placed_and_replayed(folder: Path) -> None:
    goal = {"xyz": [0.25, -0.50, 0.4305]}
    tree = [
        {"grasp": {"object": "bracket"}},
        {"transport": {"to": {"xyz": [0.30, -0.45, 0.60]}}},
        {"place": {"at": goal}},
    ]
    result = bt.run(file_with(MESH | AT_REST, *tree), record=folder / "out")
    leaves = result.arms["arm1"].leaves
    assert result.outcome == "SUCCESS", {n: (one.code, one.reason) for n, one in leaves.items()}
    assert float(leaves["sequence/place"].metrics["placed_error_m"]) < 0.005
    assert check_record(Record.read(folder / "out"), Registry.load()).agrees


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("/etc/bracket.stl", "is not below the folder of the tree or scene file"),
        ("../bracket.stl", "is not below the folder of the tree or scene file"),
        ("parts/../../bracket.stl", "is not below the folder of the tree or scene file"),
        ("C:/bracket.stl", "is not below the folder of the tree or scene file"),
        ("parts/bracket.dae", "expected an STL or OBJ file"),
        ("parts/nothing.stl", "does not exist"),
        ("parts/link.obj", "is a link to a place outside"),
        ("parts/text.stl", "cannot be read by assimp"),
        ("parts/flat.obj", "mm thick"),
    ],
)
def test_unusable_mesh_file_is_an_error(folder: Path, path: str, message: str) -> None:
    outside = folder.parent / f"{folder.name}_outside.obj"
    write_obj(outside, BRACKET)
    (folder / "parts" / "link.obj").symlink_to(outside)
    (folder / "parts" / "text.stl").write_text("a bracket", encoding="utf-8")
    write_obj(folder / "parts" / "flat.obj", BRACKET * (1, 1, 0))
    found = bt.check(file_with(MESH | {"file": path} | AT_REST))
    assert any(message in problem.message for problem in found), found


def test_scale_wrong_by_a_factor_of_1000_is_an_error_with_a_hint(folder: Path) -> None:
    """The file is in millimeters."""
    assert folder
    obj = {key: value for key, value in MESH.items() if key != "scale"}
    (problem,) = bt.check(file_with(obj | AT_REST))
    assert "extends over 80 m" in problem.message
    assert problem.hint == "a mesh in millimeters needs scale: 0.001"
    (problem,) = bt.check(file_with(obj | {"scale": 0.5} | AT_REST))
    assert problem.hint == "it needs a smaller scale"
