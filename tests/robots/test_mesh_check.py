"""Mesh checks: broken meshes are refused at their line before MuJoCo, Qhull or SciPy read them."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest
import scipy

from bt_dualarm.core.pose import Matrix
from bt_dualarm.robots import meshes
from bt_dualarm.robots.mjspec import robot_spec
from bt_dualarm.robots.robot_description import load_robot
from bt_dualarm.robots.urdf_xml import DescriptionError
from tests.robots.small_arm import URDF, line_of, write_robot

CORNERS = np.array(list(itertools.product((-0.05, 0.05), repeat=3)))
BOX: Matrix = CORNERS[scipy.spatial.ConvexHull(CORNERS).simplices]
PLATE: Matrix = BOX * (1.0, 1.0, 0.0)
SPHERE = '<geometry><sphere radius="0.03"/></geometry>'


def stl(triangles: Matrix) -> bytes:
    facets = np.zeros(len(triangles), meshes._STL_FACET)
    facets["corners"] = triangles
    return bytes(80) + np.uint32(len(triangles)).tobytes() + facets.tobytes()


def obj(triangles: Matrix) -> bytes:
    corners = [f"v {x} {y} {z}" for x, y, z in triangles.reshape(-1, 3)]
    faces = [f"f {3 * n + 1} {3 * n + 2} {3 * n + 3}" for n in range(len(triangles))]
    return "\n".join([*corners, *faces]).encode()


def ascii_stl(triangles: Matrix) -> bytes:
    lines = ["solid a"]
    for triangle in triangles:
        lines += ["facet normal 0 0 1", "outer loop"]
        lines += [f"vertex {x} {y} {z}" for x, y, z in triangle]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid a"]).encode()


def meshes_in_a_world(description: str, folder: Path) -> int:
    """Number of meshes in a world with this arm; an arm compiled alone lacks visual meshes."""
    world = mujoco.MjSpec()
    child = robot_spec(load_robot(description, folder), visuals=True)
    world.attach(child, prefix="arm1/", frame=world.worldbody.add_frame())
    return int(world.compile().nmesh)


def arm_with(
    folder: Path, mesh: str, content: bytes, tag: str = "collision", scale: str = ""
) -> str:
    """Write the small arm with this mesh for its sphere; return its description's file name."""
    (folder / mesh).write_bytes(content)
    extra = f' scale="{scale}"' if scale else ""
    geometry = f'<geometry><mesh filename="{mesh}"{extra}/></geometry>'
    urdf = URDF.replace(SPHERE, geometry)
    if tag == "visual":
        urdf = URDF.replace(
            '<link name="lower">', f'<link name="lower"><visual>{geometry}</visual>'
        )
    return write_robot(folder, urdf)


@pytest.mark.parametrize("write", [stl, ascii_stl, obj])
@pytest.mark.parametrize("tag", ["collision", "visual"])
def test_a_box_is_a_mesh_in_every_format(
    write: Callable[[Matrix], bytes], tag: str, tmp_path: Path
) -> None:
    name = f"{write.__name__}_{tag}.{'obj' if write is obj else 'stl'}"
    description = arm_with(tmp_path, name, write(BOX), tag)
    assert meshes_in_a_world(description, tmp_path) == 1


def test_a_plate_can_be_a_visual_but_no_collision_mesh(tmp_path: Path) -> None:
    description = arm_with(tmp_path, "seen_plate.stl", stl(PLATE), "visual")
    assert meshes_in_a_world(description, tmp_path) == 1
    description = arm_with(tmp_path, "touched_plate.stl", stl(PLATE))
    with pytest.raises(DescriptionError, match="is flat: 0 m thick"):
        load_robot(description, tmp_path)


