"""What nobody told the mass of is held as firmly as it turns out to weigh."""

from __future__ import annotations

from typing import Any

import pytest

from tests.plays import Play, Stage
from tests.skills.scenarios import GRIPPING, ON_TABLE, Scenario, Tree

TOLD_NOTHING = {"payload": {"known": False}}
CARRY: Tree = {"transport": {"object": "cube", "to": {"xyz": [0.35, 0.0, 0.7]}}}


def carried(stage: Stage, mass: float, friction: float = 0.8, **ports: Any) -> Play:
    """Grasp a cube of a mass in kg that the arm reckons to be 0.5 kg, and carry it."""
    cube = {"cube": ON_TABLE["cube"] | {"mass": mass, "friction": friction}}
    grasp: Tree = {"grasp": {"object": "cube", "mass": 0.5, **ports}}
    arm = GRIPPING | {"reality": TOLD_NOTHING}
    return stage.run(Scenario(cube, arm=arm, scene="table").file(grasp, CARRY))


def forces(play: Play) -> tuple[float, float]:
    """Force in N with which it was taken, and that which is asked for in the end."""
    taken = float(play.leaf("grasp").metrics["grip_force_n"])
    return taken, play.world.grippers["arm1"].commanded.force


def test_what_is_heavier_than_was_reckoned_with_is_held_more_firmly(stage: Stage) -> None:
    """2.2 kg in place of 0.5: 24 N at rest, 31 N with 8 m/s² downwards in hand, and a fifth."""
    play = carried(stage, 2.2)
    leaf = play.leaf("transport")
    assert leaf.status == "SUCCESS", leaf.reason
    taken, firm = forces(play)
    assert taken < 25.0
    assert 30.0 < firm < 60.0
    assert float(leaf.metrics["weighed_kg"]) == pytest.approx(2.2, abs=0.1)
    assert float(leaf.metrics["slid_m"]) < 1e-3


def test_what_is_lighter_is_held_as_before(stage: Stage) -> None:
    play = carried(stage, 0.3)
    assert play.leaf("transport").status == "SUCCESS"
    taken, firm = forces(play)
    assert firm == taken


def test_no_more_firmly_than_the_object_bears(stage: Stage) -> None:
    play = carried(stage, 2.2, most_force=28.0)
    assert forces(play)[1] <= 28.0


def test_what_no_grip_bears_is_refused_with_what_it_weighs(stage: Stage) -> None:
    """20 N hold 24 N by a friction of 0.6; 2.2 kg want 21.6 N, and a fifth in hand."""
    play = carried(stage, 2.2, 0.6, most_force=20.0)
    failed = [leaf for leaf in play.arm().leaves.values() if leaf.status == "FAILURE"]
    assert failed[0].code == "OVERLOADED", failed[0].reason
    assert float(failed[0].metrics["mass_kg"]) == pytest.approx(2.2, abs=0.2)
    assert failed[0].metrics["most_force_n"] == 20.0
