"""Maps of the error over model errors: the criterion of stability, the output, one corner."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.path_reality import Figures
from benchmarks.plant_map import MAPS, Place, draw, instability, stood, table

STEADY = Figures(0.1, 0.2, 0.05, "", (0.1, 0.1, 0.1))


def test_steady_error_is_stable() -> None:
    assert instability(STEADY) == ""


def test_growing_or_large_error_or_fault_is_unstable() -> None:
    assert "grows from 0.10 to 0.60" in instability(replace(STEADY, thirds=(0.1, 0.3, 0.6)))
    assert "6.0 mm off" in instability(replace(STEADY, worst=6.0))
    assert instability(replace(STEADY, fault="does not come to rest")) == "does not come to rest"


def test_every_cell_is_shown_and_unstable_ones_are_marked(tmp_path: Path) -> None:
    grids = [[[Place(0.1, ()) for _ in s.columns] for _ in s.rows] for s in MAPS]
    grids[0][-1][-1] = Place(0.7, ("seed 1: it broke",))
    text = table(MAPS[0], grids[0])
    assert text.count("0.100") == len(MAPS[0].columns) * len(MAPS[0].rows) - 1
    assert text.count("0.700!") == 1
    draw({"ur5": grids, "panda": grids}, 2, tmp_path / "new" / "map.png")
    assert (tmp_path / "new" / "map.png").read_bytes()[1:4] == b"PNG"


@pytest.mark.slow
@pytest.mark.parametrize("number", range(len(MAPS)))
def test_worst_corner_of_a_map_is_stable(number: int) -> None:
    """The corner has the largest errors of the links on the map, or the slowest drives."""
    scales = MAPS[number]
    up = scales.rows[-1] if number == 0 else scales.rows[0]
    assert stood("ur5", number, scales.columns[-1], up, seed=0)["complaint"] == ""
