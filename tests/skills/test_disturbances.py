"""A skill looks in the very tick in which it says SUCCESS: what others have done before counts."""

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
from tests.plays import Deed, Stage
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
"""A cube right below the tool: no way is spent on getting there."""

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
    """Of the world."""
    if "cube" in world.objects:
        world.remove_object("cube")


def bring(world: World) -> None:
    """Back to where it was declared."""
    if "cube" not in world.objects:
        world.spawn_object("cube")


def swap(world: World) -> None:
    """For another one of the same name, elsewhere."""
    take_out(world)
    world.spawn_object("cube", ELSEWHERE)


def tear_off(world: World) -> None:
    """Out of the tool."""
    world.attachments.detach("arm1", "cube")


def carry_off(world: World) -> None:
    """Out of the tool, if it is there, and far away."""
    tear_off(world)
    if "cube" in world.objects:
        steals("cube")(world)


def weld(world: World) -> None:
    """To the tool, wherever that is."""
    if "cube" in world.objects:
        world.attach("arm1", "cube")


def is_held(world: World) -> bool:
    return "cube" in world.attachments.attached_to("arm1")


def is_carried(world: World) -> bool:
    there = is_held(world) and world.object_pose("cube").position - GOAL
    return there is not False and float(np.linalg.norm(there)) < 0.005


def rests(world: World) -> bool:
    return (
        "cube" in world.objects
        and not is_held(world)
        and float(np.abs(world.object_velocity("cube")).max()) < 0.01
    )


@dataclass(frozen=True)
class Case:
    """A skill that names a thing.

    Attributes:
        node: Leaf with the skill.
        scenario: World in which it succeeds if nobody meddles.
        claim: What its SUCCESS says.
        meddlings: What others may do to the thing.
        shares: Moments, as shares of the leaf's time; the last ticks come in any case.
    """

    node: Tree
    scenario: Scenario
    claim: Callable[[World], bool]
    meddlings: tuple[Deed, ...]
    shares: tuple[float, ...] = ()


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
def unmeddled(skill: str) -> LeafReport:
    """The leaf's run in which nobody meddles."""
    case = CASES[skill]
    alone = Candidate(skill, REGISTRY, case.scenario)
    return alone.perform(case.node).leaves(skill)[-1]


@pytest.mark.parametrize(
    ("skill", "number"),
    [(skill, number) for skill, case in CASES.items() for number in range(len(case.meddlings))],
)
def test_what_is_said_is_true_when_it_is_said(skill: str, number: int, stage: Stage) -> None:
    """Whatever a meddler does to the thing, in the first, the last and other ticks of the leaf.

    Meddlers take turns with every other moment; in ``make matrix`` each has all of them.
    """
    case = CASES[skill]
    calm = unmeddled(skill)
    assert calm.status == "SUCCESS", calm.reason
    assert calm.ended_s is not None
    length = calm.ended_s - calm.started_s
    moments = [calm.started_s + share * length for share in case.shares]
    moments += [calm.ended_s - steps * STEP for steps in LAST if steps * STEP < length]
    if not WHOLE and len(moments) > 3:
        moments = moments[number % 2 :: 2]
    said = 0
    for moment in moments:
        deeds = [(moment, case.meddlings[number])]
        play = stage.play(case.scenario.file(case.node), deeds=deeds)
        true: list[bool] = []

        def note(change: StatusChange, world: World = play.world, true: list[bool] = true) -> None:
            if change.kind == skill and change.new == "SUCCESS":
                true.append(case.claim(world))

        play.on_event = note  # type: ignore[method-assign]
        play.run()
        said += len(true)
        leaf = play.leaves(skill)[-1]
        assert all(true), f"{leaf.status} though it is not so, {calm.ended_s - moment:.3f} s before"
        assert leaf.status == "SUCCESS" or leaf.code != "EXCEPTION", leaf.reason
    assert said < len(moments), "the meddler does make it fail"
