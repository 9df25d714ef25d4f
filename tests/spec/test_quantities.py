"""Quantities as text: accepted wherever a number with a unit is expected, and nowhere else."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jsonschema
import pytest

import bt_dualarm
from bt_dualarm.behaviors.language import LANGUAGE
from bt_dualarm.behaviors.load import load
from bt_dualarm.runtime.file_check import check
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.node_types import QUANTITY_PATTERN, NodeType
from bt_dualarm.spec.reference import json_schema
from bt_dualarm.spec.yaml_reader import read_text

TREE = """\
bt_dualarm: 1
params: {d: {type: number, default: 0.05, unit: m}}
world: {scene: empty}
objects:
  box: {shape: box, size: [4 cm, "40mm", 0.04], mass: 100 g, pose: {xyz: [-30 cm, "-40 cm", 0.02]}}
arms:
  arm1:
    robot: ur5
    base: {xyz: [0, 0, 40 cm], rpy: [0, 0, "-0.5 rad"]}
    tree:
      sequence:
        - reach_to_pose: {offset: {xyz: ["-3 cm", 0, "+2 cm"], rpy: ["-10 deg", 0, 0]}}
        - reach_to_pose: {offset: {xyz: [-3 cm, "{d}", "{d} - 1 cm"]}}
        - circle: {plane: yz, radius: 5 cm}
        - follow_path: {points: [[0, 0], [0, 9]], tool_speed: 0.1 m/s}
        - log: 3 cm
        - set: {key: k, value: 3 cm}
        - log: "{k}"
"""


@pytest.fixture(scope="module")
def skills() -> Mapping[str, NodeType]:
    return Registry.load().kinds


def test_a_quantity_is_converted_to_the_unit_of_its_field(
    skills: Mapping[str, NodeType],
) -> None:
    """In objects, arms and ports; beside keys; minus signs with and without quotes."""
    loaded = load(TREE, skills)
    file = loaded.file
    assert file is not None, loaded.problems
    box = file.objects["box"]
    assert box.size == pytest.approx((0.04, 0.04, 0.04))
    assert box.mass == pytest.approx(0.1)
    assert box.pose is not None
    assert box.pose.xyz == pytest.approx((-0.3, -0.4, 0.02))
    arm = file.arms["arm1"]
    assert arm.base.xyz == pytest.approx((0, 0, 0.4))
    assert arm.base.rpy == pytest.approx((0, 0, -28.6478898))
    move, beside_keys, circle, path, log, written, _ = arm.tree.children
    assert move.ports["offset"]["xyz"] == pytest.approx([-0.03, 0, 0.02])
    assert move.ports["offset"]["rpy"] == [-10, 0, 0]
    assert beside_keys.ports["offset"]["xyz"] == pytest.approx([-0.03, 0.05, 0.04])
    assert circle.ports["radius"] == pytest.approx(0.05)
    assert path.ports["tool_speed"] == pytest.approx(0.1)
    # Text remains text.
    assert log.ports["message"] == "3 cm"
    assert written.ports["value"] == "3 cm"


@pytest.mark.parametrize(
    ("wrong", "expected"),
    [
        ("radius: 5 s", "radius: expected a number, not text '5 s'"),
        ("radius: 5 kg", "radius: expected a number, not text '5 kg'"),
        ("radius: -5 cm", "radius: must be"),
        ("radius: 5 - cm", "radius: expected a number"),
        ("radius: 5 CM", "in meters: 0.05"),
        ("radius: 5 inch", "in meters, or with a unit: mm, cm, m"),
    ],
)
def test_another_quantity_or_a_number_out_of_range_is_an_error(
    wrong: str, expected: str, skills: Mapping[str, NodeType]
) -> None:
    loaded = load(TREE.replace("radius: 5 cm", wrong), skills)
    assert loaded.file is None
    assert any(expected in str(problem) for problem in loaded.problems)


def test_a_subtree_that_no_tree_uses_is_accepted_too(skills: Mapping[str, NodeType]) -> None:
    subtree = "subtrees: {s: {tree: {circle: {plane: yz, radius: 5 cm}}}}\n"
    assert load(TREE + subtree, skills).file is not None


def test_a_scene_has_numbers_with_a_unit(tmp_path: Path, skills: Mapping[str, NodeType]) -> None:
    (tmp_path / "cell.yaml").write_text(
        "bt_dualarm_scene: 1\nfixtures:\n"
        "  wall: {shape: box, size: [2 cm, 1, 1], pose: {xyz: [-80 cm, 0, 0.5]}}\n",
        encoding="utf-8",
    )
    text = TREE.replace("scene: empty", "scene: cell.yaml")
    loaded = load(text, skills, folder=tmp_path)
    assert loaded.file is not None, loaded.problems
    wall = loaded.file.objects["wall"]
    assert wall.size == pytest.approx((0.02, 1, 1))
    assert wall.pose is not None
    assert wall.pose.xyz[0] == pytest.approx(-0.8)


def test_the_schema_for_editors_accepts_quantities(skills: Mapping[str, NodeType]) -> None:
    schema: Any = json_schema({**LANGUAGE, **skills})
    jsonschema.validate(read_text(TREE, "tree.yaml").data, schema)


@pytest.mark.parametrize(
    "value", ["50 mm", "50 MM", "5 Mm", " +5.cm ", "0.05 M", "0.05 m/s", "30 Hz", "5 deg"]
)
def test_the_schema_for_editors_agrees_about_units(
    value: str, skills: Mapping[str, NodeType]
) -> None:
    """What the check accepts, an editor accepts; a unit in the wrong case is accepted by none."""
    text = TREE.replace("radius: 5 cm", f'radius: "{value}"')
    is_valid = load(text, skills).file is not None
    schema: Any = json_schema({**LANGUAGE, **skills})
    data = read_text(text, "tree.yaml").data
    assert is_valid == (value.strip() in ("50 mm", "+5.cm"))
    assert jsonschema.Draft202012Validator(schema).is_valid(data) or not is_valid
    assert bool(re.search(QUANTITY_PATTERN, value)) != (value in ("50 MM", "5 Mm", "0.05 M"))


PARAMETERS_TREE = """\
bt_dualarm: 1
params:
  h: {type: number, default: 5 cm, unit: m, range: [0, 0.2]}
  v: {type: vector, default: [1 cm, 0, 0.02], unit: m}
