"""A small version of the picking benchmark: true outcomes on the table and out of reach."""

from __future__ import annotations

import pytest

from benchmarks.picking import Place, attempt, places
from bt_dualarm.skill.registry import Registry
from tests.families import some

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("place", some(places(6, seed=7), 2), ids=str)
def test_cube_on_the_table_is_picked(place: Place, registry: Registry) -> None:
    """Attached and lifted in the simulator, not only by the tree's report."""
    one = attempt(place, registry)
    assert one.within_reach
    assert one.verdict == "picked", one.reason


def test_cube_out_of_reach_is_refused_before_any_motion(registry: Registry) -> None:
    """The arm is 0.5 m farther away; the reason states the distance."""
    one = attempt(Place(0.55, -0.65, 10.0), registry, back=0.5)
    assert not one.within_reach
    assert one.verdict == "refused"
    assert "OUT_OF_REACH" in one.reason
    assert "1.28 m" in one.reason
