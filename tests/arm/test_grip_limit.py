"""What fingers hold by friction is carried no faster than friction allows."""

from __future__ import annotations

from typing import Any

import pytest

from tests.plays import Stage
from tests.skills.scenarios import GRIPPING, ON_TABLE, Scenario, Tree


def carried(mass: float, force: float, stage: Stage) -> dict[str, Any]:
    """Metrics of carrying a cube of a mass in kg as fast as the arm can, held with a force in N."""
    cube = {"cube": ON_TABLE["cube"] | {"mass": mass}}
    grasp: Tree = {"grasp": {"object": "cube", "force": force}}
    carry: Tree = {"transport": {"object": "cube", "to": {"xyz": [0.35, 0.2, 0.7]}, "speed": 1.0}}
    file = Scenario(cube, arm=GRIPPING, scene="table").file(grasp, carry)
    leaf = stage.run(file).leaf("transport")
    assert leaf.status == "SUCCESS", leaf.reason
    return dict(leaf.metrics)


def test_a_loose_grip_is_carried_slower_and_says_so(stage: Stage) -> None:
    """1 kg asks for 6.1 N at rest and 11.1 N at 8 m/s²; nothing slides in either case."""
    firm = carried(1.0, 60.0, stage)
    loose = carried(1.0, 20.0, stage)
    assert "grip_speed_scale" not in firm
    light = carried(0.1, 20.0, stage)
    assert "grip_speed_scale" not in light
    heavy = carried(2.2, 20.0, stage)
    assert 0.1 < heavy["grip_speed_scale"] < 0.9
    for metrics in (firm, loose, light, heavy):
        assert metrics["slid_m"] == pytest.approx(0.0, abs=1e-3)


def test_a_grip_too_weak_for_what_it_may_hold_does_not_crawl(stage: Stage) -> None:
    """Tilted, it might not bear the kilogram that is assumed: it took 19 s to turn 50 g, not 2."""
    upright = {"xyz": [0.35, -0.4, 0.48]}
    bar = ON_TABLE["cube"] | {"size": [0.03, 0.03, 0.16], "mass": 0.05, "pose": upright}
    grasp: Tree = {"grasp": {"object": "bar", "point": [0, 0, 0.05], "approach": [0, 0, -1]}}
    lift: Tree = {"move_linear": {"offset": {"xyz": [0, 0, 0.2]}}}
    tilt: Tree = {"rotate_tool": {"axis": "y", "angle": 75}}
    file = Scenario({"bar": bar}, arm=GRIPPING, scene="table").file(grasp, lift, tilt)
    file["world"]["reality"] = "rough"
    leaf = stage.run(file).leaf("rotate_tool")
    assert leaf.status == "SUCCESS", leaf.reason
    assert (leaf.ended_s or 1e9) - leaf.started_s < 3.0
