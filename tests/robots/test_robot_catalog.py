"""The catalog: every description is complete; errors in one are reported with their position."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from bt_dualarm.core.errors import CatalogError
from bt_dualarm.core.share import share_dir
from bt_dualarm.robots.robot_description import load_robot, robot_names
from bt_dualarm.robots.urdf_arm import robot_data_dir
from tests.sim.worlds import PAGES, ROBOTS, world_with

HERE = Path(__file__).parent.parent


def test_required_arms_are_in_the_catalog() -> None:
    assert {"ur5", "panda", "ur10", "ur3", "xarm7"} <= set(robot_names())
    assert len(PAGES) >= 2


@pytest.mark.parametrize("name", ROBOTS)
def test_a_description_is_complete(name: str) -> None:
    """All limits are finite and positive, every posture lies within them."""
    robot = load_robot(name, HERE)
    limits = robot.limits
    assert len(robot.joints) == robot.dof == len(limits.lower)
    assert (limits.lower < limits.upper).all()
    for rate in (limits.velocity, limits.acceleration, limits.jerk, limits.effort):
        assert rate.shape == (robot.dof,)
        assert (rate > 0).all()
        assert np.isfinite(rate).all()
    for posture in robot.postures.values():
        assert (posture >= limits.lower).all()
        assert (posture <= limits.upper).all()


@pytest.mark.parametrize("name", ROBOTS)
def test_every_limit_has_its_source_beside_it(name: str) -> None:
    path = HERE / name if name in PAGES else share_dir("assets") / "robots" / f"{name}.yaml"
    limits = yaml.safe_load(path.read_text())["limits"]
    assert {"acceleration", "jerk"} <= limits.keys()
    assert all(len(limit["source"].split()) >= 4 for limit in limits.values())


@pytest.mark.parametrize("name", ROBOTS)
def test_full_acceleration_is_within_the_efforts_at_home(name: str) -> None:
    """No controller could use accelerations for which the motors are too weak."""
    import mujoco

    world = world_with(name)
    arm = world.arms["arm1"]
    mass = np.empty((world.model.nv, world.model.nv))
    mujoco.mj_fullM(world.model, world.data, mass)
    mass = mass[np.ix_(arm.dof_ids, arm.dof_ids)]
    gravity = world.data.qfrc_bias[arm.dof_ids]
    torque = np.abs(np.diag(mass) * arm.robot.limits.acceleration) + np.abs(gravity)
    assert (torque <= arm.robot.limits.effort).all()


@pytest.mark.parametrize("name", ROBOTS)
def test_home_is_free_of_contacts(name: str) -> None:
    """None with itself, its pedestal, or the floor that it stands on."""
    for height in (0.0, 0.4):
        world = world_with(name, xyz=(0.0, 0.0, height))
        assert len(world.data.contact) == 0


@pytest.mark.parametrize("name", ROBOTS)
def test_the_tool_points_away_from_the_arm(name: str) -> None:
    """The tool's z axis points outward: half a meter along it, no link is near."""
    world = world_with(name)
    arm = world.arms["arm1"]
    ahead = arm.tool_pose.apply(np.array([0.0, 0.0, 0.5]))
    bodies = np.unique(world.model.geom_bodyid[list(arm.geom_ids)])
    distances = np.linalg.norm(world.data.xpos[bodies] - ahead, axis=1)
    assert distances.min() > 0.3


PACKAGE = "package://example-robot-data/robots/z1_description"


def description_with_urdf(folder: Path, package: str) -> str:
    """Write a description and a copy of its URDF with meshes of a package; return its file name."""
    description = (HERE / "robots" / "z1.yaml").read_text().replace("z1_description/urdf/", "")
    (folder / "z1.yaml").write_text(description)
    urdf = (robot_data_dir() / "z1_description" / "urdf" / "z1.urdf").read_text()
    assert PACKAGE in urdf
    (folder / "z1.urdf").write_text(urdf.replace(PACKAGE, package))
    return "z1.yaml"


