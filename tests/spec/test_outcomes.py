"""Warnings about trees that are allowed but hardly intended."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from bt_dualarm.behaviors.language import LANGUAGE
from bt_dualarm.behaviors.load import check_file
from bt_dualarm.spec.checks import outcomes_in
from bt_dualarm.spec.node_types import Outcomes
from tests.spec.writing import SKILLS, messages_of, task, tree_of

ENDS = {
    "succeed": "S",
    "fail": "F",
    "look": "SF",
    "wait: 1": "S",
    "sequence: [succeed, {wait: 1}]": "S",
    "sequence: [look, fail]": "F",
    "sequence: [look, {repeat: {times: forever, child: succeed}}]": "F",
    "selector: [look, succeed]": "S",
    "selector: [fail, fail]": "F",
    "parallel: [look, {wait: 1}]": "SF",
    "parallel: {policy: 1, on_failure: continue, children: [succeed, fail]}": "S",
    "parallel: {policy: any, children: [succeed, fail]}": "SF",
    "inverter: {child: fail}": "S",
    "force_success: {child: look}": "S",
    "force_failure: {child: look}": "F",
    "repeat: {times: forever, child: succeed}": "",
    "repeat: {times: forever, child: look}": "F",
    "force_success: {child: {repeat: {times: forever, child: succeed}}}": "",
    "timeout: {seconds: 1, child: {repeat: {times: forever, child: succeed}}}": "F",
    "if: {condition: look, then: fail}": "SF",
    "if: {condition: look, then: succeed, else: {wait: 1}}": "S",
    "while: {condition: succeed, child: succeed}": "",
    "while: {condition: look, child: succeed}": "S",
    "guard: {condition: look, child: succeed}": "SF",
    "switch: {value: 1, cases: {a: succeed}, default: succeed}": "S",
    "switch: {value: 1, cases: {a: succeed}}": "SF",
    "retry: {times: 2, child: look}": "SF",
}


@pytest.mark.parametrize("tree", ENDS)
def test_possible_outcomes_of_a_node(tree: str, tmp_path: Path) -> None:
    root = tree_of(task(tmp_path, tree))
    assert outcomes_in(root, LANGUAGE)[root] == Outcomes("S" in ENDS[tree], "F" in ENDS[tree])


WARNINGS = {
    "sequence: [look, fail, look]": ["unreachable: 'fail' before it always fails"],
    "selector: [look, {log: hi}, look]": ["unreachable: 'log' before it cannot fail"],
    "sequence: [{repeat: {times: forever, child: {wait: 1}}}, look]": [
        "unreachable: 'repeat' before it never ends"
    ],
    "if: {condition: succeed, then: look, else: look}": ["unreachable: 'succeed' always holds"],
    "if: {condition: fail, then: look}": ["unreachable: 'fail' never holds"],
    "guard: {condition: fail, child: look}": ["unreachable: 'fail' never holds"],
    "retry: {times: 1, child: look}": ["retry with times: 1 has no effect"],
    "repeat: {times: 1, child: look}": ["repeat with times: 1 has no effect"],
    "retry: {times: 3, child: {wait: 1}}": ["retry has no effect: 'wait' cannot fail"],
    "repeat: {times: 3, child: fail}": ["repeat has no effect: 'fail' cannot succeed"],
    "force_success: {child: {log: hi}}": ["force_success has no effect: 'log' cannot fail"],
    "force_failure: {child: fail}": ["force_failure has no effect: 'fail' cannot succeed"],
    "inverter: {child: {inverter: {child: look}}}": ["two nested inverters have no effect"],
    "parallel: [look]": ["a parallel of one child has no effect"],
    "sequence: [look, {retry: {times: 2, child: look}}]": [],
    "selector: [look, fail]": [],
}


@pytest.mark.parametrize("tree", WARNINGS)
def test_warnings(tree: str, tmp_path: Path) -> None:
    assert messages_of(task(tmp_path, tree)) == [f"w: {message}" for message in WARNINGS[tree]]


def test_until_that_waits_before_its_child_starts(tmp_path: Path) -> None:
    """The child never ran: `until` starts it when it knows that its condition does not hold."""
    cell = "cell: {signals: {done: {type: boolean, written_by: [arm1], initial: false}}}\n"
    path = task(tmp_path, "sequence: [{look: {until: {await: done}}}, {signal: done}]", cell)
    assert messages_of(path) == [
        "w: unreachable: the child does not start while 'await' waits; to run both, write a "
        "parallel with policy: any"
    ]


def test_more_successes_than_children_is_an_error(tmp_path: Path) -> None:
    path = task(tmp_path, "parallel: {policy: 3, children: [look, look]}")
    assert messages_of(path) == ["e: parallel: policy: 3 of 2 cannot succeed"]


OBJECT = "objects: {cube: {shape: sphere, size: [0.1], mass: 1, spawned: false}}\n"


@pytest.mark.parametrize(
    ("tree", "expected"),
    [
        ("look: {object: cube}", ["w: look: 'cube' has spawned: false and no leaf spawns it"]),
        ("sequence: [{spawn: {object: cube}}, {look: {object: cube}}]", []),
        (
            "sequence: [{set: {key: o, value: cube}}, {spawn: {object: '{o}'}},"
            " {look: {object: cube}}]",
            [],
        ),
    ],
)
def test_objects_that_no_leaf_spawns(tree: str, expected: list[str], tmp_path: Path) -> None:
    assert messages_of(task(tmp_path, tree, OBJECT)) == expected


THERE = """objects: {cube: {shape: sphere, size: [0.1], mass: 1}}
faults: {gone: {kind: removed_object, object: NAME}}
"""
"""An object that is in the world from the start, and a fault that may remove it."""
SPAWNED_TWICE = ["w: spawn: 'cube' is in the world already: no leaf removes it before"]


@pytest.mark.parametrize(
    ("tree", "expected"),
    [
        ("{spawn: {object: cube}}", SPAWNED_TWICE),
        ("sequence: [{spawn: {object: cube}}, {remove: {object: cube}}]", SPAWNED_TWICE),
        ("sequence: [{remove: {object: cube}}, {spawn: {object: cube}}]", []),
        ("sequence: [{remove: {arm: arm1}}, {spawn: {object: cube}}]", SPAWNED_TWICE),
        ("sequence: [{set: {key: o, value: cube}}, {remove: {object: '{o}'}},"
         " {spawn: {object: cube}}]", []),
        ("parallel: [{spawn: {object: cube}}, {remove: {object: cube}}]", []),
        ("retry: {times: 2, child: {sequence: [{spawn: {object: cube}}, {remove: {object: cube}},"
         " look]}}", []),
        ("selector: [{spawn: {object: cube}}, look]", SPAWNED_TWICE),
        ("sequence: [{spawn: {object: cube}}, {spawn: {arm: arm1}}, {remove: {object: cube}}]",
         ["w: spawn: 'arm1' is in the world already: no leaf removes it before"]),
    ],
)  # fmt: skip
def test_what_is_there_is_spawned_in_vain(tree: str, expected: list[str], tmp_path: Path) -> None:
    """Only if no removal can come before: an arm that is spawned again runs its tree once more."""
    objects = THERE.partition("faults")[0]
    assert messages_of(task(tmp_path, tree, objects)) == expected


def test_what_another_arm_or_a_fault_removes_may_be_spawned(tmp_path: Path) -> None:
    path = task(tmp_path, "{spawn: {object: cube}}", THERE.replace("NAME", "cube"))
    assert messages_of(path) == []
    path = task(tmp_path, "{spawn: {object: cube}}", THERE.partition("faults")[0])
    with path.open("a") as file:
        file.write("  arm2: {robot: ur5, tree: {remove: {object: cube}}}\n")
    assert messages_of(path) == []


CHEST = """objects:
  cube: {shape: sphere, size: [0.1], mass: 1, spawned: false}
  chest:
    shape: compound
    fixed: true
    spawned: false
    parts: {rim: {shape: box, size: [1, 1, 1]}, lid: {shape: box, size: [1, 1, 0.1]}}
    joints: {hinge: {type: hinge, range: [0, 90], parts: [lid], mass: 1}}
