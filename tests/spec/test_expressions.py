"""Expressions in ports: values, units and errors; no text can make them do anything else."""

from __future__ import annotations

import math
import os
from pathlib import Path
from random import Random

import pytest

from bt_dualarm.behaviors.node import Blackboard, BoundPorts
from bt_dualarm.core.errors import DualArmError, Failure
from bt_dualarm.skill.skill import Skill
from bt_dualarm.spec.dimensions import ANGLE, LENGTH, ValueType
from bt_dualarm.spec.expressions import (
    FUNCTIONS,
    ExpressionError,
    keys_in,
    parse,
    resolved,
    type_of,
    value_of,
)
from bt_dualarm.spec.node_types import PortModel, port
from bt_dualarm.spec.values import Duration, PoseSpec
from bt_dualarm.spec.yaml_reader import LARGEST_INTEGER, Data
from bt_dualarm.testing import registry_with
from tests.fuzz.seeds import dice_of
from tests.spec.writing import problems_of, task, tree_of

QUARTER = {"xyz": [0.1, 0.2, 0.3], "quat": [math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)]}

KEYS: dict[str, Data] = {
    "n": 3,
    "x": 0.25,
    "v": [1.0, 2.0, 3.0],
    "pose": {"xyz": [0.1, 0.2, 0.3], "rpy": [0, 90, 45], "quat": None, "look_at": None},
    "turned": QUARTER,
    "time": "500 ms",
    "on": True,
    "word": "red",
    "poses": [QUARTER, {"xyz": [1, 1, 1]}],
}

VALUES: list[tuple[str, Data]] = [
    ("{n} + 1", 4),
    ("-{n}", -3),
    ("{n} - 1 - 1", 1),
    ("2 * {n} + 1", 7),
    ("{n} / 2", 1.5),
    ("6 / {n}", 2),
    ("{n} // 2", 1),
    ("{n} % 2", 1),
    ("({n} + 1) * {x}", 1.0),
    ("{x} + 5 cm", 0.3),
    ("{time} * 2", 1.0),
    ("{time} + 1 min", 60.5),
    ("90 deg / {n}", 30.0),
    ("{n} > 2 and {x} < 1", True),
    ("{n} > 3 or not {on}", False),
    ("1 < {n} < 3", False),
    ("{n} == 3.0", True),
    ("{time} == 500 ms", True),
    ("{word} == 'red'", True),
    ('{word} != "red"', False),
    ("{on} == true", True),
    ("{on} == 1", False),
    ("'very ' + {word}", "very red"),
    ("'cube_' + text({n})", "cube_3"),
    ("{v}[0] + {v}.z", 4.0),
    ("{v}[-1]", 3.0),
    ("2 * {v}", [2.0, 4.0, 6.0]),
    ("{v} / 2", [0.5, 1.0, 1.5]),
    ("{v} + [1, 0, {n}]", [2.0, 2.0, 6.0]),
    ("-{v}", [-1.0, -2.0, -3.0]),
    ("norm({v} - [1, 0, 0])", math.sqrt(13)),
    ("{pose}.z + 0.1", 0.4),
    ("{pose}.xyz", [0.1, 0.2, 0.3]),
    ("{pose}.yaw", 45),
    ("{turned}.yaw", 90.0),
    ("{turned}.rpy", [0.0, 0.0, 90.0]),
    ("{turned} + [0, 0, 1]", {**QUARTER, "xyz": [0.1, 0.2, 1.3]}),
    ("{poses}[1].x + len({poses})", 3),
    ("min({n}, 2, 5) + max({x}, 1)", 3),
    ("round({x} * 10) + floor({x}) + ceil({x})", 3),
    ("round({x} / 3, 2)", 0.08),
    ("sqrt({n} + 1) + abs(-{n})", 5.0),
    ("sin(30) + cos(60 deg) + tan({n} * 15)", 2.0),
    ("atan2({n}, {n})", 45.0),
    ("{x} if {on} else {n}", 0.25),
    ("{x} if {n} > 5 else {n}", 3),
    ("{n} > 5 and 1 / 0 > {n}", False),
    ("2 * pi * {n}", 6 * math.pi),
]