@pytest.mark.parametrize("package", [PACKAGE, "package://z1_description"])
def test_meshes_of_a_package_are_also_found_where_it_is_installed(
    package: str, tmp_path: Path
) -> None:
    robot = load_robot(description_with_urdf(tmp_path, package), tmp_path)
    shapes = [s for link in robot.model.links for s in robot.model.shapes(link, "visual")]
    meshes = [shape.mesh for shape in shapes if shape.mesh is not None]
    assert meshes
    assert all(mesh.is_file() for mesh in meshes)


def test_a_missing_package_is_refused_with_a_remedy(tmp_path: Path) -> None:
    description = description_with_urdf(tmp_path, "package://my_arm")
    remedy = "put the URDF below a folder of that name, or write paths relative to the URDF"
    with pytest.raises(CatalogError, match=rf"no folder 'my_arm' above [\s\S]*{remedy}"):
        load_robot(description, tmp_path)


CONTINUOUS = """\
title: Turntable
urdf: turntable.urdf
base_link: base
tool: {link: plate}
joints: [turn]
limits:
  velocity: {value: 1.0, source: chosen for this test}
  effort: {value: 5.0, source: chosen for this test}
  acceleration: {value: 2.0, source: chosen for this test}
  jerk: {value: 40.0, source: chosen for this test}
postures: {home: [0]}
"""

TURNTABLE = """\
<robot name="turntable"><link name="base"/><link name="plate"><inertial>
<mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.02"/></inertial>
<visual><geometry><sphere radius="0.1"/></geometry></visual></link>
<joint name="turn" type="continuous"><parent link="base"/><child link="plate"/></joint></robot>
"""


@pytest.mark.parametrize("limit", ["", '<limit effort="9" velocity="9"/>'])
def test_a_continuous_joint_is_limited_to_one_turn_either_way(limit: str, tmp_path: Path) -> None:
    """In the text for PlaCo and MuJoCo, too; a description may give limits that the URDF lacks."""
    (tmp_path / "turntable.yaml").write_text(CONTINUOUS, encoding="utf-8")
    urdf = TURNTABLE.replace("</joint>", f"{limit}</joint>")
    (tmp_path / "turntable.urdf").write_text(urdf, encoding="utf-8")
    robot = load_robot("turntable.yaml", tmp_path)
    assert "continuous" not in robot.urdf_text
    assert robot.limits.lower == pytest.approx(-2 * np.pi)
    assert robot.limits.upper == pytest.approx(2 * np.pi)
    assert f'upper="{2 * np.pi!r}"' in robot.urdf_text


def test_speed_scales_the_rates_only() -> None:
    limits = load_robot("ur5").limits
    half = limits.scaled(0.5)
    for rate in ("velocity", "acceleration", "jerk"):
        assert getattr(half, rate) == pytest.approx(0.5 * getattr(limits, rate))
    for bound in ("lower", "upper", "effort"):
        assert (getattr(half, bound) == getattr(limits, bound)).all()


def test_an_unknown_robot_gets_a_suggestion() -> None:
    with pytest.raises(CatalogError, match=r"no robot 'pnada' .*did you mean 'panda'\?"):
        load_robot("pnada")


def test_a_missing_file_is_reported_with_folder_and_suggestion() -> None:
    with pytest.raises(CatalogError, match=r"no robot file .robots/z2\.yaml. below .*z1\.yaml"):
        load_robot("robots/z2.yaml", HERE)


@pytest.mark.parametrize("name", ["../z1.yaml", "robots/../../z1.yaml", "../z2.yaml"])
def test_a_file_outside_the_root_is_refused_with_the_rule(name: str, tmp_path: Path) -> None:
    """No file outside the root is suggested, since it would be refused as well."""
    inside = tmp_path / "inside"
    inside.mkdir()
    (tmp_path / "z1.yaml").write_text((HERE / "robots" / "z1.yaml").read_text())
    with pytest.raises(CatalogError, match=r"below .*; a robot's description must be in"):
        load_robot(name, inside)


