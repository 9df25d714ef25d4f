"""The complete check of a file: its contents, and the robots, scenes and poses that it names."""

from __future__ import annotations

import re
import textwrap
from pathlib import Path

import numpy as np
import pytest

from bt_dualarm.core.errors import Failure
from bt_dualarm.core.share import share_dir
from bt_dualarm.kinematics.inverse_kinematics import refuse_beyond
from bt_dualarm.robots.robot_description import load_robot
from bt_dualarm.runtime.file_check import check
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.problems import Problem, SpecError, errors

FILE = """\
bt_dualarm: 1
name: task
world: {{scene: {scene}}}
objects:
  {obj}: {{shape: box, size: [0.05,0.05,0.05], mass: 0.1, color: red, pose: {{xyz: [0.4, 0, 0.1]}}}}
arms:
  arm1:
    robot: {robot}
    posture: {posture}
    camera: {{mount: {mount}}}
    tree: {tree}
"""
GOOD = {
    "scene": "empty",
    "obj": "cube",
    "robot": "ur5",
    "posture": "home",
    "mount": "wrist",
    "tree": "{wait: {seconds: 1}}",
}
TAKE = "{approach_and_attach: {object: cube}}"


@pytest.fixture(scope="module")
def registry() -> Registry:
    return Registry.load()


def problems_of(tmp_path: Path, registry: Registry, **changes: str) -> tuple[Problem, ...]:
    path = tmp_path / "task.yaml"
    path.write_text(FILE.format(**{**GOOD, **changes}))
    return check(path, registry.kinds).problems


def test_a_good_file_has_no_problems(tmp_path: Path, registry: Registry) -> None:
    assert problems_of(tmp_path, registry) == ()


@pytest.mark.parametrize(
    ("change", "given", "message", "nearest"),
    [
        ("scene", "tabel", "there is no scene 'tabel'", "table"),
        ("robot", "ur55", "there is no robot 'ur55'", "ur5"),
        ("posture", "hoem", "there is no posture of ur5 'hoem'", "home"),
        ("mount", "wirst", "there is no camera mount of ur5 'wirst'", "wrist"),
        (
            "tree",
            "{reach_to_pose: {posture: hoem}}",
            "reach_to_pose: there is no posture of ur5 'hoem'",
            "home",
        ),
    ],
)
def test_an_unknown_name_is_an_error_with_a_suggestion(
    tmp_path: Path, registry: Registry, change: str, given: str, message: str, nearest: str
) -> None:
    (problem,) = problems_of(tmp_path, registry, **{change: given})
    assert (problem.severity, problem.message) == ("error", message)
    assert f"'{nearest}'" in problem.hint


def test_an_overlap_is_reported_at_its_position(tmp_path: Path, registry: Registry) -> None:
    """It is reported at an arm that gives no base, and at an object's pose."""
    path = tmp_path / "task.yaml"
    text = FILE.format(**GOOD)
    path.write_text(text.replace("xyz: [0.4, 0, 0.1]", "xyz: [0.0, 0, 0.05]"))
    (problem,) = check(path, registry.kinds).problems
    assert (problem.place.line, problem.message.partition(" would be ")[0]) == (7, "arm 'arm1'")
    path.write_text(text.replace("xyz: [0.4, 0, 0.1]", "xyz: [0.4, 0, 0.0]"))
    (problem,) = check(path, registry.kinds).problems
    assert (problem.place.line, problem.place.column) == (5, text.splitlines()[4].index("{xyz") + 1)
    assert problem.message == "object 'cube' would be 25 mm deep in floor"


@pytest.mark.parametrize(
    ("depth_mm", "severities"),
    [(0.5, []), (2.0, ["warning"]), (4.0, ["warning"]), (6.0, ["error"])],
)
def test_an_object_that_contacts_would_push_out_is_a_warning(
    depth_mm: float, severities: list[str], tmp_path: Path, registry: Registry
) -> None:
    """It may be thrown off its table before anything moves, and a grasp then finds nothing."""
    path = tmp_path / "task.yaml"
    text = FILE.format(**GOOD)
    path.write_text(text.replace("xyz: [0.4, 0, 0.1]", f"xyz: [0.4, 0, {0.025 - 1e-3 * depth_mm}]"))
    problems = check(path, registry.kinds).problems
    assert [problem.severity for problem in problems] == severities


