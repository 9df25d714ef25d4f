"""MJCF scenes: read as objects of a tree as MuJoCo would read them; and every refusal."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

import bt_dualarm as bt
from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.robots.mjcf_scene import read_mjcf
from bt_dualarm.sim.object_body import body_of
from bt_dualarm.sim.world import World

SCENE = """<mujoco model="cell">
  <compiler angle="radian"/>
  <option timestep="0.001"/>
  <default>
    <geom rgba="0.6 0.6 0.6 1"/>
    <default class="red">
      <geom rgba="0.8 0.1 0.1 1" friction="0.5"/>
      <joint damping="2"/>
    </default>
  </default>
  <asset><material name="wood" rgba="0.6 0.5 0.4 1"/></asset>
  <worldbody>
    <geom name="floor" type="plane" size="4 4 0.1"/>
    <light pos="0 0 3"/>
    <geom name="bench" type="box" size="0.4 0.3 0.2" pos="0.4 -0.6 0.2" material="wood"/>
    <geom name="rail" type="capsule" fromto="1 0 0.5 1.2 0.3 0.8" size="0.02"/>
    <body name="cabinet" pos="0.35 -0.68 0.5" euler="0 0 0.5">
      <geom name="top" type="box" size="0.15 0.12 0.005" pos="0 0 0.085"/>
      <geom type="sphere" size="0.01" pos="0 0 0.3" contype="0" conaffinity="0"/>
      <body pos="0.14 0.12 0" childclass="red" axisangle="0 0 1 0.2">
        <joint name="hinge" pos="0.01 0 0" axis="0 0 1" range="-1.5 0.1" frictionloss="0.3"/>
        <geom name="panel" type="box" size="0.14 0.006 0.07" pos="-0.14 0 0" mass="0.5"/>
        <body pos="-0.25 0.03 0">
          <geom name="knob" type="cylinder" size="0.01 0.02" zaxis="0 1 0" mass="0.1"/>
        </body>
      </body>
    </body>
    <body name="can" pos="0.1 -0.4 0.44" quat="0.7071068 0.7071068 0 0">
      <freejoint/>
      <geom type="ellipsoid" size="0.02 0.03 0.04" mass="0.1"/>
      <inertial pos="0 0 0" mass="0.25" diaginertia="1e-4 1e-4 1e-4"/>
    </body>
    <camera name="overhead" pos="0.4 -0.5 1.5" xyaxes="1 0 0 0 1 0"/>
  </worldbody>
</mujoco>
"""

TREE = """bt_dualarm: 1
name: cell
world: {scene: scenes/cell.xml}
arms:
  arm1:
    robot: ur5
    base: {xyz: [0, 1.5, 0.4]}
    camera: {mount: overhead, resolution: [64, 48]}
    tree: {joint_at: {object: cabinet, joint: hinge, below: 1}}
"""


@pytest.fixture
def cell(tmp_path: Path) -> Path:
    (tmp_path / "scenes").mkdir()
    (tmp_path / "scenes" / "cell.xml").write_text(SCENE, encoding="utf-8")
    path = tmp_path / "cell.yaml"
    path.write_text(TREE, encoding="utf-8")
    return path


def test_bodies_are_where_mujoco_would_put_them(cell: Path) -> None:
    """Each part at the pose and of the size of its geom, in MuJoCo's own reading of the file."""
    world = World(load_tree_file(cell))
    theirs = mujoco.MjModel.from_xml_string(SCENE)
    data = mujoco.MjData(theirs)
    mujoco.mj_kinematics(theirs, data)
    compared = set()
    for name, obj in world.objects.items():
        parts = body_of(obj).parts
        for geom, part in zip(world.object_geoms(name), parts, strict=True):
            known = part.name or ("can" if name == "can" else name)
            other = theirs.geom(known).id if known != "can" else theirs.body("can").geomadr[0]
            assert np.allclose(world.data.geom_xpos[geom], data.geom_xpos[other], atol=1e-6)
            matrix = world.data.geom_xmat[geom].reshape(3, 3)
            turn = data.geom_xmat[other].reshape(3, 3).T @ matrix
            if theirs.geom_type[other] == mujoco.mjtGeom.mjGEOM_BOX:
                assert np.trace(turn) == pytest.approx(3.0, abs=1e-6)
            assert np.allclose(world.model.geom_size[geom], theirs.geom_size[other], atol=1e-6)
            compared.add(known)
    assert compared == {"bench", "rail", "top", "panel", "knob", "can"}
    ours, other = world.model.joint("cabinet.hinge"), theirs.joint("hinge")
    assert np.allclose(ours.range, other.range)
    assert ours.frictionloss == pytest.approx(other.frictionloss)
    assert ours.damping[0] == pytest.approx(2.0)
    axis = world.data.xaxis[ours.id]
    assert np.allclose(axis, data.xaxis[other.id], atol=1e-6)
    assert world.objects["can"].mass == 0.25
    assert world.objects["cabinet.hinge"].mass == pytest.approx(0.6)


def test_ignored_elements_are_warnings_and_a_camera_is_a_mount(cell: Path) -> None:
    (problem,) = bt.check(cell)
    assert problem.severity == "warning"
    assert "<option> is ignored" in problem.message
    assert problem.place.line == 3
    world = World(load_tree_file(cell))
    camera = world.arms["arm1"].camera_id
    looks = -world.data.cam_xmat[camera].reshape(3, 3)[:, 2]
    assert np.allclose(looks, (0, 0, -1), atol=1e-6)


