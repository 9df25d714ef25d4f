"""Rules that a run must keep: which states break one, and with which message."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import bt_dualarm as bt
from bt_dualarm.behaviors.report import StatusChange, StatusName
from bt_dualarm.runtime.rules import REST_S, STOPPED, STOPPING_S, RuleCheck

LIMITS = SimpleNamespace(
    lower=np.array([-1.0, -1.0]), upper=np.array([1.0, 1.0]), velocity=np.array([2.0, 3.0])
)


def body(*geoms: int) -> Any:
    robot = SimpleNamespace(limits=LIMITS, joints=("shoulder", "elbow"))
    return SimpleNamespace(geom_ids=frozenset(geoms), q=np.zeros(2), v=np.zeros(2), robot=robot)


@pytest.fixture
def world() -> Any:
    """Two arms with two geoms each; geom 4 is an object."""
    contact = SimpleNamespace(geom=np.empty((0, 2), np.int32), dist=np.empty(0))
    return SimpleNamespace(
        arms={"left": body(0, 1), "right": body(2, 3)},
        data=SimpleNamespace(contact=contact),
        model=SimpleNamespace(ngeom=5),
        generation=0,
    )


def touch(world: Any, first: int, second: int, distance: float = -1e-4) -> None:
    world.data.contact.geom = np.array([[first, second]], np.int32)
    world.data.contact.dist = np.array([distance])


def ended(new: StatusName, time: float) -> StatusChange:
    return StatusChange(time, "right", "sequence", "sequence", "RUNNING", new)


def checked(world: Any, *, of_motion: bool = True) -> str:
    check = RuleCheck(world, of_motion=of_motion)
    check.after_step(2.0)
    return check.broken


@pytest.mark.parametrize(
    ("geoms", "expected"),
    [
        ((1, 2), "left and right touch at 2.000 s"),
        ((3, 0), "left and right touch at 2.000 s"),
        ((0, 1), ""),  # of one arm
        ((1, 4), ""),  # with an object
    ],
)
def test_arms_must_not_touch(world: Any, geoms: tuple[int, int], expected: str) -> None:
    touch(world, *geoms)
    assert checked(world) == expected
    assert checked(world, of_motion=False) == expected
    touch(world, *geoms, distance=1e-4)  # a contact across a gap
    assert checked(world) == ""


def test_joints_stay_within_their_limits(world: Any) -> None:
    world.arms["right"].q[1] = -1.1
    assert checked(world) == "elbow of right is 5.7° beyond its limit at 2.000 s"
    assert checked(world, of_motion=False) == ""
    world.arms["right"].q[1] = -1.01
    assert checked(world) == ""
    world.arms["left"].v[0] = -2.4
    assert checked(world) == "shoulder of left moves at 120 % of its speed limit at 2.000 s"
    world.arms["left"].v[0] = -2.1
    assert checked(world) == ""


def test_an_arm_whose_tree_has_ended_comes_to_rest(world: Any) -> None:
    check = RuleCheck(world)
    check.on_event(ended("FAILURE", 1.0))
    for time in (1.0 + STOPPING_S - 0.1, 1.0 + STOPPING_S + 0.1):
        check.after_step(time)
        assert check.broken == ""
    world.arms["right"].q[1] += 0.1 * REST_S
    check.after_step(1.0 + STOPPING_S + 0.1 + REST_S)
    assert check.broken.startswith("elbow of right, whose tree has ended, moves at 0.100 rad/s")
    first = check.broken
    touch(world, 1, 2)
    check.after_step(9.0)
    assert check.broken == first  # the first one is kept


def test_an_arm_that_is_spawned_again_may_move(world: Any) -> None:
    check = RuleCheck(world)
    check.on_event(ended("SUCCESS", 1.0))
    check.after_step(3.0)
    check.on_event(ended("RUNNING", 3.1))
    check.on_event(StatusChange(3.2, "right", "sequence/wait", "wait", "RUNNING", "SUCCESS"))
    world.arms["right"].q[1] += 0.5
    check.after_step(9.0)
    assert check.broken == ""


def test_an_arm_that_is_spawned_again_has_not_moved_there() -> None:
    """It stands where its tree begins, elsewhere than where the one before ended."""
    comes_back = [{"remove": {"arm": "goes"}}, {"wait": 0.5}, {"spawn": {"arm": "goes"}}]
    goes = {"robot": "ur5", "tree": {"reach_to_pose": {"offset": {"xyz": [0, 0, 0.2]}}}}
    stays = {"robot": "ur3", "base": {"xyz": [0, 2, 0]}}
    stays["tree"] = {"sequence": [{"wait": 4}, *comes_back, {"wait": 2}]}
    world = {"scene": "empty", "time_limit": 10}
    file = {"bt_dualarm": 1, "world": world, "arms": {"goes": goes, "stays": stays}}
    with bt.open(file) as run:
        check = RuleCheck(run.world)
        run.watch(check)
        assert run.finish().outcome == "SUCCESS"
    assert check.broken == ""


def test_arms_that_encoder_noise_shakes_are_at_rest() -> None:
    """A Panda in `rough` stands with joint speeds of up to 0.03 rad/s, around zero."""
    world = {"scene": "empty", "reality": "rough", "time_limit": 5}
    stands = {"robot": "panda", "gripper": "panda_hand", "tree": {"wait": 0.1}}
    waits = {"robot": "ur5", "base": {"xyz": [0, 1, 0]}, "tree": {"wait": 3}}
    file = {"bt_dualarm": 1, "world": world, "arms": {"stands": stands, "waits": waits}}
    fastest = 0.0
    with bt.open(file) as run:
        check = RuleCheck(run.world)
        run.watch(check)
        while not run.done:
            run.step(0.002)
            if run.time > 1.5:
                fastest = max(fastest, float(np.abs(run.arms["stands"].v).max()))
    assert check.broken == ""
    assert fastest > STOPPED
