"""A SUCCESS is true: the object is where it was placed, and stays there."""

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
"""Some cases of the benchmark: skill, disturbance, and the code with which it fails."""

CHOSEN = [
    key
    for kind in dict.fromkeys((skill, code) for (skill, _), code in CODES.items())
    for key in some((key for key, code in CODES.items() if (key[0], code) == kind), 3)
]
"""One in three of the cases with the same skill and code."""


@pytest.mark.parametrize(
    "case",
    [case for case in cases() if (case.skill, case.name) in CHOSEN],
    ids=lambda case: case.name,
)
def test_object_that_does_not_stay_is_a_failure(case: Case) -> None:
    """The leaf fails with the code of the cause, however good the measurements of the arm are."""
    leaf, false_successes = play(case)
    assert not false_successes
    assert (leaf.skill, leaf.code) == (case.skill, CODES[case.skill, case.name]), leaf.reason
