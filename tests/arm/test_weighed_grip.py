"""The grip on an object of undeclared mass is tightened to its estimated mass."""

from __future__ import annotations

from typing import Any

import pytest

from tests.plays import Play, Stage
from tests.skills.scenarios import GRIPPING, ON_TABLE, Scenario, Tree

PAYLOAD_UNKNOWN = {"payload": {"known": False}}
CARRY: Tree = {"transport": {"object": "cube", "to": {"xyz": [0.35, 0.0, 0.7]}}}


def carried(stage: Stage, mass: float, friction: float = 0.8, **ports: Any) -> Play:
    """Grasps and carries a cube of a mass in kg that the arm assumes to be 0.5 kg."""
    cube = {"cube": ON_TABLE["cube"] | {"mass": mass, "friction": friction}}
    grasp: Tree = {"grasp": {"object": "cube", "mass": 0.5, **ports}}
    arm = GRIPPING | {"reality": PAYLOAD_UNKNOWN}
    return stage.run(Scenario(cube, arm=arm, scene="table").file(grasp, CARRY))


def forces(play: Play) -> tuple[float, float]:
    """Grip force in N at the grasp and the one commanded at the end."""
    taken = float(play.leaf("grasp").metrics["grip_force_n"])
    return taken, play.world.grippers["arm1"].commanded.force


def test_object_heavier_than_assumed_is_held_more_firmly(stage: Stage) -> None:
    """2.2 kg instead of 0.5 kg need 24 N at rest, 31 N with a reserve of 8 m/s² and a fifth."""
    play = carried(stage, 2.2)
    leaf = play.leaf("transport")
    assert leaf.status == "SUCCESS", leaf.reason
    taken, firm = forces(play)
    assert taken < 25.0
    assert 30.0 < firm < 60.0
    assert float(leaf.metrics["weighed_kg"]) == pytest.approx(2.2, abs=0.1)
    assert float(leaf.metrics["slid_m"]) < 1e-3


def test_object_lighter_than_assumed_is_held_with_the_same_force(stage: Stage) -> None:
    play = carried(stage, 0.3)
    assert play.leaf("transport").status == "SUCCESS"
    taken, firm = forces(play)
    assert firm == taken


def test_grip_force_respects_the_most_force_of_the_object(stage: Stage) -> None:
    play = carried(stage, 2.2, most_force=28.0)
    assert forces(play)[1] <= 28.0


def test_object_too_heavy_for_any_grip_is_refused_with_its_mass(stage: Stage) -> None:
    """20 N hold 24 N by a friction of 0.6; 2.2 kg need 21.6 N and a reserve of a fifth."""
    play = carried(stage, 2.2, 0.6, most_force=20.0)
    failed = [leaf for leaf in play.arm().leaves.values() if leaf.status == "FAILURE"]
    assert failed[0].code == "OVERLOADED", failed[0].reason
    assert float(failed[0].metrics["mass_kg"]) == pytest.approx(2.2, abs=0.2)
    assert failed[0].metrics["most_force_n"] == 20.0
