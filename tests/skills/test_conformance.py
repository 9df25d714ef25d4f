"""What every registered skill keeps to, whoever wrote it."""

from __future__ import annotations

import pytest

from bt_dualarm.skill.skill import Skill
from bt_dualarm.testing import LAWS
from tests.skills.candidates import REGISTRY, candidate

SKILLS = dict(REGISTRY.skills)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("name", sorted(SKILLS))
def test_every_skill_keeps_to_every_law(name: str, law: str) -> None:
    LAWS[law](candidate(name))


def test_every_skill_class_is_of_the_facade() -> None:
    """Shipped skills have no privileges: they are subclasses of the one public base."""
    assert all(issubclass(skill, Skill) for skill in SKILLS.values())
