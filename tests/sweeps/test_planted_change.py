"""Comparison of sweeps detects a lower gain of the controller."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.planted_change import lowered, swept, verdict
from bt_dualarm.control import dynamics
from bt_dualarm.sweeps.comparison import compare


@pytest.mark.slow
def test_lower_gain_is_detected(tmp_path: Path) -> None:
    before = swept(tmp_path / "before", 12)
    planted = compare(before, swept(tmp_path / "after", 12, share=0.8))
    assert verdict(planted) == "decided"
    worse = {one.name for one in planted.metrics if one.differs and one.difference > 0}
    assert "arm1.circle.path_rms_m" in worse


def test_planted_change_is_limited_to_its_context() -> None:
    whole = dynamics.BANDWIDTH
    with lowered(0.5):
        assert 0.5 * whole == dynamics.BANDWIDTH
    assert whole == dynamics.BANDWIDTH
