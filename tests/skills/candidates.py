"""One conformance candidate for each shipped skill, cached: its example runs once a process."""

from __future__ import annotations

import functools
from typing import Final

from bt_dualarm.runtime.outcome import ArmResult
from bt_dualarm.skill.registry import Registry
from bt_dualarm.testing import Candidate, twice
from tests.skills.scenarios import SCENARIOS

REGISTRY: Final = Registry.load()


class Once(Candidate):
    """A candidate whose example runs once; only one law needs a second run."""

    @functools.cached_property
    def run_twice(self) -> ArmResult:
        """Result of the arm with the leaf run once, in the tree that would run it twice."""
        file = twice(self.node, "example twice")
        file["repeat"]["times"] = 1
        return self.perform(file).result


@functools.cache
def candidate(name: str, again: bool = False) -> Candidate:
    """Candidate of a skill, cached because it keeps the results and duration of its example.

    Args:
        name: Name of the skill.
        again: Whether its example runs a second time.
    """
    assert name in SCENARIOS, f"tests/skills/scenarios.py lacks a scenario for {name}"
    return (Candidate if again else Once)(name, REGISTRY, SCENARIOS[name])