def test_a_name_that_the_scene_has_already_is_an_error(tmp_path: Path, registry: Registry) -> None:
    (problem,) = problems_of(tmp_path, registry, obj="floor")
    assert problem.severity == "error"
    assert "part of the scene" in problem.message


@pytest.mark.parametrize(
    ("tree", "words"),
    [
        ("{reach_to_pose: {to: {xyz: [5, 0, 0.3]}}}", "out of reach of arm1"),
        ("{reach_to_pose: {to: {xyz: [0.3, 0.2, 0.8], rpy: [0, 0, 0]}}}", ""),
        ("{move_through: {poses: [{xyz: [0.3, 0.2, 0.8]}, {xyz: [5, 0, 0.3]}]}}", "out of reach"),
        (
            f"{{sequence: [{TAKE}, {{transport: {{to: {{xyz: [0, 0, 3]}}}}}}]}}",
            "out of reach of arm1",
        ),
        (f"{{sequence: [{TAKE}, {{transport: {{to: {{xyz: [0.4, 0.2, 0.4]}}}}}}]}}", ""),
    ],
)
def test_a_pose_out_of_reach_is_a_warning_and_no_error(
    tmp_path: Path, registry: Registry, tree: str, words: str
) -> None:
    found = problems_of(tmp_path, registry, tree=tree)
    assert [problem.severity for problem in found] == (["warning"] if words else [])
    assert all(words in problem.message for problem in found)


@pytest.mark.parametrize(
    ("color", "ports", "words"),
    [
        ("gray", "", "gray is not a color that a camera can find"),
        ("[0.4, 0.4, 0.4]", "", "is too gray or too dark for a camera to find"),
        ("gray", ", color: red", ""),
        ("red", "", ""),
        ("red", ", by: marker", "it has no marker"),
    ],
)
def test_an_object_that_no_camera_can_detect_is_a_warning(
    color: str, ports: str, words: str, tmp_path: Path, registry: Registry
) -> None:
    """The check found the file fine, and the leaf failed with INVALID_TARGET."""
    file = FILE.format(**{**GOOD, "tree": f"{{locate: {{object: cube{ports}}}}}"})
    path = tmp_path / "task.yaml"
    path.write_text(file.replace("color: red", f"color: {color}", 1))
    found = check(path, registry.kinds).problems
    assert [one.severity for one in found] == (["warning"] if words else [])
    assert all(words in one.message for one in found)


def test_a_joint_may_be_locked_at_its_limit_with_a_unit(tmp_path: Path, registry: Registry) -> None:
    """35 times 0.01 is more than 0.35: it was beyond the limit, and so was said to be 0.35 m."""
    path = tmp_path / "task.yaml"
    arm = "{robot: tiago, locked: {torso_lift_joint: 35 cm}, tree: {go_home: {}}}"
    path.write_text(f"bt_dualarm: 1\nworld: {{scene: empty}}\narms: {{arm1: {arm}}}\n")
    assert check(path, registry.kinds).problems == ()


PICKING = """\
bt_dualarm: 1
world: {{scene: empty}}
objects:
  cube: {{shape: box, size: [0.05, 0.05, 0.05], mass: 0.1, pose: {{xyz: [{x}, 0, 0.1]}}}}
  tray: {{shape: tray, size: [0.3, 0.2, 0.03], mass: 0.5, pose: {{xyz: [{tray}, 0, 0.015]}}}}
arms:
  arm1: {{robot: ur5, gripper: panda_hand, tree: {first}}}
  arm2: {{robot: ur5, gripper: panda_hand, base: {{xyz: [3.2, 0, 0]}}, tree: {second}}}
"""
WAITING = "{wait: 1}"


