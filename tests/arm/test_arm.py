"""An arm shared by leaves: one leaf moves it at a time, and none inherits another's motion."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from bt_dualarm.arm.arm import Arm
from bt_dualarm.arm.motions import PLANNING_S
from bt_dualarm.arm.shared_arm import SharedArm
from bt_dualarm.arm.traffic import Traffic
from bt_dualarm.control.controller import JointController
from bt_dualarm.core.errors import Failure
from bt_dualarm.planning.process import PlanningProcess
from bt_dualarm.safety.failsafe import Reservations
from bt_dualarm.sim.contact_monitor import Contacts
from bt_dualarm.sim.world import World
from bt_dualarm.trajectory.path_timing import point_to_point
from bt_dualarm.trajectory.set_points import SetPoint
from bt_dualarm.trajectory.trajectory import Trajectory
from tests.sim.worlds import arm, box, file_of

TICK = 10  # steps


class Bench:
    """A UR5, two leaves that share it, and a clock that the test advances."""

    def __init__(
        self,
        planning: PlanningProcess | None = None,
        robot: str = "ur5",
        gripper: str | None = None,
        **objects: object,
    ) -> None:
        arms = {"arm1": arm(robot, gripper=gripper)}
        self.world = World(file_of(arms, objects))  # type: ignore[arg-type]
        self.controller = JointController(self.world, "arm1", self.world.timestep, Reservations())
        planning = planning or PlanningProcess()
        contacts = Contacts(self.world)
        traffic = Traffic(lambda: self.world.time)
        controllers = {"arm1": self.controller}
        shared = SharedArm(
            self.world, "arm1", self.controller, None, 1, planning, contacts, traffic, controllers
        )
        self.first = Arm(shared, "first")
        self.second = Arm(shared, "second")

    def tick(self) -> None:
        for _ in range(TICK):
            self.controller.update(self.world.time)
            self.world.step()

    def run(self, work: Iterator[float | None], ticks: int = 500) -> list[float | None]:
        """Ticks a leaf's work to its end; returns the values that it yielded."""
        yielded = []
        for _ in range(ticks):
            try:
                yielded.append(next(work))
            except StopIteration:
                return yielded
            self.tick()
        raise AssertionError(f"not finished after {ticks} ticks")

    def motion(self, angle: float = 0.4) -> Trajectory:
        """Straight motion of the first joint by an angle in rad."""
        start = self.controller.setpoint.q
        goal = start + angle * np.array([1.0, 0, 0, 0, 0, 0])
        return point_to_point(start, goal, self.first.limits(1.0), self.first.period)


def test_motion_is_followed_to_its_end() -> None:
    """Progress never decreases, and the arm comes to rest at the end of the motion."""
    bench = Bench()
    motion = bench.motion()
    progress = bench.run(bench.first.follow(motion))
    assert progress == sorted(progress, key=lambda share: share or 0.0)
    assert progress[0] == 0.0
    assert bench.world.arms["arm1"].q == pytest.approx(motion.q[-1], abs=5e-4)
    assert bench.first.tool_pose.distance(bench.first.commanded_tool_pose) < 1e-3


def test_only_one_leaf_moves_the_arm() -> None:
    bench = Bench()
    work = bench.first.follow(bench.motion())
    next(work)
    bench.tick()
    bench.tick()
    for action in (
        lambda: bench.second.begin(bench.motion()),
        lambda: bench.second.stream(lambda _: bench.controller.setpoint),
        lambda: next(bench.second.think()),
    ):
        with pytest.raises(Failure, match="first is already moving arm1") as caught:
            action()
        assert caught.value.code == "BUSY"
    bench.run(work)
    bench.second.begin(bench.motion())  # the first is done


def test_release_stops_only_the_motion_of_the_same_leaf() -> None:
    bench = Bench()
    work = bench.first.follow(bench.motion())
    next(work)
    bench.tick()
    motion = bench.controller.motion
    bench.second.release()
    assert bench.controller.motion is motion
    bench.first.release()
    assert bench.controller.motion is not motion
    for _ in range(50):
        bench.tick()
    assert bench.controller.at_rest
    bench.first.release()
    assert bench.controller.at_rest


def test_leaf_that_starts_while_the_arm_brakes_plans_from_rest() -> None:
    """Halted at full speed, the arm takes longer to stop than planning takes."""
    bench = Bench()
    work = bench.first.follow(bench.motion(1.5))
    for _ in range(40):
        next(work)
        bench.tick()
    assert np.abs(bench.world.arms["arm1"].v).max() > 1.5
    bench.first.release()
    began = bench.world.time
    bench.run(bench.second.think())
    assert bench.world.time - began > 2 * PLANNING_S
    bench.run(bench.second.follow(bench.motion(-0.2)))
    assert bench.controller.clipped == 0


def broken(time: float) -> SetPoint:
    """A stream that raises an exception."""
    raise ZeroDivisionError("in a skill")


def test_exception_in_a_stream_reaches_the_leaf() -> None:
    bench = Bench()

    bench.first.stream(broken)
    bench.tick()
    with pytest.raises(ZeroDivisionError):
        bench.first.check()


def test_pending_fault_is_withheld_from_a_skill_that_calls_check() -> None:
    bench = Bench()

    bench.first.check()
    bench.first.stream(broken)
    bench.tick()
    assert bench.first.pending_fault() is None  # it called check in its last tick and will again
    with pytest.raises(ZeroDivisionError):
        bench.first.check()
    bench.first.check()  # raised once: a skill that handles it may go on
    bench.first.release()
    bench.first.stream(broken)
    bench.tick()
    assert bench.first.pending_fault() is None
    assert isinstance(bench.first.pending_fault(), ZeroDivisionError)
    assert bench.first.pending_fault() is None


def test_leaf_does_not_raise_the_error_of_the_previous_leaf() -> None:
    bench = Bench()

    bench.first.stream(broken)
    bench.tick()
    with pytest.raises(ZeroDivisionError):
        bench.first.check()
    bench.first.release()
    bench.second.enter(anew=True)
    bench.second.check()
    bench.first.enter(anew=True)
    bench.first.check()


def test_blocked_arm_fails_and_stops_pushing_after_its_release() -> None:
    bench = Bench(wall=box((0.25, 0.45, 0.9), 0.4, fixed=True))
    start = bench.controller.setpoint.q
    goal = start + np.array([1.0, 0, 0, 0, 0, 0])
    limits = bench.first.limits(1.0)
    motion = point_to_point(start, goal, limits, bench.first.period)
    with pytest.raises(Failure) as caught:
        bench.run(bench.first.follow(motion))
    assert caught.value.code == "IN_COLLISION"
    bench.first.release()
    for _ in range(90):
        bench.tick()
    assert bench.controller.at_rest
    push = np.abs(bench.world.data.ctrl[bench.world.arms["arm1"].actuator_ids])
    assert push[0] < 0.1 * limits.effort[0]


def test_unknown_posture_is_refused_with_the_known_ones() -> None:
    bench = Bench()
    with pytest.raises(Failure, match="home") as caught:
        bench.first.posture("hom")
    assert caught.value.code == "INVALID_TARGET"


def test_target_inside_an_object_is_refused_before_any_motion() -> None:
    bench = Bench(wall=box((-0.487, -0.109, 0.827), 0.2, fixed=True))
    turned = bench.controller.setpoint.q + np.array((np.pi, 0, 0, 0, 0, 0))
    with pytest.raises(Failure, match="wall") as caught:
        bench.first.refuse_collision(turned)
    assert caught.value.code == "IN_COLLISION"
    bench.first.refuse_collision(turned, frozenset({"wall"}))
