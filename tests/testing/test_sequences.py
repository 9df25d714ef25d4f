"""Laws of skills in sequences: some sequences keep to them, and the referee sees who does not."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from benchmarks.sequence_generator import (
    CAMERA_SKILLS,
    FINGER_SKILLS,
    FREE_SKILLS,
    GRIPPER_SKILLS,
    JOINT_SKILLS,
    SkillSequence,
    Step,
    generate,
)
from benchmarks.sequence_laws import Breach
from benchmarks.sequences import judged, play
from bt_dualarm.skill.registry import Registry
from tests.families import some

CUBE = {"shape": "box", "size": [0.05, 0.05, 0.05], "mass": 0.1, "pose": {"xyz": [0.4, 0, 0.0255]}}


def written(**steps: dict[str, Any]) -> SkillSequence:
    """A sequence on a UR5 with two fingers, of leaves by the skill that each says it runs."""
    leaves = [
        {kind: ports | {"name": name}} for name, one in steps.items() for kind, ports in one.items()
    ]
    arm = {"robot": "ur5", "gripper": "robotiq_2f85", "tree": {"sequence": leaves}}
    file = {
        "bt_dualarm": 1,
        "name": "written",
        "world": {"scene": "empty"},
        "objects": {"cube": CUBE},
        "arms": {"arm1": arm},
    }
    made = tuple(Step(name, name, next(iter(one.values()))) for name, one in steps.items())
    return SkillSequence(0, file, made, "written")


def nothing(_: object) -> Iterator[None]:
    """What a skill does that says SUCCESS and has done nothing."""
    yield


def kinds(breaches: tuple[Breach, ...]) -> set[str]:
    """What kinds of laws were broken."""
    return {breach.kind for breach in breaches}


@pytest.mark.parametrize(
    ("seed", "length"),
    some([(1, 3), (10, 2), (11, 2), (13, 2), (16, 2), (1, 2), (700511, 2)], 2),
)
def test_sequences_of_skills_keep_to_all_laws(seed: int, length: int) -> None:
    """Whatever each leaf says is so, and what is believed of the world afterwards, too."""
    assert play(seed, length, "lab").breaches == ()


def test_a_seed_always_is_the_same_sequence() -> None:
    assert generate(7, 3) == generate(7, 3)
    assert generate(7, 3) != generate(8, 3)


def test_every_shipped_skill_is_asked_for(registry: Registry) -> None:
    """A new skill comes into the sequences with its scenario."""
    alone = {*FREE_SKILLS, *CAMERA_SKILLS, *GRIPPER_SKILLS, *FINGER_SKILLS}
    assert alone | {*JOINT_SKILLS} == set(registry.skills)


@pytest.mark.parametrize(
    ("skill", "ports"),
    [
        ("grasp", {"object": "cube"}),
        ("approach_and_attach", {"object": "cube"}),
        ("move_linear", {"offset": {"xyz": [0, 0, 0.05], "frame": "world"}}),
        ("move_until_contact", {"distance": 0.1}),
        ("remove", {"object": "cube"}),
    ],
)
def test_referee_sees_a_success_that_is_not_so(
    skill: str, ports: dict[str, Any], registry: Registry, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(registry.skills[skill], "run", nothing)
    _, breaches = judged(written(**{skill: {skill: ports}}), registry)
    assert kinds(breaches) == {"false success"}


def test_referee_sees_a_contact_that_nobody_asked_for(registry: Registry) -> None:
    """A leaf that says it draws a curve, and goes down to the floor."""
    down = {"move_until_contact": {"distance": 0.5, "speed": 0.02}}
    _, breaches = judged(written(circle=down), registry)
    assert "contact" in kinds(breaches)


def test_referee_sees_a_thing_believed_held_that_is_not(
    registry: Registry, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A leaf that says it has taken the cube, and holds nothing."""

    def believes(skill: Any) -> Iterator[None]:
        skill.arm.world.hold("arm1", "cube", skill.arm.world.object_pose("cube"))
        yield

    monkeypatch.setattr(registry.skills["stop"], "run", believes)
    _, breaches = judged(written(stop={"stop": {}}), registry)
    assert "bookkeeping" in kinds(breaches)


def test_referee_sees_a_traceback(registry: Registry, monkeypatch: pytest.MonkeyPatch) -> None:
    def breaks(_: object) -> Iterator[None]:
        yield
        raise KeyError("gone")

    monkeypatch.setattr(registry.skills["stop"], "run", breaks)
    _, breaches = judged(written(stop={"stop": {}}), registry)
    assert "traceback" in kinds(breaches)


def test_a_sequence_with_no_free_place_is_written_all_the_same() -> None:
    """It drew places for ever."""
    assert generate(1008, 2, "lab").steps
