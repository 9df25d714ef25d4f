"""Unused parameters and subtrees: a warning for each, once, where it is declared."""

from __future__ import annotations

from pathlib import Path
from textwrap import dedent

import pytest

from bt_dualarm.behaviors.load import check_file
from bt_dualarm.core.share import share_dir
from bt_dualarm.skill.registry import Registry
from tests.spec.writing import SKILLS, write

FILE = """
    bt_dualarm: 1
    params:
      number: {type: number, default: 1.0}
      text: {type: text, default: home}
      vector: {type: vector, default: [0, 0, 0.5]}
    subtrees:
      inner: {params: {p: {type: number, default: 1}}, tree: {log: "TEXT"}}
    world: {time_limit: WORLD}
    objects: {cube: {shape: box, size: [0.1, 0.1, 0.1], mass: OBJECT, pose: {xyz: POSE}}}
    arms:
      arm1:
        robot: ur5
        posture: POSTURE
        tree:
          sequence:
            - go: {to: {xyz: [0, 0, NESTED]}}
            - log: "MESSAGE"
            - subtree: {use: inner, params: {p: GIVEN}}
"""
UNUSED = {
    "WORLD": ("1", "number"),
    "OBJECT": ("1", "number"),
    "POSE": ("[0, 0, 0]", "vector"),
    "POSTURE": ("home", "text"),
    "NESTED": ("1", "number"),
    "MESSAGE": ("hello", "text"),
    "GIVEN": ("1", "number"),
}
"""For each place in the file: a text without a parameter, and the parameter that fits there."""


def warnings_of(folder: Path, **uses: str) -> list[str]:
    """Warnings of the file with a parameter in some places."""
    text = FILE.replace("TEXT", uses.pop("TEXT", "{p}"))
    for place, (plain, _) in UNUSED.items():
        text = text.replace(place, uses.get(place, plain))
    problems = check_file(write(folder, text), SKILLS)
    assert all(problem.severity == "warning" for problem in problems)
    return [problem.message for problem in problems]


def test_a_subtree_that_a_parameter_can_choose_is_used(tmp_path: Path) -> None:
    """Subtrees that are not chosen are not reported; one that is no choice is."""
    text = """
        bt_dualarm: 1
        params: {way: {type: text, default: high, choices: [high, low]}}
        subtrees: {high: {tree: {log: h}}, low: {tree: {log: l}}, other: {tree: {log: o}}}
        arms: {arm1: {robot: ur5, tree: {subtree: {use: "{way}"}}}}
    """
    problems = check_file(write(tmp_path, text), SKILLS)
    assert [problem.message for problem in problems] == ["nothing uses the subtree 'other'"]


def test_every_unused_parameter_is_reported_where_it_is_declared(tmp_path: Path) -> None:
    assert warnings_of(tmp_path) == [
        f"nothing uses the parameter '{name}'" for name in ("number", "text", "vector")
    ]
    (first, *_) = check_file(tmp_path / "task.yaml", SKILLS)
    assert (first.place.line, first.place.column) == (3, 3)


@pytest.mark.parametrize("place", UNUSED)
def test_one_use_anywhere_is_enough(place: str, tmp_path: Path) -> None:
    name = UNUSED[place][1]
    use = f"at {{{name}}}" if place == "MESSAGE" else f'"{{{name}}}"'
    others = {"number", "text", "vector"} - {name}
    assert warnings_of(tmp_path, **{place: use}) == [
        f"nothing uses the parameter '{other}'" for other in sorted(others)
    ]


def test_a_subtrees_parameter_is_used_within_it_and_not_outside(tmp_path: Path) -> None:
    given = {"MESSAGE": "{number} {text} {vector}"}
    assert warnings_of(tmp_path, **given) == []
    assert warnings_of(tmp_path, **given, TEXT="hello") == ["nothing uses the parameter 'p'"]


def test_a_name_within_a_subtree_is_not_the_files_parameter(tmp_path: Path) -> None:
    file = """
        bt_dualarm: 1
        params: {p: {type: number, default: 1}}
        subtrees: {inner: {params: {p: {type: number, default: 2}}, tree: {log: "{p}"}}}
        arms: {arm1: {robot: ur5, tree: {subtree: {use: inner}}}}
    """
    (problem,) = check_file(write(tmp_path, file), SKILLS)
    assert (problem.message, problem.place.line) == ("nothing uses the parameter 'p'", 2)


SUBTREES = """
    bt_dualarm: 1
    subtrees:
      used: {tree: {sequence: [{subtree: {use: inner, params: {out: "{x}"}}}, {log: "{x}"}]}}
      inner: {params: {out: {type: key}}, tree: {set: {key: out, value: 1}}}
      forgotten: {tree: succeed}
"""


def test_a_subtree_is_used_by_an_arm_and_a_key_without_braces(tmp_path: Path) -> None:
    arms = "\n    arms: {arm1: {robot: ur5, tree: {subtree: {use: used}}}}\n"
    (problem,) = check_file(write(tmp_path, dedent(SUBTREES) + dedent(arms)), SKILLS)
    assert problem.message == "nothing uses the subtree 'forgotten'"
    assert problem.place.line == 5


def test_subtrees_of_a_file_without_arms_count_as_used(tmp_path: Path) -> None:
    assert check_file(write(tmp_path, SUBTREES), SKILLS) == ()
    unused = SUBTREES.replace("key: out", "key: other")
    messages = [problem.message for problem in check_file(write(tmp_path, unused), SKILLS)]
    assert messages == ["nothing uses the parameter 'out'"]


@pytest.mark.parametrize("path", sorted(share_dir("trees").rglob("*.yaml")), ids=lambda p: p.stem)
def test_shipped_trees_use_what_they_declare(path: Path) -> None:
    assert [str(p) for p in check_file(path, Registry.load().kinds) if "uses" in p.message] == []
