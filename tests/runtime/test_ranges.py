"""Numbers of the format: each has a range, and every value within it can be run."""

from __future__ import annotations

import math
import sys

import pytest
from pydantic import BaseModel

from bt_dualarm.behaviors.language import LANGUAGE
from bt_dualarm.runtime.file_check import check
from bt_dualarm.runtime.options import RunOptions
from bt_dualarm.runtime.run import Run
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.document import TreeContent
from tests.families import WHOLE, some
from tests.runtime.numbers import Number, fields_of, numbers

REGISTRY = Registry.load()
NUMBERS = list(numbers(REGISTRY))
ANY_VALUE = {("compare", "value"), ("compare", "to"), ("switch", "value"), ("await", "to")}
"""Ports that take any value."""

RANGED = [one for one in NUMBERS if (one.node[-1:] + one.path[len(one.node) :]) not in ANY_VALUE]


FIRST = {(one.node[-1:], *one.owner): one for one in reversed(RANGED)}
"""One of each field of a node: coordinates are bounded alike, and so are forms of a skill."""


def test_every_number_of_the_format_is_tested() -> None:
    models: list[type[BaseModel]] = [TreeContent]
    models += [node_type.ports for node_type in LANGUAGE.values()]
    models += [skill.Ports for skill in REGISTRY.skills.values()]
    expected = {field for model in models for field in fields_of(model)}
    assert expected - {one.owner for one in NUMBERS} == set()


def test_every_number_has_a_smallest_and_a_largest() -> None:
    """A bound that is too large to be meant does not count."""
    beyond = (-1e10, 1e10)
    assert [str(one) for one in RANGED if any(one.is_accepted(value) for value in beyond)] == []


def test_a_number_out_of_its_range_is_refused_by_name() -> None:
    ranged = RANGED if WHOLE else some(FIRST.values(), 2)
    wrong = {
        str(one): found
        for number, one in enumerate(ranged)
        if (found := undetected_values(one, number))
    }
    assert wrong == {}


def undetected_values(one: Number, turn: int) -> list[str]:
    """Values out of a number's range that are not refused, or not by its name.

    The first one below or above, in turns; all of them in ``make matrix``. For a few numbers also
    infinity and NaN, which the file reader refuses before it knows their field.
    """
    step = 1 if one.is_integer else 0
    beyond = [
        one.bound(sign) + sign * step if step else math.nextafter(one.bound(sign), sign * math.inf)
        for sign in ((-1, 1) if WHOLE else (1 - turn % 2 * 2,))
    ]
    if WHOLE or turn % 30 == 0:
        beyond += (math.inf, math.nan)
    if WHOLE:
        beyond += (1e15, -1e15, sys.float_info.max, -sys.float_info.max, -math.inf)
    names = [part for part in one.path[len(one.node) :] if isinstance(part, str)]
    found = []
    for value in beyond:
        whole = int(value) if step and abs(value) < 1e16 else value
        checked = check(one.set_to(whole), REGISTRY.kinds, build=False)
        messages = [str(problem) for problem in checked.problems if problem.severity == "error"]
        if not any(name in message for message in messages for name in names):
            found.append(f"{value}: {messages}")
    return found


ONE_IN = 23
"""In ``make test``, one of this many numbers is run."""


@pytest.mark.parametrize("one", some(FIRST.values(), ONE_IN), ids=str)
def test_a_number_within_its_range_runs_or_is_refused_beforehand(one: Number) -> None:
    """The smallest, the largest, and those nearest to zero: no leaf raises, no run breaks.

    One of these values in turn; each of them in ``make matrix``.
    """
    tiny = [value for value in (5e-324, 1e-9) if one.is_accepted(value)]
    values = [*dict.fromkeys((*one.bounds, *tiny))]
    turn = [*FIRST.values()].index(one) // ONE_IN % len(values)
    for value in values if WHOLE else values[turn : turn + 1]:
        checked = check(one.set_to(int(value) if one.is_integer else value), REGISTRY.kinds)
        if checked.file is None:
            assert all(problem.message for problem in checked.problems)
            continue
        with Run(checked.file, REGISTRY, RunOptions(renderer="ray")) as run:
            run.step(one.steps)
            run.stop()
            result = run.finish()
        assert result.error == "", f"{value}: {result.error}"
        leaves = [leaf for arm in result.arms.values() for leaf in arm.leaves.values()]
        bugs = [f"{value}: {leaf.reason}" for leaf in leaves if leaf.code == "EXCEPTION"]
        assert bugs == []
