"""Removal of an arm during any skill, by any caller, ends its tree as REMOVED without faults."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest

from bt_dualarm import PortModel, Skill, port
from bt_dualarm.runtime import outcome
from bt_dualarm.sim.world import World
from bt_dualarm.testing import registry_with
from tests.families import some
from tests.plays import Intervention, Play, Stage
from tests.skills.candidates import candidate
from tests.skills.scenarios import SCENARIOS, Tree, node_of

FAR = {"robot": "ur3", "base": {"xyz": [0, -6, 0]}}
"""A distant arm, which removes the other one."""

PHASES = {"first": 0.0, "second": 0.4, "last": 0.97}
"""Fractions of a leaf's duration after which its arm is removed."""


def file_of(skill: str, example: str, remover: Tree, name: str) -> Tree:
    """The scenario of a skill with a second arm, named before or after the first."""
    file = SCENARIOS[skill].file(node_of(example))
    other = {name: FAR | {"tree": remover}}
    arms = file["arms"]
    file["arms"] = {**other, **arms} if name == "arm0" else {**arms, **other}
    return file


def without_faults(play: Play, caplog: pytest.LogCaptureFixture) -> bool:
    """Whether a run has no error, fault or warning except about tick times.

    Only a partner of the removed arm may fail, with PARTNER_GONE.
    """
    assert play.result is not None
    lines = [line for line in caplog.records if line.name != outcome.__name__]
    faults = [play.result.error, lines, *(arm.fault for arm in play.result.arms.values())]
    partners = [arm for arm in play.result.arms if arm != "arm1"]
    failed = [
        (arm, run.code)
        for arm in play.result.arms
        for run in play.arm(arm).runs
        if run.status == "FAILURE"
    ]
    return not any(faults) and all(
        arm in partners and code == "PARTNER_GONE" for arm, code in failed
    )


@pytest.mark.parametrize("skill", some(sorted(SCENARIOS), 10))
def test_arm_can_be_removed_while_it_works(
    skill: str, stage: Stage, caplog: pytest.LogCaptureFixture
) -> None:
    """By a leaf ticked before it, by one ticked after it, and externally between two ticks."""
    example = stage.registry.skills[skill].example
    idle: Tree = {"wait": {"seconds": 0.1}}
    leaf = candidate(skill).example_run
    assert leaf.status == "SUCCESS"
    assert leaf.ended_s is not None
    for number, (name, phase) in enumerate(PHASES.items()):
        at = round(leaf.started_s + phase * (leaf.ended_s - leaf.started_s), 2)
        take: Tree = {
            "sequence": [{"wait": {"seconds": max(at, 0.02)}}, {"remove": {"arm": "arm1"}}]
        }
        interventions: list[tuple[float, Intervention]] = []
        if name == "last":
            take = idle
            interventions = [(at + 0.006, partial(World.remove_arm, name="arm1"))]
        caplog.clear()
        with caplog.at_level(logging.WARNING):
            file = file_of(skill, example, take, f"arm{9 * (number % 2)}")
            play = stage.run(file, interventions=interventions)
        assert without_faults(play, caplog), name
        halted = play.arm("arm1").runs[-1].status == "INVALID"
        assert play.arm("arm1").outcome == ("REMOVED" if halted else "SUCCESS"), name


def partners_of(skill: str) -> list[tuple[str, str]]:
    """Type and name of the other arms and objects of a skill's scenario."""
    file = SCENARIOS[skill].file(node_of(candidate(skill).skill.example))
    arms = [("arm", name) for name in file["arms"] if name != "arm1"]
    return arms + [("object", name) for name in file.get("objects", {})]


REMOVED = [
    (skill, *one, fraction)
    for skill in ("carry_together", "hand_over", "operate", "place", "insert", "track")
    for one in partners_of(skill)
    for fraction in (0.002, 0.06, 0.3, 0.55, 0.83, 0.97)
]


