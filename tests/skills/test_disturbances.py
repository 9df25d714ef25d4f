"""A skill checks its result in the tick of its SUCCESS, so earlier disturbances count."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from bt_dualarm.behaviors.report import LeafReport, StatusChange
from bt_dualarm.core.pose import Pose
from bt_dualarm.sim.world import World
from bt_dualarm.testing import Candidate
from tests.families import WHOLE, some
from tests.plays import Intervention, Stage
from tests.skills.candidates import REGISTRY
from tests.skills.scenarios import CUBE, WALL, Scenario, Tree
from tests.skills.trials import steals

STEP = 0.002
TICK = 10  # steps

BELOW: Tree = {
    "post": WALL
    | {"spawned": True, "size": [0.1, 0.1, 0.3], "pose": {"xyz": [0.487, 0.109, 0.55]}},
    "cube": CUBE | {"pose": {"xyz": [0.487, 0.109, 0.725]}},
}
"""A cube right below the tool, so that the motion to it is short."""

ELSEWHERE = Pose.from_rpy((-0.5, -0.45, 0.425))
GOAL = (0.4, 0.0, 0.85)
PICK: Tree = {
    "approach_and_attach": {
        "object": "cube",
        "standoff": 0.06,
        "speed": 1.0,
        "approach_speed": 0.3,
    }
}
CARRY: Tree = {"transport": {"object": "cube", "to": {"xyz": list(GOAL)}, "speed": 1.0}}
LET_GO: Tree = {"detach": {"object": "cube"}}


def take_out(world: World) -> None:
    """Remove the cube from the world."""
    if "cube" in world.objects:
        world.remove_object("cube")


def bring(world: World) -> None:
    """Spawn the cube again where it was declared."""
    if "cube" not in world.objects:
        world.spawn_object("cube")


def swap(world: World) -> None:
    """Replace the cube by another one of the same name, elsewhere."""
    take_out(world)
    world.spawn_object("cube", ELSEWHERE)


def tear_off(world: World) -> None:
    """Detach the cube from the tool."""
    world.attachments.detach("arm1", "cube")


def carry_off(world: World) -> None:
    """Detach the cube, if it is present, and move it far away."""
    tear_off(world)
    if "cube" in world.objects:
        steals("cube")(world)


def weld(world: World) -> None:
    """Attach the cube to the tool, wherever that is."""
    if "cube" in world.objects:
        world.attach("arm1", "cube")


def is_held(world: World) -> bool:
    return "cube" in world.attachments.attached_to("arm1")


def is_carried(world: World) -> bool:
    error = is_held(world) and world.object_pose("cube").position - GOAL
    return error is not False and float(np.linalg.norm(error)) < 0.005


def rests(world: World) -> bool:
    return (
        "cube" in world.objects
        and not is_held(world)
        and float(np.abs(world.object_velocity("cube")).max()) < 0.01
    )


@dataclass(frozen=True)
class Case:
    """A skill with an object, and disturbances of it.

    Attributes:
        node: Leaf with the skill.
        scenario: World in which it succeeds if undisturbed.
        claim: Condition that its SUCCESS asserts.
        disturbances: What others may do to the object.
        fractions: Further moments of disturbance, as fractions of the leaf's duration.
    """

    node: Tree
    scenario: Scenario
    claim: Callable[[World], bool]
    disturbances: tuple[Intervention, ...]
    fractions: tuple[float, ...] = ()


PRESENT = Scenario(BELOW, scene="table")
HELD = Scenario(BELOW, before=(PICK,), scene="table")
ABSENT = Scenario(BELOW | {"cube": BELOW["cube"] | {"spawned": False}}, scene="table")
CASES = {
    "approach_and_attach": Case(
        PICK,
        PRESENT,
        is_held,
        (take_out, carry_off, swap, tear_off),
        (0.3, 0.97),
    ),
    "transport": Case(CARRY, HELD, is_carried, (take_out, carry_off, swap, tear_off), (0.5,)),
    "detach": Case(
        {"detach": {"object": "cube"}}, HELD, rests, (take_out, carry_off, weld), (0.5,)
    ),
    "spawn": Case(
        {"spawn": {"object": "cube"}},
        ABSENT,
        lambda world: "cube" in world.objects,
        (take_out,),
    ),
    "remove": Case(
        {"remove": {"object": "cube"}},
        PRESENT,
        lambda world: "cube" not in world.objects,
        (bring,),
    ),
}

LAST = (1, TICK - 1, *(TICK * ticks + 1 for ticks in some(range(1, 12), 11)))
"""Physics steps before the tick in which the skill would succeed."""


@functools.cache
def undisturbed(skill: str) -> LeafReport:
    """Report of the leaf without a disturbance."""
    case = CASES[skill]
    alone = Candidate(skill, REGISTRY, case.scenario)
    return alone.perform(case.node).leaves(skill)[-1]


@pytest.mark.parametrize(
    ("skill", "number"),
    [(skill, number) for skill, case in CASES.items() for number in range(len(case.disturbances))],
)
def test_success_is_true_when_reported(skill: str, number: int, stage: Stage) -> None:
    """Under each disturbance of the object, in the first, the last and other ticks of the leaf.

    Disturbances share the moments, every other one each; in ``make matrix`` each has all of them.
    """
    case = CASES[skill]
    baseline = undisturbed(skill)
    assert baseline.status == "SUCCESS", baseline.reason
    assert baseline.ended_s is not None
    length = baseline.ended_s - baseline.started_s
    moments = [baseline.started_s + fraction * length for fraction in case.fractions]
    moments += [baseline.ended_s - steps * STEP for steps in LAST if steps * STEP < length]
    if not WHOLE and len(moments) > 3:
        moments = moments[number % 2 :: 2]
    successes = 0
    for moment in moments:
        interventions = [(moment, case.disturbances[number])]
        play = stage.play(case.scenario.file(case.node), interventions=interventions)
        true: list[bool] = []

        def record_claim(
            change: StatusChange, world: World = play.world, true: list[bool] = true
        ) -> None:
            if change.kind == skill and change.new == "SUCCESS":
                true.append(case.claim(world))

        play.on_event = record_claim  # type: ignore[method-assign]
        play.run()
        successes += len(true)
        leaf = play.leaves(skill)[-1]
        assert all(true), f"false SUCCESS, disturbed {baseline.ended_s - moment:.3f} s before"
        assert leaf.status == "SUCCESS" or leaf.code != "EXCEPTION", leaf.reason
    assert successes < len(moments), "the disturbance makes it fail at some moment"
