"""Overlapping motions: limits, ends, paths, and refusals."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from bt_dualarm.core.pose import Vector
from bt_dualarm.robots.robot import JointLimits
from bt_dualarm.robots.robot_description import load_robot
from bt_dualarm.trajectory.overlap import OverlappedMotion
from bt_dualarm.trajectory.path_timing import point_to_point
from bt_dualarm.trajectory.trajectory import Trajectory, use_of_limits

DT = 0.004
ON_PATH_RAD = 1e-5
"""Tolerance of a stretched motion, which is interpolated between set-points, rad."""

LIMITS = {name: load_robot(name).limits for name in ("ur5", "panda", "xarm7")}

arms = st.sampled_from(sorted(LIMITS))
seeds = st.integers(0, 10_000)
counts = st.integers(2, 4)


def motions_of(limits: JointLimits, seed: int, count: int) -> list[Trajectory]:
    """Motions from rest to rest in the middle of the range, each at its own speed."""
    rng = np.random.default_rng(seed)
    middle = (limits.lower + limits.upper) / 2
    ends = middle + rng.uniform(-0.5, 0.5, (count + 1, len(middle)))
    speeds = rng.uniform(0.1, 1.0, count)
    return [
        point_to_point(start, end, limits.scaled(float(speed)), DT)
        for (start, end), speed in zip(itertools.pairwise(ends), speeds, strict=True)
    ]


def overlap_all(
    motions: list[Trajectory], limits: JointLimits, longest_s: float
) -> tuple[OverlappedMotion, list[tuple[int, int]]]:
    """All motions in one, and the overlaps for which the last `then` requested permission."""
    whole = OverlappedMotion.of(motions[0])
    requested: list[tuple[int, int]] = []

    def is_allowed(_: Trajectory, first: int, last: int) -> bool:
        requested.append((first, last))
        return True

    for motion in motions[1:]:
        requested.clear()
        whole = whole.then(motion, limits, longest_s, is_allowed)
    return whole, requested


@given(arms, seeds, counts, st.floats(0.0, 2.0))
@settings(max_examples=25, deadline=None)
def test_overlapped_motion_respects_the_limits_and_is_not_longer(
    arm: str, seed: int, count: int, longest_s: float
) -> None:
    limits = LIMITS[arm]
    motions = motions_of(limits, seed, count)
    whole, _ = overlap_all(motions, limits, longest_s)
    assert use_of_limits(whole.motion, limits).within
    assert whole.motion.duration <= sum(one.duration for one in motions) + 1e-9
    np.testing.assert_allclose(whole.motion.q[0], motions[0].q[0], atol=1e-12)
    np.testing.assert_allclose(whole.motion.q[-1], motions[-1].q[-1], atol=1e-9)
    for row in (0, -1):
        np.testing.assert_allclose(whole.motion.v[row], 0.0, atol=1e-12)
        np.testing.assert_allclose(whole.motion.a[row], 0.0, atol=1e-9)


@given(arms, seeds, counts)
@settings(max_examples=15, deadline=None)
def test_ends_are_ordered_and_the_last_is_the_duration(arm: str, seed: int, count: int) -> None:
    whole, _ = overlap_all(motions_of(LIMITS[arm], seed, count), LIMITS[arm], 1.0)
    assert len(whole.ends_s) == count
    assert all(next_one >= one - 1e-9 for one, next_one in itertools.pairwise(whole.ends_s))
    assert whole.ends_s[-1] == pytest.approx(whole.motion.duration, abs=1e-9)


def distance_to_line(point: Vector, start: Vector, end: Vector) -> float:
    """Distance of a configuration from the segment between two others, rad."""
    step = end - start
    fraction = float(np.clip((point - start) @ step / (step @ step), 0.0, 1.0))
    return float(np.linalg.norm(point - start - fraction * step))


@given(arms, seeds)
@settings(max_examples=15, deadline=None)
def test_motion_leaves_its_paths_only_in_the_overlap(arm: str, seed: int) -> None:
    """Before and after the set-points that the caller checks, the joints are on the paths."""
    first, second = motions_of(LIMITS[arm], seed, 2)
    whole, requested = overlap_all([first, second], LIMITS[arm], 0.5 * second.duration)
    assume(requested)  # sometimes no overlap is shorter than the sequence
    begin, end = requested[-1]
    assert 0 <= begin < end < len(whole.motion)
    for q in whole.motion.q[: begin + 1]:
        assert distance_to_line(q, first.start, first.end) < ON_PATH_RAD
    for q in whole.motion.q[end:]:
        assert distance_to_line(q, second.start, second.end) < ON_PATH_RAD
    # Soon after its beginning the overlap still follows the first path.
    between = [distance_to_line(q, first.start, first.end) for q in whole.motion.q[begin:end]]
    assert end - begin <= 3 or max(between) > 1e-4


@given(arms, seeds)
@settings(max_examples=10, deadline=None)
def test_motions_are_sequential_without_permission(arm: str, seed: int) -> None:
    first, second = motions_of(LIMITS[arm], seed, 2)
    whole = OverlappedMotion.of(first).then(second, LIMITS[arm], 1.0, lambda *_: False)
    plain = first.then(second)
    np.testing.assert_array_equal(whole.motion.q, plain.q)
    assert whole.ends_s == (first.duration, first.duration + second.duration)


@given(arms, seeds)
@settings(max_examples=10, deadline=None)
def test_shorter_overlap_is_tried_if_the_best_is_refused(arm: str, seed: int) -> None:
    first, second = motions_of(LIMITS[arm], seed, 2)
    durations: list[float] = []

    def refused_twice(whole: Trajectory, *_: int) -> bool:
        durations.append(whole.duration)
        return len(durations) > 2

    whole = OverlappedMotion.of(first).then(second, LIMITS[arm], 1.0, refused_twice)
    assert len(durations) == 3
    assert durations[0] <= durations[1] <= durations[2] == whole.motion.duration
    assert whole.motion.duration < first.duration + second.duration


def test_at_most_two_motions_overlap() -> None:
    """A third motion does not start before the first has ended."""
    for seed in range(20):
        limits = LIMITS["ur5"]
        motions = motions_of(limits, seed, 3)
        two, _ = overlap_all(motions[:2], limits, 5.0)
        begun: list[int] = []

        def note(whole: Trajectory, first: int, _: int, begun: list[int] = begun) -> bool:
            begun.append(first)
            return True

        three = two.then(motions[2], limits, 5.0, note)
        if begun:
            assert begun[-1] * three.motion.dt >= three.ends_s[0] - 2.0 * three.motion.dt
