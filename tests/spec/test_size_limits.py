"""Size limits of lists, mappings and texts: errors state the limit and the given size."""

from __future__ import annotations

import pytest

from bt_dualarm.runtime.file_check import check
from bt_dualarm.skill.registry import Registry

HEAD = "bt_dualarm: 1\n"
ARM = "arms: {arm1: {robot: ur5, tree: TREE}}\n"


def many(count: int, item: str) -> str:
    return ", ".join([item] * count)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (
            "arms: {" + ", ".join(f"a{i}: {{robot: ur5, tree: succeed}}" for i in range(17)) + "}",
            "arms: expected at most 16 items, not 17",
        ),
        (
            "objects: {"
            + ", ".join(f"o{i}: {{shape: sphere, size: [0.1], mass: 1}}" for i in range(201))
            + "}\n"
            + ARM.replace("TREE", "succeed"),
            "objects: expected at most 200 items, not 201",
        ),
        ("arms: {}", "arms: expected at least 1 item, not 0"),
        (
            ARM.replace("TREE", f"{{draw: {{points: [{many(501, '[0, 0]')}]}}}}"),
            "draw: points: expected at most 500 items, not 501",
        ),
        (
            ARM.replace("TREE", f"{{track: {{color: [{many(9, '{hue: [0, 10]}')}]}}}}"),
            "track: color: expected at most 8 items, not 9",
        ),
        (
            f"name: {'x' * 101}\n" + ARM.replace("TREE", "succeed"),
            "name: expected at most 100 characters, not 101",
        ),
    ],
)
def test_too_many_and_too_few_are_counted(text: str, expected: str) -> None:
    problems = check(HEAD + text, Registry.load().kinds, build=False).problems
    assert expected in [problem.message for problem in problems]
