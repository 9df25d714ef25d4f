"""Trees as file, text or mapping: they have the same meaning and the same errors."""

from __future__ import annotations

import re
from collections.abc import Mapping
from enum import Enum, StrEnum
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from bt_dualarm.behaviors.load import Loaded, load
from bt_dualarm.core.share import share_dir
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.problems import SpecError
from bt_dualarm.spec.yaml_reader import (
    LARGEST_INTEGER,
    MAX_BYTES,
    MAX_DEPTH,
    MAX_NODES,
    Data,
    dotted,
    is_yaml,
    read_mapping,
    read_text,
)
from tests.spec.test_mistakes import FILES
from tests.spec.writing import SKILLS

SHIPPED = [
    path
    for path in sorted(share_dir("trees").rglob("*.yaml"))
    if "arms:" in path.read_text(encoding="utf-8")  # the others have subtrees only
]


@pytest.fixture(scope="module")
def registry() -> Registry:
    return Registry.load()


def content_of(loaded: Loaded) -> dict[str, Any]:
    """Content of a file with its trees, without its path and its notation."""
    file = loaded.runnable()
    arms = {"arms": {"__all__": {"tree"}}}
    nodes = [node for arm in file.arms.values() for node in arm.tree.walk()]
    return {
        "file": file.model_dump(exclude={"path": True, "name": True, "texts": True, **arms}),
        "nodes": [(node.kind, node.name, dict(node.ports), node.slots) for node in nodes],
    }


@pytest.mark.parametrize("path", SHIPPED, ids=[path.stem for path in SHIPPED])
def test_a_text_and_a_mapping_have_the_content_of_the_file(path: Path, registry: Registry) -> None:
    text = path.read_text(encoding="utf-8")
    folder = path.parent
    of_file = load(path, registry.kinds)
    of_text = load(text, registry.kinds, folder=folder)
    of_data = load(read_text(text).data, registry.kinds, folder=folder)
    assert content_of(of_file) == content_of(of_text) == content_of(of_data)
    assert of_file.runnable().root == of_text.runnable().root == of_data.runnable().root


def readable() -> list[Path]:
    """Mistaken files that can be given as mappings, too, which have no name to include."""
    found = []
    for file in FILES:
        try:
            data = read_text(file.read_text(encoding="utf-8")).data
        except (SpecError, UnicodeDecodeError):
            continue
        if isinstance(data, dict) and file.name not in data.get("include", ()):
            found.append(file)
    return found


