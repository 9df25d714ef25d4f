from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.perception.localization import RunningMean


def test_views_alike_make_a_mean_over_the_last() -> None:
    """Of ten frames: the plain mean until then, a tenth of what each tells from then on."""
    memory = RunningMean(1)
    values = np.arange(10.0)
    for value in values:
        memory.take(np.array([value]), 0.01, 10)
    assert memory.value == pytest.approx(values.mean())
    memory.take(np.array([20.0]), 0.01, 10)
    assert memory.value == pytest.approx(0.9 * values.mean() + 0.1 * 20.0)
    assert memory.doubt == pytest.approx(0.01)


def test_one_good_view_counts_for_more_than_many_poor_ones() -> None:
    """Thirty that may be wrong by a tenth, alike, are worth no more than the last of them."""
    memory = RunningMean(1)
    for _ in range(30):
        memory.take(np.array([1.08]), 0.1, 30)
    assert memory.doubt == pytest.approx(0.1)
    memory.take(np.array([1.0]), 0.002, 30)
    assert memory.value == pytest.approx(1.0, abs=0.002)
    assert memory.doubt < 0.004


def test_poor_views_do_not_wash_away_a_good_one() -> None:
    memory = RunningMean(1)
    memory.take(np.array([1.0]), 0.002, 30)
    for _ in range(30):
        memory.take(np.array([1.08]), 0.1, 30)
    assert memory.value == pytest.approx(1.0, abs=0.002)


def test_what_was_forgotten_does_not_count() -> None:
    memory = RunningMean(2)
    memory.take(np.array([1.0, 2.0]), 0.002, 30)
    memory.forget()
    memory.take(np.array([3.0, 4.0]), 0.1, 30)
    assert memory.value == pytest.approx([3.0, 4.0])
    assert memory.doubt == pytest.approx(0.1)
