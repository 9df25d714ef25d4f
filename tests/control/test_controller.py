"""The joint controller holds, follows, brakes and carries, and reports when it cannot."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from bt_dualarm.control.controller import JointController
from bt_dualarm.core.errors import DivergenceError, Failure
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.safety.failsafe import Reservations
from bt_dualarm.sim.world import World
from bt_dualarm.trajectory.path_timing import point_to_point
from bt_dualarm.trajectory.set_points import SetPoint, Stream
from bt_dualarm.trajectory.trajectory import Trajectory, use_of_limits
from tests.sim.worlds import PAGES, ROBOTS, arm, box, file_of, world_with

MRAD = 1e-3
FAST = ("ur5", "panda")


def controlled(world: World, name: str = "arm1") -> JointController:
    return JointController(world, name, world.timestep, Reservations())


def run(world: World, seconds: float, *controllers: JointController) -> Trajectory:
    """Advances and checks all torques; returns the set-points of the first controller."""
    sent = [controllers[0].setpoint]
    for _ in range(round(seconds / world.timestep)):
        for controller in controllers:
            controller.update(world.time)
        for body in world.arms.values():
            torque = np.abs(world.data.ctrl[body.actuator_ids])
            assert (torque <= body.robot.limits.effort).all()
        world.step()
        sent.append(controllers[0].setpoint)
    q, v, a = (np.array([getattr(point, name) for point in sent]) for name in ("q", "v", "a"))
    return Trajectory(world.timestep, q, v, a)


def error(world: World, controller: JointController) -> float:
    """Largest joint error in rad. The state is one step after the set-point."""
    sent = controller.setpoint
    expected = sent.q + (sent.v + 0.5 * sent.a * controller.period) * controller.period
    return float(np.abs(expected - world.arms["arm1"].q).max())


def sine(start: SetPoint, amplitude: float, w: float, begin: float) -> Stream:
    """All joints swing from rest; the first second fades in."""

    def at(time: float) -> SetPoint:
        t = time - begin
        fade = 1.0
        rise = 0.0
        bend = 0.0
        if t < 1.0:  # the smooth step of fifth order: no jump in acceleration
            fade = t**3 * (10 - 15 * t + 6 * t * t)
            rise = 30 * t**2 * (1 - t) ** 2
            bend = 60 * t * (1 - t) * (1 - 2 * t)
        s = amplitude * np.sin(w * t)
        c = amplitude * np.cos(w * t)
        ones = np.ones_like(start.q)
        q = fade * s
        v = rise * s + fade * w * c
        a = bend * s + 2 * rise * w * c - fade * w * w * s
        return SetPoint(start.q + q * ones, v * ones, a * ones)

    return at


@pytest.mark.parametrize("robot", ROBOTS)
def test_posture_is_held_under_gravity(robot: str) -> None:
    world = world_with(robot)
    controller = controlled(world)
    start = world.arms["arm1"].q
    run(world, 0.3, controller)
    assert np.abs(world.arms["arm1"].q - start).max() < 0.5 * MRAD
    assert controller.at_rest
    assert controller.clipped == controller.saturated == 0


@pytest.mark.parametrize("robot", ROBOTS)
def test_sine_is_followed(robot: str) -> None:
    """The error stays below 1 mrad at 40 % of the velocity, acceleration or jerk limits."""
    world = world_with(robot)
    controller = controlled(world)
    limits = world.robots["arm1"].limits
    w = 4.0
    bounds = limits.velocity / w, limits.acceleration / w**2, limits.jerk / w**3
    amplitude = 0.4 * float(np.min(bounds))
    controller.stream(sine(controller.setpoint, min(amplitude, 0.2), w, 0.0))
    worst = 0.0
    for _ in range(20):
        run(world, 0.1, controller)
        worst = max(worst, error(world, controller))
    assert worst < 1.0 * MRAD
    assert controller.clipped == controller.saturated == 0


@pytest.mark.parametrize("robot", FAST)
@pytest.mark.parametrize("every", [1, 2])
def test_fast_motion_is_followed_to_its_end(robot: str, every: int) -> None:
    """The motion is at the arm's limits; updates at every second step (250 Hz) suffice."""
    world = world_with(robot)
    controller = JointController(world, "arm1", every * world.timestep, Reservations())
    start = controller.setpoint.q
    goal = start + 0.3
    limits = world.robots["arm1"].limits
    trajectory = point_to_point(start, goal, limits, controller.period)
    motion = controller.follow(trajectory, along_path=True)
    worst = 0.0
    steps = 0
    while not controller.at_rest:
        if steps % every == 0:
            controller.update(world.time)
        world.step()
        steps += 1
        if steps % every == 0:
            worst = max(worst, error(world, controller))
        assert steps < 2000
    assert worst < 2.0 * MRAD
    assert motion.done
    assert len(motion.take_measured()) == len(motion.trajectory)
    assert world.arms["arm1"].q == pytest.approx(goal, abs=0.5 * MRAD)
    assert controller.clipped == 0


