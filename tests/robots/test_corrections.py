"""Corrections of a URDF: they reach PlaCo, MuJoCo and cameras, and wrong ones are named."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt
import pytest
import yaml

from bt_dualarm.core.errors import CatalogError
from bt_dualarm.core.pose import Pose
from bt_dualarm.core.share import share_dir
from bt_dualarm.kinematics.solver import Chain
from bt_dualarm.robots.mjspec import COLLISION_GROUP, TOOL_SITE, robot_spec
from bt_dualarm.robots.robot import Robot
from bt_dualarm.robots.robot_description import load_robot

Matrix = npt.NDArray[np.float64]

# Universal Robots, "DH parameters for calculations of kinematics and dynamics": a and d of each
# joint in m, mass of each link in kg and center of mass in its DH frame in m.
E_SERIES: dict[str, tuple[list[float], list[float], list[float], list[list[float]]]] = {
    "ur3e": (
        [0, -0.24355, -0.2132, 0, 0, 0],
        [0.15185, 0, 0, 0.13105, 0.08535, 0.0921],
        [1.98, 3.4445, 1.437, 0.871, 0.805, 0.261],
        [[0, -0.02, 0], [0.13, 0, 0.1157], [0.05, 0, 0.0238], [0, 0, 0.01], [0, 0, 0.01],
         [0, 0, -0.02]],
    ),
    "ur5e": (
        [0, -0.425, -0.3922, 0, 0, 0],
        [0.1625, 0, 0, 0.1333, 0.0997, 0.0996],
        [3.761, 8.058, 2.846, 1.37, 1.3, 0.365],
        [[0, -0.02561, 0.00193], [0.2125, 0, 0.11336], [0.15, 0, 0.0265], [0, -0.0018, 0.01634],
         [0, 0.0018, 0.01634], [0, 0, -0.001159]],
    ),
    "ur10e": (
        [0, -0.6127, -0.57155, 0, 0, 0],
        [0.1807, 0, 0, 0.17415, 0.11985, 0.11655],
        [7.369, 13.051, 3.989, 2.1, 1.98, 0.615],
        [[0.021, 0, 0.027], [0.38, 0, 0.158], [0.24, 0, 0.068], [0, 0.007, 0.018],
         [0, 0.007, 0.018], [0, 0, -0.026]],
    ),
}  # fmt: skip
TWISTS = np.array([np.pi / 2, 0, 0, np.pi / 2, -np.pi / 2, 0])


def dh_frames(name: str, q: Matrix) -> list[Matrix]:
    """DH frame of each link in the base link, whose x and y axes are the reverse of UR's base."""
    a, d, _, _ = E_SERIES[name]
    frame = np.diag([-1.0, -1.0, 1.0, 1.0])
    frames = []
    for length, offset, twist, angle in zip(a, d, TWISTS, q, strict=True):
        c, s, ca, sa = np.cos(angle), np.sin(angle), np.cos(twist), np.sin(twist)
        frame = frame @ np.array(
            [
                [c, -s * ca, s * sa, length * c],
                [s, c * ca, -c * sa, length * s],
                [0, sa, ca, offset],
                [0, 0, 0, 1],
            ]
        )
        frames.append(frame)
    return frames


def in_mujoco(robot: Robot, q: Matrix) -> tuple[Any, Any]:
    model = robot_spec(robot, visuals=False).compile()
    data = mujoco.MjData(model)
    for joint, angle in zip(robot.joints, q, strict=True):
        data.qpos[model.joint(joint).qposadr[0]] = angle
    mujoco.mj_forward(model, data)
    return model, data