@pytest.mark.parametrize(("skill", "kind", "name", "fraction"), some(REMOVED, 6))
def test_partner_or_object_of_a_skill_can_be_removed(
    skill: str, kind: str, name: str, fraction: float, stage: Stage
) -> None:
    """No skill of any arm ends in an exception, whenever the removal happens."""
    leaf = candidate(skill).example_run
    take = World.remove_arm if kind == "arm" else World.remove_object
    at = max(leaf.started_s + fraction * ((leaf.ended_s or 0.0) - leaf.started_s), 0.01)
    file = SCENARIOS[skill].file(node_of(stage.registry.skills[skill].example))
    play = stage.run(file, interventions=[(at, partial(take, name=name))])
    assert play.result is not None
    assert not play.result.error
    found = [
        (run.skill, run.code, run.reason) for a in play.result.arms for run in play.arm(a).runs
    ]
    assert not [one for one in found if one[1] == "EXCEPTION"]


class LookBack(Skill):
    """Moves, and reads the state of the arm in its cleanup."""

    example = "look_back"

    def run(self) -> Iterator[float | None]:
        """Run forever."""
        self.arm.begin(self.arm.straight_to(self.arm.setpoint.q + 0.3, 0.2))
        try:
            while True:
                yield None
        finally:
            self.metrics["turned_rad"] = float(self.arm.q[0])
            self.metrics["height_m"] = float(self.arm.tool_pose.position[2])


class TakeAway(Skill):
    """Removes its own arm, and then continues or ends."""

    class Ports(PortModel):
        then: str = port("end", "what comes after that")

    example = "take_away"
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Remove the arm in the first tick."""
        self.arm.begin(self.arm.straight_to(self.arm.setpoint.q + 0.3, 0.2))
        self.arm.world.remove_arm(self.arm.name)
        if self.ports.then == "look":
            self.metrics["q"] = float(self.arm.q[0])
        if self.ports.then == "yield":
            yield None
        yield from ()


ALONE = """
world: {scene: empty, time_limit: 5}
arms:
  arm1: {robot: ur5, tree: LEAF}
  arm2: {robot: ur3, base: {xyz: [0, -3, 0]}, tree: {sequence: [{wait: 0.5 s}, OTHER]}}
"""


@pytest.fixture
def own(tmp_path: Path) -> Stage:
    return Stage(tmp_path, registry_with(LookBack, TakeAway))


def test_cleanup_of_a_leaf_can_read_its_removed_arm(
    own: Stage, caplog: pytest.LogCaptureFixture
) -> None:
    play = own.run(ALONE.replace("LEAF", "look_back").replace("OTHER", "{remove: {arm: arm1}}"))
    assert without_faults(play, caplog)
    (run,) = play.arm("arm1").runs
    assert (play.arm("arm1").outcome, run.code) == ("REMOVED", "HALTED")
    assert 0.01 < float(run.metrics["turned_rad"]) < 0.3
    assert "height_m" in run.metrics


@pytest.mark.parametrize("then", ["end", "yield", "look"])
def test_arm_that_removes_itself_ends_as_removed_and_others_continue(then: str, own: Stage) -> None:
    """The outcome of a removed arm does not depend on what its leaf does afterwards."""
    leaf = f"{{take_away: {{then: {then}}}}}"
    play = own.run(ALONE.replace("LEAF", leaf).replace("OTHER", "{go_home: {}}"))
    assert play.result is not None
    assert play.result.error == ""
    assert play.arm("arm1").outcome == "REMOVED"
    assert play.arm("arm2").outcome == "SUCCESS"


def test_arm_replaced_within_a_tick_starts_anew(own: Stage) -> None:
    """The new tree, controller and lease have no state of the old ones."""
    swap = "{parallel: [{remove: {arm: arm1}}, {spawn: {arm: arm1}}]}"
    leaf = "{reach_to_pose: {posture: up, speed: 0.5}}"
    play = own.run(ALONE.replace("LEAF", leaf).replace("OTHER", swap))
    assert play.leaf("remove", "arm2").code == "NOT_REMOVED", "it is present again a tick later"
    first, second = play.arm("arm1").runs
    assert (first.code, second.status) == ("HALTED", "SUCCESS")
    assert second.started_s == pytest.approx(0.52, abs=0.03)
    assert play.arm("arm1").clipped_setpoints == 0