@pytest.mark.parametrize(
    ("x", "tray", "first", "second", "warns"),
    [
        (2.5, 0.5, "{grasp: {object: cube}}", WAITING, True),
        (2.5, 0.5, "{approach_and_attach: {object: cube}}", WAITING, True),
        (0.5, 2.5, "{grasp: {object: cube}}", WAITING, False),
        (0.5, 2.5, "{grasp: {object: cube, at: {xyz: [2.5, 0, 0.1]}}}", WAITING, True),
        (2.5, 0.5, "{grasp: {object: cube, at: {xyz: [0.5, 0, 0.1]}}}", WAITING, False),
        (2.5, 0.5, "{grasp: {object: cube}}", "{grasp: {object: cube}}", False),
        (2.5, 2.5, "{grasp: {object: cube}}", "{grasp: {object: tray}}", False),
        (2.5, 0.5, "{sequence: [{grasp: {object: tray}}, {grasp: {object: cube}}]}", WAITING, True),
        (2.5, 2.5, "{holding: {object: cube}}", WAITING, False),
    ],
)
def test_an_object_out_of_reach_is_a_warning_unless_it_may_be_brought(
    x: float, tray: float, first: str, second: str, warns: bool, tmp_path: Path, registry: Registry
) -> None:
    """The check found the file fine, and `grasp` failed in the first tick."""
    path = tmp_path / "task.yaml"
    path.write_text(PICKING.format(x=x, tray=tray, first=first, second=second))
    found = [one.message for one in check(path, registry.kinds).problems if "holds" not in str(one)]
    assert len(found) == warns
    assert all(": object: out of reach of arm1: its tool cannot get" in one for one in found)


@pytest.mark.parametrize(
    ("noise", "tree", "words"),
    [
        ("[0.03, 0.04, 0]", "{reach_to_pose: {to: {above: cube, by: 0.1}}}", "by up to 50 mm"),
        ("[0.005, 0, 0]", "{reach_to_pose: {to: {above: cube, by: 0.1}}}", ""),
        (
            "[0.03, 0.04, 0]",
            "{sequence: [{locate: {object: cube}}, {reach_to_pose: {to: {above: cube, by: 0.1}}}]}",
            "",
        ),
        ("[0.03, 0.04, 0]", "{reach_to_pose: {to: {in_frame: tool, xyz: [0, 0, -0.05]}}}", ""),
        ("[0.03, 0.04, 0]", "{move_through: {poses: [{above: cube, by: 0.1}]}}", "by up to 50 mm"),
        (
            "[0.03, 0.04, 0]",
            "{reach_to_pose: {posture: up, keep: {facing: {toward: {in_frame: cube}, within: 9}}}}",
            "by up to 50 mm",
        ),
        ("[0, 0, 0.03]", "{reach_to_pose: {to: {above: cube, by: 0.1}}}", ""),  # it falls
    ],
)
def test_a_pose_relative_to_a_randomized_object_is_a_warning_unless_located(
    tmp_path: Path, registry: Registry, noise: str, tree: str, words: str
) -> None:
    file = FILE.format(**{**GOOD, "tree": tree})
    path = tmp_path / "task.yaml"
    path.write_text(file.replace("mass: 0.1", f"mass: 0.1, noise: {{xyz: {noise}}}"))
    found = check(path, registry.kinds).problems
    assert [one.severity for one in found] == (["warning"] if words else [])
    assert all(words in one.message and "locate" in one.hint for one in found)


CABINET = """\
bt_dualarm: 1
world: {scene: empty}
objects:
  cabinet:
    shape: compound
    fixed: true
    pose: {xyz: [0.7, 0, 0.3]}
    parts:
      frame: {shape: box, size: [0.2, 0.02, 0.2], pose: {xyz: [0, 0.2, 0]}}
      drawer: {shape: box, size: [0.2, 0.2, 0.1]}
      door: {shape: box, size: [0.2, 0.01, 0.1], pose: {xyz: [0, 0, 0.2]}}
    joints:
      slide: {type: slide, parts: [drawer], axis: [0, -1, 0], range: [0, 0.17]}
      hinge: {type: hinge, parts: [door], range: [-90, 0]}
arms:
  arm1: {robot: ur5, gripper: robotiq_2f85, tree: TREE}
"""


@pytest.mark.parametrize(
    ("node", "message"),
    [
        ("operate: {object: cabinet, joint: slide, to: 15 cm}", ""),
        ("operate: {object: cabinet, joint: hinge, to: -0.5 rad}", ""),
        ("joint_at: {object: cabinet, joint: slide, above: 20 cm}", ""),
        (
            "operate: {object: cabinet, joint: slide, to: 17.1 cm}",
            "operate: to: 0.171 m is not in the range of cabinet.slide",
        ),
        (
            "grasp: {object: cabinet, part: door, then_to: 5}",
            "grasp: then_to: 5 deg is not in the range of cabinet.hinge",
        ),
        (
            "operate: {object: cabinet, joint: slide, to: 0.1 deg}",
            "operate: to: the joint slides: its positions are lengths, not '0.1 deg'",
        ),
        (
            "operate: {object: cabinet, joint: hinge, to: -10 mm}",
            "operate: to: the joint turns: its positions are angles, not '-10 mm'",
        ),
    ],
)
def test_position_that_a_joint_cannot_have_is_an_error(
    tmp_path: Path, registry: Registry, node: str, message: str
) -> None:
    """The unit of the other kind of joint counted as its own; the range counted in the run only."""
    path = tmp_path / "task.yaml"
    path.write_text(CABINET.replace("TREE", "{" + node + "}"))
    found = errors(check(path, registry.kinds).problems)
    assert [one.message for one in found] == ([message] if message else [])