@pytest.mark.parametrize("file", readable(), ids=lambda file: file.stem)
def test_a_mapping_has_the_errors_of_its_file(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(file.parent)
    data = read_text(file.read_text(encoding="utf-8")).data
    of_file = load(Path(file.name), SKILLS)
    of_data = load(data, SKILLS)
    # Positions in messages are lines and columns of a file, or keys of a mapping.
    positions = re.compile(rf"(?:<mapping>|{re.escape(file.name)})(?::\d+:\d+| at [^)]*)")
    assert [positions.sub("PLACE", problem.message) for problem in of_data.problems] == [
        positions.sub("PLACE", problem.message).replace(file.name, "<mapping>")
        for problem in of_file.problems
    ]
    for problem in of_data.problems:
        keys = problem.place.keys
        assert str(problem).startswith(f"{problem.place}: {problem.severity}: ")
        assert not keys or keys in {dotted(path) for path in paths_in(data)} or ".yaml" in keys


def paths_in(data: Data, path: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    inside = data.items() if isinstance(data, dict) else enumerate(data)
    found = [path]
    for part, item in inside:
        found += (
            paths_in(item, (*path, part)) if isinstance(item, (dict, list)) else [(*path, part)]
        )
    return found


def test_a_position_in_a_mapping_is_given_by_its_keys() -> None:
    tree = {"sequence": [{"wait": 1}, {"go": {"to": {"xyz": [0, 0, 0]}, "near": "far"}}]}
    loaded = load({"bt_dualarm": 1, "arms": {"arm1": {"robot": "ur5", "tree": tree}}}, SKILLS)
    (problem,) = loaded.problems
    assert problem.place.keys == "arms.arm1.tree.sequence[1].go.near"
    assert str(problem).startswith("<mapping> at arms.arm1.tree.sequence[1].go.near: error: go: ")
    assert problem.as_dict()["keys"] == problem.place.keys


class Shape(Enum):
    BOX = "box"


class Robot(StrEnum):
    UR5 = "ur5"


def test_python_values_are_converted_to_yaml_data() -> None:
    given = {
        "array": np.arange(3),
        "scalar": np.float32(0.5),
        "truth": np.bool_(True),
        "tuple": (1, (2,)),
        "path": Path("robots") / "mine.yaml",
        "enum": Robot.UR5,
    }
    expected = {
        "array": [0, 1, 2],
        "scalar": 0.5,
        "truth": True,
        "tuple": [1, [2]],
        "path": str(Path("robots", "mine.yaml")),
        "enum": "ur5",
    }
    assert read_mapping(given).data == expected
    assert yaml.safe_load(yaml.safe_dump(read_mapping(given).data)) == expected


def test_the_key_on_is_accepted_as_pyyaml_reads_it() -> None:
    """YAML 1.1 reads the word as true, even where it is a key: `place: {at: {on: tray}}`."""
    given = yaml.safe_load("place: {at: {on: tray}}")
    assert read_mapping(given).data == {"place": {"at": {"on": "tray"}}}


def nested(levels: int) -> Data:
    return [nested(levels - 1)] if levels else 0


def cycle() -> list[Any]:
    inner: list[Any] = []
    inner.append(inner)
    return inner


def bomb() -> list[Any]:
    """2^40 values in 40 lists."""
    inner: list[Any] = [0]
    for _ in range(40):
        inner = [inner, inner]
    return inner


REFUSED: Mapping[str, tuple[Any, str]] = {
    "a key that is no text": ({1: 2}, "is not text"),
    "a set": ({"a": {1}}, "set cannot be part"),
    "bytes": ({"a": b"x"}, "bytes cannot be part"),
    "an enumeration": ({"a": Shape.BOX}, "Shape cannot be part"),
    "a complex number": ({"a": 1j}, "complex cannot be part"),
    "an object array": ({"a": np.array([object()])}, "object cannot be part"),
    "not a number": ({"a": float("nan")}, "'nan' is not a finite number"),
    "infinity": ({"a": np.array([1.0, -np.inf])}, "'-inf' is not a finite number"),
    "a large integer": ({"a": LARGEST_INTEGER + 1}, "too large"),
    "half a surrogate pair": ({"a": "\ud800"}, "unpaired surrogate"),
    "half a pair in a key": ({"\ud800": 1}, "unpaired surrogate"),
    "a deep list": ({"a": nested(MAX_DEPTH)}, "nested deeper"),
    "a circle": ({"a": cycle()}, "nested deeper"),
    "many values": ({"a": [0] * MAX_NODES}, "more than"),
    "shared lists": ({"a": bomb()}, "more than"),
    "much text": ({"a": "x" * (MAX_BYTES + 1)}, "Ki characters"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_data_that_no_file_can_contain_is_refused(case: str) -> None:
    given, words = REFUSED[case]
    with pytest.raises(SpecError, match=words) as caught:
        read_mapping(given)
    assert all(problem.place.file == "<mapping>" for problem in caught.value.problems)


def test_the_limits_themselves_are_allowed() -> None:
    # The mapping and the list around the values count as well.
    assert read_mapping({"a": [0] * (MAX_NODES - 2)}).data
    assert read_mapping({"a": nested(MAX_DEPTH - 2)}).data
    assert read_mapping({"a": -LARGEST_INTEGER}).data


def test_all_errors_of_a_mapping_are_reported_in_its_order() -> None:
    with pytest.raises(SpecError) as caught:
        read_mapping({"z": b"", "a": [1, {2}, {"b": float("inf")}]})
    assert [problem.place.keys for problem in caught.value.problems] == ["z", "a[1]", "a[2].b"]


@pytest.mark.parametrize(
    ("text", "expected"),
    [("a: 1\nb: 2", True), ("{a: 1}", True), (" {}", True), ("tree.yaml", False), ("", False)],
)
def test_text_of_several_lines_or_in_braces_is_yaml(text: str, expected: bool) -> None:
    assert is_yaml(text) is expected


PARAMS = """
    bt_dualarm: 1
    params:
      height: {type: number, default: 0.1}
      to: {type: vector, default: [0, 0, 0]}
      fast: {type: boolean, default: false}
    arms:
      arm1: {robot: ur5, tree: {sequence: [
        {set: {key: a, value: "{height}"}}, {set: {key: b, value: "{to}"}},
        {set: {key: c, value: "{fast}"}}, {log: "{a}{b}{c}"}]}}
"""


@pytest.mark.parametrize(
    "params",
    [
        {"height": "0.25", "to": "[1, 2, 3]", "fast": "true"},
        {"height": 0.25, "to": (1, 2, 3), "fast": True},
        {"height": np.float64(0.25), "to": np.array([1, 2, 3]), "fast": np.True_},
    ],
)
def test_parameters_are_text_or_data(params: Mapping[str, Any]) -> None:
    file = load(PARAMS, SKILLS, params).runnable()
    values = [node.ports["value"] for node in file.arms["arm1"].tree.walk() if node.kind == "set"]
    assert values == [0.25, [1, 2, 3], True]


@pytest.mark.parametrize("value", [float("nan"), b"1", {1: 2}, [1], True, None])
def test_a_parameter_of_a_wrong_type_is_reported_once(value: Any) -> None:
    (problem,) = load(PARAMS, SKILLS, {"height": value}).problems
    assert problem.message.startswith("parameter ")
    assert "height" in problem.message


def test_included_files_start_from_the_folder(tmp_path: Path) -> None:
    library = {"bt_dualarm": 1, "subtrees": {"pause": {"tree": {"wait": 1}}}}
    (tmp_path / "library.yaml").write_text(yaml.safe_dump(library))
    tree = {"subtree": {"use": "pause"}}
    arms = {"arm1": {"robot": "ur5", "tree": tree}}
    data = {"bt_dualarm": 1, "include": ["library.yaml"], "arms": arms}
    assert load(data, SKILLS, folder=tmp_path).runnable().root == tmp_path
    assert "no such file" in "".join(map(str, load(data, SKILLS).problems))
