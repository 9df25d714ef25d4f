"""Guards of a stream: fresh set-points, distance to other arms, contact."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from bt_dualarm.collision.distance import ArmDistance
from bt_dualarm.control.controller import JointController
from bt_dualarm.control.planar_servo import PlanarServo, PlaneTarget
from bt_dualarm.core.errors import Failure
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.safety.failsafe import Reservations
from bt_dualarm.safety.guard import CLEAR_M
from bt_dualarm.sim.world import World
from bt_dualarm.trajectory.path_timing import point_to_point
from bt_dualarm.trajectory.set_points import STALE_S, SetPoint, Stream
from bt_dualarm.trajectory.trajectory import Trajectory, use_of_limits
from tests.sim.worlds import arm, box, file_of, world_with

PERIOD = 0.004


def run(world: World, controllers: list[JointController], seconds: float) -> Trajectory:
    """Set-points of the first controller, at 250 Hz."""
    sent = [controllers[0].setpoint]
    for step in range(round(seconds / world.timestep)):
        if step % 2 == 0:
            for controller in controllers:
                controller.update(world.time)
            sent.append(controllers[0].setpoint)
        world.step()
    q, v, a = (np.array([getattr(point, name) for point in sent]) for name in ("q", "v", "a"))
    return Trajectory(PERIOD, q, v, a)


def stream_of(motion: Trajectory, given: Callable[[float], bool]) -> Stream:
    """A stream of a motion's set-points, with None where `given` is false."""

    def at(time: float) -> SetPoint | None:
        return SetPoint(*motion.at(time)) if given(time) else None

    return at


def swing(controller: JointController, world: World) -> Trajectory:
    limits = world.robots["arm1"].limits.scaled(0.5)
    goal = controller.setpoint.q + 0.7
    return point_to_point(controller.setpoint.q, goal, limits, PERIOD)


@pytest.mark.parametrize("robot", ["ur5", "panda"])
@pytest.mark.parametrize("repeated", [False, True])
def test_stream_without_new_set_points_ends_in_a_smooth_halt(robot: str, repeated: bool) -> None:
    """No set-point, or the same one repeated: both mean that the sender has stopped."""
    world = world_with(robot)
    controller = JointController(world, "arm1", PERIOD, Reservations())
    motion = swing(controller, world)
    last = SetPoint(*motion.at(0.5))
    fresh = stream_of(motion, lambda time: time < 0.5)
    controller.stream(lambda time: fresh(time) or (last if repeated else None))
    sent = run(world, [controller], 2.0)
    assert isinstance(controller.fault, Failure)
    assert controller.fault.code == "STALE"
    assert float(controller.fault.numbers["waited_s"]) == pytest.approx(STALE_S, abs=PERIOD + 1e-9)
    assert controller.at_rest
    use = use_of_limits(sent, world.robots["arm1"].limits)
    assert max(use.velocity, use.acceleration, use.jerk) < 1 + 1e-6
    moving = np.flatnonzero(sent.v.any(axis=1))[-1] * PERIOD
    assert 0.5 + STALE_S < moving < 1.5


def test_arm_bridges_short_gaps_of_its_stream() -> None:
    """Ten of every twenty set-points are lost; the joints stay within 0.01 rad of the motion."""
    world = world_with("ur5")
    controller = JointController(world, "arm1", PERIOD, Reservations())
    motion = swing(controller, world)
    controller.stream(stream_of(motion, lambda time: round(time / PERIOD) % 20 < 10))
    sent = run(world, [controller], motion.duration + 0.2)
    assert controller.fault is None
    expected = np.array([motion.at(i * PERIOD - PERIOD)[0] for i in range(len(sent))])
    assert np.abs(sent.q - expected).max() < 0.01
    assert use_of_limits(sent, world.robots["arm1"].limits).within


def test_servo_slows_down_and_stops_before_another_arm() -> None:
    """Its target is inside the other arm."""
    arms = {"arm1": arm("ur5", posture="present"), "arm2": arm("panda", (1.1, 0.1, 0.36), 180.0)}
    world = World(file_of(arms))
    reservations = Reservations()
    controllers = [JointController(world, name, PERIOD, reservations) for name in arms]
    kinematics = Kinematics(world.robots["arm1"], world.arms["arm1"].base)
    still = np.zeros(2)
    servo = PlanarServo(
        kinematics,
        world.robots["arm1"].limits,
        PERIOD,
        controllers[0].setpoint,
        np.array(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))),
        lambda *_: PlaneTarget(np.array((0.3, 0.0)), still, still),
        30.0,
    )
    controllers[0].stream(servo)
    separation = ArmDistance(world, "arm1")
    nearest = float("inf")
    scales = []
    for _ in range(50):
        run(world, controllers, 0.05)
        nearest = min(nearest, separation.gap({}).meters)
        scales.append(servo.time_scale)
    assert min(scales) == 0.3
    assert int(str(controllers[0].guard["slowed"])) > 0
    assert CLEAR_M - 0.002 < nearest < CLEAR_M + 0.03
    assert isinstance(controllers[0].fault, Failure)
    assert controllers[0].fault.code == "IN_COLLISION"
    assert controllers[0].at_rest


def test_stream_is_aborted_on_contact() -> None:
    """The upper arm runs into a wall; the arm yields, and the failure names the wall."""
    wall = box((0.25, 0.45, 0.9), 0.4, fixed=True)
    world = World(file_of({"arm1": arm("ur5")}, {"wall": wall}))
    controller = JointController(world, "arm1", PERIOD, Reservations())
    start = controller.setpoint.q
    goal = start + np.array([1.0, 0, 0, 0, 0, 0])
    motion = point_to_point(start, goal, world.robots["arm1"].limits.scaled(0.3), PERIOD)
    controller.stream(stream_of(motion, lambda _: True))
    run(world, [controller], 3.0)
    assert isinstance(controller.fault, Failure)
    assert controller.fault.code == "IN_COLLISION"
    assert controller.fault.numbers["second"] == "wall"
    assert controller.at_rest
    push = np.abs(world.data.ctrl[world.arms["arm1"].actuator_ids][0])
    assert push < 0.1 * world.robots["arm1"].limits.effort[0]
