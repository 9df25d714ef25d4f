"""A world with overlapping bodies is refused before the run."""

from __future__ import annotations

import pytest

from bt_dualarm.core.errors import WorldError
from bt_dualarm.sim.world import World
from tests.sim.worlds import arm, box, file_of


def test_overlapping_arms_are_refused() -> None:
    file = file_of({"arm1": arm("ur5", (0.0, 0.0, 0.0)), "arm2": arm("panda", (0.1, 0.0, 0.0))})
    with pytest.raises(
        WorldError, match=r"arm .arm1. would be \d+ mm deep in arm2/\w+, with arm1/"
    ):
        World(file).refuse_overlaps()


def test_object_in_the_floor_is_refused() -> None:
    file = file_of({"arm1": arm("ur5")}, {"cube": box((0.5, 0.4, 0.0))})
    with pytest.raises(WorldError, match=r"object 'cube' would be \d+ mm deep in floor"):
        World(file).refuse_overlaps()
