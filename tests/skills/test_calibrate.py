"""The camera is believed where it is, once the arm has looked at a still mark from around it."""

from __future__ import annotations

import pytest

from benchmarks.hand_eye import calibrated


@pytest.mark.parametrize(("reality", "seed"), [("lab", 1), ("rough", 0)])
def test_the_mount_is_corrected_by_what_is_seen(reality: str, seed: int) -> None:
    """Against the simulator: aim and turn are a fifth of what they were, at least."""
    before, after, leaf = calibrated("panda", reality, seed)
    assert leaf.status == "SUCCESS", leaf.reason
    assert before.aim_mm > 1.0
    assert after.aim_mm < 0.2 * before.aim_mm
    assert after.turn_deg < 0.2 * before.turn_deg
    assert float(leaf.metrics["residual_px"]) < 0.2 < float(leaf.metrics["residual_before_px"])
    assert leaf.metrics["views"] == 10
