"""A time-scaled motion keeps its path and the limits, and can be resumed."""

from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.core.pose import Matrix, Pose
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.planning.problem import trace
from bt_dualarm.robots.robot import Robot
from bt_dualarm.robots.robot_description import load_robot
from bt_dualarm.trajectory.path_timing import point_to_point
from bt_dualarm.trajectory.paths import circle
from bt_dualarm.trajectory.set_points import ScaledPiece, TrajectorySource, sampled_at
from bt_dualarm.trajectory.trajectory import Trajectory, use_of_limits

DT = 0.004
ROBOTS = ("ur5", "panda")


def circular(robot: Robot, speed: float) -> Trajectory:
    """A motion along a circle of 0.1 m."""
    arm = Kinematics(robot, Pose.identity())
    q = robot.postures["home"]
    axes = np.array((0.0, 1.0, 0.0)), np.array((0.0, 0.0, 1.0))
    path = circle(arm.forward(q), axes, 0.1, mode="from")
    return trace(arm, path, q, robot.limits.scaled(speed), DT).motion


def sent(motion: TrajectorySource, count: int) -> Trajectory:
    points = [motion.next(0.0) for _ in range(count)]
    q, v, a = (np.array([getattr(point, name) for point in points]) for name in ("q", "v", "a"))
    return Trajectory(DT, q, v, a)


def distance_to_path(path: Matrix, q: Matrix) -> float:
    """Largest distance of configurations q from the path's samples, of shape (n, dof), rad."""
    gaps = np.abs(q[:, None] - path[None]).max(axis=2)
    return float(gaps.min(axis=1).max())


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("fraction", [0.2, 0.5, 0.8])
def test_halt_stays_on_the_path(name: str, fraction: float) -> None:
    """At half speed, the limits allow braking on the path everywhere."""
    robot = load_robot(name)
    whole = circular(robot, 0.5)
    motion = TrajectorySource(whole)
    last = sent(motion, int(fraction * len(whole))).q[-1]
    halt = motion.halt(robot.limits)
    assert halt is not None
    assert np.abs(halt.q[0] - last).max() < 1e-9
    assert not halt.v[-1].any()
    assert use_of_limits(halt, robot.limits).within
    step = float(np.abs(np.diff(whole.q, axis=0)).max())
    assert distance_to_path(whole.q, halt.q) < 0.51 * step


@pytest.mark.parametrize("name", ROBOTS)
def test_motion_slows_down_stops_and_resumes(name: str) -> None:
    robot = load_robot(name)
    start = robot.postures["home"]
    whole = point_to_point(start, start + 0.5, robot.limits.scaled(0.5), DT)
    motion = TrajectorySource(whole)
    parts = [sent(motion, len(whole) // 3)]
    for scale in (0.0, 0.4, 1.0):
        assert motion.change_scale(scale, robot.limits)
        parts.append(sent(motion, 180))
        if scale == 0.0:
            assert not parts[-1].v[-1].any()
            assert not motion.done
    while not motion.done:
        parts.append(sent(motion, 1))
    q, v, a = (np.vstack([getattr(part, key) for part in parts]) for key in ("q", "v", "a"))
    assert use_of_limits(Trajectory(DT, q, v, a), robot.limits).within
    assert q[-1] == pytest.approx(whole.q[-1], abs=1e-6)
    assert motion.progress == 1.0
    moved = (q - start)[:, :1]
    assert np.abs((q - start) - moved).max() < 1e-9  # all joints stay on the straight line


@pytest.mark.parametrize("low", [0.0, 0.3])
@pytest.mark.parametrize("slowed", [5, 7, 9, 11])
@pytest.mark.parametrize("began", [1, 3, 8])
def test_motion_does_not_go_back_on_its_path(began: int, slowed: int, low: float) -> None:
    """Slowed soon after its start, and faster again before that is over, as the guard does it.

    The only change found let the time scale fall to -0.8 first: the arm went back, and beyond its
    start the run ended with a ValueError.
    """
    robot = load_robot("ur5")
    start = robot.postures["home"]
    motion = TrajectorySource(point_to_point(start, start + 0.3, robot.limits, DT))
    piece = 5
    points = [motion.next(0.0) for _ in range(1 + piece * began)]
    farthest = 0.0
    for scale in (*[low] * slowed, *[1.0] * 100):
        ahead = motion.to_rest_after(piece, scale, robot.limits)
        if ahead is not None:
            motion.take(ahead)
        for _ in range(piece):
            points.append(motion.next(0.0))
            farthest = max(farthest, motion.parameter.s)
            assert motion.parameter.s > farthest - 0.011
    assert motion.done
    q, v, a = (np.array([getattr(point, key) for point in points]) for key in ("q", "v", "a"))
    assert use_of_limits(Trajectory(DT, q, v, a), robot.limits).within


@pytest.mark.parametrize("name", ROBOTS)
def test_motion_resumes_wherever_it_was_stopped(name: str) -> None:
    """At full speed, most of the acceleration limits is in use all along the path.

    From some places a Panda cannot reach the full time scale: it stood still there for good.
    """
    robot = load_robot(name)
    whole = circular(robot, 1.0)
    piece = 5
    for stopped_s in np.arange(0.02, whole.duration, 0.04):
        motion = TrajectorySource(whole)
        still = np.array(((stopped_s, 0.0, 0.0),))
        motion.take(ScaledPiece(still, sampled_at(whole, still), 0.0))
        points = [motion.next(0.0)]
        for _ in range(len(whole)):
            ahead = motion.to_rest_after(piece, 1.0, robot.limits)
            if ahead is not None:
                motion.take(ahead)
            points += [motion.next(0.0) for _ in range(piece)]
            if motion.done:
                break
        assert motion.done, f"stopped at {stopped_s:.2f} s"
        q, v, a = (np.array([getattr(point, key) for point in points]) for key in ("q", "v", "a"))
        use = use_of_limits(Trajectory(DT, q, v, a), robot.limits)
        assert max(use.velocity, use.acceleration, use.jerk) < 1.0 + 1e-6  # rounding


def test_unscaled_motion_is_sent_as_planned() -> None:
    whole = circular(load_robot("ur5"), 1.0)
    motion = TrajectorySource(whole, along_path=True)
    motion.measure(np.zeros(3))
    assert np.array_equal(sent(motion, len(whole)).q, whole.q)
    assert motion.done
    assert [s for _, s in motion.take_measured()] == pytest.approx(np.arange(len(whole)) * DT)