@pytest.mark.parametrize(("robot", "most"), [("ur3", 3), ("xarm7", 3.5), ("ur5", 5), ("ur10", 10)])
def test_a_load_beyond_the_payload_is_a_warning(
    tmp_path: Path, registry: Registry, robot: str, most: float
) -> None:
    """This holds for every object that is carried; others may have any mass."""
    carry = "{transport: {object: cube, to: {xyz: [0.3, 0.1, 0.4]}}}"
    carries = f"{{sequence: [{TAKE}, {carry}]}}"
    for mass, tree, count in ((most + 0.1, carries, 1), (most, carries, 0), (90, "succeed", 0)):
        file = FILE.replace("mass: 0.1", f"mass: {mass}")
        path = tmp_path / "task.yaml"
        path.write_text(file.format(**{**GOOD, "robot": robot, "tree": tree}))
        found = check(path, registry.kinds).problems
        assert [one.severity for one in found] == ["warning"] * count
        assert all(f"cube weighs {mass:g} kg" in one.message for one in found)
        assert all(f"a {robot}, is {most:g} kg" in one.hint for one in found)


@pytest.mark.parametrize(
    ("gripper", "leaf", "hint"),
    [
        ("", "approach_and_attach: {object: cube}", "the payload of arm1, a xarm7, is 3.5 kg"),
        ("gripper: robotiq_2f85\n", "grasp: {object: cube}", "with robotiq_2f85, is 2.575 kg"),
        ("gripper: panda_hand\n", "grasp: {object: cube}", "panda_hand may hold 3 kg"),
    ],
)
def test_a_load_is_weighed_where_it_is_picked_up(
    gripper: str, leaf: str, hint: str, tmp_path: Path, registry: Registry
) -> None:
    """Only leaves that carry a named object did so; `grasp` then failed with OVERLOADED."""
    path = tmp_path / "task.yaml"
    robot = f"{gripper and gripper + 4 * ' '}robot: xarm7"
    file = FILE.replace("mass: 0.1", "mass: 4").replace("robot: {robot}", robot)
    carry = "transport: {to: {xyz: [0.3, 0.1, 0.4]}}"
    path.write_text(file.format(**{**GOOD, "tree": f"{{sequence: [{{{leaf}}}, {{{carry}}}]}}"}))
    (found,) = check(path, registry.kinds).problems
    assert found.message.endswith(": object: cube weighs 4 kg")
    assert found.hint.endswith(hint)


def test_attaching_a_fixed_object_is_a_warning(tmp_path: Path, registry: Registry) -> None:
    """A part that moves on a joint can be attached; otherwise the leaf fails."""
    path = tmp_path / "task.yaml"
    for part, count in (("", 1), (", part: frame", 1), (", part: drawer", 0)):
        leaf = f"{{approach_and_attach: {{object: cabinet{part}}}}}"
        path.write_text(CABINET.replace("TREE", leaf))
        found = check(path, registry.kinds).problems
        assert ["cabinet is fixed" in one.message for one in found] == [True] * count


TOGETHER = """
bt_dualarm: 1
world: {{scene: empty}}
objects: {{bar: {{shape: box, size: [0.4, 0.03, 0.03], mass: {mass}, pose: {{xyz: [0, -2, 0.1]}}}}}}
arms:
  a: {{robot: {robot}, gripper: robotiq_2f85, tree: {{{mine}}}}}
  b: {{robot: {robot}, gripper: robotiq_2f85, base: {{xyz: [{away}, 0, 0]}}, tree: {{{its}}}}}
"""
CARRY = {
    "mine": "carry_together: {object: bar, with: [b], to: {xyz: [0, 0.5, 0.2]}}",
    "its": "carry_together: {object: bar, with: [a]}",
}
HAND = {
    "mine": "sequence: [grasp: {object: bar}, hand_over: {object: bar, to: b}]",
    "its": "take_over: {object: bar, from: a}",
}