BROKEN: dict[str, tuple[str, bytes, str]] = {
    "empty": ("a.stl", b"", "is empty"),
    "no triangles": ("a.stl", stl(BOX[:0]), "no triangles"),
    "a NaN": ("a.stl", stl(np.where(BOX.max() == BOX, np.nan, BOX)), "NaN or infinite"),
    "infinite": ("a.stl", stl(np.where(BOX.max() == BOX, np.inf, BOX)), "NaN or infinite"),
    "in millimeters": ("a.stl", stl(1e3 * BOX), "is 100 m long; the maximum is 10 m"),
    "far away": ("a.stl", stl(BOX + 1e4), " m from its link"),
    "tiny": ("a.stl", stl(1e-5 * BOX), "is no|has no|is only"),
    "a line": ("a.stl", stl(BOX * (1.0, 0.0, 0.0)), "points or lines"),
    "a point": ("a.stl", stl(BOX * 0.0), "points or lines"),
    "one triangle": ("a.stl", stl(BOX[:1]), "fewer than 4 different corners"),
    "text": ("a.stl", b"this is no mesh at all, not by any means\n" * 5, "mesh a.stl"),
    "cut short": ("a.stl", stl(BOX)[:-7], "mesh a.stl"),
    "COLLADA cut short": ("a.dae", b'<?xml version="1.0"?><COLLADA version="1.4.1">', "mesh a.dae"),
    "no COLLADA": ("a.dae", b"<robot/>", "mesh a.dae"),
    "OBJ without faces": ("a.obj", b"v 0 0 0\nv 1 0 0\n", "mesh a.obj"),
}


@pytest.mark.parametrize("tag", ["collision", "visual"])
@pytest.mark.parametrize("what", BROKEN)
def test_a_broken_mesh_is_refused_at_its_line(what: str, tag: str, tmp_path: Path) -> None:
    name, content, expected = BROKEN[what]
    description = arm_with(tmp_path, name, content, tag)
    with pytest.raises(DescriptionError, match=expected) as caught:
        load_robot(description, tmp_path)
    (problem,) = caught.value.problems
    text = (tmp_path / "small.urdf").read_text(encoding="utf-8")
    assert problem.place.line == line_of(text, f'filename="{name}"')


def test_a_missing_scale_of_millimeters_is_suggested(tmp_path: Path) -> None:
    description = arm_with(tmp_path, "millimeters.stl", stl(1e3 * BOX * 20))
    with pytest.raises(DescriptionError, match=r'needs scale="0\.001 0\.001 0\.001"'):
        load_robot(description, tmp_path)
    description = arm_with(tmp_path, "millimeters.stl", stl(1e3 * BOX), scale="0.001 -0.001 0.001")
    assert meshes_in_a_world(description, tmp_path) == 1


def test_a_conversion_that_takes_too_long_is_aborted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(meshes, "ASSIMP_SECONDS", 0.0)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    description = arm_with(tmp_path, "slow.obj", obj(BOX))
    with pytest.raises(DescriptionError, match=r"mesh slow\.obj takes assimp longer than 0 s"):
        load_robot(description, tmp_path)


def test_extents_are_cached_until_the_file_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A mesh is read once for all processes, and again if it changes or its cache is damaged."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    measured: list[Path] = []

    def measure(mesh: Path, scale: tuple[float, ...]) -> meshes.Extents:
        measured.append(mesh)
        return original(mesh, scale)

    original = meshes._measured
    monkeypatch.setattr(meshes, "_measured", measure)
    mesh = tmp_path / "box.stl"
    one = (1.0, 1.0, 1.0)
    many = np.concatenate([BOX] * 20)

    def extents() -> meshes.Extents:
        meshes._extents.cache_clear()  # as a new process would
        return meshes.extents(mesh, one)

    mesh.write_bytes(stl(many))
    assert extents() == extents() == pytest.approx((0.1, 0.1))
    assert len(measured) == 1
    mesh.write_bytes(stl(np.concatenate((many, 2.0 * BOX))))
    assert extents() == extents() == pytest.approx((0.2, 0.2))
    assert len(measured) == 2
    for cached in (tmp_path / "cache").rglob("*.json"):
        cached.write_text("[1")
    assert extents() == pytest.approx((0.2, 0.2))
    assert len(measured) == 3
