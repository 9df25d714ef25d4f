"""Hints for values in the notation of other systems, one error each."""

from __future__ import annotations

import pytest

from bt_dualarm.runtime.file_check import check
from bt_dualarm.skill.registry import Registry

FILE = """\
bt_dualarm: 1
world: {{scene: empty, reality: {reality}}}
objects:
  peg: {{shape: box, size: [0.03, 0.03, 0.09], mass: 1, color: {color}, pose: {{xyz: [0, 1, 1]}}}}
arms:
  arm1:
    robot: z1
    gripper: {gripper}
    camera: {{mount: {mount}}}
    tree: {tree}
"""
GOOD = {
    "reality": "lab",
    "color": "red",
    "gripper": "panda_hand",
    "mount": "wrist",
    "tree": "{wait: 1}",
}
POSE = "{{reach_to_pose: {{to: {0}}}}}"
ZERO = "a direction must not be a zero vector"


def problems_of(field: str, value: str) -> list[tuple[str, str]]:
    """Messages and hints for a file with one value that is not as it should be."""
    text = FILE.format(**{**GOOD, field: value})
    return [(one.message, one.hint) for one in check(text, Registry.load().kinds).problems]


@pytest.mark.parametrize(
    ("field", "value", "name"),
    [
        ("reality", "[lab]", "lab"),
        ("color", "[red]", "red"),
        ("gripper", "[panda_hand]", "panda_hand"),
        ("mount", "[wrist]", "wrist"),
        ("tree", "{grasp: {object: [peg]}}", "peg"),
        ("tree", "{circle: {plane: [yz]}}", "yz"),
        ("tree", "{circle: {end: [rim]}}", "rim"),
        ("tree", "{track: {color: [red], duration: 1}}", "red"),
    ],
)
def test_name_in_brackets_is_meant_without_them(field: str, value: str, name: str) -> None:
    """The fields of a mapping were listed, or numbers asked for."""
    [(_, hint)] = problems_of(field, value)
    assert hint == f"without brackets: {name}"


@pytest.mark.parametrize(
    ("field", "value", "hint"),
    [
        ("reality", "[lab, rough]", "'ideal' or 'lab' or 'rough' or a mapping of set, "),
        ("tree", "{locate: {object: peg, region: 5}}", "a name or a mapping of shape, size, pose"),
        ("tree", "{circle: {plane: [0, 0, 1]}}", "{normal: [0, 0, 1]}"),
        ("tree", POSE.format("[0.4, 0, 1, 180, 0, 0]"), "{xyz: [0.4, 0, 1], rpy: [180, 0, 0]}"),
        (
            "tree",
            POSE.format("[0.4, 0, 1, 1, 0, 0, 0]"),
            "{xyz: [0.4, 0, 1], quat: [1, 0, 0, 0]}, with quat in the order w, x, y, z",
        ),
        ("tree", POSE.format("{x: 0.4, y: 0.1, z: 0.3}"), "xyz: [0.4, 0.1, 0.3]"),
        ("tree", POSE.format("{xyz: [0.4, 0, 1], roll: 180, yaw: 9}"), "rpy: [180, 0, 9]"),
        ("tree", POSE.format("{xyz: [0.4, 0, 1], pitch: down}"), "rpy: […, …, …]"),
        (
            "tree",
            POSE.format("{xyz: [0.4, 0, 1], orientation: [0, 0, 0, 1]}"),
            "here it is 'quat': [w, x, y, z]",
        ),
        (
            "tree",
            POSE.format("{posture: home}"),
            "'posture' is a port of its own, not within 'to'",
        ),
    ],
)
def test_other_notation_has_one_error_with_ours(field: str, value: str, hint: str) -> None:
    """Three coordinates with names of their own were three errors."""
    [(_, found)] = problems_of(field, value)
    assert found.startswith(hint)


PARAMETERS = """\
bt_dualarm: 1
params:
  grip: {type: text, default: panda_hand, choices: [panda_hand, none]}
  robot: {type: text, default: z1, choices: [z1, jaco2]}
  goal: {type: pose, default: {xyz: [0.3, 0, 0.5]}}
  high: {type: number, unit: m, default: 0.1, range: [0.05, 0.2]}
  step: {type: vector, unit: m, default: [0, 0, 0.1]}
arms:
  arm1:
    robot: "{robot}"
    gripper: "{grip}"
    tree:
      sequence:
        - reach_to_pose: {to: "{goal}"}
        - reach_to_pose: {offset: {xyz: [0, 0, "{high}"]}}
        - reach_to_pose: {offset: {xyz: "{step}"}}
"""
UNITS = " (in meters, or with a unit: mm, cm, m)"


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("grip", "claw", "grip: expected one of panda_hand, none, not text 'claw'"),
        ("robot", "ur5", "robot: expected one of z1, jaco2, not text 'ur5'"),
        ("goal", "{xyz: [1, 2]}", "goal: xyz: expected 3 items, not 2"),
        ("high", "5", "high: must be at most 0.2 m, not 5 (in meters: 0.005, if 5 mm are meant)"),
        ("high", "5 kg", f"high: expected a number, not text '5 kg'{UNITS}"),
        ("step", "[1, 2, x]", f"step: expected a number, not text 'x'{UNITS}"),
    ],
)
def test_wrong_value_of_a_parameter_is_one_error_with_its_name_and_unit(
    name: str, value: str, message: str
) -> None:
    """A robot '{?robot}' was not in the catalog either, and the field of a pose had no owner."""
    problems = check(PARAMETERS, Registry.load().kinds, {name: value}).problems
    assert [problem.message for problem in problems] == [f"parameter {message}"]


@pytest.mark.parametrize(
    ("tree", "message"),
    [
        ("{look_at: {at: {above: peg, by: 0.2}, direction: [0, 0, 0]}}", ZERO),
        ("{grasp: {object: peg, approach: [0, 0, 0]}}", ZERO),
        ("{approach_and_attach: {object: peg, direction: [0, 0, 0]}}", ZERO),
        ("{insert: {object: peg, at: {on: peg}, direction: [0, 0, 0]}}", ZERO),
        ("{move_until_contact: {direction: [0, 0, 1e-9]}}", ZERO),
        ("{force_above: {force: 20, direction: [0, 0, 0]}}", ZERO),
        ("{go_home: {skip_if: {force_above: {force: 9, direction: [0, 0, 0]}}}}", ZERO),
        (
            "{insert: {object: peg, into: peg, at: {xyz: [0.4, 0, 0.5]}}}",
            "insert: into: 'peg' cannot go into itself",
        ),
    ],
)
def test_target_that_no_run_can_have_is_an_error_of_the_check(tree: str, message: str) -> None:
    """The check found it fine, and the leaf failed with INVALID_TARGET."""
    assert any(message in found for found, _ in problems_of("tree", tree))
