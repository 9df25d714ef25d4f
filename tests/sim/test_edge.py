"""The edge of an open container, at which a tool touches it."""

from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.sim.object_body import body_of
from bt_dualarm.spec.document import ObjectSpec

UP = np.array([0.0, 0.0, 1.0])


@pytest.mark.parametrize(
    ("shape", "size", "near", "far"),
    [
        ("tray", [0.18, 0.16, 0.06], 0.077, 0.080),
        ("bin", [0.20, 0.16, 0.10], 0.077, 0.080),
        ("cup", [0.04, 0.09], 0.037, 0.040),
        ("tube", [0.03, 0.09], 0.027, 0.030),
        ("bowl", [0.08, 0.04], 0.070, 0.080),
    ],
)
def test_edge_is_on_top_of_the_wall(shape: str, size: list[float], near: float, far: float) -> None:
    edge = body_of(
        ObjectSpec.model_validate({"shape": shape, "size": tuple(size), "mass": 1})
    ).edge(UP)
    assert edge is not None
    assert edge[2] == pytest.approx(0.5 * size[-1], abs=1e-6)
    assert near < np.abs(edge[:2]).max() < far
    assert np.abs(edge[:2]).min() < 1e-9  # in the middle of the wall


@pytest.mark.parametrize("shape", ["table", "shelf", "prism"])
def test_closed_top_has_no_edge(shape: str) -> None:
    size = (0.05, 0.1) if shape == "prism" else (0.3, 0.2, 0.4)
    body = body_of(ObjectSpec.model_validate({"shape": shape, "size": size, "mass": 1}))
    assert body.edge(UP) is None


def test_upside_down_cup_has_no_edge() -> None:
    body = body_of(ObjectSpec.model_validate({"shape": "cup", "size": (0.04, 0.09), "mass": 1}))
    assert body.edge(-UP) is None