subtrees:
  lift: {params: {by: {type: number, default: 1, unit: m}}, tree: {log: "{by}"}}
world: {scene: empty}
arms:
  arm1:
    robot: ur5
    tree:
      sequence:
        - log: "{h} {v}"
        - subtree: {use: lift, params: {by: 3 cm}}
"""


@pytest.mark.parametrize(
    ("given", "logged"),
    [({}, "0.05 [0.01,0,0.02]"), ({"h": "8cm", "v": "[2 cm, 0, 1mm]"}, "0.08 [0.02,0,0.001]")],
)
def test_values_of_parameters_with_a_unit(given: Mapping[str, object], logged: str) -> None:
    loaded = load(PARAMETERS_TREE, params=given)
    assert loaded.file is not None, loaded.problems
    first, second = loaded.file.arms["arm1"].tree.children
    assert str(first.ports["message"]).replace(" ", "") == logged.replace(" ", "")
    assert second.children[0].ports["message"] == "0.03"


@pytest.mark.parametrize("given", ["5 s", "50 cm", "5"])
def test_values_of_another_unit_or_beyond_the_range_are_refused(given: str) -> None:
    loaded = load(PARAMETERS_TREE, params={"h": given})
    assert loaded.file is None
    assert "parameter h: " in str(loaded.problems[0])


SPELLINGS_TREE = """\
bt_dualarm: 1
params:
  pose: {type: pose, default: {xyz: [0.4, 0, 0.3], rpy: [180, 0, 0]}}
  time: {type: duration, default: 1, range: [0, 10]}
  size: {type: number, default: 0.05, unit: m, range: [0, 0.1]}
world:
  scene: empty
  reality: {links: {center: 0.001}, camera: {rotation: {normal: 0.5}, stamp: 0.002}}
objects:
  cabinet:
    shape: compound
    fixed: true
    pose: {xyz: [2, 0, 0.1]}
    parts:
      box: {shape: box, size: [0.1, 0.1, 0.1]}
      front: {shape: box, size: [0.1, 0.1, 0.1], pose: {xyz: [0, 0.2, 0]}}
      door: {shape: box, size: [0.1, 0.1, 0.1], pose: {xyz: [0, -0.2, 0]}}
    joints:
      slide: {type: slide, parts: [front], axis: [0, 1, 0], range: [0, 0.3], at: 0.1, rest: 0.01}
      hinge: {type: hinge, parts: [door], range: [0, 90], at: 45}
arms:
  arm1:
    robot: panda
    locked: {panda_finger_joint1: 0.04}
    tree:
      sequence:
        - reach_to_pose: {to: "{pose}"}
        - wait: "{time}"
        - circle: {plane: yz, radius: "{size}"}
        - set: {key: length, value: 0.02}
        - circle: {plane: yz, radius: "{length}"}
        - for_each: {items: [0.01, 0.02], item: r, child: {circle: {plane: yz, radius: "{r}"}}}
        - joint_at: {object: cabinet, joint: slide, between: [0, 0.2]}
        - joint_at: {object: cabinet, joint: hinge, above: 30}
