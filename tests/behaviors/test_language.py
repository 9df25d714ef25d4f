"""Every node type of the language is complete and defined in one class."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Any

import pytest

import bt_dualarm
from bt_dualarm.behaviors.language import LANGUAGE, LEAF_CLASSES, PARENT_CLASSES
from bt_dualarm.behaviors.leaf import LanguageLeaf
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.node_types import (
    EITHER,
    FAILURE,
    RESERVED_NAMES,
    SUCCESS,
    LanguageNode,
    NodeSpec,
    Outcomes,
)
from bt_dualarm.spec.reference import describe, json_schema

PACKAGE = Path(bt_dualarm.__file__).parent
DEFINED_IN = {
    "spec/node_types.py",  # the reserved names
    "behaviors/composites.py",
    "behaviors/decorators.py",
    "behaviors/leaf.py",
    "behaviors/coordination.py",
    "behaviors/conditions.py",
    "spec/cell.py",
}

WRITES_TREES = {"testing.py"}
"""Files that write trees around a skill, as an author of tree files does."""

OTHER_MEANINGS = {
    ("spec/parser.py", "subtree"),  # a type of name, in a message
    ("spec/checks.py", "subtree"),  # a category of names
    ("cli/bt_run.py", "log"),  # a display with one line per event
    ("runtime/display.py", "log"),
    ("spec/document.py", "set"),  # the name of a set of numbers
    ("runtime/summary.py", "guard"),  # the gate on set-points, in summary.json
    ("runtime/observations.py", "guard"),  # likewise, in run.history
    ("skill/following_error.py", "guard"),  # likewise, as a cause
    ("skill/cell.py", "signal"),  # the cause of a wait
    ("behaviors/graph.py", "signal"),  # a port
    ("cli/__init__.py", "compare"),  # a command
    ("spec/faults.py", "fail"),  # the effect of a fault
    ("spec/expressions.py", "if"),  # keywords of expressions
    ("spec/expressions.py", "not"),
    ("spec/problems.py", "if"),  # a name that some use for a condition, in a hint
    ("spec/goals.py", "in_zone"),  # a field of a goal
    ("cli/bt_sweep.py", "all"),  # a value of an option
}
"""Strings that equal a node type's name and mean something else."""


def test_every_node_type_has_one_class_and_a_reserved_name() -> None:
    assert not PARENT_CLASSES.keys() & LEAF_CLASSES.keys()
    assert PARENT_CLASSES.keys() | LEAF_CLASSES.keys() == LANGUAGE.keys() == RESERVED_NAMES


@pytest.mark.parametrize("leaf", LEAF_CLASSES.values(), ids=LEAF_CLASSES)
def test_leaf_runs_with_the_ports_of_its_node_type(leaf: type[LanguageLeaf]) -> None:
    assert leaf.Ports is leaf.node_type.ports


@pytest.fixture(scope="module")
def nodes_of_the_schema() -> dict[str, Any]:
    """Node types in the schema of tree files, which takes a tenth of a second to build."""
    found: dict[str, Any] = json_schema(LANGUAGE)["$defs"]["node"]["anyOf"][1]["properties"]
    return found


@pytest.mark.parametrize("node_type", LANGUAGE.values(), ids=LANGUAGE)
def test_node_type_is_complete(
    node_type: LanguageNode, nodes_of_the_schema: dict[str, Any]
) -> None:
    assert node_type.summary
    assert node_type.example.startswith(node_type.name)
    assert (node_type.name in LEAF_CLASSES) is (node_type.is_leaf and not node_type.uses)
    assert node_type.fixed <= node_type.ports.model_fields.keys()
    assert {node_type.shorthand, node_type.uses} <= {"", *node_type.ports.model_fields}
    assert node_type.advances_on is None or node_type.many, "only a list of children has an order"
    if any(slot.after is not None for slot in node_type.slots):
        assert node_type.slots[0].after is None
        assert node_type.slots[0].required, "a slot that others wait for is required"
    assert describe(node_type).summary == node_type.summary
    assert node_type.name in nodes_of_the_schema


def nodes(node_type: LanguageNode) -> Iterator[NodeSpec]:
    """Nodes of a type with the fewest and the most children, or one to three of them."""
    given = {"times": 2, "policy": "all", "memory": True}
    ports = {name: value for name, value in given.items() if name in node_type.ports.model_fields}
    required = [slot.name for slot in node_type.slots if slot.required]
    counts = {len(required), len(node_type.slots)}
    if node_type.many or node_type.cases:
        counts = {2, 3} if node_type.name == "if_then_else" else {1, 2, 3}
    for count in sorted(counts) if not node_type.uses else [1]:
        children = tuple(NodeSpec("look", f"look {i}", {}) for i in range(count))
        slots = tuple(slot.name for slot in node_type.slots)[:count]
        if node_type.many:
            slots = ("children",) * count
        elif node_type.cases:
            slots = (*(f"case {i}" for i in range(count - 1)), "default")
        yield NodeSpec(node_type.name, node_type.name, ports, children, slots or ("child",) * count)


@pytest.mark.parametrize("node_type", LANGUAGE.values(), ids=LANGUAGE)
def test_rules_of_a_node_type_hold_for_all_outcomes_of_its_children(
    node_type: LanguageNode,
) -> None:
    """More possible outcomes of a child never mean fewer of the node, so warnings are true."""
    never = Outcomes(succeeds=False, fails=False)
    for node in nodes(node_type):
        for outcomes in product((never, SUCCESS, FAILURE, EITHER), repeat=len(node.children)):
            outcome = node_type.outcomes(node, outcomes)
            widest = node_type.outcomes(node, [EITHER] * len(outcomes))
            assert outcome.succeeds <= widest.succeeds
            assert outcome.fails <= widest.fails
            assert isinstance(node_type.no_effect(node, outcomes), str)
        assert isinstance(node_type.revisits(node), bool)
        assert list(node_type.problems(node)) == []


def texts_in(path: Path) -> Iterator[str]:
    """All string constants in a file."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value


def files() -> list[tuple[str, Path]]:
    """Names and paths of the files of the packages that handle nodes of a tree."""
    folders = ("spec", "skill", "behaviors", "runtime", "tuning", "testing", "cli")
    paths = (path for folder in folders for path in (PACKAGE / folder).rglob("*.py"))
    return [(path.relative_to(PACKAGE).as_posix(), path) for path in paths]


def test_no_other_file_knows_a_node_type_by_name() -> None:
    found = {(name, text) for name, path in files() for text in texts_in(path) if text in LANGUAGE}
    elsewhere = {(name, text) for name, text in found if name not in DEFINED_IN | WRITES_TREES}
    assert elsewhere == OTHER_MEANINGS


def test_no_other_file_knows_a_shipped_skill_by_name() -> None:
    """A skill declares all properties that the package uses, so that a user's skill can, too."""
    skills = Registry.load().skills
    found = {(name, text) for name, path in files() for text in texts_in(path) if text in skills}
    assert found == {
        ("runtime/history.py", "place"),  # the location of a node in a file
        ("runtime/run.py", "look_at"),  # an argument of `render`
        ("spec/expressions.py", "look_at"),  # a field of a pose
        ("spec/problems.py", "count"),  # a name that some use for `times`, in a hint
    }
