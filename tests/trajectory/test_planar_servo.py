"""The servo follows a target in a plane, holds the other axes, and respects the arm's limits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import product
from typing import TypeAlias

import numpy as np
import pytest

from bt_dualarm.control.planar_servo import (
    PlanarServo,
    PlaneTarget,
    plane_limits,
    stopping_positions,
)
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.robots.robot_description import load_robot
from bt_dualarm.trajectory.set_points import SetPoint, SetPointLimiter
from bt_dualarm.trajectory.trajectory import Trajectory, use_of_limits
from tests.families import some
from tests.sim.worlds import WIDE

PERIOD = 0.002  # s
MM = 1e-3
YZ = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
BANDWIDTH = 30.0  # rad/s: that of a camera at 30 Hz
POSTURES = {
    # Away from limits and singularities, with 0.1 m of room in every direction of the plane.
    "ur5": np.array([0.0015, -0.9451, 1.5663, 2.5204, -1.5723, 3.1416]),
    "panda": np.array([0.0, -0.156, 0.0, -2.198, 0.0, 2.042, 0.785]),
}
ROBOTS = pytest.mark.parametrize("robot", POSTURES)

TargetOf: TypeAlias = Callable[[float], PlaneTarget | None]


@dataclass
class Follower:
    """A servo with the set-point limiter, without a world: the arm is at its set-points."""

    robot: str
    speed: float = 1.0
    axes: Matrix = field(default_factory=lambda: YZ)

    def __post_init__(self) -> None:
        robot = load_robot(self.robot)
        self.kinematics = Kinematics(robot, Pose.identity())
        self.limits = robot.limits.scaled(self.speed)
        self.start = POSTURES.get(self.robot, robot.postures["home"])
        self.origin = self.kinematics.matrix(self.start)

    def follow(
        self, position: TargetOf, seconds: float, bandwidth: float = BANDWIDTH
    ) -> Trajectory:
        """Sent set-points; ``gate`` counts the clipped ones."""
        still = np.zeros_like(self.start)
        start = SetPoint(self.start, still, still)

        def target(time: float, _: Vector) -> PlaneTarget | None:
            return position(time)

        servo = PlanarServo(
            self.kinematics, self.limits, PERIOD, start, self.axes, target, bandwidth
        )
        self.gate = SetPointLimiter(self.limits, PERIOD, self.start)
        sent = [self.gate.send(servo(i * PERIOD)) for i in range(round(seconds / PERIOD))]
        q, v, a = (np.array([getattr(point, name) for point in sent]) for name in ("q", "v", "a"))
        return Trajectory(PERIOD, q, v, a)

    def poses(self, motion: Trajectory) -> Matrix:
        """Poses of the tool, of shape (n, 4, 4)."""
        return np.array([self.kinematics.matrix(q) for q in motion.q])

    def displacement(self, motion: Trajectory) -> Matrix:
        """Displacements of the tool from its start, of shape (n, 3)."""
        moved: Matrix = self.poses(motion)[:, :3, 3] - self.origin[:3, 3]
        return moved

    def assert_held(
        self, motion: Trajectory, distance: float = 1.0 * MM, angle: float = 2e-3
    ) -> None:
        """Check that the position along the normal and the orientation are constant."""
        poses = self.poses(motion)
        normal = np.cross(*self.axes)
        assert np.abs((poses[:, :3, 3] - self.origin[:3, 3]) @ normal).max() < distance
        turns = poses[:, :3, :3] @ self.origin[:3, :3].T
        cosines = 0.5 * (np.trace(turns, axis1=1, axis2=2) - 1)
        assert np.arccos(np.clip(cosines, -1, 1)).max() < angle

    def assert_within_limits(self, motion: Trajectory) -> None:
        """Check that the limits are respected without clipping."""
        use = use_of_limits(motion, self.limits)
        assert max(use.velocity, use.acceleration, use.jerk) < 1 + 2e-6
        assert use.position_margin > 0
        assert self.gate.clipped == 0


def circle(radius: float, period: float) -> Callable[[float], PlaneTarget]:
    """A target that circles around the start, at full speed from the beginning."""
    w = 2 * np.pi / period

    def at(time: float) -> PlaneTarget:
        position = radius * np.array([np.cos(w * time), np.sin(w * time)])
        turned = np.array([-position[1], position[0]])
        return PlaneTarget(position, w * turned, -w * w * position)

    return at


def at_rest(position: Vector) -> PlaneTarget:
    return PlaneTarget(position, np.zeros(2), np.zeros(2))


@ROBOTS
def test_servo_follows_a_circle(robot: str) -> None:
    """Radius 0.1 m, one turn in 4 s: once it has caught up, the error is below 0.1 mm."""
    follower = Follower(robot)
    target = circle(0.1, 4.0)
    motion = follower.follow(target, 6.0)
    expected = np.array([target(i * PERIOD).position for i in range(len(motion))])
    error = np.linalg.norm(follower.displacement(motion)[:, 1:] - expected, axis=1)
    assert error[round(2.0 / PERIOD) :].max() < 0.1 * MM
    follower.assert_held(motion)
    follower.assert_within_limits(motion)


def test_servo_does_not_overspeed_with_little_spare_acceleration() -> None:
    """Legs of a polygon, from rest to rest, that need the full acceleration and are known late.

    An arm that hurries to reduce its lag is too fast at the corners: 9.5 mm of error.
    """
    age = 0.07
    follower = Follower("ur5")
    limit = plane_limits(follower.kinematics, follower.limits, follower.start, YZ).acceleration
    corners = 0.09 * np.array(((0.0, 0), (1, 1), (-1, 1), (1, -1), (-1, -1), (0, 0)))
    lengths = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    durations = np.sqrt(10.0 / np.sqrt(3.0) * lengths / limit)
    begins = 0.3 + np.append(0.0, np.cumsum(durations))

    def position_at(time: float) -> Vector:
        leg = int(np.clip(np.searchsorted(begins, time) - 1, 0, len(lengths) - 1))
        done = np.clip((time - begins[leg]) / durations[leg], 0.0, 1.0)
        progress = done**3 * (10.0 - 15.0 * done + 6.0 * done**2)
        position: Vector = (1.0 - progress) * corners[leg] + progress * corners[leg + 1]
        return position

    def known(time: float) -> PlaneTarget:
        before, at, after = (position_at(time - age + step * PERIOD) for step in (-1, 0, 1))
        velocity = (after - before) / (2.0 * PERIOD)
        acceleration = (after - 2.0 * at + before) / PERIOD**2
        position = at + age * velocity + 0.5 * age**2 * acceleration
        return PlaneTarget(position, velocity + age * acceleration, acceleration)

    motion = follower.follow(known, float(begins[-1]) + 0.5, 100.0)
    expected = np.array([position_at(i * PERIOD) for i in range(len(motion))])
    error = np.linalg.norm(follower.displacement(motion)[:, 1:] - expected, axis=1)
    assert np.sqrt(np.mean(error**2)) < 8.8 * MM
    follower.assert_within_limits(motion)


@ROBOTS
def test_servo_follows_a_helix_in_space(robot: str) -> None:
    """Along three axes, rotated relative to the world's, with constant orientation."""
    axes = Pose.from_rpy((0.0, 0.0, 0.0), (0.3, -0.4, 0.5)).rotation_matrix
    w = 2 * np.pi / 4.0
    sizes = np.array((0.05, 0.05, 0.03))
    phases = np.array((0.0, 0.5 * np.pi, 0.2))

    def target(time: float) -> PlaneTarget:
        angle = w * time + phases
        position = sizes * (np.sin(angle) - np.sin(phases))
        return PlaneTarget(position, w * sizes * np.cos(angle), -w * w * sizes * np.sin(angle))

    follower = Follower(robot, axes=axes)
    motion = follower.follow(target, 6.0)
    expected = np.array([target(i * PERIOD).position for i in range(len(motion))])
    error = np.linalg.norm(follower.displacement(motion) @ axes.T - expected, axis=1)
    assert error[round(2.0 / PERIOD) :].max() < 0.1 * MM
    turns = follower.poses(motion)[:, :3, :3] @ follower.origin[:3, :3].T
    assert np.trace(turns, axis1=1, axis2=2).min() > 3.0 - 1e-6
    follower.assert_within_limits(motion)


