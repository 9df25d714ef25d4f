"""Robots with several arms: two arms of a file at the same base are one robot with one torso."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import pytest

import bt_dualarm as bt
from bt_dualarm.core.errors import LockedJointError
from bt_dualarm.runtime.arm_runtime import IdleObserver
from bt_dualarm.runtime.file_check import check
from bt_dualarm.skill.registry import Registry

HOME: Final = {"reach_to_pose": {"posture": "home"}}
BASE: Final = {"xyz": [0.2, -0.1, 0.93], "rpy": [0, 0, 30]}
FILE: Final[Mapping[str, Any]] = {
    "bt_dualarm": 1,
    "name": "two arms",
    "world": {"scene": "empty"},
    "arms": {
        "one": {"robot": "baxter_left", "base": BASE, "tree": HOME},
        "two": {"robot": "baxter_right", "base": BASE, "tree": HOME},
    },
}
BODY: Final = "one+two/"


def file_with(**arms: Mapping[str, Any]) -> dict[str, Any]:
    """The file with some fields of its arms replaced."""
    file: dict[str, Any] = copy.deepcopy(dict(FILE))
    for name, fields in arms.items():
        file["arms"].setdefault(name, {}).update(fields)
    return file


def shapes_of(run: bt.Run, prefix: str) -> set[str]:
    """Names of geoms with a prefix."""
    model = run.world.model
    names = {model.geom(number).name for number in range(model.ngeom)}
    return {name for name in names if name.startswith(prefix)}


@pytest.mark.parametrize("gripper", [None, "suction_cup"])
def test_shared_body_is_in_the_world_once(gripper: str | None) -> None:
    with bt.open(file_with(one={"gripper": gripper})) as run:
        world = run.world
        assert {"torso_0", "pedestal_0"} <= {
            name.removeprefix(BODY) for name in shapes_of(run, BODY)
        }
        assert all("right" not in name for name in shapes_of(run, "one/"))
        assert all("left" not in name for name in shapes_of(run, "two/"))
        assert not shapes_of(run, "one/torso") | shapes_of(run, "two/torso")
        assert len({body.base.position.tobytes() for body in world.arms.values()}) == 1
        assert not list(world.overlaps(0.0))
        assert run.finish().outcome == "SUCCESS"


@pytest.mark.parametrize("name", ["one", "two"])
def test_arm_avoids_the_body(name: str) -> None:
    """Alone or with the other arm; the message names the torso."""
    inside = {"xyz": [0.03, 0.0, 0.25], "in_frame": "base"}
    tree = {"reach_to_pose": {"to": inside, "free": ["rx", "ry", "rz"]}}
    file = file_with(**{name: {"tree": tree}})
    for arms in (["one", "two"], [name]):
        file["arms"] = {arm: file["arms"][arm] for arm in arms}
        failed = bt.run(file).arms[name].runs[0]
        assert failed.status == "FAILURE"
        assert "torso" in failed.reason, failed.reason


def test_arms_at_different_bases_are_two_robots() -> None:
    """Each has its own body, with the other arm folded."""
    with bt.open(file_with(two={"base": {"xyz": [0, 2.0, 0.93]}})) as run:
        assert not shapes_of(run, BODY)
        assert shapes_of(run, "one/torso")
        assert shapes_of(run, "two/torso")
        assert shapes_of(run, "one/right_wrist")


def test_body_stays_when_an_arm_is_spawned_and_removed() -> None:
    steps = [{"spawn": {"arm": "two"}}, {"wait": 0.1}, {"remove": {"arm": "two"}}, {"wait": 0.1}]
    file = file_with(one={"tree": {"sequence": steps}}, two={"spawned": False, "removable": True})
    with bt.open(file) as run:
        before = shapes_of(run, BODY)
        assert "torso_0" in {name.removeprefix(BODY) for name in before}
        assert run.finish().outcome == "SUCCESS"
        assert shapes_of(run, BODY) == before
        assert not shapes_of(run, "two/")


def test_arms_of_one_body_avoid_each_other() -> None:
    """They cross in front of the body without contact, or fail."""
    crossed = {}
    for name, side in (("one", -1.0), ("two", 1.0)):
        pose = {"xyz": [0.55, side * 0.12, 0.15], "rpy": [180, 0, 0], "in_frame": "base"}
        crossed[name] = {"tree": {"sequence": [{"reach_to_pose": {"to": pose}}, HOME]}}
    touching: list[str] = []

    class Touch(IdleObserver):
        """Contacts between the arms."""

        def __init__(self, run: bt.Run) -> None:
            self.run = run

        def after_step(self, time: float) -> None:
            """Record contacts."""
            world = self.run.world
            own = {name: world.arms[name].geom_ids for name in ("one", "two")}
            for one, other in world.data.contact.geom.tolist():
                if {one, other} & own["one"] and {one, other} & own["two"]:
                    touching.append(f"{time}")

    with bt.open(file_with(**crossed)) as run:
        run.watch(Touch(run))
        run.finish()
    assert not touching


def test_arms_of_one_body_carry_one_object() -> None:
    both = {"gripper": "suction_cup"}
    pose = {"xyz": [0.6, 0.0, -0.06], "in_frame": "base"}
    board = {"shape": "box", "size": [0.1, 0.6, 0.02], "mass": 0.6}
    stand = {"shape": "box", "size": [0.2, 0.5, 0.8], "mass": 5, "fixed": True}
    file = file_with(
        one=both | {"base": {"xyz": [0, 0, 0.93]}}, two=both | {"base": {"xyz": [0, 0, 0.93]}}
    )
    file["objects"] = {
        "stand": stand | {"pose": {"xyz": [0.6, 0, 0.4]}},
        "board": board | {"pose": {"xyz": [0.6, 0, 0.811]}},
    }
    file["arms"]["one"]["tree"] = {
        "carry_together": {
            "object": "board",
            "with": ["two"],
            "to": {**pose, "xyz": [0.6, 0, 0.1]},
            "set_down": False,
        }
    }
    file["arms"]["two"]["tree"] = {"carry_together": {"object": "board", "with": ["one"]}}
    with bt.open(file) as run:
        result = run.finish()
        assert result.outcome == "SUCCESS", [arm.runs[0].reason for arm in result.arms.values()]
        height = float(run.world.object_pose("board").position[2])
    assert height == pytest.approx(1.03, abs=0.005)


@pytest.mark.parametrize(
    ("joint", "message"),
    [
        ("right_s0", "'right_s0' is moved by two, another arm of the same robot"),
        ("head_pan", "'head_pan' is at 10 degrees, but for two, another arm of the same robot"),
    ],
)
def test_locking_a_shared_or_foreign_joint_is_refused(joint: str, message: str) -> None:
    file = file_with(one={"locked": {joint: 10}})
    with pytest.raises(LockedJointError, match="one: "):
        bt.open(file)
    (problem,) = check(file, Registry.load().kinds).problems
    assert message in problem.message


def test_joint_of_the_body_has_one_position() -> None:
    """It is given for both arms; a finger belongs to one arm only."""
    both = {"locked": {"head_pan": 10}}
    with bt.open(file_with(one=both, two=both)) as run:
        model = run.world.model
        turn = model.body(f"{BODY}head").quat
        assert 2.0 * np.degrees(np.arccos(abs(turn[0]))) == pytest.approx(10.0)
    fingers = {"l_gripper_l_finger_joint": 0.01}
    bt.open(file_with(one={"locked": fingers})).close()