@pytest.mark.parametrize("name", E_SERIES)
def test_e_series_kinematics_and_masses_equal_published_values(name: str) -> None:
    """To 1 nm for PlaCo and MuJoCo; centers of mass are published to 1 µm."""
    robot = load_robot(name)
    q = np.random.default_rng(3).uniform(-3, 3, 6)
    frames = dh_frames(name, q)
    tool = frames[-1] @ np.array([0, 0, 0.005, 1])  # the tool frame is at the rim of its cup
    assert Chain(robot, Pose.identity()).forward(q).position == pytest.approx(tool[:3], abs=1e-9)
    model, data = in_mujoco(robot, q)
    assert data.site(TOOL_SITE).xpos == pytest.approx(tool[:3], abs=1e-9)
    _, _, masses, centers = E_SERIES[name]
    placed = [frame @ [*center, 1] for frame, center in zip(frames, centers, strict=True)]
    expected = np.average([point[:3] for point in placed], axis=0, weights=masses)
    moving = model.joint(robot.joints[0]).bodyid[0]
    assert model.body_subtreemass[moving] == pytest.approx(sum(masses))
    assert data.subtree_com[moving] == pytest.approx(expected, abs=2e-6)


@pytest.mark.parametrize("name", ["ur5e", "ur10e"])
def test_the_added_shapes_are_for_contacts_and_cameras(name: str) -> None:
    """A ray at the height of the gap between the meshes of base and shoulder hits the base."""
    robot = load_robot(name)
    model, data = in_mujoco(robot, robot.postures["home"])
    hit = np.zeros(1, np.int32)
    groups = np.array([group == COLLISION_GROUP for group in range(mujoco.mjNGROUP)], np.uint8)
    start = np.array([-1.0, 0.0, 0.07])
    distance = mujoco.mj_ray(model, data, start, np.array([1.0, 0, 0]), groups, 1, -1, hit, None)
    assert distance == pytest.approx(1.0 - model.geom_size[hit[0], 0])
    assert model.body(model.geom_bodyid[hit[0]]).name == "base_link"
    assert model.geom_contype[hit[0]] > 0


def test_the_fr3_has_the_kinematics_of_the_panda_and_its_own_limits() -> None:
    fr3, panda = load_robot("fr3"), load_robot("panda")
    q = fr3.postures["home"] + np.linspace(-0.3, 0.3, 7)
    poses = [Chain(robot, Pose.identity()).forward(q) for robot in (fr3, panda)]
    assert poses[0].distance(poses[1]) < 1e-12
    assert fr3.limits.upper[5] > panda.limits.upper[5]
    assert (fr3.limits.velocity[[4, 6]] > panda.limits.velocity[[4, 6]]).all()
    assert 'upper="4.2094"' in fr3.urdf_text


DESCRIPTION = """\
title: Two joints
urdf: two.urdf
base_link: base
tool: {link: tip}
joints: [first, second]
locked: {slide: 0.1}
limits:
  velocity: {value: 1.0, source: chosen for this test}
  effort: {value: 5.0, source: chosen for this test}
  acceleration: {value: 2.0, source: chosen for this test}
  jerk: {value: 40.0, source: chosen for this test}
postures: {home: [0, 0]}
"""

URDF = """\
<robot name="two">
<link name="floor"/>
<joint name="below" type="fixed"><parent link="floor"/><child link="base"/></joint>
<link name="base"/>
<joint name="first" type="revolute"><origin xyz="0 0 0.1" rpy="0 0.2 0"/>
<parent link="base"/><child link="one"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" velocity="2" effort="10"/></joint>
<link name="one"><inertial><origin xyz="0.1 0 0"/><mass value="2"/>
<inertia ixx="0.01" iyy="0.02" izz="0.02"/></inertial>
<visual><geometry><sphere radius="0.03"/></geometry></visual></link>
<joint name="second" type="continuous"><origin xyz="0.2 0 0"/>
<parent link="one"/><child link="two"/><axis xyz="0 1 0"/>
<limit velocity="2" effort="10"/></joint>
<link name="two"/>
<joint name="slide" type="prismatic"><origin xyz="0.3 0 0"/>
<parent link="two"/><child link="tip"/><axis xyz="1 0 0"/>
<limit lower="0" upper="0.2" velocity="1" effort="10"/></joint>
<link name="tip"/>
</robot>
"""

OWN_BODY = "two: {mass: 1, inertia: [0.01, 0.01, 0.01, 0, 0, 0]}"
"""Mass and inertia of the link that has none in the URDF."""


