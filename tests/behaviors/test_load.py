"""Whole tree files: good ones are loaded, bad ones are refused with all problems at once."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from textwrap import dedent
from typing import Any, TypeAlias

import pytest

from bt_dualarm.behaviors.load import check_file, load_tree_file
from bt_dualarm.spec.node_types import NodeType, PortModel, port
from bt_dualarm.spec.problems import SpecError
from bt_dualarm.spec.values import ArmName, ObjectName, PoseSpec, Speed

GOOD = """
    bt_dualarm: 1
    params:
      speed: {type: number, default: 0.5, range: [0.1, 1], description: How fast}
      height: {type: number, default: 0.3}
      seed: {type: integer, default: 7}
      target: {type: object, default: cube}
    world: {scene: table, seed: "{seed}"}
    objects:
      cube: {shape: box, size: [0.05, 0.05, 0.05], mass: 0.1, color: yellow,
             pose: {xyz: [0.4, -0.5, 0.025]}, noise: {xyz: [0.1, 0, 0], yaw: 10}}
    arms:
      arm1:
        robot: ur5
        base: {xyz: [0, 0, "{height}"], rpy: [0, 0, 90]}
        camera: {mount: {xyz: [1, 0, 1], look_at: [0, 0, 0]}, fov: 60, latency: 40 ms}
        tree:
          sequence:
            - grasp: {object: "{target}", speed: "{speed}", name: pick it}
            - move: {to: {xyz: [0.4, 0, "{height}"]}}
            - wait: 500 ms
            - succeed