def near(a: Data, b: Data) -> bool:
    if isinstance(b, dict):
        return a.keys() == b.keys() and all(near(a[key], b[key]) for key in b)
    if isinstance(b, list):
        return len(a) == len(b) and all(map(near, a, b))
    if isinstance(b, float):
        return math.isclose(a, b, rel_tol=1e-12, abs_tol=1e-12)
    return type(a) is type(b) and a == b


@pytest.mark.parametrize(("text", "value"), VALUES)
def test_value_of_an_expression(text: str, value: Data) -> None:
    assert near(value_of(parse(text), KEYS.__getitem__), value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{n} / ({n} - 3)", "'{n} / ({n} - 3)' divides by zero"),
        ("{n} * {word}", "'{n} * {word}': text 'red' is no number"),
        ("{v} + [1]", "'{v} + [1]': lists of 3 and 1"),
        ("{v}[3]", "'{v}' has no item 3: it has 3, counted from 0"),
        ("{v}[0.5]", "an index is a whole number, not 0.5"),
        ("{pose}.weight", "'{pose}', a mapping, has no part 'weight'"),
        ("{on} + 1", "'{on} + 1': true and 1 cannot be added"),
        ("not {n}", "'{n}' is 3, not true or false"),
        ("{word} < 1", "'{word}' is text 'red', not a number"),
        ("sqrt(-{n})", "sqrt has no value for -3"),
        ("{n} * 1e15 * 1e15", "'{n} * 1e15 * 1e15' is too large"),
    ],
)
def test_an_expression_without_a_value_is_an_error(text: str, message: str) -> None:
    """An operand of the wrong kind is an error of the expression, with the part that is wrong."""
    with pytest.raises(ExpressionError) as caught:
        value_of(parse(text), KEYS.__getitem__)
    assert str(caught.value) == message
    assert 0 <= caught.value.start < caught.value.end <= len(text)


def test_a_text_cannot_grow_without_bound() -> None:
    longest = {"word": "a" * 1000}
    with pytest.raises(ExpressionError, match="more than 1000 characters"):
        value_of(parse("{word} + {word}"), longest.__getitem__)


TYPES = {
    "r": ValueType("number", LENGTH),
    "a": ValueType("number", ANGLE),
    "t": ValueType("number", (("s", 1),)),
    "p": ValueType("object"),
    "v": ValueType("array", LENGTH),
}


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("2 * {r}", LENGTH),
        ("{r} + 0.1", LENGTH),
        ("{r} + 2 * 0.1", LENGTH),
        ("{r} / {t}", (("m", 1), ("s", -1))),
        ("{r} / 2 m", ()),
        ("sqrt({r} * {r})", LENGTH),
        ("{p}.z - {v}.x", LENGTH),
        ("{p}.yaw + 5", ANGLE),
        ("atan2({r}, 5 cm)", ANGLE),
        ("{r} * sin({a})", LENGTH),
        ("{q} * {r}", None),
        ("{q} + {r}", LENGTH),
        ("1 + 2 * {q}", None),
        ("max({r}, 5 cm)", LENGTH),
    ],
)
def test_unit_of_an_expression(text: str, unit: object) -> None:
    """A bare number has any unit in a sum and none in a product; an unknown key has any."""
    assert type_of(parse(text), TYPES).dimension == unit


@pytest.mark.parametrize(
    "text",
    ["{r} + {a}", "{r} > {t}", "{r} * {r} + {r}", "{p}.z + {p}.yaw", "sin({r})", "{p} + {a} * {v}",
     "min({r}, {a})", "{v} + [{t}, {t}, {t}]", "{r} + 5 s", "not {r}", "{r} and true"],
)  # fmt: skip
def test_units_that_do_not_match_are_refused(text: str) -> None:
    with pytest.raises(ExpressionError):
        type_of(parse(text), TYPES)


class Ports(PortModel):
    to: PoseSpec = port(..., "Target")
    time: Duration = port(1.0, "Time", le=10)
    times: int = port(1, "Count", ge=1)


