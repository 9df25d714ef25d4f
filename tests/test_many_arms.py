"""The benchmarks of many arms, in small: arms that cannot meet do not disturb one another."""

from __future__ import annotations

import pytest

from benchmarks.many_arms import judged
from benchmarks.third_arm import Place, failures, places, run_beside
from bt_dualarm.skill.registry import Registry

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("seed", range(3))
def test_arms_end_as_alone_where_they_cannot_meet(seed: int, registry: Registry) -> None:
    """And none touches another, or is refused for one that it did not come near."""
    finding = judged(seed, registry)
    assert finding.wrong == []


@pytest.mark.parametrize("place", places(1, seed=0), ids=str)
def test_the_main_job_is_done_beside_a_third_arm(place: Place, registry: Registry) -> None:
    """More than a metre away, whatever it does, it matters to nobody."""
    assert failures(run_beside(place, registry)) == []