goal:
  open: {object: cabinet, joint: slide, between: [0, 0.2]}
"""


@pytest.mark.parametrize(
    ("number", "quantity"),
    [
        ("default: {xyz: [0.4,", "default: {xyz: [40 cm,"),
        ("rpy: [180,", "rpy: [180 deg,"),
        ("range: [0, 10]", "range: [0, 10 s]"),
        ("range: [0, 0.1]", "range: [0, 10 cm]"),
        ("center: 0.001", "center: 1 mm"),
        ("normal: 0.5", "normal: 0.5 deg"),
        ("stamp: 0.002", "stamp: 2 ms"),
        ("range: [0, 0.3]", "range: [0, 30 cm]"),
        ("at: 0.1,", "at: 10 cm,"),
        ("rest: 0.01", "rest: 1 cm"),
        ("range: [0, 90], at: 45", "range: [0 deg, 90 deg], at: 45 deg"),
        ("panda_finger_joint1: 0.04", "panda_finger_joint1: 4 cm"),
        ("slide, between: [0, 0.2]", "slide, between: [0 cm, 20 cm]"),
        ("above: 30", "above: 30 deg"),
        ("value: 0.02", "value: 2 cm"),
        ("items: [0.01,", "items: [1 cm,"),
    ],
)
def test_every_number_with_a_unit_may_have_it(number: str, quantity: str) -> None:
    """Also in parameters, distributions and positions of joints, and by way of the blackboard."""
    assert number in SPELLINGS_TREE
    kinds = Registry.load().kinds
    text = SPELLINGS_TREE.replace(number, quantity)
    plain, spelled = (check(one, kinds, {}, build=False) for one in (SPELLINGS_TREE, text))
    assert not spelled.problems
    assert plain.file is not None
    assert spelled.file is not None
    assert spelled.file.world == plain.file.world
    assert spelled.file.goal == plain.file.goal
    for name, obj in plain.file.objects.items():
        other = spelled.file.objects[name]
        assert other.model_dump() == obj.model_dump()
        assert (other.joint and other.joint.spec) == (obj.joint and obj.joint.spec)
    assert spelled.file.arms["arm1"].locked == plain.file.arms["arm1"].locked
    first = [file.arms["arm1"].tree.children[0] for file in (plain.file, spelled.file)]
    assert first[0].ports == first[1].ports
    schema: Any = json_schema({**LANGUAGE, **kinds})
    jsonschema.validate(read_text(text, "tree.yaml").data, schema)


@pytest.mark.parametrize(
    ("right", "wrong", "message"),
    [
        ("range: [0, 0.3]", "range: [0, 30 deg]", "range: the joint slides"),
        ("at: 45", "at: 4 cm", "at: the joint turns"),
        ("joint1: 0.04", "joint1: 4 deg", "the joint slides: its positions are lengths"),
        ("above: 30", "above: 3 cm", "joint_at: above: the joint turns: its positions are angles"),
        (
            "joint_at: {object: cabinet, joint: slide, between: [0, 0.2]}",
            "grasp: {object: cabinet, part: front, then_to: 20 deg}",
            "grasp: then_to: the joint slides",
        ),
        (
            "joint_at: {object: cabinet, joint: slide, between: [0, 0.2]}",
            "operate: {object: cabinet, joint: hinge, to: 20 cm}",
            "operate: to: the joint turns",
        ),
        ("open: {object: cabinet, joint: slide, between: [0, 0.2]}",
         "open: {object: cabinet, joint: slide, between: [0, 2 deg]}", "the joint slides"),
    ],
)  # fmt: skip
def test_a_position_of_a_joint_has_the_unit_of_its_kind(
    right: str, wrong: str, message: str
) -> None:
    assert right in SPELLINGS_TREE
    text = SPELLINGS_TREE.replace(right, wrong)
    problems = check(text, Registry.load().kinds, {}, build=False).problems
    assert any(message in str(problem) for problem in problems), problems


def test_a_quantity_on_the_blackboard_is_converted_where_it_is_read() -> None:
    tree = """\
bt_dualarm: 1
arms:
  arm1:
    robot: ur5
    tree:
      sequence:
        - set: {key: step, value: {xyz: [0, 0, -2 cm]}}
        - reach_to_pose: {offset: "{step}"}
        - set: {key: radius, value: 2 cm}
        - circle: {plane: yz, radius: "{radius}"}
"""
    assert bt_dualarm.run(tree).outcome == "SUCCESS"