WRONG = {
    "a link": (
        "link: gripperStator, xyz: [0.13",
        "link: griperStator, xyz: [0.13",
        "did you mean 'gripperStator'",
    ),
    "a joint": ("joints: [joint1,", "joints: [joint_1,", "did you mean 'joint1'"),
    "the base": ("base_link: link00", "base_link: link_00", "did you mean 'link00'"),
    "a color": ("default: [0.55", "link99: [0.55", "no link 'link99'"),
    "a field": ("title:", "titel:", "did you mean 'title'"),
    "the URDF": ("urdf/z1.urdf", "urdf/z2.urdf", "no file 'z1_description/urdf/z2.urdf'"),
    "a URDF elsewhere": ("z1_description/urdf/z1.urdf", "../../../../etc/passwd", "no file"),
    "home": ("home:", "hom:", "'home' is missing"),
    "a posture's length": ("[0, 85, -60, -25, 0, 0]", "[0, 85]", "has 2 angles, the arm 6 joints"),
    "a posture's angle": ("[0, 85, -60", "[0, -85, -60", "joint2: 0.0° to 170.0°"),
    "a limit": ("value: 8.0", "value: [8.0, 8.0]", "has 2 values, the arm 6 joints"),
    "a limit's sign": ("value: 8.0", "value: -8.0", "greater than 0"),
    "a number": ("value: 8.0", "value: .nan", ""),
    "a source": (
        "source: Not published by Unitree;",
        "sorce: Not published by Unitree;",
        "'source'",
    ),
    "a camera": ("up: [0, 0, 1]", "up: [2, 0, 0]", "different directions"),
    "the syntax": ("joints: [", "joints: [[", ""),
    "a key given twice": ("title: Unitree Z1", "title: a\ntitle: b", "title"),
}


@pytest.mark.parametrize("what", WRONG)
def test_an_error_in_a_description_is_reported_with_its_position(what: str, tmp_path: Path) -> None:
    """One change makes a description invalid; the message has file, line and what was expected."""
    right, wrong, expected = WRONG[what]
    description = (HERE / "robots" / "z1.yaml").read_text()
    assert right in description
    (tmp_path / "z1.yaml").write_text(description.replace(right, wrong, 1))
    with pytest.raises(CatalogError) as caught:
        load_robot("z1.yaml", tmp_path)
    message = str(caught.value)
    assert f"{tmp_path / 'z1.yaml'}:" in message
    assert expected in message


@pytest.mark.parametrize("content", [b"", b"- a list", b"\xff\xfe", b"<robot>", b"a: &x [*x]"])
def test_a_file_that_is_no_description_is_refused(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "broken.yaml").write_bytes(content)
    with pytest.raises(CatalogError, match=r"broken\.yaml"):
        load_robot("broken.yaml", tmp_path)


def test_a_urdf_that_is_no_xml_is_refused(tmp_path: Path) -> None:
    description = (HERE / "robots" / "z1.yaml").read_text().replace("z1_description/urdf/", "")
    (tmp_path / "z1.yaml").write_text(description)
    (tmp_path / "z1.urdf").write_text("<robot>")
    with pytest.raises(CatalogError, match=r"z1\.urdf"):
        load_robot("z1.yaml", tmp_path)


@pytest.mark.parametrize("name", ["loop.yaml", "a\0b.yaml", "x" * 300 + ".yaml", "../up.yaml"])
def test_an_unreachable_robot_file_is_refused(name: str, tmp_path: Path) -> None:
    inside = tmp_path / "inside"
    inside.mkdir()
    (inside / "loop.yaml").symlink_to(inside / "loop.yaml")
    (tmp_path / "up.yaml").write_text("name: up\n", encoding="utf-8")
    with pytest.raises(CatalogError, match="there is no robot file"):
        load_robot(name, inside)


@pytest.mark.parametrize(
    ("name", "expected"),
    [("a\0b.urdf", r"control character U\+0000"), ("a\u200bb.urdf", "cannot be printed")],
)
def test_a_description_with_an_invalid_urdf_path_is_refused(
    name: str, expected: str, tmp_path: Path
) -> None:
    text = (share_dir("assets") / "robots" / "ur5.yaml").read_text(encoding="utf-8")
    entry = yaml.safe_load(text)
    entry["urdf"] = name
    (tmp_path / "arm.yaml").write_text(yaml.safe_dump(entry), encoding="utf-8")
    with pytest.raises(CatalogError, match=expected):
        load_robot("arm.yaml", tmp_path)