@pytest.mark.parametrize("robot", ["ur3", "ur5", "xarm7", "panda"])
@pytest.mark.parametrize("action", [CARRY, HAND], ids=["carry", "hand over"])
def test_arms_that_cannot_hold_one_object_at_once(
    tmp_path: Path, registry: Registry, robot: str, action: dict[str, str]
) -> None:
    """Nothing said so before the run."""
    path = tmp_path / "task.yaml"
    for away, count in ((0.8, 0), (4.0, 1)):
        path.write_text(TOGETHER.format(robot=robot, away=away, mass=0.2, **action))
        found = check(path, registry.kinds).problems
        messages = [one.message for one in found if one.severity == "warning"]
        assert sum("a and b cannot hold bar at once" in one for one in messages) == count, messages


@pytest.mark.parametrize(
    ("gripper", "size", "mass", "complaint"),
    [
        ("panda_hand", "[0.2, 0.03, 0.03]", 0.2, ""),
        ("suction_cup", "[0.2, 0.03, 0.03]", 0.2, "bar has no face on which suction_cup seals"),
        ("panda_hand", "[0.2, 0.082, 0.082]", 0.2, "bar is 82 mm wide"),
        ("suction_cup", "[0.2, 0.06, 0.06]", 2.5, "bar weighs 2.5 kg"),
        ("robotiq_2f85", "[0.2, 0.06, 0.06]", 2.5, "bar weighs 2.5 kg"),
        ("", "[0.2, 0.06, 0.06]", 3.5, "bar weighs 3.5 kg"),
    ],
)
def test_an_object_that_is_taken_over_has_to_fit_the_hand(
    gripper: str, size: str, mass: float, complaint: str, tmp_path: Path, registry: Registry
) -> None:
    """Only `grasp` and `regrasp` were checked, and only `take_over` then failed, after the lift."""
    text = TOGETHER.format(robot="ur5", away=0.8, mass=mass, **HAND)
    hand = f"gripper: {gripper}, " if gripper else ""
    taker = f"b: {{robot: ur3, {hand}"
    text = text.replace("b: {robot: ur5, gripper: robotiq_2f85, ", taker)
    path = tmp_path / "task.yaml"
    path.write_text(text.replace("[0.4, 0.03, 0.03]", size))
    found = [one.message for one in check(path, registry.kinds).problems if "take_" in str(one)]
    assert found == ([f"take_over: object: {complaint}"] if complaint else [])


@pytest.mark.parametrize(("robot", "most"), [("ur3", 4.15), ("ur5", 8.15)])
def test_a_load_beyond_the_payload_of_all_that_carry_it_is_a_warning(
    tmp_path: Path, registry: Registry, robot: str, most: float
) -> None:
    path = tmp_path / "task.yaml"
    for mass, count in ((most - 0.1, 0), (most + 0.1, 1)):
        path.write_text(TOGETHER.format(robot=robot, away=0.8, mass=mass, **CARRY))
        found = [one for one in check(path, registry.kinds).problems if "weighs" in one.message]
        assert len(found) == count
        assert all("a and b together is" in one.hint for one in found)


@pytest.mark.parametrize(
    ("tree", "message", "hint"),
    [
        (
            "{move_joints: {to: [0, 0]}}",
            "move_joints: to: 2 values for the 6 joints of ur5",
            "base to tip: shoulder_pan_joint",
        ),
        (
            "{move_joints: {by: {elbow: 3}}}",
            "move_joints: there is no joint of ur5 'elbow'",
            "'elbow_joint'",
        ),
        ("{move_joints: {to: [0, 0, 0, 0, 0, 0]}}", "", ""),
        ("{move_joints: {by: {elbow_joint: 3}}}", "", ""),
        (
            "{sequence: [{set: {key: q, value: [0, 0]}}, {move_joints: {to: '{q}'}}]}",
            "",
            "",
        ),
    ],
)
def test_joint_values_must_match_the_robot(
    tmp_path: Path, registry: Registry, tree: str, message: str, hint: str
) -> None:
    found = problems_of(tmp_path, registry, tree=tree)
    assert [problem.message for problem in found] == ([message] if message else [])
    assert all(hint in problem.hint for problem in found)


