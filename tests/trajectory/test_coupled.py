"""Coupled motions: all arms start together, parameter one path parameter, and brake together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bt_dualarm.robots.robot import JointLimits
from bt_dualarm.trajectory.coupled import (
    Correction,
    CoupledMotion,
    CoupledSource,
    stacked_limits,
)
from bt_dualarm.trajectory.path_timing import time_path
from bt_dualarm.trajectory.set_points import TrajectorySource

DT = 0.004
PARTS = {"arm1": slice(0, 2), "arm2": slice(2, 5)}


def limits_of(dof: int) -> JointLimits:
    """Equal limits of `dof` joints."""
    full = np.full
    return JointLimits(
        full(dof, -3.0),
        full(dof, 3.0),
        full(dof, 2.0),
        full(dof, 5.0),
        full(dof, 60.0),
        full(dof, 50),
    )


def motion(correction: Correction | None = None) -> CoupledMotion:
    """A motion of two arms of two and three joints."""
    limits = stacked_limits({"arm1": limits_of(2), "arm2": limits_of(3)})
    rows = np.linspace(0.0, 1.0, 40)[:, None] * np.array((1.0, -0.5, 0.3, 0.8, -0.2))
    trajectory = time_path(rows, limits.scaled(0.85), DT)  # the rest is for corrections
    return CoupledMotion(trajectory, PARTS, limits, correction)


def play(coupled: CoupledMotion, halted_at: int | None = None) -> tuple[np.ndarray, int]:
    """Set-points of both arms, of shape (n, 5), and the number of steps."""
    sources: dict[str, TrajectorySource] = {arm: coupled.source(arm) for arm in PARTS}
    rows = []
    for step in range(3000):
        if step == halted_at:  # of arm2 only, as by its controller
            braking = sources["arm2"].halt(limits_of(3))
            assert braking is not None
            sources["arm2"] = TrajectorySource(braking)
            sources["arm2"].next(step * DT)
        if all(source.done for source in sources.values()):
            break
        rows.append(np.concatenate([source.next(step * DT).q for source in sources.values()]))
    return np.array(rows), step


def reserved(coupled: CoupledMotion, arm: str) -> CoupledSource:
    """Source of an arm, whose guard has reserved the first 30 set-points."""
    source = coupled.source(arm)
    ahead = source.to_rest_after(30, 1.0, coupled.limits)
    assert ahead is not None
    source.take(ahead)
    return source


def test_both_arms_follow_their_part_to_the_end() -> None:
    coupled = motion()
    rows, _ = play(coupled)
    np.testing.assert_array_equal(rows[0], coupled.trajectory.start)
    np.testing.assert_allclose(rows[1:], coupled.trajectory.q[: len(rows) - 1])
    assert coupled.is_at_rest
    assert coupled.reached == 1.0


@pytest.mark.parametrize("late", [0, 1, 5])
def test_no_arm_misses_a_set_point_at_the_start(late: int) -> None:
    """All arms are at the same row, whichever joins last, and in any order of calls."""
    for first, second in (("arm1", "arm2"), ("arm2", "arm1")):
        coupled = motion()
        sources = {arm: reserved(coupled, arm) for arm in PARTS}
        for step in range(late + 20):
            row = coupled.trajectory.q[max(step - late, 0)]
            for arm in (first, second) if step >= late else (first,):
                sent = sources[arm].next(step * DT).q
                np.testing.assert_array_equal(sent, row[PARTS[arm]])


def test_controllers_half_a_period_apart_start_at_the_same_row() -> None:
    coupled = motion()
    one, two = (reserved(coupled, arm) for arm in PARTS)
    for step in range(20):
        row = coupled.trajectory.q[max(step - 1, 0)]
        np.testing.assert_array_equal(one.next(step * DT).q, row[:2])
        row = coupled.trajectory.q[step]
        np.testing.assert_array_equal(two.next((step + 0.5) * DT).q, row[2:])


def test_no_arm_starts_alone() -> None:
    coupled = motion()
    first = coupled.source("arm1")
    for step in range(5):
        np.testing.assert_array_equal(first.next(step * DT).q, coupled.trajectory.start[:2])
    assert not coupled.has_begun
    coupled.source("arm2").next(5 * DT)
    assert coupled.has_begun


def test_halt_of_one_arm_brakes_all_on_the_path() -> None:
    coupled = motion()
    rows, steps = play(coupled, halted_at=60)
    assert steps < len(coupled.trajectory)
    assert 0.05 < rows[-1, 0] < 0.95
    # All joints parameter one path parameter at any time, even while braking.
    parameter = rows[:, :1]
    np.testing.assert_allclose(rows, parameter * np.array((1.0, -0.5, 0.3, 0.8, -0.2)), atol=2e-3)
    assert np.abs(np.diff(rows, 2, axis=0)).max() / DT**2 < 5.1


def test_braking_arms_stay_coupled_while_a_guard_reserves() -> None:
    """The halted arm follows a copy of the braking plan, so the others must follow it exactly."""
    coupled = motion()
    one: CoupledSource = coupled.source("arm1")
    two: TrajectorySource = coupled.source("arm2")
    for step in range(120):
        ahead = one.to_rest_after(10, 1.0, coupled.limits)
        if step == 60:
            braking = two.halt(limits_of(3))
            assert braking is not None
            two = TrajectorySource(braking)
            two.next(step * DT)
        if ahead is not None:
            one.take(ahead)
        sent = one.next(step * DT).q
        assert sent[0] == pytest.approx(two.next(step * DT).q[0] / 0.3, abs=1e-9)
    assert sent[0] > 0.0


def test_halt_before_all_arms_have_joined_moves_nothing() -> None:
    coupled = motion()
    first = coupled.source("arm1")
    first.next(0.0)
    coupled.source("arm2").halt(limits_of(3))
    coupled.source("arm2").next(DT)
    np.testing.assert_array_equal(first.next(2 * DT).q, coupled.trajectory.start[:2])
    assert first.done


def test_correction_is_added_to_all_arms() -> None:
    by = np.array((0.01, 0.0, 0.0, -0.02, 0.0))
    coupled = motion(lambda time: by if time < 1.0 else 0.0 * by)
    rows, _ = play(coupled)
    np.testing.assert_allclose(rows[-1], coupled.trajectory.end + by, atol=1e-4)


@pytest.mark.parametrize("braked_at", [None, 40, 100])
def test_noise_in_a_correction_breaks_no_limit(braked_at: int | None) -> None:
    """Encoders of a slow arm made it break its jerk limits in every third period."""
    noise = np.random.default_rng(0)
    coupled = motion(lambda _: noise.normal(0.0, 0.02, 5))
    sources = [coupled.source(arm) for arm in PARTS]
    rows = []
    for step in range(3000):
        if step == braked_at:
            coupled.brake()
        if all(source.done for source in sources):
            break
        sent = [source.next(step * DT) for source in sources]
        rows.append([np.concatenate(one) for one in zip(*sent, strict=True)])
    q, v, a = np.array(rows).swapaxes(0, 1)
    # The motion itself uses all of the jerk limit for moments; a correction always has 2 %.
    assert np.abs(np.diff(a, axis=0)).max() <= 1.02 * 60.0 * DT * (1.0 + 1e-9)
    assert np.abs(a).max() <= 5.0 * 1.02
    np.testing.assert_allclose(np.diff(q, axis=0), 0.5 * DT * (v[1:] + v[:-1]), atol=1e-4)
    assert coupled.is_at_rest


@pytest.mark.parametrize(("slowed_at", "curve"), [(76, 0.0), (80, 0.0), (140, 1.0), (144, 1.0)])
def test_correction_keeps_the_acceleration_between_set_points_of_a_slowed_motion(
    slowed_at: int, curve: float
) -> None:
    """Their velocities may differ by more than the accelerations at both: it was clipped."""
    limits = stacked_limits({"arm1": limits_of(2), "arm2": limits_of(3)})
    along = np.linspace(0.0, 1.0, 200)[:, None]
    rows = along * np.array((1.0, -0.5, 0.3, 0.8, -0.2))
    rows += curve * np.sin(2.0 * np.pi * along) * np.array((0.0, 0.4, -0.3, 0.1, 0.5))
    allowed = replace(limits.scaled(0.97), jerk=0.85 * limits.jerk)
    noise = np.random.default_rng(0)
    trajectory = time_path(rows, allowed, DT)
    coupled = CoupledMotion(trajectory, PARTS, limits, lambda _: noise.normal(0.0, 0.02, 5))
    sources = [coupled.source(arm) for arm in PARTS]
    velocities = []
    for step in range(400):
        if step == slowed_at:
            coupled.common.change_scale(0.4, coupled.limits)
        velocities.append(np.concatenate([source.next(step * DT).v for source in sources]))
    assert np.abs(np.diff(velocities, axis=0)).max() <= 5.0 * DT * (1.0 + 1e-6)


def test_correction_stops_before_a_position_limit() -> None:
    """It led a joint that the path brings near its limit to it: the limiter clipped 41 times."""
    plain = motion()
    limits = replace(plain.limits, upper=np.full(5, 1.02))
    coupled = CoupledMotion(plain.trajectory, PARTS, limits, lambda _: np.full(5, 0.05))
    rows, _ = play(coupled)
    assert rows[:, 0].max() < 1.02 - 0.005
    moved = rows[-1] - plain.trajectory.end
    assert moved[1] < moved[2]  # the whole arm with that joint stays, the other one goes on


@pytest.mark.parametrize(("needed", "seconds"), [(0, 0.0), (75, 75 * DT), (10_000, 1.0)])
def test_correction_continues_at_the_end_while_needed(needed: int, seconds: float) -> None:
    """It lasts for a second at most; then the motion ends at the corrected positions."""
    plain = motion()
    before = len(play(plain)[0])
    left = [needed]
    speed = np.full(5, 1e-3)

    def is_needed() -> bool:
        left[0] -= 1
        return left[0] >= 0

    coupled = CoupledMotion(plain.trajectory, PARTS, plain.limits, lambda _: speed, is_needed)
    rows, _ = play(coupled)
    fading_s = 0.3
    assert seconds - DT <= (len(rows) - before) * DT <= seconds + fading_s
    assert coupled.is_at_rest
    moved = (DT * (before - 1) + seconds) * speed
    np.testing.assert_allclose(rows[-1] - plain.trajectory.end, moved, atol=1e-4)
