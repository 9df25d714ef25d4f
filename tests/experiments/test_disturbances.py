"""What the benchmarks do to a follower."""

from __future__ import annotations

import pytest

from benchmarks.disturbances import ages_of_data, covered
from bt_dualarm.skill.registry import Registry


@pytest.mark.slow
def test_a_cover_is_survived_by_a_prediction_that_is_certain_for_a_while(
    registry: Registry,
) -> None:
    """Half a second without a sight: the arm goes on by the prediction, then brakes."""
    with ages_of_data() as ages:
        trial = covered(registry, seed=0, begin=6.0, length=0.5)
    assert trial.outcome == "SUCCESS"
    assert trial.lost_count == 1, "it was covered"
    assert ages.asked > 500
    assert ages.oldest <= 0.3
