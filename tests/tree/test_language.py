"""Every word of the language has all its parts, in one definition and one class."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from itertools import product
from pathlib import Path

import pytest

import bt_dualarm
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.describe import describe
from bt_dualarm.spec.ends import EITHER, FAILURE, SUCCESS, Ends
from bt_dualarm.spec.language import LANGUAGE
from bt_dualarm.spec.node import NodeSpec
from bt_dualarm.spec.schema import json_schema
from bt_dualarm.spec.word import Word
from bt_dualarm.tree.build import INNER, LEAVES

PACKAGE = Path(bt_dualarm.__file__).parent
DEFINED_IN = {f"spec/{kind}_words.py" for kind in ("composite", "decorator", "leaf")}

WRITES_TREES = {"testing/laws.py", "testing/scenario.py"}
"""They write trees around a skill, as an author of tree files does."""

OTHER_THINGS = {
    ("spec/expand.py", "subtree"),  # what a name in a message is the name of
    ("cli/run_arguments.py", "log"),  # a display of one line an event
    ("runtime/display.py", "log"),
    ("spec/reality.py", "set"),  # the name of a set of numbers
    ("runtime/summary.py", "guard"),  # the gate on set-points, in summary.json
    ("runtime/notes.py", "guard"),  # likewise, in run.history
}
"""Texts that are spelt like a word and mean something else."""


def test_every_word_has_one_class_that_ticks_it() -> None:
    assert not INNER.keys() & LEAVES.keys()
    assert INNER.keys() | LEAVES.keys() == LANGUAGE.keys()
    words = [*(node.word for node in INNER.values()), *(leaf.word for leaf in LEAVES.values())]
    assert all(LANGUAGE[word.name] is word for word in words)


@pytest.mark.parametrize("word", LANGUAGE.values(), ids=LANGUAGE)
def test_a_word_has_all_its_parts(word: Word) -> None:
    assert word.summary
    assert word.example.startswith(word.name)
    assert (word.name in LEAVES) is (word.is_leaf and not word.uses)
    assert word.fixed <= word.ports.model_fields.keys()
    assert {word.shorthand, word.uses} <= {"", *word.ports.model_fields}
    assert word.goes_on is None or word.many, "only a list of children has an order"
    if any(slot.after is not None for slot in word.slots):
        assert word.slots[0].after is None
        assert word.slots[0].required, "what others wait for is there"
    assert describe(word).summary == word.summary
    assert word.name in json_schema({})["$defs"]["node"]["anyOf"][1]["properties"]


def nodes(word: Word) -> Iterator[NodeSpec]:
    """Nodes of a word with as few and as many children as it takes."""
    given = {"times": 2, "policy": "all", "memory": True}
    ports = {name: value for name, value in given.items() if name in word.ports.model_fields}
    required = [slot.name for slot in word.slots if slot.required]
    counts = {len(required), len(word.slots)}
    if word.many or word.cases:
        counts = {1, 2, 3}
    for count in sorted(counts) if not word.uses else [1]:
        children = tuple(NodeSpec("look", f"look {i}", {}) for i in range(count))
        slots = tuple(slot.name for slot in word.slots)[:count]
        if word.many:
            slots = ("children",) * count
        elif word.cases:
            slots = (*(f"case {i}" for i in range(count - 1)), "default")
        yield NodeSpec(word.name, word.name, ports, children, slots or ("child",) * count)


@pytest.mark.parametrize("word", LANGUAGE.values(), ids=LANGUAGE)
def test_the_rules_of_a_word_hold_for_all_ends_of_its_children(word: Word) -> None:
    """More ends of a child never mean fewer of the node: what is warned of cannot happen."""
    never = Ends(succeeds=False, fails=False)
    for node in nodes(word):
        for ends in product((never, SUCCESS, FAILURE, EITHER), repeat=len(node.children)):
            end = word.ends(node, ends)
            widest = word.ends(node, [EITHER] * len(ends))
            assert end.succeeds <= widest.succeeds
            assert end.fails <= widest.fails
            assert isinstance(word.pointless(node, ends), str)
        assert isinstance(word.revisits(node), bool)
        assert list(word.complaint(node)) == []


def texts_in(path: Path) -> Iterator[str]:
    """Every text in the code of a file."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value


def files() -> list[tuple[str, Path]]:
    """The files of the rooms that see nodes of a tree."""
    rooms = ("spec", "skill", "preflight", "tree", "runtime", "tuning", "testing", "cli")
    paths = (path for room in rooms for path in (PACKAGE / room).rglob("*.py"))
    return [(path.relative_to(PACKAGE).as_posix(), path) for path in paths]


def test_no_other_file_knows_a_word_by_name() -> None:
    found = {(name, text) for name, path in files() for text in texts_in(path) if text in LANGUAGE}
    elsewhere = {(name, text) for name, text in found if name not in DEFINED_IN | WRITES_TREES}
    assert elsewhere == OTHER_THINGS


def test_no_file_of_the_package_knows_a_shipped_skill_by_name() -> None:
    """What is known of a skill, the skill declares: one by somebody else can declare the same."""
    skills = Registry.load().skills
    found = {(name, text) for name, path in files() for text in texts_in(path) if text in skills}
    assert found == {("runtime/history_start.py", "place")}  # where in a file a node stands