def test_a_skill_that_looks_needs_a_camera_that_moves_with_the_arm(
    tmp_path: Path, registry: Registry
) -> None:
    assert problems_of(tmp_path, registry, tree="track") == ()
    standing = "{xyz: [1, 0, 1], look_at: [0.4, 0, 0.5]}"
    (problem,) = problems_of(tmp_path, registry, tree="track", mount=standing)
    assert problem.message == "track: arm1 has no camera that moves with it"
    assert problem.hint == "give arm1 one: camera: {mount: wrist}"


MISTAKEN = """\
bt_dualarm: 1
name: task
params:
  speed: {type: number, default: fast}
world: {scene: tabel, seed: -1}
objects:
  cube: {shape: box, size: [0.05, 0.05, 0.05], mass: heavy, pose: {xyz: [0.4, 0, 0.1]}}
arms:
  arm1:
    robot: ur55
    gripper: robotiq_2f58
    tree: {circel: {radius: 1}}
  arm2:
    robot: panda
    base: {xyz: [1, 0]}
    posture: hoem
    camera: {mount: wrst, fps: none}
    tree:
      sequence:
        - reach_to_pose: {posture: hom, speed: 50}
        - move_joints: {to: 7}
        - track
        - grasp: {object: cubus}
  arm3: {robot: ur5, base: {xyz: [0, 2, 0]}, limits: {speed: 1}, tree: {set: {key: n}}}
"""


def test_all_mistakes_are_reported_at_once(tmp_path: Path, registry: Registry) -> None:
    """Names of external files are looked up whatever other mistakes there are."""
    path = tmp_path / "task.yaml"
    path.write_text(MISTAKEN)
    found = [problem.message for problem in check(path, registry.kinds).problems]
    assert found == [
        "default of speed: expected a number, not text 'fast'",
        "there is no scene 'tabel'",
        "seed: must be at least 0, not -1",
        "mass: expected a number, not text 'heavy'",
        "there is no robot 'ur55'",
        "there is no gripper 'robotiq_2f58'",
        "there is no node or skill 'circel'",
        "xyz: expected 3 items, not 2",
        "there is no posture of panda 'hoem'",
        "there is no camera mount of panda 'wrst'",
        "fps: expected a number, not text 'none'",
        "reach_to_pose: there is no posture of panda 'hom'",
        "reach_to_pose: speed: must be at most 1, not 50",
        "move_joints: to: expected a list or a mapping, not 7",
        "grasp: arm2 has no gripper",
        "grasp: there is no object 'cubus'",
        "unknown field 'speed'",
        "set: port 'value' is missing",
    ]


def test_warnings_of_the_world_hide_no_other_ones(tmp_path: Path, registry: Registry) -> None:
    path = tmp_path / "task.yaml"
    text = FILE.format(**{**GOOD, "tree": "{reach_to_pose: {to: {xyz: [5, 0, 0]}}}"})
    path.write_text(text.replace("xyz: [0.4, 0, 0.1]", "xyz: [0.4, 0, 0.022]"))
    checked = check(path, registry.kinds)
    pushed, far = (problem.message for problem in checked.problems)
    assert pushed == "object 'cube' would be 3 mm deep in floor"
    assert "out of reach of arm1" in far
    assert checked.file is not None


@pytest.mark.parametrize(("fixed", "count"), [("true", 1), ("false", 0)])
def test_an_arm_that_begins_slightly_in_what_is_fixed_is_a_warning(
    fixed: str, count: int, tmp_path: Path, registry: Registry
) -> None:
    """All of its plans failed with `IN_COLLISION`; a free object gives way, and may be grasped."""
    path = tmp_path / "task.yaml"
    below_the_tool = f"pose: {{xyz: [0.487, 0.109, 0.4055]}}, fixed: {fixed}"
    text = FILE.format(**GOOD).replace("pose: {xyz: [0.4, 0, 0.1]}", below_the_tool)
    path.write_text(text)
    problems = check(path, registry.kinds).problems
    assert len(problems) == count
    for problem in problems:
        assert problem.severity == "warning"
        assert problem.message == "arm 'arm1' would be 4 mm deep in cube, with arm1/tool0"
        assert "no motion may begin there" in problem.hint


