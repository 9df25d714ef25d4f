"""A SUCCESS is true: the object is where it was left, and stays there."""

from __future__ import annotations

import pytest

from benchmarks.false_success_cases import Case, cases, play
from tests.families import some

CODES = {
    ("place", "sticks to a finger for 60 s"): "NOT_PLACED",
    ("place", "a ball that rolls"): "NOT_PLACED",
    ("place", "held 20 mm off its center"): "NOT_PLACED",
    ("place", "half over a board"): "NOT_SUPPORTED",
    ("transport", "slid by 15 mm"): "NOT_REACHED",
    ("transport", "tilted by 20°"): "NOT_REACHED",
    ("regrasp", "pushed by 15 mm"): "NOT_PLACED",
}
"""A few of the ways of the benchmark: skill, what happens, and the code with which it fails."""

CHOSEN = [
    key
    for kind in dict.fromkeys((skill, code) for (skill, _), code in CODES.items())
    for key in some((key for key, code in CODES.items() if (key[0], code) == kind), 3)
]
"""One in three of those with the same skill and the same code."""


@pytest.mark.parametrize(
    "case",
    [case for case in cases() if (case.skill, case.name) in CHOSEN],
    ids=lambda case: case.name,
)
def test_what_does_not_stay_is_no_success(case: Case) -> None:
    """The leaf fails with the code that says why, however well it went by what the arm senses."""
    leaf, lies = play(case)
    assert not lies
    assert (leaf.skill, leaf.code) == (case.skill, CODES[case.skill, case.name]), leaf.reason
