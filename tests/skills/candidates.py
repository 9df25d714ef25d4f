"""Each shipped skill on trial, for all tests of a process: its example is played once."""

from __future__ import annotations

import functools
from typing import Final

from bt_dualarm.skill.registry import Registry
from bt_dualarm.testing import Candidate
from tests.skills.scenarios import SCENARIOS

REGISTRY: Final = Registry.load()


@functools.cache
def candidate(name: str) -> Candidate:
    """Kept, because it knows what its example does and how long that takes."""
    assert name in SCENARIOS, f"tests/skills/scenarios.py lacks a scenario for {name}"
    return Candidate(name, REGISTRY, SCENARIOS[name])