@pytest.mark.parametrize(
    ("ports", "warned"),
    [
        ("to: [0, -90, 900, 0, 0, 0]", ["elbow_joint cannot be at 900°"]),
        ("to: {elbow_joint: -181, wrist_3_joint: 361}", ["-181°", "wrist_3_joint cannot be at"]),
        ("to: {elbow_joint: 180, wrist_3_joint: -360}", []),
        ("by: {elbow_joint: -300}", []),
    ],
)
def test_joint_angles_beyond_limits_are_warnings(
    ports: str, warned: list[str], registry: Registry
) -> None:
    text = FILE.format(**{**GOOD, "tree": f"{{move_joints: {{{ports}}}}}"})
    problems = check(text, registry.kinds).problems
    assert len(problems) == len(warned)
    for problem, part in zip(problems, warned, strict=True):
        assert (problem.severity, problem.place.line) == ("warning", 11)
        assert part in problem.message
        assert problem.hint.startswith("its limits are -")


@pytest.mark.parametrize("name", ["baxter_left", "fr3", "panda", "so100", "ur5", "xarm7"])
def test_limits_that_a_warning_names_are_possible(name: str, registry: Registry) -> None:
    """Also to the skill, whose refusal names the same; rounded to the nearest they would not be."""
    robot = load_robot(name, Path(), None)

    def warned(joint: str, angle: float) -> str:
        tree = f"{{move_joints: {{to: {{{joint}: {angle}}}}}}}"
        text = FILE.format(**{**GOOD, "tree": tree}).replace("robot: ur5", f"robot: {name}")
        found = check(text, registry.kinds, build=False).problems
        return "".join(problem.hint for problem in found if "cannot be at" in problem.message)

    for index, joint in enumerate(robot.joints):
        named = re.fullmatch(r"its limits are (\S+)° and (\S+)°", warned(joint, 500.0))
        assert named is not None
        for bound, beyond in zip(map(float, named.groups()), (-1e-4, 1e-4), strict=True):
            assert not warned(joint, bound)
            q = robot.postures["home"].copy()
            q[index] = np.radians(bound)
            refuse_beyond(robot.joints, q, robot.limits)
            q[index] += beyond
            with pytest.raises(Failure, match=re.escape(f" beyond its limit of {bound}°")):
                refuse_beyond(robot.joints, q, robot.limits)


@pytest.mark.parametrize(
    ("y", "where"),
    [(0.257, "in contact with"), (0.28, "20 mm from"), (0.3, "25 mm from"), (0.4, None)],
)
def test_arms_that_begin_too_near_each_other_are_a_warning(
    y: float, where: str | None, registry: Registry
) -> None:
    """`go_home` would fail there once one of them had left, with a reason that is known before.

    Nothing was said of arms that begin in contact, up to the depth that is an error.
    """
    text = (
        "bt_dualarm: 1\nworld: {scene: empty}\narms:\n  a: {robot: ur5, tree: go_home}\n"
        f"  b: {{robot: ur5, base: {{xyz: [0, {y}, 0]}}, tree: go_home}}\n"
    )
    found = [(p.severity, p.place.line, p.message) for p in check(text, registry.kinds).problems]
    assert len(found) == (where is not None)
    if where is not None:
        severity, line, message = found[0]
        assert (severity, line) == ("warning", 5)
        assert f"begins {where} a/" in message


def test_overlaps_are_reported_with_mistakes_in_trees(tmp_path: Path, registry: Registry) -> None:
    text = FILE.format(**{**GOOD, "tree": "circel"})
    other = "  ball: {shape: sphere, size: [0.05], mass: 0.1, pose: {xyz: [0.4, 0, 0.1]}}\n"
    third = "  can: {shape: box, size: [0.1, 0.1, 0.1], mass: 1, pose: {xyz: [0.4, 0.07, 0.1]}}\n"
    path = tmp_path / "task.yaml"
    path.write_text(text.replace("arms:", f"{other}{third}arms:"))
    messages = [problem.message for problem in check(path, registry.kinds).problems]
    assert messages[-1] == "there is no node or skill 'circel'"
    assert len(messages) == 3
    assert all("deep in" in message for message in messages[:2])


def test_problems_are_raised_where_a_runnable_file_is_needed(
    tmp_path: Path, registry: Registry
) -> None:
    path = tmp_path / "task.yaml"
    path.write_text(textwrap.dedent(FILE.format(**{**GOOD, "robot": "ur55"})))
    with pytest.raises(SpecError, match="ur55"):
        check(path, registry.kinds).runnable()


@pytest.mark.parametrize("path", sorted(share_dir("trees").rglob("*.yaml")), ids=lambda p: p.stem)
def test_shipped_trees_have_no_problems(path: Path, registry: Registry) -> None:
    assert check(path, registry.kinds).problems == ()
