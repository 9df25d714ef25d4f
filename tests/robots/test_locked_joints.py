"""Locked joints: joints of a robot that its arm does not move; a tree file may set them."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from benchmarks.between_fingers import OPEN, SHUT, admits, finger_problems
from bt_dualarm.core.errors import CatalogError
from bt_dualarm.core.pose import Pose
from bt_dualarm.kinematics.solver import Chain
from bt_dualarm.robots.mjspec import robot_spec
from bt_dualarm.robots.robot_description import load_robot
from bt_dualarm.robots.urdf_xml import DescriptionError
from bt_dualarm.runtime.file_check import check
from bt_dualarm.skill.registry import Registry
from tests.robots.small_arm import DESCRIPTION, URDF, line_of, write_robot
from tests.sim.worlds import ROBOTS, WORLD, world_with

KINDS = Registry.load().kinds
LOCKED = {name: robot.locked for name in ROBOTS if (robot := load_robot(name, WORLD)).locked}

TURNING = URDF.replace('name="slide" type="prismatic"', 'name="slide" type="revolute"').replace(
    'upper="0.04"', 'upper="1"'
).replace('<parent link="lower"/>\n    <child link="flange"/>',
          '<parent link="finger"/>\n    <child link="flange"/>')  # fmt: skip
"""The small arm with a wrist that turns about the x axis of the lower link and is locked."""


def test_some_arm_has_locked_joints() -> None:
    assert "panda" in LOCKED


@pytest.mark.parametrize("name", LOCKED)
def test_a_locked_joint_can_be_at_either_limit(name: str) -> None:
    """Its link moves in its parent's frame by the range of the joint."""
    for joint, locked in LOCKED[name].items():
        if locked.follows in LOCKED[name]:
            continue
        poses = []
        for value in (locked.lower, locked.upper):
            moved = load_robot(name, WORLD, {joint: value})
            assert moved.locked[joint].at == value
            poses.append(moved.model.parts[locked.link].pose)
        motion = poses[0].distance(poses[1]), poses[0].angle(poses[1])
        turned = np.radians(locked.upper - locked.lower)
        expected = (0.0, np.pi - abs(np.pi - turned % (2 * np.pi)))
        assert motion == pytest.approx(
            expected if locked.turns else (locked.upper - locked.lower, 0.0)
        )


@pytest.mark.parametrize("name", LOCKED)
def test_a_locked_joint_beyond_its_limits_is_refused(name: str) -> None:
    for joint, locked in LOCKED[name].items():
        for value in (locked.lower - 0.01, locked.upper + 0.01):
            with pytest.raises(CatalogError, match=f"{joint}.*limits are|{joint}.*follows"):
                load_robot(name, WORLD, {joint: value})


def test_the_description_is_the_default() -> None:
    """It is even the same object: a run without `locked` does not change."""
    assert load_robot("panda", locked={}) is load_robot("panda")
    assert load_robot("panda").locked["panda_finger_joint1"].at == 0.01


def test_the_other_finger_follows_the_first() -> None:
    """In the world, both fingers open the hand: 80 mm from pad to pad."""
    for given, between in ((SHUT, 0.02), (OPEN, 0.08)):
        world = world_with("panda", locked=given)
        data = world.data
        mujoco.mj_kinematics(world.model, data)
        fingers = [data.body(f"arm1/panda_{side}finger").xpos for side in ("left", "right")]
        assert np.linalg.norm(fingers[0] - fingers[1]) == pytest.approx(between)


def test_a_locked_joint_that_turns_moves_the_tool(tmp_path: Path) -> None:
    """Values are degrees, as everywhere in a file: 30° about x moves the flange aside."""
    description = write_robot(tmp_path, TURNING)
    for angle in (0.0, 30.0):
        robot = load_robot(description, tmp_path, {"slide": angle})
        tool = Chain(robot, Pose.identity()).forward(np.zeros(2))
        turn = np.radians(angle)
        assert tool.position == pytest.approx([0, -0.3 * np.sin(turn), 0.4 + 0.3 * np.cos(turn)])
        assert robot_spec(robot, visuals=False).compile().nv == 2