@pytest.mark.parametrize("robot", FAST)
def test_stop_brakes_within_the_limits(robot: str) -> None:
    world = world_with(robot)
    controller = controlled(world)
    limits = world.robots["arm1"].limits
    start = controller.setpoint.q
    controller.follow(point_to_point(start, start + 0.5, limits, controller.period))
    run(world, 0.2, controller)
    assert np.abs(world.arms["arm1"].v).max() > 0.3
    controller.stop()
    motion = run(world, 1.0, controller)
    use = use_of_limits(motion, limits)
    assert max(use.velocity, use.acceleration, use.jerk) < 1 + 1e-6
    assert controller.at_rest
    assert controller.clipped == 0
    controller.stop()  # harmless at rest
    assert controller.at_rest


def test_attached_load_does_not_reduce_accuracy() -> None:
    """Holding and moving an attached kilogram is as exact as without it."""
    world = World(file_of({"arm1": arm("ur5")}, {"load": box((0.0, 0.0, 0.0), mass=1.0)}))
    controller = controlled(world)
    tool = world.arms["arm1"].tool_pose
    world.remove_object("load")
    world.spawn_object("load", tool @ Pose.from_rpy((0.02, 0.0, 0.03)))
    world.attach("arm1", "load")
    run(world, 0.3, controller)
    assert error(world, controller) < 0.5 * MRAD
    controller.stream(sine(controller.setpoint, 0.1, 4.0, world.time))
    worst = 0.0
    for _ in range(15):
        run(world, 0.1, controller)
        worst = max(worst, error(world, controller))
    assert worst < 1.0 * MRAD
    world.attachments.detach("arm1", "load")
    run(world, 0.1, controller)
    assert error(world, controller) < 1.0 * MRAD


def test_blocked_arm_reports_a_fault_and_stops_pushing() -> None:
    """A fixed wall blocks the forearm."""
    wall = box((0.25, 0.45, 0.9), 0.4, fixed=True)
    world = World(file_of({"arm1": arm("ur5")}, {"wall": wall}))
    controller = controlled(world)
    limits = world.robots["arm1"].limits
    start = controller.setpoint.q
    goal = start + np.array([1.0, 0, 0, 0, 0, 0])
    controller.follow(point_to_point(start, goal, limits, controller.period))
    run(world, 2.0, controller)
    assert isinstance(controller.fault, Failure)
    assert controller.fault.code == "IN_COLLISION"
    assert controller.fault.numbers["second"] == "wall"
    assert float(controller.fault.numbers["depth_m"]) > 0.0
    assert controller.at_rest
    push = np.abs(world.data.ctrl[world.arms["arm1"].actuator_ids][0])
    assert push < 0.1 * limits.effort[0]
    assert controller.clipped == 0


def test_new_motion_clears_the_fault_of_the_last() -> None:
    world = world_with("ur5")
    controller = controlled(world)
    controller.fault = Failure("TRACKING_ERROR", "an old one")
    controller.follow(Trajectory.rest(controller.setpoint.q, controller.period))
    assert controller.fault is None


def broken(time: float) -> SetPoint:
    raise ZeroDivisionError("in a skill")


def nan_stream(start: SetPoint) -> Stream:
    return lambda time: SetPoint(start.q * np.nan, start.v, start.a)


