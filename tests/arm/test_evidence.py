"""The numbers of a failure are evidence for people: no code may base a decision on them."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from bt_dualarm.core.errors import Failure, Number
from bt_dualarm.core.pose import Matrix
from bt_dualarm.planning.process import PlanningProcess
from bt_dualarm.sim.world import World
from bt_dualarm.trajectory.path_timing import point_to_point
from tests.arm.test_arm import Bench
from tests.arm.test_planning import WalledBench
from tests.control.walls import LEFT
from tests.plays import Stage
from tests.sim.worlds import box

Story = Callable[[Stage, PlanningProcess], Matrix]
"""Runs a scenario in which failures decide what an arm does; returns its joint angles."""


@pytest.fixture
def planning() -> Iterator[PlanningProcess]:
    """One process for both runs of a story: starting one takes longer than the story itself."""
    process = PlanningProcess()
    yield process
    process.close()


def recorded(bench: Bench, work: Iterator[float | None], ticks: int) -> Matrix:
    """Joint angles at each tick, of shape (ticks, dof), during a leaf's work and after its end."""
    rows = []
    for _ in range(ticks):
        try:
            next(work, None)
        except Failure:
            bench.first.release()
        bench.tick()
        rows.append(bench.world.arms["arm1"].q)
    return np.array(rows)


def wall_appears_on_the_path(_: Stage, planning: PlanningProcess) -> Matrix:
    """The arm stops, and then goes around the wall."""
    bench = WalledBench(planning, standing=False)
    work = bench.first.travel([LEFT], 0.2)

    def disturbed() -> Iterator[float | None]:
        for tick, progress in enumerate(work):
            if tick == 15:
                bench.world.spawn_object("wall")
            yield progress

    rows = recorded(bench, disturbed(), 400)
    assert rows[-1] == pytest.approx(LEFT, abs=1e-3), "it went around the wall"
    return rows


def link_hits_a_wall(_: Stage, __: PlanningProcess) -> Matrix:
    """The arm retreats along its path."""
    bench = Bench(wall=box((0.25, 0.45, 0.9), 0.4, fixed=True))
    start = bench.controller.setpoint.q
    goal = start + np.array([1.0, 0, 0, 0, 0, 0])
    motion = point_to_point(start, goal, bench.first.limits(1.0), bench.first.period)
    rows = recorded(bench, bench.first.follow(motion), 120)
    assert abs(rows[-1, 0] - rows[:, 0].max()) > 0.01, "it retreated"
    return rows


REACH = "{reach_to_pose: {to: {xyz: [0.55, SIDE, 0.75]}, give_way: true, patience: 20}}"
FACING = """
world: {scene: empty, time_limit: 60}
arms:
  arm1: {robot: ur5, base: {xyz: [0, 0, 0.4]}, tree: {sequence: [FIRST, SECOND]}}
  arm2:
    robot: ur5
    base: {xyz: [1.1, 0, 0.4], rpy: [0, 0, 180]}
    tree: {sequence: [SECOND, FIRST]}
"""


def two_arms_swap_places(stage: Stage, _: PlanningProcess) -> Matrix:
    """They block each other, wait, yield and plan again."""
    text = FACING.replace("FIRST", REACH.replace("SIDE", "0.2"))
    play = stage.play(text.replace("SECOND", REACH.replace("SIDE", "-0.2")))
    rows: list[Matrix] = []

    def look(world: World) -> None:
        rows.append(np.concatenate([arm.q for arm in world.arms.values()]))

    play.watchers.append(look)
    play.run()
    assert {arm.outcome for arm in (play.arm("arm1"), play.arm("arm2"))} == {"SUCCESS"}
    return np.array(rows)


STORIES = (wall_appears_on_the_path, link_hits_a_wall, two_arms_swap_places)


@pytest.mark.parametrize("story", STORIES, ids=lambda story: story.__name__)
def test_renaming_the_numbers_of_failures_changes_no_motion(
    story: Story, stage: Stage, planning: PlanningProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Motions are equal to the bit whatever the numbers are called."""
    expected = story(stage, planning)
    init = Failure.__init__
    renamed = []

    def renaming(failure: Failure, code: str, reason: str, **numbers: Number) -> None:
        renamed.append(code)
        init(failure, code, reason, **{f"so_called_{name}": n for name, n in numbers.items()})

    monkeypatch.setattr(Failure, "__init__", renaming)
    assert np.array_equal(story(stage, planning), expected)
    assert renamed, "the story includes failures"
