"""URDF validation: errors are reported with their line before any library reads the file."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from bt_dualarm.core.pose import Pose
from bt_dualarm.kinematics.solver import Chain
from bt_dualarm.robots.mjspec import robot_spec
from bt_dualarm.robots.robot import Robot
from bt_dualarm.robots.robot_description import load_robot
from bt_dualarm.robots.urdf_xml import MAX_DEPTH, DescriptionError
from tests.robots.small_arm import DESCRIPTION, URDF, line_of, write_robot


def loaded(folder: Path, urdf: str = URDF, description: str = DESCRIPTION) -> Robot:
    return load_robot(write_robot(folder, urdf, description), folder)


def compiled(robot: Robot) -> mujoco.MjModel:
    return robot_spec(robot, visuals=True).compile()


def test_the_small_arm_is_valid(tmp_path: Path) -> None:
    robot = loaded(tmp_path)
    assert compiled(robot).nv == 2
    tool = Chain(robot, Pose.identity()).forward(0.0 * robot.postures["home"])
    assert tool.position == pytest.approx([0.0, 0.0, 0.7])


MASS = '<mass value="1.0"/>'
ELBOW = '<joint name="elbow" type="revolute">'
SHIFT = '<origin xyz="0 0 0.3" rpy="0 0 0"/>'
STOPS = '<limit lower="-2" upper="2" velocity="2" effort="20"/>'
AXIS = '<axis xyz="0 1 0"/>'
SPHERE = '<sphere radius="0.03"/>'
FLANGE = '<link name="flange"/>'

WRONG = {
    "no mass": (MASS, "", "<inertial>", "lacks a <mass>"),
    "a mass of nothing": (MASS, '<mass value="0"/>', "<mass", "has no mass"),
    "a negative mass": (MASS, '<mass value="-1"/>', "-1", "from 0 to 10000 kg, not -1"),
    "a mass as text": (MASS, '<mass value="heavy"/>', "heavy", "expected a number, not 'heavy'"),
    "a comma": (MASS, '<mass value="0,5"/>', "0,5", "write 0.5: use a decimal point"),
    "an axis of two": (AXIS, '<axis xyz="0 1"/>', "0 1", "<axis> xyz: expected 3 numbers, not 2"),
    "no axis": (AXIS, '<axis xyz="0 0 0"/>', "0 0 0", "has no direction"),
    "limits as text": (STOPS, '<limit lower="low" upper="2"/>', "low", "not 'low'"),
    "limits upside down": (STOPS, '<limit lower="1" upper="-1"/>', "<limit", "at least 0.05"),
    "no limits": (STOPS, "", ELBOW, "joint 'elbow' lacks a <limit>"),
    "limits in degrees": (
        STOPS, STOPS.replace("2", "115"), "<limit", "in rad: -2.007 to 2.007, if degrees are meant"
    ),
    "a velocity in degrees": (
        STOPS, STOPS.replace('velocity="2"', 'velocity="115"'), "acceleration",
        "in rad/s: 2.007, if 115 degrees/s are meant",
    ),
    "an origin in millimeters": (
        SHIFT, '<origin xyz="0 0 300"/>', "0 0 300", "in m: 0.3, if 300 mm are meant"
    ),
    "an origin in degrees": (
        SHIFT, '<origin rpy="0 0 90"/>', "0 0 90", "in rad: 1.571, if 90 degrees are meant"
    ),
    "a shape in millimeters": (SPHERE, '<sphere radius="30"/>', "30", "if 30 mm are meant"),
    "limits of NaN": (STOPS, '<limit lower="nan" upper="1"/>', "nan", "not nan"),
    "an infinite velocity": (
        STOPS, '<limit lower="-1" upper="1" velocity="inf"/>', "inf", "<limit> velocity: must be"
    ),
    "an origin of NaN": (SHIFT, '<origin xyz="0 nan 0"/>', "0 nan 0", "must be from -10"),
    "an origin of four": (SHIFT, '<origin xyz="0 0 0 0"/>', "0 0 0 0", "not 4"),
    "a circle": ('<parent link="base"/>', '<parent link="lower"/>', "<joint", "closes a cycle"),
    "a joint of its own": (
        '<parent link="base"/>', '<parent link="upper"/>', "<joint", "closes a cycle"
    ),
    "two joints of one name": ('name="elbow"', 'name="shoulder"', "shoulder", "two joints"),
    "two links of one name": (FLANGE, '<link name="finger"/>', "finger", "two links 'finger'"),
    "two joints of one child": (
        '<child link="flange"/>', '<child link="finger"/>', "<joint", "of both 'flange_j"
    ),
    "a link that is not there": (
        '<child link="flange"/>', '<child link="flagne"/>', "flagne", "did you mean 'flange'?"
    ),
    "a joint without a child": ('<child link="flange"/>', "", "<joint", "lacks a <child>"),
    "two roots": (FLANGE, FLANGE + '<link name="loose"/>', "<link", "both have no parent"),
    "an unknown type": (ELBOW, ELBOW.replace("revolute", "rotary"), "rotary", "joint type 'rotary"),
    "a nameless link": (FLANGE, "<link/>", "<link/>", "<link> lacks the attribute 'name'"),
    "a name with a slash": (FLANGE, '<link name="a/b"/>', "a/b", "holds a slash"),
    "an unknown shape": (SPHERE, '<cone radius="1"/>', "<cone", "one of box, cylinder, sphere"),
    "a shape of no size": (SPHERE, '<sphere radius="0"/>', '0"', "greater than 0 m"),
    "a shape without": ("<geometry>" + SPHERE + "</geometry>", "", "<collision>", "lacks a <geom"),
    "an inertia of no body": (
        'iyy="0.01" iyz="0" izz="0.005"', 'iyy="-0.01" iyz="0" izz="0.005"', "<inertia", "impossib"
    ),
    "a prismatic joint": (
        ELBOW, ELBOW.replace("revolute", "prismatic"), "elbow", "joint 'elbow' is prismatic"
    ),
    "a mimic": (STOPS, STOPS + '<mimic joint="slide"/>', "elbow", "joint 'elbow' mimics another"),
    "a template": (FLANGE, '<xacro:arm name="a"/>', "<xacro", "xacro ROBOT.xacro > ROBOT.urdf"),
    "a template's value": (MASS, '<mass value="${mass}"/>', "${mass}", "run xacro on it first"),
    "an entity": ("<robot", '<!DOCTYPE r [<!ENTITY a "b">]><robot', "[<!EN", "document type"),
    "an element left open": (FLANGE, '<link name="flange">', "robot>", "mismatched tag"),
    "another top": ("robot", "mujoco", "<mujoco", "its top element is <mujoco>"),
    "no file of the mesh": (SPHERE, '<mesh filename="a.stl"/>', "a.stl", "does not exist"),
    "a mesh without a name": (SPHERE, "<mesh/>", "<mesh", "lacks the attribute 'filename'"),
    "a mesh of the system": (
        SPHERE, '<mesh filename="file:///etc/passwd"/>', "file:///", "meshes must be below"
    ),
    "a mesh above": (SPHERE, '<mesh filename="../../a.stl"/>', "../../", "is outside"),
    "a mesh above its package": (
        SPHERE, '<mesh filename="package://panda_description/../../../a.stl"/>', "pack", "outside"
    ),
    "a mesh of the web": (
        SPHERE, '<mesh filename="https://a.example/a.stl"/>', "https", "not on this machine"
    ),
    "a mesh of no kind": (SPHERE, '<mesh filename="small.urdf"/>', "small.u", ".stl, .obj, .dae"),
}  # fmt: skip


@pytest.mark.parametrize("what", WRONG)
def test_an_error_in_a_urdf_is_reported_with_its_position(what: str, tmp_path: Path) -> None:
    """One change makes a valid URDF invalid; a problem is reported there, with what is allowed."""
    right, wrong, mark, expected = WRONG[what]
    assert right in URDF
    last = right in (MASS, STOPS, AXIS, SHIFT, FLANGE)
    urdf = wrong.join(URDF.rsplit(right, 1)) if last else URDF.replace(right, wrong)
    with pytest.raises(DescriptionError) as caught:
        loaded(tmp_path, urdf)
    assert expected in str(caught.value)
    texts = {str(tmp_path / "small.urdf"): urdf, str(tmp_path / "small.yaml"): DESCRIPTION}
    positions = [problem.place for problem in caught.value.problems]
    assert all(p.text == texts[p.file].split("\n")[p.line - 1] for p in positions)
    assert any(p.text[p.column - 1 :].startswith(mark) for p in positions)


def test_all_problems_are_reported_at_once(tmp_path: Path) -> None:
    """Those of the description and of its URDF, so that all can be mended together."""
    urdf = URDF.replace(MASS, '<mass value="-1"/>').replace(AXIS, '<axis xyz="0 1"/>')
    description = DESCRIPTION.replace("[0, 30]", "[0, 300]").replace("value: 5.0", "value: [5.0]")
    description += "locked: {slied: 0.01}\ncolors: {flagne: [1, 1, 1, 1]}\n"
    with pytest.raises(DescriptionError) as caught:
        loaded(tmp_path, urdf, description)
    positions = {(Path(p.place.file).name, p.place.line) for p in caught.value.problems}
    assert positions == {
        ("small.urdf", line_of(urdf, 'value="-1"')),
        ("small.urdf", line_of(urdf, 'xyz="0 1"')),
        ("small.yaml", line_of(description, "value: [5.0]")),
        ("small.yaml", line_of(description, "[0, 300]")),
        ("small.yaml", line_of(description, "slied")),
        ("small.yaml", line_of(description, "flagne")),
    }


@pytest.mark.parametrize(
    "mount",
    [
        "cameras: {eye: {link: upper, xyz: [0, 0, 0], forward: [0, 0, 1], up: [1, 0, 0]}}",
        "flange: {link: upper}",
    ],
)
def test_mount_that_moves_relative_to_the_tool_is_refused(mount: str, tmp_path: Path) -> None:
    """`look_at` placed the tool so that a camera above the elbow looked elsewhere: SUCCESS."""
    with pytest.raises(DescriptionError) as caught:
        loaded(tmp_path, URDF, DESCRIPTION + mount)
    (problem,) = caught.value.problems
    assert "is on 'upper', which moves relative to the tool" in problem.message
    assert problem.place.line == line_of(DESCRIPTION + mount, mount)
    loaded(tmp_path, URDF, DESCRIPTION + mount.replace("upper", "finger"))


def test_an_entity_bomb_is_refused_before_its_expansion(tmp_path: Path) -> None:
    """A billion laughs: each entity is ten of the one before it."""
    laughs = "".join(f'<!ENTITY l{n} "{f"&l{n - 1};" * 10}">' for n in range(1, 10))
    bomb = f'<!DOCTYPE robot [<!ENTITY l0 "ha">{laughs}]>\n<robot name="&l9;"/>'
    with pytest.raises(DescriptionError, match="document type"):
        loaded(tmp_path, bomb)


@pytest.mark.parametrize(
    "content",
    [b"", b"\xff\xfe<robot/>", b"\0", b"<robot/>", b'<robot name="a">' + b"<a>" * (MAX_DEPTH + 1),
     b'<?xml version="1.0" encoding="klingon"?><robot/>', b"\x1f\x8b\x08", b"<robot", b"&a;"],
)  # fmt: skip
def test_a_file_that_is_no_urdf_is_refused(content: bytes, tmp_path: Path) -> None:
    name = write_robot(tmp_path)
    (tmp_path / "small.urdf").write_bytes(content)
    with pytest.raises(DescriptionError, match=r"small\.urdf"):
        load_robot(name, tmp_path)


NAMES = ("pedestal", "camera", "mount", "tool", "base_0", "upper_visual_0", "world_to_root")
"""Names that a world made from a URDF uses itself; links and joints may have them, too."""


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("old", ["finger", "flange_joint", "elbow", "upper"])
def test_names_in_a_urdf_do_not_collide_with_those_of_the_world(
    old: str, name: str, tmp_path: Path
) -> None:
    robot = loaded(tmp_path, URDF.replace(f'"{old}"', f'"{name}"'), DESCRIPTION.replace(old, name))
    assert compiled(robot).nv == 2
    Chain(robot, Pose.identity()).matrix(robot.postures["home"])


@pytest.mark.parametrize("stops", ['lower="-1e16" upper="1e16"', 'lower="-inf" upper="inf"'])
def test_infinite_limits_become_one_turn(stops: str, tmp_path: Path) -> None:
    urdf = URDF.replace(STOPS, f'<limit {stops} velocity="2" effort="20"/>')
    assert loaded(tmp_path, urdf).limits.upper == pytest.approx([2.0, 2 * np.pi])


def chained(count: int) -> str:
    """The arm with a chain of this many unused links, each fixed to the previous one."""
    heavy = '<inertial><mass value="0.001"/><inertia ixx="1e-6" iyy="1e-6" izz="1e-6"/></inertial>'
    links = "".join(f'<link name="f{n}">{heavy}</link>' for n in range(count))
    joints = "".join(
        f'<joint name="j{n}" type="fixed"><parent link="{f"f{n - 1}" if n else "lower"}"/>'
        f'<child link="f{n}"/><origin xyz="0 0 0.0001"/></joint>'
        for n in range(count)
    )
    return URDF.replace(FLANGE, FLANGE + links).replace("</robot>", joints + "</robot>")


def test_fixed_links_are_merged(tmp_path: Path) -> None:
    """A chain of 3000 of them becomes one link with the same mass and center of mass."""
    count = 3000
    model = compiled(loaded(tmp_path, chained(count)))
    assert model.nbody == 5
    lower = model.body("lower")
    assert lower.mass == pytest.approx(1.0 + 0.001 * count)
    # The frame n is 0.0001 (n + 1) m ahead.
    center = 0.001 * 0.0001 * count * (count + 1) / 2 / float(lower.mass[0])
    assert np.abs(lower.ipos - [0.0, 0.0, center]).max() < 1e-9
