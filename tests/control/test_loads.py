"""An arm either carries a load or refuses it before it moves."""

from __future__ import annotations

import pytest

from benchmarks.loads import Case, carry, cases
from bt_dualarm.skill.registry import Registry

REGISTRY = Registry.load()

WIDE_LOADS = (
    Case("xarm7", "plate", 1.0, (0.3, 0.3, 0.01), (0.0, 0.0, 0.005), 1),
    Case("xarm7", "rod", 0.1, (0.6, 0.02, 0.02), (0.0, 0.0, 0.01), 1),
    Case("ur10", "rod", 0.5, (0.4, 0.02, 0.02), (0.0, 0.0, 0.01), 1),
)
"""Wide loads at light wrists: on a soft weld they shook a joint at up to 40 times its limit."""


@pytest.mark.parametrize("case", WIDE_LOADS, ids=lambda case: f"{case.robot}-{case.kind}")
def test_wide_load_does_not_shake_a_light_wrist(case: Case) -> None:
    outcome, fastest = carry(case, REGISTRY)
    assert outcome == "carried"
    assert fastest < 1.02


@pytest.mark.slow
def test_every_load_is_carried_or_refused() -> None:
    """Plates, rods, cubes and eccentric weights do not fail on any robot."""
    outcomes = [(case, *carry(case, REGISTRY)) for case in cases(60, 5)]
    failed = [row for row in outcomes if row[1] not in ("carried", "refused")]
    assert failed == []
    assert sum(outcome == "carried" for _, outcome, _ in outcomes) >= 50
