"""Mesh conversions: each happens once, and completely or not at all."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from bt_dualarm.core.errors import CatalogError
from bt_dualarm.core.share import cache_dir
from bt_dualarm.robots import meshes
from bt_dualarm.robots.meshes import as_stl, stl_triangles
from bt_dualarm.robots.robot_description import load_robot
from bt_dualarm.robots.urdf_arm import robot_data_dir

DAE = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
  <asset><created>2020-01-01T00:00:00</created><modified>2020-01-01T00:00:00</modified>
    <unit name="meter" meter="1"/><up_axis>{up}</up_axis></asset>
  <library_geometries><geometry id="g"><mesh>
    <source id="p"><float_array id="a" count="9">0 0 0 1 0 0 0 2 3</float_array>
      <technique_common><accessor source="#a" count="3" stride="3">
        <param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/>
      </accessor></technique_common></source>
    <vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
    <triangles count="1"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2</p></triangles>
  </mesh></geometry></library_geometries>
  <library_visual_scenes><visual_scene id="s"><node id="n"><instance_geometry url="#g"/></node>
  </visual_scene></library_visual_scenes>
  <scene><instance_visual_scene url="#s"/></scene>
</COLLADA>
"""


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache for this test."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "bt_dualarm"


@pytest.fixture
def triangle(tmp_path: Path) -> Path:
    """A COLLADA file whose z axis is up, as Blender writes it."""
    path = tmp_path / "triangle.dae"
    path.write_text(DAE.format(up="Z_UP"))
    return path


def test_the_cache_is_in_xdg_cache_home(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", "/elsewhere")
    assert cache_dir() == Path("/elsewhere/bt_dualarm")
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert cache_dir() == Path.home() / ".cache" / "bt_dualarm"


def test_a_user_without_home_has_no_cache(monkeypatch: pytest.MonkeyPatch) -> None:
    """As in a container whose user has no account; its path is known but cannot be created."""

    def homeless() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(Path, "home", homeless)
    assert not cache_dir().exists()
    with pytest.raises(OSError, match=re.escape(str(cache_dir().parent))):
        cache_dir().mkdir(parents=True)


def test_without_a_cache_a_mesh_is_converted_once_per_process(
    tmp_path: Path, triangle: Path
) -> None:
    """The cache folder cannot be created here."""
    (tmp_path / "cache").write_text("no folder")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
        converted = as_stl(triangle)
        patch.setattr(meshes, "_run_assimp", pytest.fail)
        assert as_stl(triangle) == converted
    assert len(stl_triangles(converted)) == 1
    assert not converted.is_relative_to(tmp_path)


def test_binary_stl_is_used_as_it_is(cache: Path) -> None:
    path = robot_data_dir() / "ur_description/meshes/ur5/collision/base.stl"
    assert as_stl(path) == path
    assert not cache.exists()


@pytest.mark.parametrize("up", ["Z_UP", "Y_UP", "X_UP"])
def test_a_conversion_keeps_the_vertices(up: str, cache: Path, triangle: Path) -> None:
    """A URDF uses vertices as they are, whichever axis the file declares as up."""
    triangle.write_text(DAE.format(up=up))
    corners = stl_triangles(as_stl(triangle))
    assert corners.shape == (1, 3, 3)
    assert sorted(map(tuple, corners[0])) == [(0, 0, 0), (0, 2, 3), (1, 0, 0)]


def test_a_mesh_is_converted_once(
    cache: Path, triangle: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = []
    run = meshes._run_assimp

    def counted(*arguments: str) -> str:
        calls.append(arguments)
        return run(*arguments)

    monkeypatch.setattr(meshes, "_run_assimp", counted)
    first = as_stl(triangle)
    assert as_stl(triangle) == first
    assert first.is_relative_to(cache)
    assert len(calls) == 1
    triangle.write_text(DAE.format(up="Z_UP").replace("2 3<", "2 4<"))
    assert as_stl(triangle) != first  # another content is another mesh


def test_an_interrupted_conversion_leaves_nothing(
    cache: Path, triangle: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The program writes half a file and dies: neither the file nor its folder remains."""

    def dies(*arguments: str) -> None:
        Path(arguments[2]).write_bytes(b"half")
        raise KeyboardInterrupt

    monkeypatch.setattr(meshes, "_run_assimp", dies)
    with pytest.raises(KeyboardInterrupt):
        as_stl(triangle)
    assert list((cache / "meshes").iterdir()) == []


def test_a_mesh_that_assimp_cannot_read_is_refused_with_its_message(
    cache: Path, tmp_path: Path
) -> None:
    path = tmp_path / "broken.dae"
    path.write_text("this is no mesh")
    with pytest.raises(CatalogError, match=r"broken\.dae cannot be read by assimp: .*malformed"):
        as_stl(path)


def test_a_missing_mesh_is_named(tmp_path: Path) -> None:
    with pytest.raises(CatalogError, match=r"gone\.stl"):
        as_stl(tmp_path / "gone.stl")


def test_ascii_stl_is_converted(cache: Path, tmp_path: Path) -> None:
    path = tmp_path / "ascii.stl"
    path.write_text(
        "solid s\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 2 0\n"
        "endloop\nendfacet\nendsolid s\n"
    )
    assert stl_triangles(as_stl(path)).shape == (1, 3, 3)
    assert as_stl(path).is_relative_to(cache)


def test_visual_and_collision_meshes_coincide(cache: Path) -> None:
    """Both describe the same link: their bounding boxes agree within a centimeter."""
    robot = load_robot("ur5")
    for link in ("shoulder_link", "upper_arm_link", "forearm_link", "wrist_3_link"):
        bounds = []
        for tag in ("visual", "collision"):
            (shape,) = robot.model.shapes(link, tag)
            assert shape.mesh is not None
            points = shape.pose.apply(stl_triangles(as_stl(shape.mesh)).reshape(-1, 3))
            bounds.append((points.min(axis=0), points.max(axis=0)))
        assert np.abs(np.array(bounds[0]) - np.array(bounds[1])).max() < 0.01