@ROBOTS
@pytest.mark.parametrize("speed", [0.3, 1.0])
def test_servo_catches_up_without_overshoot(robot: str, speed: float) -> None:
    """A resting target 0.15 m away is approached fast, with less than 1 mm of overshoot."""
    follower = Follower(robot, speed)
    position = np.array([0.12, -0.09])
    motion = follower.follow(lambda _: at_rest(position), 4.0)
    moved = follower.displacement(motion)[:, 1:]
    assert np.linalg.norm(moved[-1] - position) < 0.1 * MM
    along = moved @ position / np.linalg.norm(position)
    assert along.max() < np.linalg.norm(position) + 1.0 * MM
    follower.assert_held(motion)
    follower.assert_within_limits(motion)


@ROBOTS
def test_servo_comes_to_rest_when_the_target_vanishes(robot: str) -> None:
    """Within a second, near its last position, with the other axes still held."""
    follower = Follower(robot)
    target = circle(0.1, 4.0)
    motion = follower.follow(lambda time: target(time) if time < 2.0 else None, 3.0)
    lost = round(2.0 / PERIOD)
    moved = follower.displacement(motion)
    assert np.linalg.norm(np.diff(moved[lost - 2 : lost], axis=0)) / PERIOD > 0.1  # it was moving
    assert np.linalg.norm(np.diff(moved[-2:], axis=0)) / PERIOD < 1e-4
    assert np.linalg.norm(moved[-1] - moved[lost]) < 0.05
    follower.assert_held(motion)
    follower.assert_within_limits(motion)


