"""The command ``bt-robot``: from a URDF to a robot description that a tree file can use."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from bt_dualarm import cli
from bt_dualarm.cli.bt_robot import main
from bt_dualarm.robots.gripper import load_gripper
from bt_dualarm.robots.robot_description import load_robot, with_gripper
from bt_dualarm.robots.urdf import read_urdf
from bt_dualarm.robots.urdf_arm import ArmChain, arm_chains, robot_data_dir
from bt_dualarm.robots.urdf_xml import DescriptionError
from bt_dualarm.runtime.file_check import check
from bt_dualarm.runtime.options import RunOptions
from bt_dualarm.runtime.run import Run
from bt_dualarm.skill.registry import Registry
from tests.families import some
from tests.robots.small_arm import URDF


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Working directory with the URDF of a small arm."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small.urdf").write_text(URDF, encoding="utf-8")
    return tmp_path


def test_chains_are_listed(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.robot(["small.urdf"]) == 0
    out = capsys.readouterr().out
    assert "--base base --tool flange" in out
    assert "2 joints: shoulder, elbow" in out


def test_robot_description_is_written_and_can_be_loaded(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["small.urdf", "--base", "base", "--tool", "flange"]
    assert cli.robot([*arguments, "--out", "arm.yaml"]) == 0
    robot = load_robot("arm.yaml", folder)
    assert robot.joints == ("shoulder", "elbow")
    capsys.readouterr()
    assert cli.robot(arguments) == 0
    assert capsys.readouterr().out == (folder / "arm.yaml").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("palm", "flange"),
    [
        # Fingers on the link of the tool; on one that is fixed to it; on a link of the arm.
        ("flange", {"link": "lower", "stock": ["flange"]}),
        ("palm", {"link": "flange", "stock": ["palm"]}),
        ("lower", None),
    ],
)
def test_grippers_replace_the_robots_own(
    palm: str, flange: dict[str, Any] | None, folder: Path
) -> None:
    """Mounted beside the fingers of the robot, they could not grasp."""
    fingers = (
        '<link name="palm"/>'
        '<joint name="fix" type="fixed"><parent link="flange"/><child link="palm"/></joint>'
        '<joint name="slide" type="prismatic">\n    <parent link="lower"/>'
    ).replace("lower", palm)
    urdf = URDF.replace(
        '<joint name="slide" type="prismatic">\n    <parent link="lower"/>', fingers
    )
    assert urdf != URDF
    (folder / "small.urdf").write_text(urdf, encoding="utf-8")
    arguments = ["small.urdf", "--base", "base", "--tool", "flange", "--out", "arm.yaml"]
    assert cli.robot(arguments) == 0
    assert yaml.safe_load((folder / "arm.yaml").read_text(encoding="utf-8")).get("flange") == flange
    robot = load_robot("arm.yaml", folder)
    links = with_gripper(robot, load_gripper("panda_hand")).model.links
    assert not {*links} & {*(flange["stock"] if flange else ())}


def test_guessed_limits_are_marked_as_guessed(folder: Path) -> None:
    """For a URDF without velocities and efforts, the description has limits with their source."""
    urdf = URDF.replace('velocity="2" effort="20"', "").replace('velocity="2" effort="40"', "")
    (folder / "small.urdf").write_text(urdf, encoding="utf-8")
    arguments = ["small.urdf", "--base", "base", "--tool", "flange", "--out", "arm.yaml"]
    assert cli.robot(arguments) == 0
    limits = yaml.safe_load((folder / "arm.yaml").read_text(encoding="utf-8"))["limits"]
    assert limits.keys() == {"velocity", "effort", "acceleration", "jerk"}
    assert all(limit["source"].startswith("Guessed by bt-robot") for limit in limits.values())


@pytest.mark.parametrize(
    ("kind", "span", "at"),
    [
        ("prismatic", 'lower="0.1" upper="0.3"', 0.1),
        ("revolute", 'lower="-2" upper="-1"', -57.2958),
    ],
)
def test_a_joint_that_cannot_be_at_zero_is_locked_at_the_limit_next_to_it(
    kind: str, span: str, at: float, folder: Path
) -> None:
    """Such as the lift of a torso; the page says so."""
    urdf = URDF.replace('"slide" type="prismatic"', f'"slide" type="{kind}"')
    urdf = urdf.replace('lower="0" upper="0.04"', span)
    (folder / "small.urdf").write_text(urdf, encoding="utf-8")
    assert cli.robot(["small.urdf", "--base", "base", "--tool", "flange", "--out", "arm.yaml"]) == 0
    assert "# these cannot be at zero" in (folder / "arm.yaml").read_text(encoding="utf-8")
    assert load_robot("arm.yaml", folder).locked["slide"].at == pytest.approx(at, abs=1e-3)


WRONG = {
    "no file": (["none.urdf"], "there is no URDF 'none.urdf'"),
    "no such link": (["small.urdf", "--base", "bas", "--tool", "flange"], "did you mean 'base'?"),
    "no joint between": (["small.urdf", "--base", "lower", "--tool", "flange"], "no revolute"),
    "upside down": (["small.urdf", "--base", "flange", "--tool", "base"], "no revolute joint"),
    "another ending": (
        ["small.urdf", "--base", "base", "--tool", "flange", "--out", "a.txt"], "ends with .yaml"
    ),
    "there already": (
        ["small.urdf", "--base", "base", "--tool", "flange", "--out", "old.yaml"], "already exists"
    ),
    "elsewhere": (
        ["small.urdf", "--base", "base", "--tool", "flange", "--out", "x/arm.yaml"], "is neither"
    ),
}  # fmt: skip


@pytest.mark.parametrize("what", WRONG)
def test_wrong_arguments_are_reported(
    what: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments, expected = WRONG[what]
    (folder / "old.yaml").write_text("old", encoding="utf-8")
    assert cli.robot(arguments) == 2
    assert expected in capsys.readouterr().err
    assert (folder / "old.yaml").read_text(encoding="utf-8") == "old"


def test_broken_urdf_is_reported_with_its_place(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "small.urdf").write_text(URDF.replace('"1.0"', '"-1"'), encoding="utf-8")
    assert cli.robot(["small.urdf", "--base", "base", "--tool", "flange"]) == 2
    assert "small.urdf:19:20: error: <mass> value: must be from 0" in capsys.readouterr().err


REFUSED = (
    "double_pendulum.urdf", "double_pendulum_simple.urdf", "quadruped.urdf",  # turn from 0 to 0
    "human.urdf", "icub.urdf", "icub_reduced.urdf",  # moving links without mass or inertia
    "simple_humanoid.urdf", "simple_humanoid_classical.urdf",  # no shapes
    "anymal_c_simple_description/urdf/anymal.urdf",  # a leg; its base is named like a joint
)  # fmt: skip
"""URDFs whose chains are no usable arms; the message gives the reason."""

NOT_READ = {"iris.urdf", "iris_simple.urdf", "romeo_laas_small.urdf", "ur3.urdf"}
"""Have names with a slash, or no links."""

COLLIDES_WITH_PEDESTAL = (
    "hextilt_flying_arm_5.urdf",
    "allegro_left_hand.urdf",
    "allegro_right_hand.urdf",
)
"""Hang below a drone or have fingers below the palm: no posture is free on a pedestal."""

TREE = """\
bt_dualarm: 1
name: trial
world: {scene: empty}
arms:
  arm1:
    robot: arm.yaml
    base: {xyz: [0, 0, 1.5]}
    tree:
      sequence:
        - move_joints: {to: {%s: "%s deg"}}
        - go_home
        - %s
