from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.perception.localization import RunningMean


def test_equal_views_are_averaged_over_the_last_frames() -> None:
    """For ten frames: the plain mean at first, then each new view with a weight of a tenth."""
    memory = RunningMean(1)
    values = np.arange(10.0)
    for value in values:
        memory.take(np.array([value]), 0.01, 10)
    assert memory.value == pytest.approx(values.mean())
    memory.take(np.array([20.0]), 0.01, 10)
    assert memory.value == pytest.approx(0.9 * values.mean() + 0.1 * 20.0)
    assert memory.doubt == pytest.approx(0.01)


def test_one_good_view_counts_for_more_than_many_poor_ones() -> None:
    """Thirty views with the same possible error of a tenth count for no more than one of them."""
    memory = RunningMean(1)
    for _ in range(30):
        memory.take(np.array([1.08]), 0.1, 30)
    assert memory.doubt == pytest.approx(0.1)
    memory.take(np.array([1.0]), 0.002, 30)
    assert memory.value == pytest.approx(1.0, abs=0.002)
    assert memory.doubt < 0.004


def test_poor_views_do_not_outweigh_a_good_one() -> None:
    memory = RunningMean(1)
    memory.take(np.array([1.0]), 0.002, 30)
    for _ in range(30):
        memory.take(np.array([1.08]), 0.1, 30)
    assert memory.value == pytest.approx(1.0, abs=0.002)


def test_forgotten_views_do_not_count() -> None:
    memory = RunningMean(2)
    memory.take(np.array([1.0, 2.0]), 0.002, 30)
    memory.forget()
    memory.take(np.array([3.0, 4.0]), 0.1, 30)
    assert memory.value == pytest.approx([3.0, 4.0])
    assert memory.doubt == pytest.approx(0.1)
