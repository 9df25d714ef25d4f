"""Subtrees and includes: typed parameters, scopes of their own, and no infinite recursion."""

from __future__ import annotations

from pathlib import Path

import pytest

from bt_dualarm.behaviors.load import check_file, load_tree_file
from bt_dualarm.spec.problems import SpecError
from tests.spec.writing import SKILLS, messages_of, task, tree_of, write

SUBTREES = """
    subtrees:
      pause:
        description: Waits, and says how long it took.
        params:
          time: {type: duration, default: 1, range: [0, 5], description: How long}
          label: {type: text}
          result: {type: key, default: null}
        tree:
          sequence:
            - set: {key: t, value: "{time}"}
            - log: "{label}: {t}"
            - wait: "{t}"
            - set: {key: result, value: "{t}"}
"""


def use(params: str) -> str:
    return f"sequence: [{{subtree: {{use: pause, params: {params}}}}}, {{log: '{{r}}'}}]"


def test_parameters_are_filled_in_and_keys_are_its_own(tmp_path: Path) -> None:
    root = tree_of(task(tmp_path, use('{label: hi, result: "{r}", time: 2 s}'), SUBTREES))
    subtree = root.children[0]
    assert (subtree.kind, subtree.name) == ("subtree", "pause")
    first, log, wait, last = subtree.children[0].children
    assert first.ports == {"key": "pause#1/t", "value": "2 s"}
    assert log.ports == {"message": "hi: {pause#1/t}"}
    assert wait.ports == {"seconds": "{pause#1/t}"}
    assert last.ports == {"key": "r", "value": "{pause#1/t}"}


def test_a_parameter_can_be_a_key(tmp_path: Path) -> None:
    tree = "sequence: [{set: {key: x, value: 3}}, " + use(
        '{label: hi, result: "{r}", time: "{x}"}'
    ).removeprefix("sequence: [")
    root = tree_of(task(tmp_path, tree, SUBTREES))
    assert root.children[1].children[0].children[0].ports["value"] == "{x}"


@pytest.mark.parametrize(
    ("params", "expected"),
    [
        ('{label: 3, result: "{r}"}', "e: label: expected text, not 3"),
        ('{label: a, result: "{r}", time: 6}', "e: time: must be at most 5 s, not 6"),
        ('{label: a, result: r}', "e: result: expected a blackboard key"),
        ('{result: "{r}"}', "e: subtree 'pause' needs its parameter 'label'"),
        ('{label: a, result: "{r}", tim: 1}', "e: subtree 'pause' has no parameter 'tim'"),
        ("3", "e: subtree: params: expected a mapping, not 3"),
    ],
)  # fmt: skip
def test_mistakes_in_a_use(params: str, expected: str, tmp_path: Path) -> None:
    assert expected in messages_of(task(tmp_path, use(params), SUBTREES))


def test_unknown_subtree(tmp_path: Path) -> None:
    path = task(tmp_path, "subtree: {use: paus}", SUBTREES)
    assert messages_of(path) == ["e: there is no subtree 'paus'"]
    assert check_file(path, SKILLS)[0].hint == "did you mean 'pause'?"


def test_a_subtree_that_a_parameter_names_is_called_by_its_name(tmp_path: Path) -> None:
    before = """
    params: {how: {type: text, default: slow}}
    subtrees: {slow: {tree: {wait: 2}}, fast: {tree: {wait: 1}}}
    """
    path = task(tmp_path, 'subtree: {use: "{how}"}', before)
    assert tree_of(path).name == "slow"
    assert load_tree_file(path, SKILLS, {"how": "fast"}).arms["arm1"].tree.name == "fast"


def test_keys_of_the_user_are_not_visible_inside(tmp_path: Path) -> None:
    before = 'subtrees: {inner: {tree: {wait: "{x}"}}}\n'
    path = task(
        tmp_path,
        "sequence: [{set: {key: x, value: 1}}, {subtree: {use: inner}}, {wait: '{x}'}]",
        before,
    )
    (problem,) = check_file(path, SKILLS)
    assert problem.message == "wait: no node before this one writes '{x}'"
    assert problem.hint.endswith(f"its own keys; the subtree is used at {path}:7:46")


def test_a_mistake_in_a_subtree_is_reported_once_however_often_it_is_used(tmp_path: Path) -> None:
    before = "subtrees: {bad: {tree: {wait: -1}}}\n"
    path = task(tmp_path, "sequence: [{subtree: {use: bad}}, {subtree: {use: bad}}]", before)
    assert messages_of(path) == ["e: wait: seconds: must be greater than 0 s, not -1"]


def test_an_unused_subtree_is_checked_too(tmp_path: Path) -> None:
    before = """
        subtrees:
          bad: {params: {o: {type: object}}, tree: {look: {objekt: "{o}"}}}
        """
    assert messages_of(task(tmp_path, "look", before)) == ["e: look: unknown port 'objekt'"]


@pytest.mark.parametrize(
    ("bodies", "circle"),
    [
        ("{a: {tree: {subtree: {use: a}}}}", "a → a"),
        ("{a: {tree: {subtree: {use: b}}}, b: {tree: {subtree: {use: a}}}}", "a → b → a"),
    ],
)
def test_recursion_is_refused(bodies: str, circle: str, tmp_path: Path) -> None:
    path = task(tmp_path, "subtree: {use: a}", f"subtrees: {bodies}\n")
    assert f"e: subtrees use each other in a cycle: {circle}" in messages_of(path)