def test_a_joint_has_the_value_of_the_description_unless_given(tmp_path: Path) -> None:
    description = write_robot(tmp_path, description=DESCRIPTION + "locked: {slide: 0.03}\n")
    assert load_robot(description, tmp_path).locked["slide"].at == 0.03
    assert load_robot(description, tmp_path, {"slide": 0.0}).locked["slide"].at == 0.0


def test_a_description_cannot_lock_a_joint_beyond_its_limits(tmp_path: Path) -> None:
    """It is reported at the value, with the range that is allowed."""
    text = DESCRIPTION + "locked: {slide: 0.05}\n"
    with pytest.raises(DescriptionError) as caught:
        load_robot(write_robot(tmp_path, description=text), tmp_path)
    (problem,) = caught.value.problems
    assert (problem.place.line, problem.message, problem.hint) == (
        line_of(text, "0.05}"),
        "joint 'slide' cannot be at 0.05 m",
        "its limits are 0 to 0.04 m",
    )


@pytest.mark.parametrize(("kind", "limits"), [("prismatic", "0.1 to 0.3 m"), ("revolute", "-40.1")])
def test_locked_joint_that_cannot_be_at_zero_needs_a_position(
    kind: str, limits: str, tmp_path: Path
) -> None:
    """It was locked at zero all the same, outside its limits."""
    span = {"prismatic": 'lower="0.1" upper="0.3"', "revolute": 'lower="-0.7" upper="-0.2"'}[kind]
    urdf = URDF.replace('"slide" type="prismatic"', f'"slide" type="{kind}"')
    urdf = urdf.replace('lower="0" upper="0.04"', span)
    with pytest.raises(DescriptionError) as caught:
        load_robot(write_robot(tmp_path, urdf), tmp_path)
    (problem,) = caught.value.problems
    assert problem.place.line == line_of(DESCRIPTION, "joints:")
    assert "joint 'slide' cannot be at 0" in problem.message
    assert limits in problem.hint
    assert "'locked'" in problem.hint


MISTAKEN = """\
bt_dualarm: 1
name: locked_mistakes
world: {scene: empty}
arms:
  arm1: {robot: panda, locked: {panda_finger_joint1: 0.05}, tree: go_home}
  arm2: {robot: panda, base: {xyz: [2, 0, 0]}, locked: {panda_finger_jiont1: 0.04}, tree: go_home}
  arm3: {robot: panda, base: {xyz: [4, 0, 0]}, locked: {panda_joint1: 0.04}, tree: go_home}
  arm4: {robot: panda, base: {xyz: [6, 0, 0]}, locked: {panda_finger_joint2: 0.04}, tree: go_home}
  arm5: {robot: ur5, base: {xyz: [8, 0, 0]}, locked: {slide: 0.04}, tree: go_home}
  arm6:
    robot: panda
    gripper: panda_hand
    base: {xyz: [-2, 0, 0]}
    locked: {panda_finger_joint1: 0.04}
    tree: go_home
  arm7: {robot: panda, base: {xyz: [-4, 0, 0]}, locked: {panda_finger_joint1: wide}, tree: go_home}
"""

MESSAGES = {
    "0.05}": ("joint 'panda_finger_joint1' cannot be at 0.05 m", "its limits are 0 to 0.04 m"),
    "panda_finger_jiont1": ("there is no locked joint of panda", "did you mean 'panda_finger_jo"),
    "panda_joint1": ("joint 'panda_joint1' is one of the arm's", "locked joints of panda: panda_f"),
    "0.04}, tree: go_home}\n  arm5": ("joint 'panda_finger_joint2' follows", "panda_finger_jo"),
    "slide": ("there is no locked joint of ur5 'slide'", "ur5 has none"),
    "panda_finger_joint1: 0.04}\n    tree": ("comes off for panda_hand", "use `open_gripper`"),
    "wide": ("panda_finger_joint1: expected a number, or text with a unit", "not 'wide'"),
}
"""Text at which each problem is reported, with its message and its hint."""


