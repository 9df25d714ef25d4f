"""Laws of skills in sequences: skills obey them, and the referee detects violations."""

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
    """A sequence on a UR5 with a two-finger gripper; keys are the claimed skills of the leaves."""
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
    """Run method of a skill that succeeds without doing anything."""
    yield


def kinds(breaches: tuple[Breach, ...]) -> set[str]:
    """Kinds of the broken laws."""
    return {breach.kind for breach in breaches}


@pytest.mark.parametrize(
    ("seed", "length"),
    some([(1, 3), (10, 2), (11, 2), (13, 2), (16, 2), (1, 2), (700511, 2)], 2),
)
def test_sequences_of_skills_obey_all_laws(seed: int, length: int) -> None:
    """Every result of a leaf is true, and so is the arm's knowledge of the world afterwards."""
    assert play(seed, length, "lab").breaches == ()


def test_sequence_is_determined_by_its_seed() -> None:
    assert generate(7, 3) == generate(7, 3)
    assert generate(7, 3) != generate(8, 3)


def test_every_shipped_skill_occurs_in_sequences(registry: Registry) -> None:
    """A new skill must be added to one of the lists."""
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
def test_referee_detects_a_false_success(
    skill: str, ports: dict[str, Any], registry: Registry, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(registry.skills[skill], "run", nothing)
    _, breaches = judged(written(**{skill: {skill: ports}}), registry)
    assert kinds(breaches) == {"false success"}


def test_referee_detects_an_unintended_contact(registry: Registry) -> None:
    """A leaf that claims to be a circle moves down to the floor."""
    down = {"move_until_contact": {"distance": 0.5, "speed": 0.02}}
    _, breaches = judged(written(circle=down), registry)
    assert "contact" in kinds(breaches)


def test_referee_detects_a_wrongly_held_object(
    registry: Registry, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A leaf records the cube as held without grasping it."""

    def hold_wrongly(skill: Any) -> Iterator[None]:
        skill.arm.world.hold("arm1", "cube", skill.arm.world.object_pose("cube"))
        yield

    monkeypatch.setattr(registry.skills["stop"], "run", hold_wrongly)
    _, breaches = judged(written(stop={"stop": {}}), registry)
    assert "bookkeeping" in kinds(breaches)


def test_referee_detects_a_traceback(registry: Registry, monkeypatch: pytest.MonkeyPatch) -> None:
    def breaks(_: object) -> Iterator[None]:
        yield
        raise KeyError("gone")

    monkeypatch.setattr(registry.skills["stop"], "run", breaks)
    _, breaches = judged(written(stop={"stop": {}}), registry)
    assert "traceback" in kinds(breaches)


def test_sequence_without_a_free_position_is_generated() -> None:
    """Sampling of positions did not end."""
    assert generate(1008, 2, "lab").steps
