"""Blackboard keys: mistakes that the check reports, and correct uses that it accepts."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.spec.writing import messages_of, problems_of, task

RIGHT = {
    "written before": """
        sequence:
          - set: {key: x, value: 2}
          - wait: "{x}"
        """,
    "an output": """
        sequence:
          - look: {where: "{there}"}
          - go: {to: "{there}"}
        """,
    "written later in a loop": """
        repeat:
          times: 2
          child:
            sequence:
              - selector: [{compare: {value: "{n}", to: 1}}, {set: {key: n, value: 0}}]
              - set: {key: n, value: 1}
        """,
    "written by a sibling at the same time": """
        parallel:
          - wait: {seconds: "{x}"}
          - set: {key: x, value: 1}
        """,
    "asked again by a reactive sequence": """
        sequence:
          memory: false
          children:
            - selector: [{compare: {value: "{n}", to: 1}}, succeed]
            - set: {key: n, value: 1}
        """,
    "written by a branch that may not run": """
        sequence:
          - selector: [{look: {size: "{s}"}}, succeed]
          - compare: {value: "{s}", relation: greater, to: 0.1}
        """,
    "written by a condition": """
        if: {condition: {look: {size: "{s}"}}, then: {go: {to: {xyz: [0, 0, 1]}, near: "{s}"}}}
        """,
    "a number from two writers": """
        sequence:
          - set: {key: x, value: 1}
          - set: {key: x, value: 2.5}
          - wait: "{x}"
        """,
    "a copy, whose type is not known": """
        sequence:
          - look: {color: "{c}"}
          - set: {key: d, value: "{c}"}
          - log: "{d}"
        """,
    "the item of a loop below a guard": """
        guard:
          condition: {compare: {value: 1, to: 1}}
          child: {for_each: {items: [1, 2], item: a, index: n, child: {log: "{n} is {a}"}}}
        """,
    "the item of a loop in a loop": """
        for_each:
          items: [1, 2]
          item: a
          child: {for_each: {items: [3, 4], item: b, child: {log: "{a} and {b}"}}}
        """,
    "a text with units": """
        sequence: [{set: {key: x, value: 500 ms}}, {wait: "{x}"}]
        """,
}


@pytest.mark.parametrize("name", RIGHT)
def test_correct_trees_have_no_problems(name: str, tmp_path: Path) -> None:
    assert messages_of(task(tmp_path, RIGHT[name])) == []


WRONG = {
    "never written": (
        'sequence: [{set: {key: speed, value: 1}}, {wait: "{sped}"}]',
        ["e: wait: no node before this one writes '{sped}'"],
        "did you mean 'speed'?",
    ),
    "written only later": (
        'sequence: [{wait: "{x}"}, {set: {key: x, value: 1}}]',
        ["e: wait: no node before this one writes '{x}'"],
        "it is written only further down",
    ),
    "in a text": (
        'log: "x is {x}"',
        ["e: log: no node before this one writes '{x}'"],
        "nothing writes a key in this scope",
    ),
    "written in the other branch": (
        'if: {condition: look, then: {set: {key: x, value: 1}}, else: {wait: "{x}"}}',
        ["e: wait: no node before this one writes '{x}'"],
        "it is written only further down",
    ),
    "written in another case": (
        "switch: {value: a, cases: {a: {set: {key: x, value: 1}}, b: {wait: '{x}'}}}",
        ["e: wait: no node before this one writes '{x}'"],
        "it is written only further down",
    ),
    "a value of the wrong type": (
        'sequence: [{set: {key: x, value: soon}}, {wait: "{x}"}]',
        ["e: wait: seconds: expected a number, or text with a unit (ms, s, min, h), not 'soon'"],
        "'{x}' is written at",
    ),
    "a value out of range": (
        'sequence: [{set: {key: x, value: -1}}, {wait: "{x}"}]',
        ["e: wait: seconds: must be greater than 0 s, not -1"],
        "'{x}' is written at",
    ),
    "one of two writers": (
        'sequence: [{set: {key: x, value: 1}}, {set: {key: x, value: [1]}}, {wait: "{x}"}]',
        ["e: wait: seconds: expected a number, not a list of 1"],
        "'{x}' is written at",
    ),
    "an output of the wrong type": (
        'sequence: [{look: {color: "{c}"}}, {go: {to: "{c}"}}]',
        ["e: go: to: expected a mapping, not text"],
        "'{c}' is written at",
    ),
    "unused output": (
        'look: {size: "{s}"}',
        ["w: look: nothing reads '{s}'"],
        "",
    ),
    "an output that is no key": (
        "look: {size: 3}",
        ["e: look: output 'size' needs a key to write, not 3"],
        'for example: size: "{size}"',
    ),
    "a key of the wrong type inside of a port": (
        "sequence: [{set: {key: y, value: a}}, {go: {to: {xyz: [0, '{y}', 0]}}}]",
        ["e: go: xyz: expected a number, not text 'a', where '{y}' is text 'a'"],
        "",
    ),
    "a key inside of a port that nothing writes": (
        "sequence: [{set: {key: y, value: 1}}, {compare: {value: ['{y}', '{yy}'], to: [1]}}]",
        ["e: compare: no node before this one writes '{yy}'"],
        "did you mean 'y'?",
    ),
    "a key with another unit": (
        'sequence: [{look: {size: "{s}"}}, {wait: "{s}"}]',
        ["e: wait: seconds: expected a time (s), not a length (m)"],
        "'{s}' is written at",
    ),
    "a port that cannot come from a key": (
        "sequence: [{set: {key: m, value: false}},"
        " {sequence: {memory: '{m}', children: [succeed]}}]",
        ["e: sequence: memory: cannot come from the blackboard"],
        "give a literal value, or use a parameter",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_mistakes_are_reported(name: str, tmp_path: Path) -> None:
    tree, expected, hint = WRONG[name]
    path = task(tmp_path, tree)
    assert messages_of(path) == expected
    assert any(hint in problem.hint for problem in problems_of(path))


def test_arms_do_not_share_keys(tmp_path: Path) -> None:
    path = task(tmp_path, "sequence: [{set: {key: x, value: 1}}, {wait: '{x}'}]")
    with path.open("a") as file:
        file.write("  arm2:\n    robot: ur5\n    tree: {wait: '{x}'}\n")
    assert messages_of(path) == ["e: wait: no node before this one writes '{x}'"]