def test_ports_are_evaluated_at_each_start() -> None:
    blackboard = Blackboard()
    given = {"to": {"xyz": ["{x} / 2", 0, "{z}"]}, "time": "{t} * 2", "times": "{n} + 1"}
    bound = BoundPorts(Ports, given, blackboard)
    for key, value in {"x": 0.4, "z": 0.3, "t": "1 s", "n": 1}.items():
        blackboard.write(key, value)
    now = bound.now()
    assert isinstance(now, Ports)
    assert now.to.xyz == (0.2, 0, 0.3)
    assert (now.time, now.times) == (2.0, 2)
    blackboard.write("n", 4)
    again = bound.now()
    assert isinstance(again, Ports)
    assert again.times == 5


@pytest.mark.parametrize(
    ("n", "reason"),
    [(-1, "times: must be at least 1, not 0"), ("a", "'{n} + 1': text 'a' and 1 cannot be added")],
)
def test_a_value_that_its_port_does_not_allow_is_a_failure(n: Data, reason: str) -> None:
    blackboard = Blackboard()
    blackboard.write("n", n)
    bound = BoundPorts(Ports, {"to": {"xyz": [0, 0, 0]}, "times": "{n} + 1"}, blackboard)
    with pytest.raises(Failure, match="NO_VALUE") as caught:
        bound.now()
    assert reason in caught.value.reason


PARAMS = (
    "params: {r: {type: number, default: 0.2, unit: m}, t: {type: duration, default: 500 ms}}\n"
)


def test_an_expression_of_parameters_is_its_value(tmp_path: Path) -> None:
    text = 'go: {to: {xyz: ["{r} / 2", "-{r}", 0.5]}, time: "2 * {t} + 1"}'
    tree = tree_of(task(tmp_path, text, PARAMS))
    assert tree.ports == {"to": {"xyz": [0.1, -0.2, 0.5]}, "time": 2.0}


def test_keys_in_a_subtree_are_its_own(tmp_path: Path) -> None:
    before = (
        "subtrees: {pause: {params: {time: {type: duration}},"
        ' tree: {sequence: [{set: {key: n, value: 1}}, {wait: "{time} * {n}"}]}}}\n'
    )
    text = (
        "sequence: [{set: {key: n, value: 3}},"
        ' {subtree: {use: pause, params: {time: "{n} * 0.1"}}}]'
    )
    waits = [node for node in tree_of(task(tmp_path, text, before)).walk() if node.kind == "wait"]
    (wait,) = waits
    assert wait.ports["seconds"] == "({n} * 0.1) * {pause#1/n}"
    assert [*keys_in(wait.ports["seconds"])] == ["n", "pause#1/n"]


def test_a_condition_may_be_an_expression(tmp_path: Path) -> None:
    text = 'if: {condition: "{r} > 10 cm", then: succeed}'
    condition = tree_of(task(tmp_path, text, PARAMS)).children[0]
    assert (condition.kind, dict(condition.ports)) == ("test", {"expression": True})


def test_a_guarded_value_is_no_error(tmp_path: Path) -> None:
    """One of the values written would be refused, but it is not known which one is present."""
    text = (
        "sequence: [{set: {key: n, value: 0}}, {force_success: {child: {set: {key: n, value: 1}}}},"
        ' {if: {condition: "{n} > 0", then: {wait: "1 / {n}"}}}]'
    )
    assert not [one for one in problems_of(task(tmp_path, text)) if one.severity == "error"]


TIMES = int(os.environ.get("BT_DUALARM_FUZZ_TIMES", "1"))
WORDS = [
    *("{n}", "{x}", "{v}", "{pose}", "{word}", "{on}", "{time}", "{poses}", "{gone}", "{", "}"),
    *("+", "-", "*", "/", "//", "%", "**", "<", "==", "!=", "(", ")", "[", "]", ",", ".", ":"),
    *("and", "or", "not", "if", "else", "in", "is", "lambda", "for", "await", "true", "pi"),
    *("1", "0", "2.5", "1e308", "9" * 39, "5 cm", "3deg", "1 m/s²", "0x1f", "1_000", "007", "1j"),
    *(
        "'a'",
        '"b"',
        "'",
        '"',
        "\\",
        "\n",
        "\0",
        "°",
        "é",
        "\U0001d4b3",
        "\ufeff",
        "#",
        "@",
        ":=",
        "f''",
    ),
    *("__class__", "__import__", "exec", "open", "x", "z", "xyz", "rpy", *FUNCTIONS),
]