def arm(folder: Path, corrections: str, description: str = DESCRIPTION, urdf: str = URDF) -> Robot:
    (folder / "two.urdf").write_text(urdf, encoding="utf-8")
    text = f"{description}corrections:\n  source: chosen for this test\n{corrections}"
    (folder / "two.yaml").write_text(text, encoding="utf-8")
    return load_robot("two.yaml", folder)


def tool_of(robot: Robot, *q: float) -> Pose:
    return Chain(robot, Pose.identity()).forward(np.array(q))


def test_a_correction_changes_only_the_fields_that_it_gives(tmp_path: Path) -> None:
    """Position and rotation of moving, fixed and locked joints; a locked joint keeps its value."""
    links = f"  links: {{{OWN_BODY}}}\n"
    plain = arm(tmp_path, links)
    assert tool_of(plain, 0, 0).position == pytest.approx(
        [0.6 * np.cos(0.2), 0, 0.1 - 0.6 * np.sin(0.2)]
    )
    moved = arm(tmp_path, f"  joints: {{first: {{xyz: [0.01, 0, 0.12]}}}}\n{links}")
    shift = tool_of(moved, 0, 0).position - tool_of(plain, 0, 0).position
    assert shift == pytest.approx([0.01, 0, 0.02])
    turned = arm(tmp_path, f"  joints: {{first: {{rpy: [0, 0, 90]}}}}\n{links}")
    assert tool_of(turned, 0, 0).position == pytest.approx([0, 0.6, 0.1])
    locked = arm(tmp_path, f"  joints: {{slide: {{xyz: [0.4, 0, 0]}}}}\n{links}")
    assert np.linalg.norm(tool_of(locked, 0, 0).position - [0, 0, 0.1]) == pytest.approx(0.7)


def test_inertias_replace_those_of_the_urdf_or_complete_it(tmp_path: Path) -> None:
    """A mass alone scales the inertia; a link without mass gets one."""
    robot = arm(tmp_path, f"  links: {{one: {{mass: 3, center: [0, 0, 0.05]}}, {OWN_BODY}}}\n")
    one, two = (robot.model.parts[link].inertial for link in ("one", "two"))
    assert one is not None
    assert (one.mass, one.origin.xyz) == (3.0, (0.0, 0.0, 0.05))
    assert one.moments == pytest.approx((0.015, 0.03, 0.03, 0, 0, 0))
    assert two is not None
    assert (two.mass, two.moments[:3]) == (1.0, (0.01, 0.01, 0.01))


def test_an_added_shape_does_not_replace_shapes_for_images(tmp_path: Path) -> None:
    """This URDF has only visual shapes, which are used for contacts, too."""
    box = "shapes: [{shape: box, size: [0.1, 0.02, 0.02]}]"
    robot = arm(tmp_path, f"  links: {{{OWN_BODY[:-1]}, {box}}}}}\n")
    assert [shape.kind for shape in robot.model.shapes("one", "collision")] == ["sphere"]
    assert [shape.kind for shape in robot.model.shapes("two", "collision")] == ["box"]
    assert [shape.size for shape in robot.model.shapes("two", "visual")] == [(0.1, 0.02, 0.02)]


def test_position_limits_reach_planner_and_solver(tmp_path: Path) -> None:
    """Also for a continuous joint, which is limited by them; a wider range requires `widens`."""
    position = "  position: {lower: [-1.5, -2], upper: [0.5, 2], source: of this test%s}\n"
    description = DESCRIPTION.replace("postures", position % ", widens: true" + "postures")
    robot = arm(tmp_path, f"  links: {{{OWN_BODY}}}\n", description)
    assert robot.limits.lower == pytest.approx([-1.5, -2])
    assert robot.limits.upper == pytest.approx([0.5, 2])
    assert 'lower="-1.5"' in robot.urdf_text
    assert 'upper="0.5"' in robot.urdf_text
    description = DESCRIPTION.replace("postures", position % "" + "postures")
    with pytest.raises(CatalogError, match=r"two\.yaml:12:22: error: joint 'first' turns from -1"):
        arm(tmp_path, f"  links: {{{OWN_BODY}}}\n", description)