@pytest.mark.parametrize("mark", MESSAGES)
def test_a_mistake_is_reported_at_its_position(mark: str) -> None:
    """The report has line and column, what was given and what is allowed."""
    text = MISTAKEN
    if mark != "wide":  # a value of a wrong type is reported first, alone
        text = text[: text.index("  arm7")]
    problems = check(text, KINDS).problems
    message, hint = MESSAGES[mark]
    line = line_of(text, mark)
    column = text.index(mark) - text.rfind("\n", 0, text.index(mark))
    found = [p for p in problems if (p.place.line, p.place.column) == (line, column)]
    assert found, [str(p) for p in problems]
    assert message in found[0].message
    assert hint in f"{found[0].message} {found[0].hint}"


def test_valid_locked_joints_have_no_problems() -> None:
    text = MISTAKEN[: MISTAKEN.index("  arm1")] + (
        "  arm1: {robot: panda, locked: {panda_finger_joint1: 0.04}, tree: go_home}\n"
    )
    assert check(text, KINDS).problems == ()


def test_objects_fit_between_open_fingers() -> None:
    """Posts of 25 to 60 mm: with the fingers as the description locks them, none is reachable."""
    shut = finger_problems(3, SHUT)
    opened = finger_problems(3, OPEN)
    pairs = [(next(shut), next(opened)) for _ in range(12)]
    assert all(np.array_equal(one.goals[0], other.goals[0]) for one, other in pairs)
    assert not any(admits(one) for one, _ in pairs)
    assert sum(admits(other) for _, other in pairs) >= 10


OTHER = DESCRIPTION.replace("joints: [shoulder, elbow]", "joints: [wrist]").replace(
    "home: [0, 30]", "home: [0]"
).replace("tool: {link: flange}", "tool: {link: hand}")  # fmt: skip
"""Description of a second arm of the small robot: one joint beside the first arm."""

TWO_ARMS = URDF.replace("</robot>", """
  <link name="hand">
    <inertial><mass value="0.5"/>
      <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial>
    <collision><geometry><sphere radius="0.03"/></geometry></collision>
  </link>
  <joint name="wrist" type="revolute">
    <parent link="base"/>
    <child link="hand"/>
    <origin xyz="0.5 0 0.1"/>
    <axis xyz="0 0 1"/>
    <limit lower="-2" upper="2" velocity="2" effort="40"/>
  </joint>
</robot>""")  # fmt: skip


def test_an_arm_knows_the_other_arms_of_its_robot(tmp_path: Path) -> None:
    write_robot(tmp_path, TWO_ARMS, DESCRIPTION + "other_arms: [other.yaml]\n")
    (tmp_path / "other.yaml").write_text(OTHER, encoding="utf-8")
    assert load_robot("small.yaml", tmp_path).other_arms == {"other": frozenset({"hand"})}
    assert load_robot("other.yaml", tmp_path).other_arms == {}


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("nobody.yaml", "'nobody.yaml' cannot be used"),
        ("ur5", "'ur5' is no arm of this robot: its URDF"),
        ("small.yaml", "'small.yaml' moves joint 'shoulder', too"),
    ],
)
def test_an_invalid_other_arm_is_refused(name: str, expected: str, tmp_path: Path) -> None:
    description = DESCRIPTION + f"other_arms: [{name}]\n"
    write_robot(tmp_path, TWO_ARMS, description)
    with pytest.raises(DescriptionError) as caught:
        load_robot("small.yaml", tmp_path)
    (problem,) = caught.value.problems
    assert expected.partition(":")[0] in problem.message
    assert problem.place.line == line_of(description, "other_arms")
