"""Leaves that are part of the language."""

from __future__ import annotations

import logging
from pathlib import Path

import pytest

from bt_dualarm.behaviors.leaf import near, same
from tests.behaviors.ticking import Stage


@pytest.mark.parametrize(
    ("value", "relation", "to", "holds"),
    [
        (1, "equal", 1.0, True),
        (1, "equal", "true", False),
        ('"red"', "equal", "red", True),
        (1, "not_equal", 2, True),
        (1, "less", 2, True),
        (2, "less", 2, False),
        (2, "less_or_equal", 2, True),
        (3, "greater", 2, True),
        (2, "greater_or_equal", 2, True),
        (1, "greater_or_equal", 2, False),
        (0.3, "near", 0.30000001, True),
        ("[0, 1]", "near", "[0, 1.5]", False),
        ("[1, {a: 2}]", "equal", "[1.0, {a: 2}]", True),
    ],
)
def test_compare(value: object, relation: str, to: object, holds: bool, tmp_path: Path) -> None:
    tree = f"compare: {{value: {value}, relation: {relation}, to: {to}}}"
    assert Stage(tmp_path, tree).tick() == ("S" if holds else "F")


@pytest.mark.parametrize(
    ("relation", "reason"),
    [
        ("less", "NOT_COMPARABLE: text 'a' and 1 cannot be ordered; only numbers can"),
        ("near", "NOT_COMPARABLE: text 'a' and 1 are not both numbers"),
        ("equal", "FALSE: text 'a' does not equal 1"),
    ],
)
def test_failed_compare_gives_the_reason(relation: str, reason: str, tmp_path: Path) -> None:
    stage = Stage(tmp_path, f"compare: {{value: a, relation: {relation}, to: 1}}")
    stage.tick()
    assert stage.tree.view().reason == reason


@pytest.mark.parametrize(
    ("expression", "reason"),
    [
        ("false", "the expression is false"),
        ('"{so}"', "{so} is false"),
        ('"{n} == 2 and {so}"', "{n} == 2 and {so} is false: 1 == 2 and false"),
        ('"len({where}) > {n} + 1"', "len({where}) > {n} + 1 is false: len([0, 1]) > 1 + 1"),
    ],
)
def test_failed_test_shows_the_values(expression: str, reason: str, tmp_path: Path) -> None:
    """It said nothing but "the expression is false"."""
    keys = {"n": "1", "so": "false", "where": "[0, 1]"}
    written = "".join(f"\n  - set: {{key: {key}, value: {keys[key]}}}" for key in keys)
    stage = Stage(tmp_path, f"sequence:{written}\n  - test: {expression}")
    stage.tick()
    assert stage.tree.view().children[-1].reason == f"FALSE: {reason}"


def test_true_is_not_one() -> None:
    assert not same(True, 1)
    assert not same({"a": True}, {"a": 1})
    assert same([True], [True])
    assert near([1.0], [1.0], 0.0)


def test_log_writes_values_of_keys(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    stage = Stage(
        tmp_path,
        "sequence: [{set: {key: n, value: 3}}, {log: {message: 'n is {n} %s', level: warning}}]",
    )
    assert stage.tick() == "S S S"
    assert [(r.levelno, r.getMessage()) for r in caplog.records] == [(logging.WARNING, "n is 3 %s")]


def test_message_of_log_may_be_a_key_alone(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    stage = Stage(tmp_path, "sequence: [{set: {key: n, value: 3}}, {log: '{n}'}]")
    assert stage.tick() == "S S S"
    assert caplog.messages == ["3"]


def test_fail_gives_code_and_reason(tmp_path: Path) -> None:
    stage = Stage(tmp_path, "fail: {code: NO_CUBE, reason: the table is empty}")
    stage.tick()
    assert stage.tree.view().reason == "NO_CUBE: the table is empty"


def test_set_copies_a_key(tmp_path: Path) -> None:
    stage = Stage(
        tmp_path,
        "sequence: [{set: {key: a, value: [1, 2]}}, {set: {key: b, value: '{a}'}},"
        " {compare: {value: '{b}', to: [1, 2]}}]",
    )
    assert stage.tick() == "S S S S"


def test_key_of_the_wrong_type_fails_the_leaf_that_reads_it(tmp_path: Path) -> None:
    """Two writers write different types, so the static check alone cannot decide."""
    stage = Stage(
        tmp_path,
        "sequence:\n- set: {key: t, value: 1}\n- selector: [succeed, {set: {key: t, value: 2}}]\n"
        "- set: {key: u, value: '{t}'}\n- wait: {seconds: '{u}'}",
    )
    assert stage.table(2)[-1] == "S S S S - S S"


def test_log_writes_values_as_yaml(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    Stage(
        tmp_path,
        "sequence: [{set: {key: v, value: {a: [true, 0.5, é]}}}, {log: 'v = {v}'}]",
    ).tick()
    assert caplog.messages == ['v = {a: [true, 0.5, "é"]}']


@pytest.mark.parametrize(
    ("expression", "letters"),
    [("{n} < 4", "S S S"), ("{n} > 3", "F S F"), ("{n} / 0 > 1", "F S F"), ("{n} + 1", "F S F")],
)
def test_test(expression: str, letters: str, tmp_path: Path) -> None:
    """A test fails if its expression is false and if it has no truth value."""
    stage = Stage(
        tmp_path,
        f"sequence:\n- selector: [{{set: {{key: n, value: 3}}}}, {{set: {{key: m, value: 1}}}}]\n"
        f"- set: {{key: n, value: '{{n}}'}}\n- test: '{expression}'",
    )
    assert stage.tick().split()[0] == letters[0]
    assert stage.tick().split()[-1] == letters[-1]