@pytest.mark.parametrize("what", ["velocity", "effort"])
def test_a_limit_above_that_of_the_urdf_must_be_explicit(what: str, tmp_path: Path) -> None:
    """Such a limit was once silently lowered to that of the URDF."""
    old, new = {"velocity": ("1.0", "2.5"), "effort": ("5.0", "12")}[what]
    description = DESCRIPTION.replace(f"{what}: {{value: {old}", f"{what}: {{value: {new}")
    with pytest.raises(CatalogError, match=rf"{what} of joint 'first' is .* in the URDF"):
        arm(tmp_path, f"  links: {{{OWN_BODY}}}\n", description)
    description = description.replace(f"value: {new}", f"value: {new}, widens: true")
    robot = arm(tmp_path, f"  links: {{{OWN_BODY}}}\n", description)
    assert getattr(robot.limits, what) == pytest.approx(float(new))


WRONG = {
    "a joint": ("joints: {frist: {xyz: [0, 0, 0]}}", "two.urdf has no joint 'frist'", "'first'"),
    "a link": ("links: {onee: {mass: 1}}", "two.urdf has no link 'onee'", "'one'"),
    "a joint above": ("joints: {below: {xyz: [0, 0, 0]}}", "'below' is not below base_link", ""),
    "a link above": ("links: {floor: {mass: 1}}", "'floor' is not below base_link, 'base'", ""),
    "a position": ("joints: {first: {xyz: [0, 0]}}", "xyz: expected 3 items, not 2", ""),
    "no position": ("joints: {first: {xyz: [0, 0, .nan]}}", "", ""),
    "a field": ("joints: {first: {xzy: [0, 0, 0]}}", "unknown field 'xzy'", "'xyz'"),
    "a mass": ("links: {one: {mass: 0}}", "mass: must be greater than 0", ""),
    "an inertia": ("links: {one: {inertia: [1, 1, 3, 0, 0, 0]}}", "no body has the principal", ""),
    "no inertia": ("links: {two: {mass: 1}}", "gives link 'two' no mass", "ixx"),
    "a shape": ("links: {one: {shapes: [{shape: box, size: [1]}]}}", "a box has 3 sizes", ""),
    "a mesh": ("links: {one: {shapes: [{shape: mesh, size: [1]}]}}", "shape: expected one of", ""),
}  # fmt: skip


@pytest.mark.parametrize("what", WRONG)
def test_a_wrong_correction_is_reported_at_its_line(what: str, tmp_path: Path) -> None:
    wrong, expected, hint = WRONG[what]
    with pytest.raises(CatalogError) as caught:
        arm(tmp_path, f"  {wrong}\n")
    message = str(caught.value)
    line = len(DESCRIPTION.splitlines()) + 3
    assert f"{tmp_path / 'two.yaml'}:{line}:" in message
    assert expected in message
    assert hint in message


@pytest.mark.parametrize(
    ("ends", "expected"),
    [
        ("lower: [-1], upper: [1, 1]", "has 1 value, the arm 2 joints"),
        ("lower: [0.5, -1], upper: [0.5, 1]", "joint 'first' turns from 0.5 to 0.5 rad"),
    ],
)
def test_wrong_position_limits_are_reported_at_their_line(
    ends: str, expected: str, tmp_path: Path
) -> None:
    description = DESCRIPTION.replace(
        "postures", f"  position: {{{ends}, source: of this test}}\npostures"
    )
    with pytest.raises(CatalogError) as caught:
        arm(tmp_path, f"  links: {{{OWN_BODY}}}\n", description)
    assert f"{tmp_path / 'two.yaml'}:12:" in str(caught.value)
    assert expected in str(caught.value)


def test_corrections_state_their_source() -> None:
    for path in sorted((share_dir("assets") / "robots").glob("*.yaml")):
        corrections = yaml.safe_load(path.read_text(encoding="utf-8")).get("corrections")
        assert corrections is None or len(corrections["source"].split()) >= 4
