"""What every registered skill keeps to, whoever wrote it."""

from __future__ import annotations

from itertools import product

import pytest

from bt_dualarm.skill.skill import Skill
from bt_dualarm.testing import LAWS
from tests.families import some
from tests.skills.candidates import REGISTRY, candidate

SKILLS = dict(REGISTRY.skills)
REPEATED = "starts again after success"
"""The law for which an example is run twice."""

HALTS = [law for law in LAWS if " when halted at " in law]
AGAIN = [law for law in LAWS if law.startswith("starts again ")]
NEVER = [law for law in LAWS if law.startswith("has no effect ")]
CASES = sorted(
    {
        *product(SKILLS, set(LAWS) - {*HALTS, *AGAIN, *NEVER}),
        *some(product(sorted(SKILLS), HALTS), 24),
        *some(product(sorted(SKILLS), AGAIN), 9),
        *some(product(sorted(SKILLS), NEVER), 4),
    }
)
"""Skill and law, skill by skill; each of the moments at which some skill is halted, and each way in
which it starts again, in turns; one in four skills that is never ticked."""


@pytest.mark.parametrize(("name", "law"), CASES)
def test_every_skill_keeps_to_every_law(name: str, law: str) -> None:
    LAWS[law](candidate(name, again=(name, REPEATED) in CASES))


def test_every_skill_class_is_of_the_facade() -> None:
    """Shipped skills have no privileges: they are subclasses of the one public base."""
    assert all(issubclass(skill, Skill) for skill in SKILLS.values())