"""


def chain_of(path: Path) -> ArmChain | None:
    """The chain that is most likely an arm, or None."""
    found = [chain for chain in arm_chains(read_urdf(path)) if chain.rank[0] <= 0]
    return found[0] if found else None


def urdfs() -> list[Path]:
    found = some(sorted(robot_data_dir().glob("*/*/*.urdf")), 14)
    return [path for path in found if path.name not in NOT_READ and chain_of(path)]


@pytest.mark.slow
@pytest.mark.parametrize("urdf", urdfs(), ids=lambda path: path.stem)
def test_every_arm_of_example_robot_data(urdf: Path, tmp_path: Path, registry: Registry) -> None:
    """An arm moves by the written description, or is refused with a reason and its line."""
    chain = chain_of(urdf)
    assert chain is not None
    name = str(urdf.relative_to(robot_data_dir()))
    description = tmp_path / "arm.yaml"
    arguments = [name, "--base", chain.base, "--tool", chain.tool, "--out", str(description)]
    if str(urdf).endswith(REFUSED):
        with pytest.raises(DescriptionError, match=r"\.urdf:\d+:\d+: error"):
            main(arguments)
        return
    assert main(arguments) == 0
    robot = load_robot("arm.yaml", tmp_path)
    home = robot.postures["home"][-1]
    upper = robot.limits.upper[-1]
    lower = robot.limits.lower[-1]
    goal = 57.29577951 * home + (5 if upper - home > home - lower else -5)
    last = "reach_to_pose: {offset: {xyz: [0, 0, 0.02]}}" if robot.dof > 4 else "go_home"
    (tmp_path / "trial.yaml").write_text(TREE % (robot.joints[-1], goal, last), encoding="utf-8")
    checked = check(tmp_path / "trial.yaml", registry.kinds)
    if str(urdf).endswith(COLLIDES_WITH_PEDESTAL):
        (problem,) = checked.problems
        assert "would collide with its pedestal" in problem.message
        return
    with Run(checked.runnable(), registry, RunOptions(duration=60.0)) as run:
        result = run.finish()
    leaves = result.arms["arm1"].leaves.values()
    assert [leaf.reason for leaf in leaves if leaf.status != "SUCCESS"] == []
