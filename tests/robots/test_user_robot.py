"""A user's own robot: a description that passes the check can be run."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from bt_dualarm import cli
from bt_dualarm.robots.robot_description import load_robot
from tests.robots.small_arm import DESCRIPTION, write_robot
from tests.sim.worlds import PAGES, WORLD

TREE = """\
bt_dualarm: 1
name: reaching
world: {scene: empty}
arms:
  arm1:
    robot: %s
    base: {xyz: [0, 0, 0.4]}
    tree:
      sequence:
        - reach_to_pose: {offset: {xyz: [0.05, 0.05, -0.05]}}
        - circle: {plane: yz, radius: 0.03}
        - go_home
"""


@pytest.mark.parametrize("page", PAGES)
def test_a_description_that_passes_the_check_is_run(
    page: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With any joints: those of the Jaco are continuous. The report shows the robot's title."""
    shutil.copytree(WORLD / "robots", tmp_path / "robots")
    (tmp_path / "reaching.yaml").write_text(TREE % page, encoding="utf-8")
    assert cli.check([str(tmp_path / "reaching.yaml")]) == 0
    assert cli.run([str(tmp_path / "reaching.yaml")]) == 0, capsys.readouterr()
    assert f"arm1 · {load_robot(page, WORLD).title} " in capsys.readouterr().out


def test_a_camera_on_an_arm_without_mounts_is_told_where_they_are_declared(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(WORLD / "robots", tmp_path / "robots")
    tree = (TREE % PAGES[0]).replace("    tree:", "    camera: {}\n    tree:")
    (tmp_path / "reaching.yaml").write_text(tree, encoding="utf-8")
    assert cli.check([str(tmp_path / "reaching.yaml")]) == 1
    assert "= its description declares none: add `cameras` there" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("flange", "message"),
    [
        ("{link: flange, stock: [flange]}", "it would be mounted on 'flange', which is then gone"),
        ("{link: base, stock: [finger, lower]}", "joint 'elbow' is part of the arm"),
    ],
)
def test_a_gripper_replaces_neither_its_flange_nor_the_arm(
    flange: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of such a description the check ended with a KeyError where an arm had a gripper."""
    write_robot(tmp_path, description=f"{DESCRIPTION}flange: {flange}\n")
    tree = (TREE % "small.yaml").replace("    tree:", "    gripper: panda_hand\n    tree:")
    (tmp_path / "reaching.yaml").write_text(tree, encoding="utf-8")
    assert cli.check([str(tmp_path / "reaching.yaml")]) == 1
    assert message in capsys.readouterr().out
