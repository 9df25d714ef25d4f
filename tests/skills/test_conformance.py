"""What every registered skill keeps to, whoever wrote it."""

from __future__ import annotations

import functools
from typing import Any

import pytest
from pydantic.fields import FieldInfo

from bt_dualarm.registry import Registry, faults
from bt_dualarm.skill import Skill
from bt_dualarm.spec.annotations import metadata_of
from bt_dualarm.spec.unit import Unit
from tests.plays import STOPPED, Play, Stage
from tests.skills.scenarios import SCENARIOS, Scenario, Tree, after, node_of

SKILLS = dict(Registry.load().skills)
PHASES = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 0.98)
"""Shares of a skill's duration at which it is halted; 0 is at its second tick."""

every_skill = pytest.mark.parametrize("name", sorted(SKILLS))


def scenario_of(name: str) -> Scenario:
    assert name in SCENARIOS, f"tests/skills/scenarios.py lacks a scenario for {name}"
    return SCENARIOS[name]


def run_of(name: str, stage: Stage) -> Play:
    """The example in its scenario."""
    return stage.run(scenario_of(name).file(node_of(SKILLS[name].example)))


@functools.cache
def durations() -> dict[str, float]:
    """Simulated seconds that each example takes, filled as they are run."""
    return {}


def duration_of(name: str, stage: Stage) -> float:
    if name not in durations():
        leaf = run_of(name, stage).leaf(name)
        durations()[name] = (leaf.ended_s or 0.0) - leaf.started_s
    return durations()[name]


@every_skill
def test_author_forgot_nothing(name: str) -> None:
    assert list(faults(SKILLS[name])) == []
    assert SKILLS[name].example.startswith(f"{name}:")


@every_skill
def test_numbers_of_ports_say_their_unit(name: str) -> None:
    """A number that is not a count or a share has a unit, its own or that of its type."""
    fields = SKILLS[name].Ports.model_fields.items()
    assert [f"{name}.{port}" for port, field in fields if lacks_unit(field)] == []


def lacks_unit(field: FieldInfo) -> bool:
    if field.annotation not in (float, float | None):
        return False
    extra = field.json_schema_extra
    if (isinstance(extra, dict) and extra.get("unit")) or metadata_of(field, Unit):
        return False
    words = ("share", "how often", "image error")
    return not any(word in (field.description or "") for word in words)


@every_skill
def test_example_succeeds(name: str, stage: Stage) -> None:
    play = run_of(name, stage)
    leaf = play.leaf(name)
    assert leaf.status == "SUCCESS", f"{leaf.code}: {leaf.reason}"
    assert play.arm().clipped_setpoints == 0


@every_skill
@pytest.mark.parametrize("phase", PHASES)
def test_halted_skill_leaves_the_arm_stopped(name: str, phase: float, stage: Stage) -> None:
    """Within a simulated second, in whatever phase, and it stays so."""
    seconds = max(0.01, phase * duration_of(name, stage))
    node = after(seconds, node_of(SKILLS[name].example))
    play = stage.run(scenario_of(name).file(node, {"wait": {"seconds": 1.5}}))
    leaf = play.leaf(name)
    if leaf.ended_s is not None and leaf.status == "INVALID":
        assert leaf.code == "HALTED"
        assert leaf.reason == "", "its clean-up raised nothing"
    assert play.speed_after((leaf.ended_s or 0.0) + 1.0) < STOPPED
    assert play.arm().outcome == "SUCCESS"


@every_skill
def test_starts_again_after_success(name: str, stage: Stage) -> None:
    """The same leaf, run twice: it begins anew, with nothing left over."""
    twice: Tree = {"repeat": {"times": 2, "child": node_of(SKILLS[name].example)}}
    first, second = leaves_of(stage.run(scenario_of(name).file(twice)), name)
    assert first.status == "SUCCESS"
    assert second.status == scenario_of(name).again, second.reason
    assert second.code in ("", *SKILLS[name].failures)


@every_skill
def test_starts_again_after_it_was_halted(name: str, stage: Stage) -> None:
    """Halted in its middle at first, given all its time then: it does its job."""
    timeout = {"timeout": {"seconds": "{limit}", "child": node_of(SKILLS[name].example)}}
    forgiven: Tree = {"force_success": {"child": timeout}}
    lengthen: Tree = {"set": {"key": "limit", "value": 60.0}}
    half = max(0.01, 0.5 * duration_of(name, stage))
    leaves = (
        {"set": {"key": "limit", "value": half}},
        {"repeat": {"times": 2, "child": {"sequence": [forgiven, lengthen]}}},
    )
    first, second = leaves_of(stage.run(scenario_of(name).file(*leaves)), name)
    assert (first.status, first.code) in (("INVALID", "HALTED"), ("SUCCESS", ""))
    if first.status == "INVALID" and scenario_of(name).again == "SUCCESS":
        assert second.status == "SUCCESS", second.reason


@every_skill
def test_never_started_and_never_heard_of(name: str, stage: Stage) -> None:
    """A leaf that its tree never reaches is halted with it, without a word."""
    skipped: Tree = {"selector": [{"succeed": {}}, node_of(SKILLS[name].example)]}
    play = stage.run(scenario_of(name).file(skipped))
    assert [leaf for leaf in play.arm().leaves if leaf.path.endswith(f"selector/{name}")] == []
    assert play.arm().outcome == "SUCCESS"


def leaves_of(play: Play, name: str) -> list[Any]:
    """Runs of the leaf under test: those of the scenario's own leaves come first."""
    return play.leaves(name)[-2:]


def test_every_skill_class_is_of_the_facade() -> None:
    """Shipped skills have no privileges: they are subclasses of the one public base."""
    assert all(issubclass(skill, Skill) for skill in SKILLS.values())
