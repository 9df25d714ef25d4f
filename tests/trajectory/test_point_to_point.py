from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.robots.robot import JointLimits
from bt_dualarm.robots.robot_description import load_robot
from bt_dualarm.trajectory.cubic_spline import cubic_spline
from bt_dualarm.trajectory.path_timing import (
    Profile,
    TimeOptimal,
    point_to_point,
    spline_through,
    stop,
    time_path,
    timed_path,
)
from bt_dualarm.trajectory.trajectory import Trajectory, use_of_limits

DT = 0.002
LIMITS = {name: load_robot(name).limits for name in ("ur5", "panda")}

arms = st.sampled_from(sorted(LIMITS))
speeds = st.floats(0.05, 1.0)
seeds = st.integers(0, 10_000)


def assert_at_rest(motion: Trajectory) -> None:
    for row in (0, -1):
        np.testing.assert_array_equal(motion.v[row], 0.0)
        np.testing.assert_array_equal(motion.a[row], 0.0)


def smooth_path(limits: JointLimits, seed: int, size: float, harmonics: int = 2) -> Matrix:
    """A random closed curve around the middle of the limits; ``size`` in rad, at most 0.3."""
    rng = np.random.default_rng(seed)
    middle = (limits.lower + limits.upper) / 2
    angle = np.linspace(0.0, 2.0 * np.pi, 120)[:, None]
    path: Matrix = np.tile(middle, (120, 1))
    for n in range(1, harmonics + 1):
        shift = rng.uniform(0.0, 2.0 * np.pi, len(middle))
        path += size / n**2 * rng.uniform(-1.0, 1.0, len(middle)) * np.sin(n * angle + shift)
    return path


@given(arms, seeds, speeds, st.floats(1e-4, 0.3))
@settings(max_examples=25, deadline=None)
def test_timed_path_respects_the_limits(arm: str, seed: int, speed: float, size: float) -> None:
    limits = LIMITS[arm].scaled(speed)
    path = smooth_path(LIMITS[arm], seed, size)
    motion = time_path(path, limits, DT, closed=True)
    assert use_of_limits(motion, limits).within
    assert_at_rest(motion)
    np.testing.assert_allclose(motion.q[[0, -1]], path[[0, 0]], atol=1e-12)


@given(arms, seeds, speeds)
@settings(max_examples=8, deadline=None)
def test_timing_does_not_leave_the_path(arm: str, seed: int, speed: float) -> None:
    """Every set-point lies on the curve at any speed."""
    path = smooth_path(LIMITS[arm], seed, 0.3)
    motion = time_path(path, LIMITS[arm].scaled(speed), DT, closed=True)
    fraction = np.linspace(0.0, 1.0, len(path))
    path[-1] = path[0]
    dense = cubic_spline(fraction, path, closed=True)(np.linspace(0.0, 1.0, 20_001))
    distance, _ = cKDTree(dense).query(motion.q[::10])
    assert (
        distance.max() < 1e-3
    )  # due to the spacing of the dense curve and the position of the knots


def test_timed_path_is_little_longer_than_the_bound_without_jerk_limits() -> None:
    limits = LIMITS["ur5"]
    path = smooth_path(limits, 4, 0.2, harmonics=1)
    fraction = np.linspace(0.0, 1.0, len(path))
    shortest = TimeOptimal(cubic_spline(fraction, path), limits).fastest.duration
    motion = time_path(path, limits, DT, closed=True)
    assert shortest < motion.duration < 1.25 * shortest


def test_bound_is_returned_with_the_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    """No TOPP-RA problem is solved twice."""
    limits = LIMITS["ur5"]
    solved = list[Vector]()
    solve = TimeOptimal.profile

    def recorded(optimal: TimeOptimal, fraction: Vector) -> Profile:
        solved.append(fraction.copy())
        return solve(optimal, fraction)

    path = smooth_path(limits, 4, 0.2)
    shortest = TimeOptimal(spline_through(path, limits, closed=False), limits).fastest.duration
    monkeypatch.setattr(TimeOptimal, "profile", recorded)
    motion, bound = timed_path(path, limits, DT)
    assert bound == shortest < motion.duration
    assert len({fraction.tobytes() for fraction in solved}) == len(solved) > 1


def test_half_the_speed_takes_longer() -> None:
    path = smooth_path(LIMITS["ur5"], 1, 0.2)
    fast = time_path(path, LIMITS["ur5"], DT)
    slow = time_path(path, LIMITS["ur5"].scaled(0.5), DT)
    assert slow.duration > 1.2 * fast.duration


def test_repeated_samples_change_nothing() -> None:
    path = smooth_path(LIMITS["ur5"], 2, 0.2)
    twice = np.repeat(path, 2, axis=0)
    np.testing.assert_array_equal(
        time_path(twice, LIMITS["ur5"], DT).q, time_path(path, LIMITS["ur5"], DT).q
    )


@pytest.mark.parametrize("count", [1, 2, 50])
def test_path_of_zero_length_is_one_set_point(count: int) -> None:
    motion = time_path(np.full((count, 6), 0.3), LIMITS["ur5"], DT)
    assert len(motion) == 1
    np.testing.assert_array_equal(motion.q[0], 0.3)


def test_arm_stops_where_a_path_reverses() -> None:
    """A line there and back takes twice as long as the line."""
    one_way = np.linspace(np.zeros(6), np.full(6, 0.5), 40)
    once = time_path(one_way, LIMITS["ur5"], DT)
    both = time_path(np.vstack((one_way, one_way[::-1])), LIMITS["ur5"], DT)
    assert both.duration == pytest.approx(2 * once.duration)
    assert use_of_limits(both, LIMITS["ur5"]).within
    np.testing.assert_allclose(both.q.max(axis=0), 0.5)