REFUSED = [
    ("<light", '<include file="/etc/passwd"/><light', "<include> in <worldbody>", 14),
    ("<asset>", '<extension><plugin plugin="x"/></extension><asset>', "<extension>", 11),
    ('<geom name="rail"', '<geom class="blue" name="rail"', "there is no class 'blue'", 16),
    ('material="wood"', 'material="wod"', "there is no material 'wod'", 15),
    ('size="0.4 0.3 0.2"', 'size="0.4 0.3"', "needs a size of 3", 15),
    ('size="0.4 0.3 0.2"', 'size="0.4 0,3 0.2"', "expected 3 numbers", 15),
    ('type="ellipsoid"', 'type="hfield"', "cannot be a 'hfield'", 30),
    ('name="bench"', 'name="a bench"', "cannot be the name of an object", 15),
    ('name="rail"', 'name="bench"', "there are two objects 'bench'", 16),
    (' range="-1.5 0.1"', "", "needs a range", 21),
    ('range="-1.5 0.1"', 'range="0.1 -1.5"', "give the smaller one first", 17),
    ("<freejoint/>", '<joint type="ball"/>', "a ball joint is not possible", 29),
    ('euler="0 0 0.5"', 'euler="0 0 0.5" quat="1 0 0 0"', "the orientation twice", 17),
    ('euler="0 0 0.5"', 'quat="0 0 0 0"', "length 0", 17),
    ("</worldbody>", "<worldbody/>", "mismatched tag", 0),
    ("<mujoco", "<!DOCTYPE x><mujoco", "document type", 1),
    ("<freejoint/>", '<freejoint/><geom type="mesh" mesh="m"/>', "there is no mesh 'm'", 29),
]


@pytest.mark.parametrize(("old", "new", "message", "line"), REFUSED)
def test_an_invalid_scene_is_refused(
    cell: Path, old: str, new: str, message: str, line: int
) -> None:
    scene = cell.parent / "scenes" / "cell.xml"
    scene.write_text(SCENE.replace(old, new, 1), encoding="utf-8")
    problems = [one for one in bt.check(cell) if message in one.message]
    assert problems, bt.check(cell)
    assert all(Path(one.place.file) == scene for one in problems)
    assert not line or line in {one.place.line for one in problems}


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("scenes/nothing.xml", "no such file"),
        ("../cell.xml", "is outside the folder"),
        ("/etc/cell.xml", "is outside the folder"),
        ("scenes/big.xml", "is larger than"),
    ],
)
def test_unsafe_scene_files_are_refused(cell: Path, path: str, message: str) -> None:
    (cell.parent / "scenes" / "big.xml").write_text(SCENE + " " * 300_000, encoding="utf-8")
    cell.write_text(TREE.replace("scenes/cell.xml", path), encoding="utf-8")
    assert any(message in problem.message for problem in bt.check(cell)), bt.check(cell)


def test_a_mesh_is_a_separate_object(cell: Path) -> None:
    """Its file is below the folder of the tree file, and is read by the checks of meshes."""
    mesh = Path(__file__).parents[1] / "runtime" / "bracket.obj"
    (cell.parent / "scenes" / "parts").mkdir()
    (cell.parent / "scenes" / "parts" / "bracket.obj").write_bytes(mesh.read_bytes())
    scene = cell.parent / "scenes" / "cell.xml"
    text = SCENE.replace('angle="radian"', 'angle="radian" meshdir="parts"')
    text = text.replace("<asset>", '<asset><mesh file="bracket.obj" scale="0.01 0.01 0.01"/>')
    body = '<body name="part" pos="2 0 1"><geom type="mesh" mesh="bracket"/></body>'
    scene.write_text(text.replace("<camera", f"{body}<camera"), encoding="utf-8")
    assert not [one for one in bt.check(cell) if one.severity == "error"]
    file = load_tree_file(cell)
    assert (file.objects["part"].shape, file.objects["part"].scale) == ("mesh", 0.01)


def test_mutants_are_scenes_or_have_problems() -> None:
    """Words of the file are exchanged, doubled, cut and replaced: no exception is raised."""
    rng = np.random.default_rng(5)
    words = SCENE.split(" ")
    hostile = ('"nan"', '"1e999"', '""', '"-1"', "<", '"a/b"', '"' + "9" * 400 + '"', "&x;", "\x00")
    outcomes = set()
    for _ in range(400):
        mutant = list(words)
        for _ in range(int(rng.integers(1, 4))):
            index = int(rng.integers(len(mutant)))
            other = mutant[int(rng.integers(len(mutant)))]
            name, _, _ = mutant[index].partition("=")
            mutant[index] = [
                other,
                f"{mutant[index]} {other}",
                "",
                f"{name}={hostile[int(rng.integers(len(hostile)))]}",
            ][int(rng.integers(4))]
        scene, problems = read_mjcf(" ".join(mutant), "mutant.xml")
        errors = [one for one in problems if one.severity == "error"]
        assert (scene is None or scene.content is None) == bool(errors)
        assert all(one.message for one in problems)
        outcomes.add(bool(errors))
    assert outcomes == {True, False}
