"""Laws that every registered skill obeys, whoever wrote it."""

from __future__ import annotations

from itertools import product

import pytest

from bt_dualarm.skill.skill import Skill
from bt_dualarm.testing import LAWS
from tests.families import some
from tests.skills.candidates import REGISTRY, candidate

SKILLS = dict(REGISTRY.skills)
REPEATED = "starts again after success"
"""The law for which an example runs twice."""

HALTS = [law for law in LAWS if " when halted at " in law]
AGAIN = [law for law in LAWS if law.startswith("starts again ")]
NEVER = [law for law in LAWS if law.startswith("has no effect ")]
BRAKES = [law for law in LAWS if law == "starts while the arm brakes"]
CASES = sorted(
    {
        *product(SKILLS, set(LAWS) - {*HALTS, *AGAIN, *NEVER, *BRAKES}),
        *some(product(sorted(SKILLS), HALTS), 24),
        *some(product(sorted(SKILLS), AGAIN), 9),
        *some(product(sorted(SKILLS), NEVER), 4),
        *some(product(sorted(SKILLS), BRAKES), 4),
    }
)
"""Pairs of skill and law. Moments of halting and kinds of restart are spread over the skills; one
skill in four is checked for the laws of a skill that is never ticked, or starts on a moving arm."""


@pytest.mark.parametrize(("name", "law"), CASES)
def test_every_skill_obeys_every_law(name: str, law: str) -> None:
    LAWS[law](candidate(name, again=(name, REPEATED) in CASES))


def test_every_skill_is_a_subclass_of_the_public_base() -> None:
    """Shipped skills have no privileges over a user's own."""
    assert all(issubclass(skill, Skill) for skill in SKILLS.values())
