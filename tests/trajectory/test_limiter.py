"""The set-point limiter: for any input, its output respects the limits."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bt_dualarm.core.pose import Vector
from bt_dualarm.robots.robot import JointLimits
from bt_dualarm.robots.robot_description import load_robot
from bt_dualarm.trajectory.path_timing import point_to_point, time_path
from bt_dualarm.trajectory.set_points import SetPoint, SetPointLimiter
from bt_dualarm.trajectory.trajectory import Trajectory, use_of_limits

PERIOD = 0.002  # s
SLACK = 1e-6  # fraction by which rounding may exceed a limit, or rad
LIMITS = {name: load_robot(name).limits for name in ("ur5", "panda")}
ROBOTS = pytest.mark.parametrize("robot", LIMITS)
SEEDS = st.integers(0, 2**32 - 1)
thorough = settings(
    max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


def at_rest(q: Vector) -> SetPoint:
    return SetPoint(q, np.zeros_like(q), np.zeros_like(q))


def sent_for(limiter: SetPointLimiter, stream: Iterable[SetPoint]) -> Trajectory:
    """Output of the limiter for a stream."""
    sent = [limiter.sent, *(limiter.send(point) for point in stream)]
    q, v, a = (np.array([getattr(point, name) for point in sent]) for name in ("q", "v", "a"))
    return Trajectory(PERIOD, q, v, a)


def assert_within_limits(motion: Trajectory, limits: JointLimits) -> None:
    """Check velocity, acceleration (given and as difference), jerk, position, and consistency."""
    use = use_of_limits(motion, limits)
    assert max(use.velocity, use.acceleration, use.jerk) <= 1 + SLACK
    assert use.position_margin >= -SLACK
    drift = np.diff(motion.q, axis=0) - 0.5 * PERIOD * (motion.v[1:] + motion.v[:-1])
    assert (np.abs(drift) <= limits.acceleration * PERIOD**2).all()


def sine(
    rng: np.random.Generator, limits: JointLimits, fraction: float, length: int
) -> list[SetPoint]:
    """A conforming stream around the middle that uses at most ``fraction`` of every limit."""
    dof = len(limits.lower)
    span = np.minimum(limits.upper - limits.lower, 4.0)
    middle = 0.5 * (limits.lower + limits.upper) + rng.uniform(-0.1, 0.1, dof) * span
    w = rng.uniform(1.0, 8.0, dof)
    rates = limits.velocity / w, limits.acceleration / w**2, limits.jerk / w**3, 0.3 * span
    size = fraction * np.minimum.reduce(rates)
    phase = w * PERIOD * np.arange(length)[:, None] + rng.uniform(0.0, 6.28, dof)
    rows = middle + size * np.sin(phase), size * w * np.cos(phase), -size * w**2 * np.sin(phase)
    return [SetPoint(*row) for row in zip(*rows, strict=True)]


def wild(rng: np.random.Generator, limits: JointLimits, length: int) -> list[SetPoint]:
    """Anything: noise, jumps, NaN, values beyond the limits, wrong derivatives."""
    dof = len(limits.lower)
    stream = [*sine(rng, limits, 1.5, length)]
    for start in range(0, length, 25):
        kind = rng.integers(6)
        for i in range(start, min(start + 25, length)):
            point = stream[i]
            if kind == 1:
                point = at_rest(rng.uniform(1.5 * limits.lower, 1.5 * limits.upper))
            elif kind == 2:
                point = SetPoint(point.q, rng.normal(0, 9, dof), rng.normal(0, 99, dof))
            elif kind == 3:
                hole = rng.choice([np.nan, np.inf, -np.inf], dof)
                point = SetPoint(np.where(rng.random(dof) < 0.5, hole, point.q), point.v, point.a)
            elif kind == 4:
                point = SetPoint(stream[start].q, 3 * limits.velocity, -3 * limits.acceleration)
            elif kind == 5:
                point = at_rest(rng.choice([limits.lower, limits.upper]))
            stream[i] = point
    return stream


@ROBOTS
@given(seed=SEEDS)
@thorough
def test_output_respects_the_limits_for_any_input(robot: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    limits = LIMITS[robot]
    start = rng.uniform(limits.lower, limits.upper)
    limiter = SetPointLimiter(limits, PERIOD, start)
    assert_within_limits(sent_for(limiter, wild(rng, limits, 200)), limits)
    assert limiter.clipped > 0


@ROBOTS
@given(seed=SEEDS)
@thorough
def test_limiter_reaches_a_constant_reference_after_a_jump(robot: str, seed: int) -> None:
    """The reference is reached and kept, without overshoot or limit cycle."""
    rng = np.random.default_rng(seed)
    limits = LIMITS[robot]
    start, goal = 0.3 * rng.uniform(limits.lower, limits.upper, (2, len(limits.lower)))
    start, goal = (np.clip(q, limits.lower, limits.upper) for q in (start, goal))
    limiter = SetPointLimiter(limits, PERIOD, start)
    expected = point_to_point(start, goal, limits, PERIOD)
    motion = sent_for(limiter, [at_rest(goal)] * (len(expected) + 2))
    assert_within_limits(motion, limits)
    assert motion.q[-1] == pytest.approx(goal, abs=1e-9)
    assert motion.v[-1] == pytest.approx(0.0, abs=1e-9)
    past = np.sign(goal - start) * (motion.q - goal)
    assert past.max() < 1e-6
    clipped = limiter.clipped
    sent_for(limiter, [at_rest(goal)] * 20)
    assert limiter.clipped == clipped


@ROBOTS
@given(seed=SEEDS)
@thorough
def test_limiter_joins_a_moving_stream_after_a_jump(robot: str, seed: int) -> None:
    """Once it has caught up, it passes the stream unchanged, and counts no clipping."""
    rng = np.random.default_rng(seed)
    limits = LIMITS[robot]
    stream = sine(rng, limits, 0.5, 1000)
    start = np.clip(stream[0].q + rng.uniform(-0.3, 0.3), limits.lower, limits.upper)
    limiter = SetPointLimiter(limits, PERIOD, start)
    sent_for(limiter, stream[:800])
    clipped = limiter.clipped
    rest = sent_for(limiter, stream[800:])
    assert limiter.clipped == clipped
    assert (rest.q[1:] == [point.q for point in stream[800:]]).all()


@ROBOTS
@given(seed=SEEDS)
@thorough
def test_conforming_motion_passes_unchanged(robot: str, seed: int) -> None:
    """Point to point over the whole range, as fast as allowed, with ends at the limits."""
    rng = np.random.default_rng(seed)
    limits = LIMITS[robot]
    start, goal = rng.uniform(limits.lower, limits.upper, (2, len(limits.lower)))
    at_limit = rng.random(len(goal)) < 0.5
    goal = np.where(at_limit, rng.choice([limits.lower, limits.upper]), goal)
    motion = point_to_point(start, goal, limits, PERIOD)
    limiter = SetPointLimiter(limits, PERIOD, start)
    sent = sent_for(
        limiter, (SetPoint(*rows) for rows in zip(motion.q, motion.v, motion.a, strict=True))
    )
    assert limiter.clipped == 0
    assert (sent.q[1:] == motion.q).all()


@ROBOTS
def test_timed_path_passes_unchanged(robot: str) -> None:
    limits = LIMITS[robot]
    middle = 0.5 * (limits.lower + limits.upper)
    angle = np.linspace(0.0, 2 * np.pi, 60)[:, None]
    shape = np.sin(angle * np.arange(1, 1 + len(middle)) / 2)
    motion = time_path(middle + 0.3 * shape, limits, PERIOD)
    limiter = SetPointLimiter(limits, PERIOD, motion.q[0])
    sent_for(limiter, (SetPoint(*rows) for rows in zip(motion.q, motion.v, motion.a, strict=True)))
    assert limiter.clipped == 0


@ROBOTS
def test_other_joints_are_not_disturbed_by_invalid_values(robot: str) -> None:
    limits = LIMITS[robot]
    rng = np.random.default_rng(1)
    stream = sine(rng, limits, 0.5, 100)
    start = stream[0]
    limiter = SetPointLimiter(limits, PERIOD, start.q)
    limiter.sent = start
    corrupted = []
    for point in stream[1:]:
        q = point.q.copy()
        q[2] = np.nan
        corrupted.append(SetPoint(q, point.v, point.a))
    sent = sent_for(limiter, corrupted)
    others = [j for j in range(len(limits.lower)) if j != 2]
    assert (sent.q[:, others] == np.array([point.q for point in stream])[:, others]).all()
    assert limiter.clipped == 99


def test_reference_beyond_a_limit_leads_to_the_limit() -> None:
    limits = LIMITS["panda"]
    start = 0.5 * (limits.lower + limits.upper)
    limiter = SetPointLimiter(limits, PERIOD, start)
    motion = sent_for(limiter, [at_rest(limits.upper + 1.0)] * 1200)
    assert motion.q[-1] == pytest.approx(limits.upper, abs=1e-9)
    assert limiter.clipped == 1200


def test_stream_that_cannot_stop_in_time_is_braked() -> None:
    """At full speed toward a limit, each set-point is valid, but no valid one could follow."""
    limits = LIMITS["ur5"]
    start = np.zeros(6)
    ramp = point_to_point(start, np.array([6.0, 0, 0, 0, 0, 0]), limits, PERIOD)
    fast = int(np.argmax(ramp.v[:, 0]))
    speed = ramp.v[fast]
    from_here = ramp.q[fast]
    onward = (SetPoint(from_here + speed * i * PERIOD, speed, start) for i in range(1, 2500))
    limiter = SetPointLimiter(limits, PERIOD, start)
    limiter.sent = SetPoint(from_here, speed, start)
    motion = sent_for(limiter, onward)
    assert_within_limits(motion, limits)
    assert motion.q[-1][0] == pytest.approx(limits.upper[0], abs=1e-6)


@ROBOTS
@given(seed=SEEDS)
@thorough
def test_joint_held_beyond_its_limit_comes_to_rest_exactly(robot: str, seed: int) -> None:
    """With a velocity of 1e-18 rad/s, left by rounding, an arm counted as moving forever."""
    rng = np.random.default_rng(seed)
    limits = LIMITS[robot]
    start = rng.uniform(limits.lower, limits.upper)
    goal = rng.choice([limits.lower, limits.upper])
    limiter = SetPointLimiter(limits, PERIOD, start)
    count = len(point_to_point(start, goal, limits, PERIOD)) + 20
    sent = sent_for(limiter, [at_rest(goal + 1e-4 * np.sign(goal - start))] * count)
    assert sent.q[-1] == pytest.approx(goal, abs=1e-9)
    assert not sent.v[-1].any()
    assert not sent.a[-1].any()
