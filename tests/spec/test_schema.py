"""The schema and the check agree, except for what the schema cannot express."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from bt_dualarm.behaviors.language import LANGUAGE
from bt_dualarm.behaviors.load import check_file
from bt_dualarm.core.share import share_dir
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.document import ObjectSpec
from bt_dualarm.spec.problems import errors
from bt_dualarm.spec.reference import json_schema
from bt_dualarm.spec.yaml_reader import read_file
from tests.spec.writing import SKILLS, task, write

SCHEMA = json_schema({**LANGUAGE, **SKILLS})
is_valid = Draft202012Validator(SCHEMA).is_valid

GOOD = {
    "all notations of a node": """
        sequence:
          - succeed
          - succeed:
          - look: {object: "{o}", where: "{w}", name: a look}
          - selector: {memory: false, children: [look, {wait: 2 s}]}
          - log: hello
          - set: {key: o, value: [1, {a: b}]}
        """,
    "slots and cases": """
        if:
          condition: {compare: {value: 1, relation: less, to: 2}}
          then: {switch: {value: a, cases: {a: look, b: {wait: 1}}, default: succeed}}
          else: {on_halt: {child: look, cleanup: look}}
        """,
    "parameters inside of values": """
        go: {to: {xyz: [0, "{x}", 0], rpy: [0, 0, "{x}"]}, time: "{x}"}
        """,
    "numbers and words": """
        parallel:
          policy: 1
          on_failure: continue
          children:
            - repeat: {times: forever, child: look}
            - repeat: {times: 3, child: look}
        """,
}

BAD = {
    "unknown kind": "look2",
    "unknown port": "look: {objekt: cube}",
    "missing port": "go: {time: 1}",
    "missing child": "retry: {times: 2}",
    "no children": "sequence: []",
    "no list": "sequence: {memory: true}",
    "two kinds": "{look: {}, wait: 1}",
    "a list for a node": "[look]",
    "a number for a node": "3",
    "wrong type": "wait: {seconds: [1]}",
    "wrong unit": "wait: 1 week",
    "out of range": "wait: -1",
    "not of the choices": "compare: {value: 1, relation: smaller, to: 2}",
    "too few numbers": "go: {to: {xyz: [0, 0]}}",
    "too many numbers": "go: {to: {xyz: [0, 0, 0, 0]}}",
    "text for a number": "go: {to: {xyz: [0, 0, '0']}}",
    "an output that is no key": "look: {size: 3}",
    "a key that is none": "set: {key: a b, value: 1}",
    "a truth value for a number": "retry: {times: true, child: look}",
    "ports without a mapping": "look: 3",
    "no cases": "switch: {value: 1}",
    "a subtree without a name": "subtree: {params: {}}",
}


@pytest.mark.parametrize("name", GOOD)
def test_both_accept(name: str, tmp_path: Path) -> None:
    before = "params: {x: {type: number, default: 0.5}, o: {type: object, default: cube}}\n"
    before += "objects: {cube: {shape: box, size: [0.1, 0.1, 0.1], mass: 1, color: [1, 0, 0]}}\n"
    path = task(tmp_path, GOOD[name], before)
    assert not errors(check_file(path, SKILLS)), check_file(path, SKILLS)
    assert is_valid(read_file(path).data)


@pytest.mark.parametrize(
    ("obj", "is_sound"),
    [
        ("mass: 1", True),
        ("mass: 1, fixed: true", True),
        ("fixed: true", True),
        ("fixed: true, color: gray", True),
        ("fixed: false", False),
        ("color: red", False),
    ],
)
def test_a_fixed_object_needs_no_mass(obj: str, is_sound: bool, tmp_path: Path) -> None:
    before = f"objects: {{cube: {{shape: box, size: [0.1, 0.1, 0.1], {obj}}}}}\n"
    path = task(tmp_path, "look", before)
    assert (not errors(check_file(path, SKILLS))) == is_sound
    assert is_valid(read_file(path).data) == is_sound


def test_british_spelling_of_a_color_is_the_same_color() -> None:
    fields = {"shape": "box", "size": (0.1, 0.1, 0.1), "mass": 1.0}
    gray, grey = (ObjectSpec.model_validate(fields | {"color": c}) for c in ("gray", "grey"))
    assert gray == grey


@pytest.mark.parametrize("name", BAD)
def test_both_refuse(name: str, tmp_path: Path) -> None:
    path = task(tmp_path, BAD[name])
    assert errors(check_file(path, SKILLS))
    assert not is_valid(read_file(path).data)


@pytest.mark.parametrize(
    "text",
    [
        "bt_dualarm: 2\narms: {a: {robot: ur5, tree: look}}",
        "bt_dualarm: 1",
        "bt_dualarm: 1\narms: {}",
        "bt_dualarm: 1\narms: {a: {robot: ur5}}",
        "bt_dualarm: 1\narms: {a b: {robot: ur5, tree: look}}",
        "bt_dualarm: 1\narms: {a: {robot: ur5, tree: look}}\nworld: {scen: a}",
        "bt_dualarm: 1\narms: {a: {robot: ur5, tree: look, camera: {fov: 500}}}",
        "bt_dualarm: 1\narms: {a: {robot: ur5, tree: look}}\nparams: {x: {type: int}}",
        "bt_dualarm: 1\narms: {a: {robot: ur5, tree: look}}\nsubtrees: {x: {}}",
        "bt_dualarm: 1\narms: {a: {robot: ur5, tree: look}}\ninclude: x.yaml",
        "[]",
    ],
)
def test_both_refuse_files(text: str, tmp_path: Path) -> None:
    path = write(tmp_path, text)
    assert errors(check_file(path, SKILLS))
    assert not is_valid(read_file(path).data)


SHIPPED = sorted(share_dir("trees").rglob("*.yaml"))


@pytest.fixture(scope="module")
def validator_of_the_shipped_skills(registry: Registry) -> Draft202012Validator:
    return Draft202012Validator(json_schema({**LANGUAGE, **registry.kinds}))


@pytest.mark.parametrize("path", SHIPPED, ids=[path.name for path in SHIPPED])
def test_shipped_trees_pass_both(
    path: Path, registry: Registry, validator_of_the_shipped_skills: Draft202012Validator
) -> None:
    assert check_file(path, registry.kinds) == ()
    assert validator_of_the_shipped_skills.is_valid(read_file(path).data)


def test_the_schema_is_valid() -> None:
    Draft202012Validator.check_schema(SCHEMA)


def test_the_schema_is_json_with_every_reference_defined() -> None:
    text = json.dumps(SCHEMA)
    names = {part.split('"')[0] for part in text.split('"#/$defs/')[1:]}
    assert names <= SCHEMA["$defs"].keys()


def test_every_field_of_a_file_is_explained_to_editors() -> None:
    schema = json_schema({**LANGUAGE, **SKILLS})
    parts = [schema["properties"]["world"], schema["$defs"]["CameraSpec"]]
    parts += [schema["properties"][name]["additionalProperties"] for name in ("objects", "arms")]
    for part in parts:
        for name, field in part["properties"].items():
            assert field.get("description") or field == {"$ref": "#/$defs/node"}, name