def test_exception_in_a_stream_is_a_fault_and_stops_the_arm() -> None:
    """The arm was moving; it brakes within its limits, and the error is kept for the skill."""
    world = world_with("panda")
    controller = controlled(world)
    swing = sine(controller.setpoint, 0.1, 4.0, 0.0)
    controller.stream(lambda time: swing(time) if time < 0.5 else broken(time))
    motion = run(world, 1.0, controller)
    assert isinstance(controller.fault, ZeroDivisionError)
    assert controller.motion is None
    assert controller.at_rest
    use = use_of_limits(motion, world.robots["arm1"].limits)
    assert max(use.velocity, use.acceleration, use.jerk) < 1 + 1e-6


def test_stream_of_nan_leaves_the_arm_at_rest() -> None:
    world = world_with("panda")
    controller = controlled(world)
    controller.stream(nan_stream(controller.setpoint))
    run(world, 0.2, controller)
    assert error(world, controller) < 0.5 * MRAD
    assert controller.clipped == 100


@pytest.mark.parametrize(
    "make", [nan_stream, lambda start: lambda t: SetPoint(start.q + 9, start.v, start.a)]
)
def test_torques_stay_within_the_efforts(make: Callable[[SetPoint], Stream]) -> None:
    """``run`` checks every torque."""
    world = world_with("ur3")
    controller = controlled(world)
    controller.stream(make(controller.setpoint))
    run(world, 0.5, controller)


def test_saturation_is_counted() -> None:
    world = world_with("ur3")
    controller = controlled(world)
    world.data.qvel[world.arms["arm1"].dof_ids] = 3.0
    run(world, 0.1, controller)
    assert controller.saturated > 0


def test_arm_with_a_large_velocity_comes_to_rest() -> None:
    """Torques clipped per joint would keep adding energy, and the arm would never stop."""
    world = world_with("panda")
    controller = controlled(world)
    world.data.qvel[world.arms["arm1"].dof_ids] = (0, 20, 0, -25, 0, 30, 0)
    run(world, 1.5, controller)
    assert controller.saturated > 0
    assert controller.at_rest


def test_motion_must_start_at_the_current_configuration() -> None:
    world = world_with("ur5")
    controller = controlled(world)
    with pytest.raises(Failure, match=r"5\.73° from where the arm is"):
        controller.follow(Trajectory.rest(controller.setpoint.q + 0.1, controller.period))
    assert controller.at_rest


def test_motion_must_not_start_at_rest_while_the_arm_moves() -> None:
    """The gate would let the arm leave the path that was checked and reserved."""
    world = world_with("ur5")
    controller = controlled(world)
    start = controller.setpoint.q
    limits = world.robots["arm1"].limits
    controller.follow(point_to_point(start, start + 0.5, limits, controller.period))
    run(world, 0.2, controller)
    moving = controller.setpoint
    with pytest.raises(Failure, match=r"the arm moves at .*°/s: a skill waits with .*come_to_rest"):
        controller.follow(point_to_point(moving.q, start, limits, controller.period))
    controller.stop()
    run(world, 1.0, controller)
    controller.follow(point_to_point(controller.setpoint.q, start, limits, controller.period))
    run(world, 2.0, controller)
    assert controller.setpoint.q == pytest.approx(start, abs=1e-9)
    assert controller.clipped == 0


def test_nan_torques_raise_a_divergence_error() -> None:
    world = world_with("ur5")
    controller = controlled(world)
    world.data.qpos[0] = np.nan
    world.sense()
    with pytest.raises(DivergenceError, match="arm1"):
        controller.update(0.0)


def test_controller_goes_on_when_the_world_is_recompiled() -> None:
    """Spawned and removed arms and objects change an arm's array indices, not its motion."""
    file = file_of(
        {"arm1": arm("ur5"), "arm2": arm("panda", (1.6, 0.0, 0.0), spawned=False)},
        {"cube": box((0.5, 0.5, 0.025))},
    )
    world = World(file)
    controller = controlled(world)
    start = controller.setpoint.q
    changes: tuple[Callable[[], object], ...] = (
        lambda: world.spawn_arm("arm2"),
        lambda: world.remove_object("cube"),
        lambda: world.spawn_object("cube"),
        lambda: world.remove_arm("arm2"),
    )
    for change in changes:
        change()
        run(world, 0.02, controller)
        assert np.abs(world.arms["arm1"].q - start).max() < 0.5 * MRAD


