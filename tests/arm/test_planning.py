"""Arms plan in simulated time, and plan again when the world changes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from bt_dualarm.arm.motions import HALT_S, PLANNING_S
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Pose
from bt_dualarm.planning.path_constraints import POSES, ConstrainedProblem, PathConstraint
from bt_dualarm.planning.problem import CHECKS, PlanningProblem
from bt_dualarm.planning.process import PlanningProcess
from bt_dualarm.trajectory.set_points import SetPoint
from bt_dualarm.trajectory.trajectory import Trajectory
from tests.arm.test_arm import TICK, Bench
from tests.control.walls import ABOVE, LEFT, RIGHT, wall
from tests.sim.worlds import box


@pytest.fixture(scope="module")
def planning() -> Iterator[PlanningProcess]:
    process = PlanningProcess()
    yield process
    process.close()


TOOL_LEFT = (0.33, 0.57, 0.57)
"""Tool position in `LEFT`, m."""


class WalledBench(Bench):
    """An arm in `RIGHT`, with a wall that stands from the start or that the test spawns later."""

    def __init__(self, planning: PlanningProcess, *, standing: bool = True) -> None:
        post = box((0.33, 0.57, 0.57), 0.2, fixed=True, spawned=False)  # at `TOOL_LEFT`
        super().__init__(planning, wall=wall(spawned=False), post=post)
        self.run(self.first.follow(self.first.straight_to(RIGHT, 1.0)))
        if standing:
            self.world.spawn_object("wall")

    def planned(self, *goals: object) -> tuple[Trajectory, float]:
        """A plan of the first leaf, and the simulated planning time in s."""
        began = self.world.time
        found = []

        def work() -> Iterator[None]:
            found.append((yield from self.first.plan(goals, 1.0)))  # type: ignore[arg-type]

        self.run(work())
        return found[0], self.world.time - began


class Unanswered(PlanningProcess):
    """Accepts problems without an answer, and counts the callers that still wait."""

    def __init__(self) -> None:
        super().__init__()
        self.waiting = 0

    def solve(self, problem: PlanningProblem) -> object:  # type: ignore[override]
        self.waiting += 1
        return self

    def abandon(self) -> None:
        self.waiting -= 1


def test_straight_motion_is_found_at_once_and_a_search_takes_simulated_time(
    planning: PlanningProcess,
) -> None:
    bench = WalledBench(planning)
    for goal, straight in ((ABOVE, True), (LEFT, False)):
        motion, taken = bench.planned(goal)
        moved = motion.q - RIGHT
        line = (goal - RIGHT) / np.linalg.norm(goal - RIGHT)
        assert (np.abs(moved - np.outer(moved @ line, line)).max() < 1e-9) == straight
        assert motion.q[-1] == pytest.approx(goal, abs=1e-9)
        lasts = 0.0 if straight else PLANNING_S
        assert taken == pytest.approx(lasts, abs=TICK * bench.world.timestep)


def test_straight_motion_starts_no_planning_process() -> None:
    process = PlanningProcess()
    WalledBench(process).planned(ABOVE)
    assert process.pid is None


def test_leaf_halted_while_planning_abandons_its_problem() -> None:
    unanswered = Unanswered()
    bench = WalledBench(unanswered)
    work = bench.first.plan([LEFT], 1.0)
    next(work)
    bench.tick()
    next(work)
    assert unanswered.waiting == 1
    work.close()
    assert unanswered.waiting == 0


def test_search_is_as_much_shorter_with_a_constraint_as_without() -> None:
    """While another arm might leave, an arm with passengers searched to the end each time."""
    asked: list[int] = []

    class Recording(Unanswered):
        def solve(self, problem: ConstrainedProblem) -> object:  # type: ignore[override]
            asked.append(problem.poses)
            return super().solve(problem.problem)

    bench = WalledBench(Recording())
    arm = bench.first
    keep = PathConstraint(arm.robot, arm.kinematics.base, Pose.identity(), lowest=0.0)
    for arm.checks in (CHECKS, CHECKS // 8):
        work = arm.plan([LEFT], 1.0, keep=keep)
        next(work)
        work.close()
    assert asked == [POSES, POSES // 8]


def test_planning_failure_reports_the_planner_and_the_planning_time() -> None:
    class Hopeless(Unanswered):
        def result(self) -> Trajectory:
            raise Failure("NO_PLAN", "no way", planner="RRTConnect", states=7)

    bench = WalledBench(Hopeless())
    with pytest.raises(Failure, match="no way") as caught:
        bench.run(bench.first.plan([LEFT], 1.0))
    numbers = caught.value.numbers
    assert numbers == {"planner": "RRTConnect", "states": 7, "planning_s": PLANNING_S}


def test_impossible_goals_are_refused_at_once_with_the_reason_of_the_first() -> None:
    bench = WalledBench(PlanningProcess())
    in_the_wall = (RIGHT + LEFT) / 2
    with pytest.raises(Failure, match="wall") as caught:
        next(bench.first.plan([in_the_wall, in_the_wall + 0.01], 1.0))
    assert caught.value.code == "IN_COLLISION"


def test_outdated_plan_is_made_again(
    planning: PlanningProcess,
) -> None:
    """A post appears on the path around the wall while the arm plans."""
    bench = WalledBench(planning)
    around, _ = bench.planned(LEFT)
    midway = bench.first.kinematics.forward(around.q[len(around) // 2])
    work = bench.first.plan([LEFT], 1.0)
    found = []

    def planned() -> Iterator[None]:
        found.append((yield from work))

    planner = planned()
    began = bench.world.time
    next(planner)
    bench.tick()
    bench.world.spawn_object("post", midway)
    with pytest.raises(Failure):
        bench.first.refuse_collision_along(around.q)
    bench.run(planner)
    assert bench.world.time - began == pytest.approx(2 * PLANNING_S, abs=0.05)
    bench.first.refuse_collision_along(found[0].q)


def test_arm_stops_for_an_object_on_its_path_and_then_goes_around_it(
    planning: PlanningProcess,
) -> None:
    bench = WalledBench(planning, standing=False)
    work = bench.first.travel([LEFT], 0.1)
    for _ in range(20):
        next(work)
        bench.tick()
    bench.world.spawn_object("wall")
    speeds = []
    for _ in work:
        bench.tick()
        speeds.append(float(np.abs(bench.world.arms["arm1"].v).max()))
        assert not touches(bench, "wall")
    assert bench.world.arms["arm1"].q == pytest.approx(LEFT, abs=1e-3)
    assert min(speeds[: len(speeds) // 2]) < 0.01  # it stopped in between


def test_second_object_on_the_path_ends_the_motion_with_the_reason(
    planning: PlanningProcess,
) -> None:
    """The arm plans again once; then the leaf reports the object that blocks the path."""
    bench = WalledBench(planning, standing=False)
    work = bench.first.travel([LEFT], 0.1)

    def disturbed() -> Iterator[float | None]:
        for tick, progress in enumerate(work):
            yield progress
            if tick == 20:
                bench.world.spawn_object("wall")
            if tick > 120 and "post" not in bench.world.objects and bench.controller.motion:
                bench.world.spawn_object("post")

    with pytest.raises(Failure) as caught:
        bench.run(disturbed(), 3000)
    assert caught.value.code == "IN_COLLISION", caught.value
    assert caught.value.numbers["second"] == "post"
    bench.run(bench.first.halt())
    assert not touches(bench, "wall")
    assert not touches(bench, "post")


def test_wait_for_an_arm_that_never_comes_to_rest_is_limited() -> None:
    bench = Bench()
    bench.controller.stream(lambda _: bench.controller.setpoint)
    for work in (bench.first.think(), bench.first.plan([ABOVE], 1.0)):
        began = bench.world.time
        with pytest.raises(Failure, match="still moves") as caught:
            bench.run(work)
        assert caught.value.code == "TRACKING_ERROR"
        assert bench.world.time - began == pytest.approx(HALT_S, abs=0.1)


def touches(bench: Bench, obj: str) -> bool:
    geom = bench.world.object_geom(obj)
    return bool((bench.world.data.contact.geom == geom).any())


def test_straight_path_that_was_free_is_checked_again_when_replanned(
    planning: PlanningProcess,
) -> None:
    """A new plan is checked in full, although the path was known to be free when it began."""
    bench = WalledBench(planning, standing=False)
    tool = bench.first.commanded_tool_pose
    beyond = (bench.first.kinematics.forward(LEFT).position - tool.position) * 0.6
    end = Pose(tool.position + beyond, tool.quaternion)
    work = bench.first.past_others(0.1).straight(end, known_free=True)
    for _ in range(5):
        next(work)
        bench.tick()
    bench.world.spawn_object("wall")
    with pytest.raises(Failure, match="wall") as caught:
        bench.run(work)
    assert caught.value.code == "IN_COLLISION"
    assert bench.world.data.ncon == 0


@pytest.mark.parametrize(
    "degrees",
    [
        (-90.5, 159.1, 81.9, -137.4, -115.2, -165.5),
        (24.3, 152.9, 143.8, 5.2, 112.1, -77.8),
        (-25.3, -30.3, 150.0, 49.3, 156.7, 139.5),
    ],
)
def test_configuration_near_self_collision_comes_last(
    degrees: tuple[float, ...],
) -> None:
    """An arm held there sags by up to 2 mm and would not come to rest at its goal."""
    arm = Bench().first
    grazing = np.radians(degrees)
    assert arm.checker().free(grazing)
    arm.controller._limiter.sent = SetPoint(grazing + 0.05, np.zeros(6), np.zeros(6))
    first, *others = arm.configurations(arm.kinematics.forward(grazing))
    clear = arm.checker()
    clear.keep_clear(0.003, itself=True)
    assert clear.free(first)
    assert any(np.abs(q - grazing).max() < 0.01 for q in others), "it is still among them"


def test_arm_does_not_move_aside_for_one_that_was_just_removed() -> None:
    """What that arm waited for is visible to the end of the step in which it is removed."""
    arm = Bench().first
    move = arm.past_others(0.5)
    move.traffic.block("removed", "leaf", {arm.name})
    arm.world.data.time += 0.1
    assert move.traffic.is_in_the_way(arm.name)
    assert list(move.make_way()) == []
