"""Disturbances of tracking by the benchmarks."""

from __future__ import annotations

import pytest

from benchmarks.disturbances import ages_of_data, covered
from bt_dualarm.skill.registry import Registry


@pytest.mark.slow
def test_tracking_survives_half_a_second_of_occlusion(
    registry: Registry,
) -> None:
    """Without detections, the arm follows the prediction for a while and then brakes."""
    with ages_of_data() as ages:
        trial = covered(registry, seed=0, begin=6.0, length=0.5)
    assert trial.outcome == "SUCCESS"
    assert trial.lost_count == 1, "the target was occluded"
    assert ages.asked > 500
    assert ages.oldest <= 0.3
