"""Motions of two arms in step start together, and the shorter one is slowed to match."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from bt_dualarm.arm.in_step import MotionPair
from bt_dualarm.sim.world import World
from bt_dualarm.trajectory.set_points import TrajectorySource
from bt_dualarm.trajectory.trajectory import Trajectory
from tests.plays import Play, Stage
from tests.skills.scenarios import Tree

MOVING = 0.02
"""Joint speed above which an arm moves, rad/s."""


def motion(seconds: float, dt: float = 0.004) -> TrajectorySource:
    """A motion of one joint from rest to rest."""
    time = np.arange(round(seconds / dt) + 1) * dt
    phase = np.pi * time / time[-1]
    rate = np.pi / time[-1]
    q = 0.5 - 0.5 * np.cos(phase)
    v = 0.5 * rate * np.sin(phase)
    a = 0.5 * rate**2 * np.cos(phase)
    return TrajectorySource(Trajectory(dt, q[:, None], v[:, None], a[:, None]))


def steps(source: TrajectorySource) -> int:
    """Number of set-points until the end."""
    count = 0
    while not source.done:
        source.next(0.0)
        count += 1
    return count


def test_shorter_motion_is_slowed_to_the_longer_one() -> None:
    pair = MotionPair("arm1", "arm2")
    short, long = motion(0.4), motion(1.0)
    pair.begin("arm1", "a", 0.0, short)
    pair.start()
    assert short.waits
    pair.begin("arm2", "b", 0.0, long)
    pair.start()
    assert not short.waits
    assert not pair.waiting
    assert steps(short) == pytest.approx(steps(long), abs=2)


def test_motion_does_not_wait_for_a_partner_that_has_left() -> None:
    pair = MotionPair("arm1", "arm2")
    alone = motion(0.4)
    pair.begin("arm1", "a", 0.0, alone)
    pair.leave("arm2")
    pair.start()
    assert not alone.waits
    assert steps(alone) == steps(motion(0.4))


def test_motion_abandoned_while_waiting_does_not_start_its_partner() -> None:
    pair = MotionPair("arm1", "arm2")
    pair.begin("arm1", "a", 0.0, motion(0.4))
    pair.abandon("arm1")
    other = motion(0.4)
    pair.begin("arm2", "b", 0.0, other)
    pair.start()
    assert other.waits


def test_replanned_motion_rejoins_its_partner() -> None:
    pair = MotionPair("arm1", "arm2")
    first, other, again = motion(1.0), motion(1.0), motion(0.2)
    pair.begin("arm1", "a", 0.0, first)
    pair.begin("arm2", "b", 0.0, other)
    pair.start()
    for _ in range(100):
        first.next(0.0)
        other.next(0.0)
    pair.begin("arm1", "a", 0.4, again)
    pair.start()
    assert not again.waits
    assert steps(again) == pytest.approx(steps(other), abs=3)


@pytest.mark.parametrize("first", ["short", "long"])
def test_equally_advanced_motions_do_not_slow_each_other(first: str) -> None:
    """However long ago the guard of either arm has looked, whichever controller comes first."""
    pair = MotionPair("arm1", "arm2")
    short, long = motion(0.4), motion(1.0)
    pair.begin("arm1", "a", 0.0, short)
    pair.begin("arm2", "b", 0.0, long)
    pair.start()
    looks = {id(short): 0.012, id(long): 0.1}
    order = (short, long) if first == "short" else (long, short)
    for k in range(200):
        time = 0.004 * k
        for source in order:
            if k % round(looks[id(source)] / 0.004) == 0:
                assert source.paced(1.0, time) == source.most_scale
            source.next(time)


def test_motion_does_not_keep_the_pace_of_one_that_was_given_up() -> None:
    """Its partner was held up, and has planned anew: they keep the pace of each other again."""
    pair = MotionPair("arm1", "arm2")
    first, other, again = motion(1.0), motion(1.0), motion(0.2)
    pair.begin("arm1", "a", 0.0, first)
    pair.begin("arm2", "b", 0.0, other)
    pair.start()
    for k in range(100):
        first.next(0.004 * k)
        other.next(0.004 * k)
    first.note_share(0.0, 0.4)  # held up
    pair.begin("arm1", "a", 0.404, again)
    pair.start()
    for k in range(101, 254):  # 251 set-points, and what rounding adds
        time = 0.004 * k
        assert other.paced(1.0, time) == 1.0
        assert again.paced(1.0, time) == again.most_scale
        again.next(time)
        other.next(time)
    assert again.done
    assert other.done


def test_motion_has_its_own_speed_again_if_the_other_one_was_given_up() -> None:
    pair = MotionPair("arm1", "arm2")
    long, short = motion(10.0), motion(1.0)
    pair.begin("arm1", "a", 0.0, long)
    pair.begin("arm2", "b", 0.0, short)
    pair.start()
    short.next(0.004)
    assert short.paced(1.0, 0.008) == pytest.approx(0.1)
    pair.give_up("arm1")
    assert short.paced(1.0, 0.012) == 1.0


class Moving:
    """Times at which each arm moved, by the true joint speeds."""

    def __init__(self) -> None:
        self.times: dict[str, list[float]] = {}

    def look(self, world: World) -> None:
        for name, arm in world.arms.items():
            if float(np.abs(arm.v).max()) > MOVING:
                self.times.setdefault(name, []).append(world.time)

    def span(self, arm: str) -> tuple[float, float]:
        return self.times[arm][0], self.times[arm][-1]


def reach(x: float, y: float, z: float, speed: float) -> Tree:
    return {"reach_to_pose": {"offset": {"xyz": [x, y, z]}, "speed": speed}}


def step(other: str, child: Tree) -> Tree:
    return {"in_step": {"with": other, "child": child}}


def played(stage: Stage, first: Tree, second: Tree, *, backwards: bool = False) -> Any:
    arms: Tree = {
        "arm1": {"robot": "ur5", "tree": first},
        "arm2": {
            "robot": "panda",
            "base": {"xyz": [1.5, 0, 0], "rpy": [0, 0, 180]},
            "tree": second,
        },
    }
    if backwards:
        arms = dict(reversed(arms.items()))
    world = {"scene": "empty", "reality": "lab", "seed": 0, "time_limit": 20.0}
    play = stage.play({"name": "step", "world": world, "arms": arms})
    moving = Moving()
    play.watchers.append(moving.look)
    play.run()
    return play, moving


def codes(play: Play) -> list[tuple[str, str, str]]:
    return [
        (name, leaf.status, leaf.code) for name in ("arm1", "arm2") for leaf in play.arm(name).runs
    ]


@pytest.mark.parametrize("backwards", [False, True])
def test_arms_in_step_move_at_the_same_time(backwards: bool, stage: Stage) -> None:
    fast = step("arm2", reach(0.0, 0.1, 0.1, 1.0))
    slow = {"sequence": [{"wait": {"seconds": 0.5}}, step("arm1", reach(0.0, 0.2, -0.1, 0.2))]}
    play, moving = played(stage, fast, slow, backwards=backwards)
    assert {one[1] for one in codes(play)} == {"SUCCESS"}
    (begin1, end1), (begin2, end2) = moving.span("arm1"), moving.span("arm2")
    assert begin1 == pytest.approx(begin2, abs=0.06)
    assert end1 == pytest.approx(end2, abs=0.1)
    assert begin1 > 0.5


@pytest.mark.parametrize("backwards", [False, True])
def test_step_takes_as_long_as_its_longer_motion(backwards: bool, stage: Stage) -> None:
    """Nothing slows either arm; the node begins and ends one tick beside its child."""
    fast, slow = reach(0.0, 0.05, 0.05, 0.5), reach(0.0, 0.2, -0.1, 0.5)
    alone, _ = played(stage, fast, slow, backwards=backwards)
    both, _ = played(stage, step("arm2", fast), step("arm1", slow), backwards=backwards)
    longest = max(run.ended_s for run in alone.arm("arm1").runs + alone.arm("arm2").runs)
    for name in ("arm1", "arm2"):
        (run,) = both.arm(name).runs
        assert run.ended_s - 0.02 == pytest.approx(longest, abs=0.021)


def test_motion_goes_on_alone_if_the_leaf_of_the_other_one_is_halted(stage: Stage) -> None:
    """It crept at a tenth of its speed to its end, behind a motion that had been given up."""
    halted = {"timeout": {"seconds": 0.5, "child": reach(0.0, -0.2, 0.1, 0.1)}}
    first = step("arm2", {"sequence": [{"force_success": {"child": halted}}, {"wait": 3}]})
    play, moving = played(stage, first, step("arm1", reach(-0.1, 0.0, 0.1, 0.2)))
    assert ("arm1", "INVALID", "HALTED") in codes(play)
    _, alone = played(stage, {"wait": 0.1}, reach(-0.1, 0.0, 0.1, 0.2))
    begin, end = moving.span("arm2")
    free_begin, free_end = alone.span("arm2")
    assert end - begin < free_end - free_begin + 0.7


def test_halting_one_arm_stops_its_partner(stage: Stage) -> None:
    halted = {"timeout": {"seconds": 0.8, "child": step("arm1", reach(0.0, 0.2, -0.1, 0.1))}}
    play, moving = played(stage, step("arm2", reach(0.0, 0.1, 0.1, 0.5)), halted)
    assert ("arm1", "INVALID", "HALTED") in codes(play)
    assert moving.span("arm1")[1] < 1.3
    assert play.speed_after(1.4) < MOVING


def test_motion_whose_partner_waits_for_a_later_signal_is_a_deadlock(stage: Stage) -> None:
    """A selector hides the deadlock from the static check of the file."""
    signals = {"sequence": [reach(0.0, 0.05, 0.0, 0.5), {"signal": "moved"}]}
    waits = {"sequence": [{"selector": [{"fail": {}}, {"await": "moved"}]}, reach(0, 0, 0.05, 0.5)]}
    arms: Tree = {
        "arm1": {"robot": "ur5", "tree": step("arm2", signals)},
        "arm2": {
            "robot": "ur5",
            "base": {"xyz": [1.6, 0, 0], "rpy": [0, 0, 180]},
            "tree": step("arm1", waits),
        },
    }
    cell = {"signals": {"moved": {"type": "boolean", "written_by": ["arm1"]}}}
    world = {"scene": "empty", "time_limit": 20.0}
    play = stage.run({"name": "step", "world": world, "cell": cell, "arms": arms})
    found = [change for change in play.changes if change.code == "DEADLOCK"]
    assert found
    assert play.opened.time < 2.0