"""


class Grasp(PortModel):
    object: ObjectName = port(..., "What to take")
    speed: Speed = port(1.0, "How fast")
    helper: ArmName | None = port(None, "Who helps")


class Move(PortModel):
    to: PoseSpec = port(..., "Where to")


Write: TypeAlias = Callable[[str], Path]

SKILLS = {"grasp": NodeType("grasp", "Takes.", Grasp), "move": NodeType("move", "Moves.", Move)}


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def written(text: str) -> Path:
        path = tmp_path / "task.yaml"
        path.write_text(dedent(text).lstrip("\n"))
        return path

    return written


def messages(path: Path, **params: str) -> list[str]:
    found = check_file(path, SKILLS, params)
    return [f"{p.place.line}:{p.place.column}: {p.message}" for p in found]


def test_good_file_is_loaded(write: Write) -> None:
    file = load_tree_file(write(GOOD), SKILLS)
    assert file.name == "task"
    assert file.world.seed == 7
    assert file.objects["cube"].rgba == (0.95, 0.85, 0.05, 1.0)
    assert file.objects["cube"].noise.yaw == 10
    arm = file.arms["arm1"]
    assert arm.base.pose.position.tolist() == [0, 0, 0.3]
    assert arm.camera is not None
    assert arm.camera.latency == 0.04
    assert arm.camera.fov_rad == pytest.approx(1.0472, abs=1e-4)
    grasp, move, wait, succeed = arm.tree.children
    assert (grasp.kind, grasp.name) == ("grasp", "pick it")
    assert grasp.ports == {"object": "cube", "speed": 0.5}
    assert move.ports == {"to": {"xyz": [0.4, 0, 0.3]}}
    assert wait.ports == {"seconds": "500 ms"}
    assert (succeed.kind, succeed.ports) == ("succeed", {})


def test_given_parameters_replace_defaults(write: Write) -> None:
    file = load_tree_file(write(GOOD), SKILLS, {"speed": "0.25", "height": "1e-1"})
    grasp, move, *_ = file.arms["arm1"].tree.children
    assert grasp.ports["speed"] == 0.25
    assert move.ports["to"] == {"xyz": [0.4, 0, 0.1]}


@pytest.mark.parametrize(
    ("params", "expected"),
    [
        ({"speed": "2"}, "parameter speed: must be at most 1, not 2"),
        ({"speed": "fast"}, "parameter speed: expected a number, not text 'fast'"),
        ({"sped": "1"}, "it has no parameter 'sped'"),
        ({"seed": "1.5"}, "parameter seed: expected a whole number, not 1.5"),
        ({"seed": "["}, "parameter seed: expected a whole number, not text '['"),
    ],
)
def test_bad_parameter_is_reported_once(
    params: dict[str, str], expected: str, write: Write
) -> None:
    """A bad parameter is reported once, not at every place that uses it."""
    (message,) = messages(write(GOOD), **params)
    assert message.endswith(expected)


def test_parameter_without_default_must_be_given(write: Write) -> None:
    text = GOOD.replace("height: {type: number, default: 0.3}", "height: {type: number}")
    assert "0:0: parameter 'height' must be given" in messages(write(text))
    load_tree_file(write(text), SKILLS, {"height": "0.2"})


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("bt_dualarm: 1", "bt_dualarm: 2", "1:13: version 2 of the format is not supported"),
        ("bt_dualarm: 1", "- {}", "2:1: not YAML"),
        ("scene: table", "scen: table", "7:9: unknown field 'scen'"),
        ("world:", "path: x.yaml\n    world:", "unknown field 'path'"),
        ("shape: box", "shape: bx", "9:17: shape: expected one of box, cylinder, capsule, sphere"),
        ("shape: box", "shape: sphere", "9:9: cube: the size of a sphere is [radius]"),
        ("mass: 0.1", "mass: 0", "mass: must be at least 0.0001 kg, not 0"),
        ("color: yellow", "color: [1, 0]", "color: expected at least 3 items, not 2"),
        ("robot: ur5", "rboot: ur5", "13:5: unknown field 'rboot'"),
        ("object: \"{target}\"", "object: cub", "grasp: there is no object 'cub'"),
        ("object: \"{target}\"", "helper: arm2, object: cube", "grasp: there is no arm 'arm2'"),
        ("speed: \"{speed}\"", "sped: 1", "18:39: grasp: unknown port 'sped'"),
        ("speed: \"{speed}\"", "speed: 2", "grasp: speed: must be at most 1, not 2"),
        ("speed: \"{speed}\"", "speed: {speed}", "expected a number, not a mapping"),
        ("object: \"{target}\", ", "", "18:11: grasp: port 'object' is missing"),
        ("- grasp:", "- grap:", "18:11: there is no node or skill 'grap'"),
        ("\"{height}\"]}}", "\"{hight}\"]}}", "move: no node before this one writes '{hight}'"),
        ("name: pick it", "name: a/b", "name: text 'a/b' cannot be a node's name"),
        ("- succeed", "- sequence: []", "21:11: sequence: has no children"),
        ("- succeed", "- retry: {times: 2}", "21:11: retry: 'child' is missing"),
        ("- succeed", "- [succeed]", "21:11: expected a node, not a list of 1"),
        ("- succeed", "- a: 1\n              b: 2", "21:11: a node has one key"),
        ("- succeed", "- set: {key: 'a b', value: 1}", "key: text 'a b' cannot be a key"),
        ("- succeed", "- compare: {value: '{}', to: 1}", "'{}' is not a reference to a key"),
        ("cube:", "arm1:", "9:3: 'arm1' is the name of an object and of an arm: rename one"),
        ("range: [0.1, 1]", "range: [1, 0.1]", "speed: the range goes from 1 down to 0.1"),
        ("default: 0.5", "default: 5", "3:34: default of speed: must be at most 1, not 5"),
        ("type: integer", "type: int", "type: expected one of"),
    ],
)  # fmt: skip
def test_mistake_is_reported_with_its_place(
    old: str, new: str, expected: str, write: Write
) -> None:
    assert old in GOOD
    found = messages(write(GOOD.replace(old, new, 1)))
    assert any(expected in message for message in found), found


def test_every_object_with_the_name_of_an_arm_is_reported(write: Write) -> None:
    """One of a group is reported at its entry."""
    text = """
    bt_dualarm: 1
    objects:
      left: {shape: box, size: [0.1, 0.1, 0.1], mass: 1, pose: {xyz: [1, 0, 0.05]}}
      part: {shape: sphere, size: [0.02], mass: 1, many: {grid: [2, 1], spacing: [0.1, 0.1]}}
    arms:
      part2: {robot: ur5, tree: {wait: 1}}
      left: {robot: ur5, tree: {wait: 1}}
    """
    clash = "is the name of an object and of an arm: rename one"
    assert messages(write(text)) == [f"3:3: 'left' {clash}", f"4:3: 'part2' {clash}"]


def test_all_problems_are_reported_at_once_in_order(write: Write) -> None:
    text = GOOD.replace("robot: ur5", "robot: 5").replace("- grasp:", "- grap:")
    text = text.replace("mass: 0.1", "mass: heavy").replace("500 ms", "1 week")
    with pytest.raises(SpecError) as caught:
        load_tree_file(write(text), SKILLS)
    assert len(caught.value.problems) == 4
    lines = [problem.place.line for problem in caught.value.problems]
    assert lines == sorted(lines)


def test_without_skills_leaves_are_not_checked(write: Write) -> None:
    load_tree_file(write(GOOD.replace("- grasp:", "- unheard_of:")))
    with pytest.raises(SpecError):
        load_tree_file(write(GOOD.replace("wait: 500 ms", "wait: -1")))


@pytest.mark.parametrize(
    "text",
    [
        "[]",
        "3",
        "bt_dualarm: 1",
        "bt_dualarm: 1\narms: 3",
        "bt_dualarm: 1\narms: {a: 3}",
        "bt_dualarm: 1\narms: {}",
        "bt_dualarm: true\narms: {a: {robot: ur5, tree: {}}}",
    ],
)
def test_file_without_a_task_is_refused(text: str, write: Write) -> None:
    with pytest.raises(SpecError):
        load_tree_file(write(text), SKILLS)


def test_problems_name_the_file_as_given(write: Write, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write("bt_dualarm: 1")
    monkeypatch.chdir(path.parent)
    assert str(check_file("task.yaml")[0]).startswith("task.yaml:1:1: error: ")


@pytest.mark.parametrize("given", [0, 1, 2, 3, 4, 5, 17, 201, 1000])
@pytest.mark.parametrize(
    ("part", "least", "most", "noun"),
    [
        ("arms", 1, 16, "item"),
        ("objects", 0, 200, "item"),
        ("size", 1, 3, "item"),
        ("xyz", 3, 3, "item"),
        ("color", 3, 4, "item"),
        ("name", 1, 100, "character"),
    ],
)
def test_wrong_number_of_items_is_reported(
    part: str, least: int, most: int, noun: str, given: int
) -> None:
    """The message has the number of items, although pydantic stops counting at the limit."""
    ball = {"shape": "box", "size": [0.1, 0.1, 0.1], "mass": 1}
    arm = {"robot": "ur5", "tree": "succeed"}
    data = {"bt_dualarm": 1, "objects": {"ball": ball}, "arms": {"arm1": arm}}
    of = {"arms": data, "objects": data, "size": ball, "color": ball, "name": data}
    many = {"arms": {f"a{i}": arm for i in range(given)}, "name": "x" * given}
    many["objects"] = {f"o{i}": dict(ball) for i in range(given)}
    holder: Any = ball.setdefault("pose", {}) if part == "xyz" else of[part]
    holder[part] = many.get(part, [0.5] * given)
    messages = [problem.message for problem in check_file(data)]
    if part == "size" and given == 0:
        assert "ball: a box needs size: [x, y, z]" in messages
        return
    if least <= given <= most:
        assert not [message for message in messages if "expected" in message]
        return
    bound = f"at least {least}" if given < least else f"at most {most}"
    number = least if given < least else most
    expected = str(number) if least == most else bound
    assert f"{part}: expected {expected} {noun}{'s' * (number != 1)}, not {given}" in messages


@pytest.mark.parametrize(
    ("text", "kind", "key"),
    [
        ("bt_dualarm_scene: 1\nfixtures: {}\n", "a scene", "scene"),
        ("title: Arm\nurdf: arm.urdf\n", "a robot", "robot"),
        ("title: Hand\nurdf: hand.urdf\npalm: hand\n", "a gripper", "gripper"),
    ],
)
def test_file_of_another_type_is_reported_as_such(text: str, kind: str, key: str) -> None:
    """Such a file used to give a page of errors about unknown fields."""
    (found,) = check_file(text)
    assert found.message == f"this file describes {kind}, not a tree"
    assert f"{key}: FILE" in found.hint