@ROBOTS
def test_servo_recovers_from_a_jump_of_the_target(robot: str) -> None:
    """A false detection 0.25 m away for half a second, and back."""
    follower = Follower(robot)
    near = at_rest(np.array([0.05, 0.05]))
    far = at_rest(np.array([-0.2, 0.1]))
    motion = follower.follow(lambda time: far if 1.0 < time < 1.5 else near, 4.0)
    moved = follower.displacement(motion)[-1, 1:]
    assert np.linalg.norm(moved - near.position) < 0.1 * MM
    follower.assert_held(motion)
    follower.assert_within_limits(motion)


@ROBOTS
def test_servo_fails_where_the_arm_cannot_hold_its_plane(robot: str) -> None:
    """At 2 m a stretched arm cannot hold its plane; the servo fails before it moves erratically."""
    follower = Follower(robot)
    with pytest.raises(Failure, match=r"out of its plane") as caught:
        follower.follow(lambda _: at_rest(np.array([0.0, 2.0])), 8.0)
    assert caught.value.code == "UNREACHABLE"
    assert follower.gate.clipped == 0


@ROBOTS
def test_noisy_target_does_not_violate_the_limits(robot: str) -> None:
    """Millimeters of noise in position, and noise of the order of the limits in the derivatives."""
    rng = np.random.default_rng(3)
    follower = Follower(robot)
    clean = circle(0.08, 3.0)

    def noisy(time: float) -> PlaneTarget:
        p, v, a = clean(time)
        return PlaneTarget(
            p + rng.normal(0, 0.003, 2), v + rng.normal(0, 0.2, 2), a + rng.normal(0, 5.0, 2)
        )

    motion = follower.follow(noisy, 3.0)
    follower.assert_within_limits(motion)
    follower.assert_held(motion, 3 * MM, 0.02)


@pytest.mark.parametrize(
    ("robot", "speed", "axes"),
    some(product(WIDE, [0.1, 0.3, 1.0], [YZ, np.eye(3)[:2], np.eye(3)[[0, 2]]]), 4),
)
def test_no_arm_oscillates_in_front_of_a_resting_target(
    robot: str, speed: float, axes: Matrix
) -> None:
    """10 mm away, with the noise of an estimate, at any scale of the limits.

    A law that ignored the jerk limit would oscillate permanently at low jerk.
    """
    rng = np.random.default_rng(5)
    follower = Follower(robot, speed, axes)
    position = np.array([0.008, -0.006])

    def seen(_: float) -> PlaneTarget:
        return PlaneTarget(
            position + rng.normal(0, 5e-5, 2), rng.normal(0, 1e-3, 2), rng.normal(0, 1e-2, 2)
        )

    motion = follower.follow(seen, 5.0, 200.0)
    error = follower.displacement(motion) @ axes.T - position
    assert np.abs(error[round(4.0 / PERIOD) :]).max() < 0.2 * MM
    assert (error @ position).max() / np.linalg.norm(position) < 0.3 * MM, "it must not overshoot"
    follower.assert_held(motion)
    follower.assert_within_limits(motion)


def test_redundant_arm_stays_near_its_posture() -> None:
    """Over ten circles the joints return each time: the elbow does not drift."""
    follower = Follower("panda")
    motion = follower.follow(circle(0.1, 2.0), 20.0)
    rounds = motion.q[:: round(2.0 / PERIOD)][1:]
    assert np.abs(np.diff(rounds[2:], axis=0)).max() < 1e-3


@ROBOTS
@pytest.mark.parametrize("angle", [0.0, 0.8, 2.3, 4.0])
@pytest.mark.parametrize("left_s", [0.05, 0.12, 0.25])
def test_stopping_path_is_predicted(robot: str, angle: float, left_s: float) -> None:
    """With maximal braking assumed, the arm came to rest 1.3 times as far away."""
    follower = Follower(robot)
    far = 0.12 * np.array([np.cos(angle), np.sin(angle)])
    motion = follower.follow(lambda time: at_rest(far) if time < left_s else None, 1.5)
    left = round(left_s / PERIOD) - 1
    then = SetPoint(motion.q[left], motion.v[left], motion.a[left])
    predicted = stopping_positions(follower.kinematics, follower.limits, YZ, then, 8)
    assert (predicted[0] == then.q).all()
    passed = follower.displacement(motion)[[left, -1]]
    ends = np.array([follower.kinematics.matrix(q)[:3, 3] for q in predicted[[0, -1]]])
    real, expected = (float(np.linalg.norm(one[1] - one[0])) for one in (passed, ends))
    assert 0.9 * real - 0.5 * MM < expected < 1.3 * real + 2 * MM