"""


@pytest.mark.parametrize(
    ("brought", "expected"),
    [
        ("chest", []),
        ("cube", ["w: look: 'chest.hinge' has spawned: false and no leaf spawns it"]),
    ],
)
def test_a_part_on_a_joint_is_spawned_with_its_object(
    brought: str, expected: list[str], tmp_path: Path
) -> None:
    tree = f"sequence: [{{spawn: {{object: {brought}}}}}, {{look: {{object: chest.hinge}}}}]"
    assert messages_of(task(tmp_path, tree, CHEST)) == expected


@pytest.mark.parametrize("name", ["spawn", "bring", "unpack"])
@pytest.mark.parametrize("brings", [True, False])
def test_a_skill_spawns_what_it_declares(name: str, brings: bool, tmp_path: Path) -> None:
    """Whatever its name: the check knows no skill by its name."""
    kind = replace(SKILLS["spawn"], name=name, brings_in=frozenset({"object"} if brings else ()))
    tree = f"sequence: [{{{name}: {{object: cube}}}}, {{look: {{object: cube}}}}]"
    problems = check_file(task(tmp_path, tree, OBJECT), {**SKILLS, name: kind})
    assert bool(problems) is not brings


_NEVER = "never holds an object: nothing in its tree takes one"
_YET = "holds no object yet: 'take' comes later"


def _no_more(leaf: str) -> str:
    return f"holds nothing any more: '{leaf}' has let go of it before"


@pytest.mark.parametrize(
    ("tree", "why"),
    [
        ("sequence: [look, place]", _NEVER),
        ("sequence: [look, look]", ""),
        ("sequence: [place, take]", _YET),
        ("sequence: [{timeout: {seconds: 9, child: place}}, take]", _YET),
        ("sequence: [{selector: [place, look]}, take]", _YET),
        ("selector: [{sequence: [look, take]}, place]", ""),
        ("sequence: [take, place, place]", _no_more("place")),
        ("sequence: [take, {retry: {times: 2, child: free}}, look, place]", _no_more("free")),
        ("sequence: [take, {repeat: {times: 2, child: place}}]", ""),
        ("sequence: [take, free, {selector: [look, place]}]", _no_more("free")),
        ("sequence: [take, free, {selector: [take, look]}, place]", ""),
        ("sequence: [take, {force_success: place}, place]", ""),
        ("sequence: [take, {selector: [place, look]}, place]", ""),
        ("sequence: [take, {skip_if: {condition: holding, child: free}}, place]", ""),
        ("sequence: [take, free, attach, place]", ""),
    ],
)
def test_an_arm_that_needs_a_held_object_but_holds_none(
    tree: str, why: str, tmp_path: Path
) -> None:
    look = SKILLS["look"]
    hand = replace(look, needs_gripper=True)
    kinds = {
        **SKILLS,
        "place": replace(hand, name="place", needs_held=True, lets_go=True),
        "free": replace(hand, name="free", lets_go=True),
        "take": replace(hand, name="take", takes_hold=True),
        "attach": replace(look, name="attach", takes_hold=True),
        "holding": replace(look, name="holding"),
    }
    path = task(tmp_path, tree)
    path.write_text(path.read_text().replace("robot: ur5", "robot: ur5\n    gripper: robotiq_2f85"))
    warnings = [one.message for one in check_file(path, kinds) if "hold" in one.message]
    assert warnings == [f"place: arm1 {why}"] * bool(why)


def test_an_arm_that_no_leaf_spawns(tmp_path: Path) -> None:
    path = task(tmp_path, "look")
    with path.open("a") as file:
        file.write("  arm2: {robot: ur5, spawned: false, tree: look}\n")
    assert messages_of(path) == [
        "w: arm 'arm2' has spawned: false and no leaf spawns it: its tree never starts"
    ]
