"""No value in a tree file ends the check with an exception: each one is accepted or explained."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from bt_dualarm.runtime.file_check import check
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.yaml_reader import read_file
from tests.source import ROOT

FILES = sorted([*(ROOT / "trees").glob("*.yaml"), *(ROOT / "docs" / "cookbook").glob("*.yaml")])
STRIDE = 23
"""Every how many values of a file one is replaced; prime, so that different fields are hit."""


def places(data: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:  # Any: YAML
    """Paths of all values within a file."""
    if path:
        yield path
    if isinstance(data, dict):
        for key, value in data.items():
            yield from places(value, (*path, key))
    elif isinstance(data, (list, tuple)):
        for number, value in enumerate(data):
            yield from places(value, (*path, number))


def changed(data: Any, path: tuple[Any, ...], value: object) -> Any:
    """A copy of a file with another value."""
    new = copy.deepcopy(data)
    at = new
    for key in path[:-1]:
        at = at[key]
    at[path[-1]] = value
    return new


@pytest.mark.parametrize("file", FILES, ids=lambda file: str(file.stem))
def test_a_value_of_another_kind_is_explained(file: Path) -> None:
    data = read_file(file).data
    kinds = Registry.load().kinds
    for number, path in enumerate(places(data)):
        if number % STRIDE == 0:
            value: object
            for value in ({"x": 1}, [[]], "1 furlong"):
                found = check(changed(data, path, value), kinds, folder=file.parent, build=False)
                assert all(problem.message for problem in found.problems)


PARAMS = """
bt_dualarm: 1
world: {scene: empty}
params: {a: %s}
arms: {arm1: {robot: panda, tree: go_home}}
"""


@pytest.mark.parametrize(
    ("param", "field"),
    [
        ("{type: {x: 1}, default: 1, range: [0, 1]}", "type"),
        ("{type: number, default: 1, range: ['0 cm', 1], unit: [m]}", "unit"),
    ],
)
def test_a_parameter_with_a_range_needs_a_text_as_type_and_unit(param: str, field: str) -> None:
    found = check(PARAMS % param, Registry.load().kinds, build=False).problems
    assert any(problem.message.startswith(f"{field}: expected one of") for problem in found)


def test_a_part_that_is_no_name_is_one_error() -> None:
    text = (ROOT / "trees" / "drawer.yaml").read_text().replace("part: handle", "part: {x: 1}", 1)
    found = check(text, Registry.load().kinds, folder=ROOT / "trees", build=False).problems
    errors = [problem for problem in found if problem.severity == "error"]
    assert [problem.message for problem in errors] == ["grasp: part: expected text, not a mapping"]