def test_a_bomb_of_subtrees_is_refused(tmp_path: Path) -> None:
    """Twenty subtrees that each use the next one twice would be a million nodes."""
    twice = "{{sequence: [{{subtree: {{use: s{0}}}}}, {{subtree: {{use: s{0}}}}}]}}"
    bodies = "".join(f"  s{i}: {{tree: {twice.format(i + 1)}}}\n" for i in range(20))
    path = task(tmp_path, "subtree: {use: s0}", f"subtrees:\n{bodies}  s20: {{tree: succeed}}\n")
    assert "e: the trees have more than 5000 nodes" in messages_of(path)


def test_a_tower_of_subtrees_is_refused(tmp_path: Path) -> None:
    bodies = "".join(f"  s{i}: {{tree: {{subtree: {{use: s{i + 1}}}}}}}\n" for i in range(500))
    path = task(tmp_path, "subtree: {use: s0}", f"subtrees:\n{bodies}  s500: {{tree: succeed}}\n")
    assert "e: nodes are nested deeper than 64 levels" in messages_of(path)


LIBRARY = """
    bt_dualarm: 1
    subtrees:
      nap: {tree: {wait: 1}}
"""


def test_include(tmp_path: Path) -> None:
    write(tmp_path, LIBRARY, "lib/sleep.yaml")
    write(tmp_path, "bt_dualarm: 1\ninclude: [sleep.yaml]\n", "lib/all.yaml")
    path = task(tmp_path, "subtree: {use: nap}", "include: [lib/all.yaml]\n")
    assert tree_of(path).children[0].ports == {"seconds": 1}


def test_a_library_by_itself_can_be_checked_but_not_run(tmp_path: Path) -> None:
    path = write(tmp_path, LIBRARY)
    assert check_file(path, SKILLS) == ()
    with pytest.raises(SpecError, match="has only subtrees: nothing to run"):
        load_tree_file(path, SKILLS)


def test_invalid_includes_are_refused(tmp_path: Path) -> None:
    inside = tmp_path / "inside"
    write(tmp_path, LIBRARY, "outside.yaml")
    write(inside, "bt_dualarm: 1\narms: {}\n", "task2.yaml")
    write(inside, "a: 1\n", "other.yaml")
    write(inside, "bt_dualarm: 1\ninclude: [task.yaml]\n", "circle.yaml")
    (inside / "link.yaml").symlink_to(tmp_path / "outside.yaml")
    (inside / "loop.yaml").symlink_to(inside / "loop.yaml")
    include = (
        "include: [../outside.yaml, link.yaml, /etc/passwd, missing.yaml, task2.yaml,"
        " other.yaml, circle.yaml, 3, loop.yaml]\n"
    )
    messages = "\n".join(messages_of(task(inside, "look", include)))
    for expected in (
        "include: '../outside.yaml' is outside the folder",
        "include: 'link.yaml' is outside the folder",
        "include: '/etc/passwd' is outside the folder",
        "missing.yaml' cannot be used",
        "no such file",
        "unknown field 'arms'",
        "does not begin with 'bt_dualarm: 1'",
        "include: files include each other in a cycle: task.yaml → circle.yaml → task.yaml",
        "include: expected a file, not 3",
        "include: 'loop.yaml' cannot be resolved",
    ):
        assert expected in messages


def test_two_subtrees_of_one_name_are_refused(tmp_path: Path) -> None:
    write(tmp_path, LIBRARY, "sleep.yaml")
    before = "include: [sleep.yaml]\nsubtrees: {nap: {tree: {wait: 2}}}\n"
    (message,) = messages_of(task(tmp_path, "subtree: {use: nap}", before))
    assert message.startswith("e: subtree 'nap' is already declared in")


@pytest.mark.parametrize(
    ("before", "expected"),
    [
        ("subtrees: 3\n", "e: subtrees: expected a mapping, not 3"),
        ("subtrees: {a: 3}\n", "e: subtree 'a' has no tree"),
        ("subtrees: {a b: {tree: look}}\n", "e: 'a b' cannot be a name"),
        ("subtrees: {a: {tree: look, parms: {}}}\n", "e: unknown field 'parms'"),
        ("include: a.yaml\n", "e: include: expected a list of files, not text 'a.yaml'"),
    ],
)
def test_mistakes_in_declarations(before: str, expected: str, tmp_path: Path) -> None:
    assert expected in messages_of(task(tmp_path, "look", before))


@pytest.mark.parametrize("default", ["seen", '"{seen}"', "3"])
def test_a_key_has_no_default(default: str, tmp_path: Path) -> None:
    """Otherwise writers and readers of the key would not know of each other."""
    subtree = f"p: {{params: {{out: {{type: key, default: {default}}}}}, tree: succeed}}"
    problems = messages_of(task(tmp_path, "look", f"subtrees: {{{subtree}}}\n"))
    assert "e: out: a key has no default: it is given where the subtree is used" in problems