def random_text(dice: Random) -> str:
    """Words in any order, or a correct expression with one word replaced."""
    if dice.random() < 0.5:
        return "{n}" + "".join(
            dice.choice(WORDS) + " " * dice.randrange(2) for _ in range(dice.randint(1, 8))
        )
    words = dice.choice(VALUES)[0].split(" ")
    words[dice.randrange(len(words))] = dice.choice(WORDS)
    return " ".join(words) + (" + {n}" if dice.random() < 0.5 else "")


@pytest.mark.parametrize("chunk", range(2))
def test_random_texts_raise_only_expression_errors(chunk: int) -> None:
    """Only expression errors are raised, at positions in the text; all values are YAML data."""
    dice = dice_of(chunk)
    evaluated = 0
    outside = 0
    for _ in range(1000 * TIMES):
        text = random_text(dice)
        try:
            expression = parse(text)
            type_of(expression, {})
            value = value_of(expression, lambda key: KEYS.get(key))
        except ExpressionError as error:
            outside += not 0 <= error.start < error.end <= len(text) + 1
            continue
        evaluated += 1
        assert is_data(value), text
    assert evaluated > 10 * TIMES
    assert not outside


def is_data(value: Data) -> bool:
    if isinstance(value, list):
        return all(map(is_data, value))
    if isinstance(value, dict):
        return all(isinstance(key, str) and is_data(item) for key, item in value.items())
    if isinstance(value, bool) or value is None or isinstance(value, str):
        return True
    return isinstance(value, int | float) and abs(value) <= LARGEST_INTEGER


@pytest.mark.parametrize(
    "text", ["-" * 450 + "{n}", "[" * 90 + "{n}", "{n}" + ".x" * 200,
             "not " * 100 + "{on}", "{n}" + " + 1" * 120, "{n}" * 200]
)  # fmt: skip
def test_deep_texts_are_refused(text: str) -> None:
    """Depth and length are bounded before any recursion."""
    with pytest.raises(ExpressionError):
        parse(text)


def test_resolved_leaves_other_texts_unchanged() -> None:
    plain = ["a{2,3}|{}", "no reference", {"deep": ["{n} + 1", "{word}"]}, 5, None]
    expected = ["a{2,3}|{}", "no reference", {"deep": [4, "red"]}, 5, None]
    assert resolved(plain, KEYS.__getitem__) == expected


def test_the_documentation_has_every_function() -> None:
    page = (Path(__file__).parents[2] / "docs" / "expressions.md").read_text(encoding="utf-8")
    for name, function in FUNCTIONS.items():
        assert f"| `{name}` | {function.description} |" in page


def test_conditions_among_the_ports_become_nodes_around_the_node(tmp_path: Path) -> None:
    """From the outside in: skip_if, only_if, until, in whatever order the file has them."""
    text = 'wait: {until: "{r} > 1", seconds: 2, name: pause, skip_if: succeed}'
    tree = tree_of(task(tmp_path, text, PARAMS))
    nodes = [(node.kind, node.name) for node in tree.walk()]
    assert nodes == [
        ("skip_if", "skip_if"),
        ("succeed", "succeed"),
        ("until", "until"),
        ("test", "test"),
        ("wait", "pause"),
    ]
    assert tree.location.text[tree.location.column - 1 :].startswith("skip_if")


def test_a_skill_cannot_have_a_port_with_the_name_of_a_condition() -> None:
    class Watch(Skill):
        """Watches."""

        class Ports(PortModel):
            until: float = port(1.0, "Time", unit="s")

        example = "watch"

    with pytest.raises(DualArmError, match="'until' cannot be the name of a port"):
        registry_with(Watch)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("({n} + 1", "this expression is not complete"),
        ("1 if {on}", "this expression is not complete"),
        ("{n} - not 1", "'{n} - not 1' is not an expression"),
        ("(* {n})", "'(* {n})' is not an expression"),
        ("{n} + 1)", "'{n} + 1)' is not an expression"),
    ],
)
def test_an_error_reads_the_same_in_every_version_of_python(text: str, message: str) -> None:
    """Python's own words for them differ between 3.11 and 3.13."""
    with pytest.raises(ExpressionError) as found:
        parse(text)
    assert str(found.value) == message
