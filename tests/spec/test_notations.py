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
        ("tree", "{carry_together: {object: peg, with: b}}", "as a list: [b]"),
        ("reality", "{rough: true}", "write set: rough"),
        ("tree", "{circle: {yz: 0.1}}", "write plane: yz"),
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


WORDS = """\
bt_dualarm: 1
params: {{r: {{type: number, default: 0.05}}, n: {{type: integer, default: 3}}}}
subtrees:
  ring:
    params: {{radius: {{type: number, range: [0.01, 0.1]}}}}
    tree: {{circle: {{radius: "{{radius}}"}}}}
  turn: {{params: {{to: {{type: pose}}}}, tree: {{reach_to_pose: {{to: "{{to}}"}}}}}}
arms: {{arm1: {{robot: z1, tree: {{sequence: [{{go_home: {{speed: "{{r}} * {{n}}"}}}}, {node}]}}}}}}
"""


@pytest.mark.parametrize(
    ("node", "message", "hint"),
    [
        ("{circle: {radius: r * 2}}", "text 'r * 2'", 'as an expression: "{r} * 2"'),
        ("{circle: {radius: '{r'}}", "text '{r'", "a key or a parameter begins and ends with"),
        ("{circle: {radius: '${r}'}}", "'$' is not allowed", "a key or a parameter is written w"),
        ("{circle: {radius: '{{r}}'}}", "'{' is not allowed", "a key or a parameter has single b"),
        ("{wait: '{n} ms'}", "there is no name 'ms'", "a unit follows a number: 1 ms"),
        ("{wait: '1,5 s'}", "not '1,5 s' (did you mean '1.5 s'?)", ""),
        ("{wait: 90 sec}", "not '90 sec' (did you mean '90 s'?)", ""),
        ("{test: '{n} is 3'}", "'is' is not allowed in an expression", "write == to compare"),
        (
            "{for_each: {in: [1], item: c, child: {wait: 1}}}",
            "unknown port 'in'",
            "here it is 'items'",
        ),
        (
            "{while: {condition: true, child: {wait: 1}}}",
            "a node, not true",
            "as a condition: {test",
        ),
        ("{ring: {radius: 0.05}}", "no node or skill 'ring'", "it is a subtree: subtree: {use: r"),
        ("{subtree: {use: ring, params: {radius: 5}}}", "radius: must be at most 0.1, not 5", ""),
        ("{subtree: {use: turn, params: {to: home}}}", "to: expected a mapping, not text 'h", ""),
    ],
)
def test_words_and_signs_of_other_languages_have_one_error_with_ours(
    node: str, message: str, hint: str
) -> None:
    """A wrong value of a subtree's parameter was an error where it is used, too."""
    [problem] = check(WORDS.format(node=node), Registry.load().kinds).problems
    assert message in problem.message
    assert problem.hint.startswith(hint)


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
        ("{locate: {shape: box, color: red}}", "locate: a shape needs its size and color"),
        (
            "{locate: {shape: box, size: [0.05], color: red}}",
            "locate: the size of a box has 3 numbers, not 1",
        ),
        (
            "{insert: {object: peg, into: peg, at: {xyz: [0.4, 0, 0.5]}}}",
            "insert: into: 'peg' cannot go into itself",
        ),
    ],
)
def test_target_that_no_run_can_have_is_an_error_of_the_check(tree: str, message: str) -> None:
    """The check found it fine, and the leaf failed with INVALID_TARGET."""
    assert any(message in found for found, _ in problems_of("tree", tree))