def test_clipped_motion_still_ends_at_its_goal() -> None:
    """A motion faster than the limits is clipped, but ends at its intended configuration."""
    world = world_with("ur5")
    controller = controlled(world)
    start: Vector = controller.setpoint.q
    limits = world.robots["arm1"].limits
    motion = point_to_point(start, start + 0.5, limits, controller.period)
    twice = Trajectory(motion.dt, motion.q[::2], 2 * motion.v[::2], 4 * motion.a[::2])
    end = twice.q[-1]
    controller.follow(twice)
    sent = run(world, 1.5, controller)
    assert controller.clipped > 0
    use = use_of_limits(sent, limits)
    assert max(use.velocity, use.acceleration, use.jerk) < 1 + 2e-6
    assert controller.setpoint.q == pytest.approx(end, abs=1e-9)


def test_user_robots_are_part_of_these_tests() -> None:
    """Arms outside the catalog hold and follow like those in it."""
    assert set(PAGES) < set(ROBOTS)


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("share", [0.4, 1.0])
def test_joint_faster_than_the_robot_allows_is_a_fault(name: str, share: float) -> None:
    """The measured speed counts, against the robot's limits even if the arm declares lower ones.

    One that breaks away from dry friction is too fast for a few milliseconds only.
    """
    world = world_with(name, limits={"velocity": share})
    controller = controlled(world)
    body = world.arms["arm1"]
    limits = world.robots["arm1"].limits
    goal = body.q + np.where(limits.upper - body.q > 0.5, 0.4, -0.4)
    controller.follow(point_to_point(body.q, goal, limits, world.timestep))
    run(world, 0.3, controller)
    assert controller.fault is None
    assert 0.0 < float(controller.guard["fastest_share"]) < share * 1.02
    for times, seconds, fails in ((1.2, 0.014, False), (0.99, 0.03, False), (1.2, 0.03, True)):
        for _ in range(round(seconds / world.timestep)):
            world.data.qvel[body.dof_ids[-1]] = times * limits.velocity[-1] / share
            world.sense()
            controller.update(world.time)
        assert isinstance(controller.fault, Failure) == fails
    assert isinstance(controller.fault, Failure)
    assert controller.fault.code == "TRACKING_ERROR"
    assert controller.fault.numbers["joint_speed_share"] == pytest.approx(1.2)
    assert controller.guard["fastest_share"] == pytest.approx(1.2)


@pytest.mark.parametrize("robot", ["panda", "fr3"])
def test_arm_is_not_still_while_a_joint_lags_behind_an_ended_motion(robot: str) -> None:
    """From a small speed, set-points of a fast arm stop before its delayed drives do."""
    world = World(file_of({"arm1": arm(robot, reality="rough")}))
    controller = controlled(world)
    at_rest: list[float] = []
    still: list[float] = []
    for number in range(8):
        controller.stream(sine(controller.setpoint, 0.01, 15.0, world.time))
        run(world, 1.2 + 0.05 * number, controller)
        controller.stop()
        begun = len(still)
        while len(still) == begun:
            run(world, world.timestep, controller)
            speed = float(np.abs(world.arms["arm1"].v).max())
            if controller.at_rest:
                at_rest.append(speed)
            if controller.is_still:
                still.append(speed)
    assert max(still) < max(at_rest) - 0.01


@pytest.mark.parametrize("robot", FAST)
def test_controller_rests_only_when_its_set_point_does(robot: str) -> None:
    """The gate follows a jump of the last set-point with bounded jerk after the motion has ended.

    A motion planned from an intermediate set-point was refused later with TRACKING_ERROR.
    """
    world = world_with(robot)
    controller = controlled(world)
    start = controller.setpoint.q
    q = np.array([start, start, start + 1e-4])
    controller.follow(Trajectory(world.timestep, q, 0.0 * q, 0.0 * q))
    resting = []
    for _ in range(100):
        run(world, world.timestep, controller)
        if controller.at_rest:
            resting.append(controller.setpoint.q)
    assert resting
    assert all((one == resting[-1]).all() for one in resting)