def test_sharp_bend_slows_the_arm_only_locally() -> None:
    """An ellipse ten times as long as wide takes little longer than a line there and back."""
    angle = np.linspace(0.0, 2.0 * np.pi, 400)[:, None]
    along, across = np.eye(6)[:2]
    ellipse = 0.5 * np.cos(angle) * along + 0.05 * np.sin(angle) * across
    there_and_back = 2 * point_to_point(-0.5 * along, 0.5 * along, LIMITS["ur5"], DT).duration
    motion = time_path(ellipse, LIMITS["ur5"], DT, closed=True)
    assert use_of_limits(motion, LIMITS["ur5"]).within
    assert motion.duration < 1.2 * there_and_back


@pytest.mark.parametrize("length", [1e-8, 1e-6, 1e-3, 1.0])
@pytest.mark.parametrize("count", [2, 3, 10])
def test_short_and_sparse_paths_are_timed(length: float, count: int) -> None:
    path = np.linspace(np.zeros(6), np.full(6, length), count)
    motion = time_path(path, LIMITS["ur5"], DT)
    assert use_of_limits(motion, LIMITS["ur5"]).within
    np.testing.assert_allclose(motion.q[-1], path[-1], atol=1e-12)


def test_straight_path_takes_little_longer_than_point_to_point() -> None:
    path = np.linspace(np.zeros(6), np.full(6, 1.0), 50)
    shortest = point_to_point(path[0], path[-1], LIMITS["ur5"], DT).duration
    assert time_path(path, LIMITS["ur5"], DT).duration < 1.1 * shortest


@pytest.mark.parametrize("value", [np.nan, 7.0])
def test_path_with_invalid_configurations_is_refused(value: float) -> None:
    path = np.zeros((5, 6))
    path[3, 2] = value
    with pytest.raises(ValueError, match="path"):
        time_path(path, LIMITS["ur5"], DT)


def configurations(limits: JointLimits, seed: int) -> tuple[Vector, Vector]:
    rng = np.random.default_rng(seed)
    first, second = rng.uniform(limits.lower, limits.upper, (2, len(limits.lower)))
    return first, second


@given(arms, seeds, speeds)
@settings(max_examples=40, deadline=None)
def test_point_to_point_stays_on_the_line_and_within_limits(
    arm: str, seed: int, speed: float
) -> None:
    limits = LIMITS[arm].scaled(speed)
    start, goal = configurations(limits, seed)
    whole = point_to_point(start, goal, limits, DT)
    motion = whole.piece(0, len(whole))
    direction = (goal - start) / np.linalg.norm(goal - start)
    moved = motion.q - start
    assert np.abs(moved - np.outer(moved @ direction, direction)).max() < 1e-12
    assert use_of_limits(motion, limits).within
    assert_at_rest(motion)
    np.testing.assert_array_equal(motion.q[-1], goal)


def test_point_to_point_has_the_given_duration() -> None:
    start, goal = configurations(LIMITS["ur5"], 0)
    assert point_to_point(start, goal, LIMITS["ur5"], DT, 20.0).duration == pytest.approx(20.0)


def test_point_to_point_to_the_start_does_not_move() -> None:
    start, _ = configurations(LIMITS["ur5"], 0)
    assert len(point_to_point(start, start, LIMITS["ur5"], DT)) == 1


@pytest.mark.parametrize("value", [np.nan, 100.0])
def test_goal_outside_the_limits_is_refused(value: float) -> None:
    with pytest.raises(ValueError, match="goal"):
        point_to_point(np.zeros(6), np.full(6, value), LIMITS["ur5"], DT)


@given(arms, seeds, speeds, st.floats(0.0, 1.0))
@settings(max_examples=40, deadline=None)
def test_stop_at_any_time_of_a_motion_respects_the_limits(
    arm: str, seed: int, speed: float, fraction: float
) -> None:
    limits = LIMITS[arm].scaled(speed)
    motion = point_to_point(*configurations(limits, seed), limits, DT)
    q, v, a = motion.at(fraction * motion.duration)
    braking = stop(q, v, a, limits, DT)
    use = use_of_limits(braking, limits)
    assert max(use.velocity, use.acceleration, use.jerk) <= 1.0 + 1e-9
    np.testing.assert_allclose(braking.q[0], q)
    np.testing.assert_allclose(braking.v[0], v, atol=1e-12)
    np.testing.assert_array_equal(braking.v[-1], 0.0)
    np.testing.assert_array_equal(braking.a[-1], 0.0)


def test_stop_at_rest_is_one_set_point() -> None:
    rest = np.zeros(6)
    assert len(stop(np.ones(6), rest, rest, LIMITS["ur5"], DT)) == 1


def test_stop_with_a_state_of_another_arm_is_refused() -> None:
    with pytest.raises(ValueError, match="6 finite numbers"):
        stop(np.zeros(7), np.zeros(7), np.zeros(7), LIMITS["ur5"], DT)


def test_error_of_ruckig_is_a_failure_with_its_message() -> None:
    """Ruckig's own exception would look like a bug of the skill."""
    still = replace(LIMITS["ur5"], jerk=np.zeros(6))
    start, goal = configurations(LIMITS["ur5"], 0)
    with pytest.raises(Failure, match=r"NO_PLAN: Ruckig finds no motion.*jerk"):
        point_to_point(start, goal, still, DT)
    with pytest.raises(Failure, match=r"NO_PLAN: Ruckig finds no motion.*jerk"):
        stop(start, np.ones(6), np.zeros(6), still, DT)
