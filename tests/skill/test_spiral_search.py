from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_dualarm.skill.tracking import SEARCH_SPEED, Spiral

points = st.builds(lambda x, y: np.array((x, y)), *[st.floats(-0.3, 0.3)] * 2)


@given(start=points, center=points, radius=st.floats(0.0, 0.2), elapsed=st.floats(0.0, 20.0))
def test_search_stays_within_its_start_or_radius(
    start: np.ndarray, center: np.ndarray, radius: float, elapsed: float
) -> None:
    """Every position is nearer to the center than the start, or within the radius."""
    distance = float(np.linalg.norm(Spiral(start, center, radius).position(elapsed) - center))
    assert distance <= max(radius, float(np.linalg.norm(start - center))) + 1e-9


@given(start=points, center=points, radius=st.floats(0.001, 0.2), elapsed=st.floats(0.0, 20.0))
def test_search_is_continuous_and_slow(
    start: np.ndarray, center: np.ndarray, radius: float, elapsed: float
) -> None:
    """No jumps, and no faster than declared, with a tolerance where the spiral meets its rim."""
    search = Spiral(start, center, radius)
    step = search.position(elapsed + 1e-3) - search.position(elapsed)
    assert float(np.linalg.norm(step)) <= 1.02 * SEARCH_SPEED * 1e-3


def test_search_starts_at_the_tool_and_ends_on_its_rim() -> None:
    search = Spiral(np.zeros(2), np.array((0.03, 0.04)), 0.02)
    assert search.position(0.0) == pytest.approx(np.zeros(2))
    assert search.position(0.5) == pytest.approx(np.array((0.03, 0.04)))
    rim = [float(np.linalg.norm(search.position(t) - search.center)) for t in (2.0, 3.0, 9.0)]
    assert rim == pytest.approx([0.02, 0.02, 0.02])
