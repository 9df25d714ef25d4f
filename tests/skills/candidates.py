"""Each shipped skill on trial, for all tests of a process: its example is played once."""

from __future__ import annotations

import functools
from typing import Final

from bt_dualarm.runtime.outcome import ArmResult
from bt_dualarm.skill.registry import Registry
from bt_dualarm.testing import Candidate, twice
from tests.skills.scenarios import SCENARIOS

REGISTRY: Final = Registry.load()


class Once(Candidate):
    """A skill whose example is run once: only one law is about what it does the second time."""

    @functools.cached_property
    def run_twice(self) -> ArmResult:
        """Result of the arm with the leaf run once, at the path at which it would be run twice."""
        file = twice(self.node, "example twice")
        file["repeat"]["times"] = 1
        return self.perform(file).result


@functools.cache
def candidate(name: str, again: bool = False) -> Candidate:
    """Kept, because it knows what its example does and how long that takes.

    Args:
        name: Name of the skill.
        again: Whether its example is run a second time.
    """
    assert name in SCENARIOS, f"tests/skills/scenarios.py lacks a scenario for {name}"
    return (Candidate if again else Once)(name, REGISTRY, SCENARIOS[name])
