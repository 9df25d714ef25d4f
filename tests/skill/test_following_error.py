"""`FollowingError`: when a follower has arrived, when it fails, and for which cause."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Vector
from bt_dualarm.skill.following_error import ErrorCause, FollowingError, FollowingSample

BOUND_M = 0.01
PATIENCE_S = 2.0
RATES = (5, 15, 60, 200)


def sample(
    stamp: float, error: float, noise: Vector | float = 0.0, *, by_images: bool = False
) -> FollowingSample:
    """A sample of a target that has moved by an error, with a tool at rest."""
    target = np.array((error, 0.0)) + noise
    predicted = np.zeros(2) if by_images else target
    return FollowingSample(stamp, target, target, predicted)


def judge_errors(
    error: Callable[[float], float], seconds: float, fps: int, noise: float = 0.0
) -> tuple[FollowingError, Failure | None, float]:
    """The judge after these seconds, its failure, if any, and the time of its end."""
    judge = FollowingError(BOUND_M, PATIENCE_S)
    rng = np.random.default_rng(fps)
    for stamp in np.arange(10.0, 10.0 + seconds, 1.0 / fps).tolist():
        try:
            judge.take(sample(stamp, error(stamp - 10.0), rng.normal(0.0, noise, 2)))
        except Failure as failure:
            return judge, failure, stamp - 10.0
    return judge, None, seconds


def swing(amplitude: float, hertz: float) -> Callable[[float], float]:
    return lambda time: amplitude * np.sin(2 * np.pi * hertz * time)


@pytest.mark.parametrize("fps", RATES)
@pytest.mark.parametrize("start", [0.02, 0.1, 1.0])
def test_any_decreasing_error_is_allowed_before_arrival(start: float, fps: int) -> None:
    """The error may decrease slowly: half of it remains after a second."""
    judge, failure, _ = judge_errors(lambda time: start * 0.5**time, 10.0, fps)
    assert failure is None
    assert judge.arrived
    assert float(judge.metrics()["seen_max_m"]) <= BOUND_M * 1.5


@pytest.mark.parametrize("fps", RATES)
@pytest.mark.parametrize(
    "error",
    [
        lambda _: 0.02,  # a tool at rest
        lambda time: 0.1 * time,  # a target that moves away
        swing(0.03, 2.4),  # three times the bound
        swing(0.03, 0.9),
        lambda time: max(0.1 - 0.1 * time, 0.02),  # it stops before it arrives
    ],
)
def test_follower_that_does_not_approach_fails(error: Callable[[float], float], fps: int) -> None:
    judge, failure, at = judge_errors(error, 10.0, fps)
    assert failure is not None
    assert failure.code == "NOT_FOLLOWING"
    assert "10.0 mm" in str(failure)
    assert not judge.arrived or at > 0.5
    assert PATIENCE_S * 0.2 < at < 2.0 * PATIENCE_S + 1.0


@pytest.mark.parametrize("fps", RATES)
@pytest.mark.parametrize("noise", [0.0, 2e-3])
@pytest.mark.parametrize("late", [swing(0.05, 2.4), swing(0.05, 0.6), lambda time: 0.05 * time])
def test_follower_that_has_arrived_must_stay_near(
    late: Callable[[float], float], noise: float, fps: int
) -> None:
    """Any growing error fails within 1.5 s, above twice the bound."""
    judge, failure, at = judge_errors(
        lambda time: 0.0 if time < 3.0 else late(time - 3.0), 9.0, fps, noise
    )
    assert judge.arrived
    assert failure is not None
    assert 3.0 < at < 4.5
    assert float(failure.numbers["seen_rms_m"]) > 2.0 * BOUND_M


@pytest.mark.parametrize("fps", RATES)
@pytest.mark.parametrize("error", [lambda _: 0.009, swing(0.01, 2.4), swing(0.009, 0.5)])
def test_errors_within_the_bound_do_not_fail(error: Callable[[float], float], fps: int) -> None:
    judge, failure, _ = judge_errors(error, 20.0, fps)
    assert failure is None
    assert judge.arrived


def test_follower_must_arrive_anew_after_an_interruption() -> None:
    judge, _, _ = judge_errors(lambda _: 0.0, 2.0, 60)
    assert judge.arrived
    judge.interrupt()
    assert not judge.arrived
    for frame in range(30):
        judge.take(sample(20.0 + frame / 60, 0.2 * 0.9**frame))
    assert not judge.arrived


def test_metrics_are_empty_before_arrival() -> None:
    assert judge_errors(lambda _: 0.02, 1.0, 60)[0].metrics() == {"max_error_m": BOUND_M}


@pytest.mark.parametrize("fps", RATES)
def test_total_error_counts_in_the_end(fps: int) -> None:
    """15 mm RMS is below twice the bound in each second, but above the bound in total."""
    judge, failure, _ = judge_errors(
        lambda time: 0.0 if time < 1.0 else swing(0.015 * 2**0.5, 1.0)(time), 9.0, fps
    )
    assert failure is None
    assert judge.rms == pytest.approx(0.015, rel=0.1)
    with pytest.raises(Failure, match=r"NOT_FOLLOWING: the target was 1[345]"):
        judge.refuse_above_bound()


def test_errors_count_from_arrival_or_timeout() -> None:
    arrived = judge_errors(lambda time: 0.2 * 0.1**time, 4.0, 60)[0]
    assert arrived.counts_from is not None
    assert 10.5 < arrived.counts_from < 12.0
    slow = judge_errors(lambda time: 1.0 * 0.5**time, 4.0, 60)[0]
    assert slow.counts_from == pytest.approx(10.0 + PATIENCE_S, abs=0.05)
    assert not slow.arrived


def test_target_out_of_reach_does_not_count_before_arrival() -> None:
    judge = FollowingError(BOUND_M, PATIENCE_S)
    for frame in range(300):
        judge.take(sample(frame / 60, 0.5)._replace(within_reach=False))
        judge.postpone()
    assert judge.counts_from is None
    assert judge.rms == 0.0


def test_time_without_the_target_counts_as_error() -> None:
    """5 s without error, then 1 s with 50 mm: 20 mm in total, by occlusion."""
    judge, failure, _ = judge_errors(lambda _: 0.0, 5.5, 60)
    assert failure is None
    judge.interrupt()
    stamps = np.linspace(15.5, 16.48, 50)
    judge.miss(stamps, np.full(len(stamps), 0.05))
    assert judge.rms == pytest.approx(0.05 / 6**0.5, rel=0.05)
    for frame in range(60):
        judge.take(sample(16.5 + frame / 60, 0.04 * 0.9**frame))
    assert judge.arrived
    assert judge.cause is ErrorCause.OCCLUSION, "the return to the target also counts as occlusion"
    with pytest.raises(Failure, match="not in view"):
        judge.refuse_above_bound()


@pytest.mark.parametrize(
    ("by_images", "cause"), [(False, ErrorCause.SPEED), (True, ErrorCause.LATENCY)]
)
def test_loss_after_lagging_behind_is_not_an_occlusion(by_images: bool, cause: ErrorCause) -> None:
    """The error exceeded the bound in the last three images before the target left the view."""
    judge, failure, _ = judge_errors(lambda _: 0.001, 5.0, 60)
    assert failure is None
    if not by_images:
        judge.need, judge.limit = (0.2, 2.0), 1.2
    for frame, error in enumerate((0.012, 0.02, 0.03)):
        judge.take(sample(15.0 + frame / 60, error, by_images=by_images))
    judge.interrupt()
    judge.miss(np.linspace(15.1, 16.0, 50), np.full(50, 0.05))
    assert judge.cause is cause
    with pytest.raises(Failure) as caught:
        judge.refuse_above_bound()
    assert caught.value.numbers["cause"] == str(cause)


@pytest.mark.parametrize(
    ("need", "speed_share", "by_images", "cause"),
    [
        (2.0, 0.1, True, ErrorCause.SPEED),
        (2.0, 0.1, False, ErrorCause.SPEED),
        (0.5, 1.0, False, ErrorCause.SPEED),
        (0.5, 0.1, True, ErrorCause.LATENCY),
        # The servo follows unsteady images less closely than the arm could.
        (0.5, 0.1, False, ErrorCause.LATENCY),
    ],
)
def test_arm_is_too_slow_only_for_a_target_that_needs_more_than_its_limits(
    need: float, speed_share: float, by_images: bool, cause: ErrorCause
) -> None:
    """It was blamed for a target that needs 0.5 of its 2.9 m/s², in images of 15 Hz."""
    judge = FollowingError(BOUND_M, PATIENCE_S)
    judge.need = (0.2, need)
    judge.limit = 1.2
    judge.speed_share = speed_share

    def swings() -> None:
        for frame in range(600):
            error = 0.0 if frame < 60 else 0.05 * np.sin(frame / 5)
            judge.take(sample(frame / 60, error, by_images=by_images))

    with pytest.raises(Failure) as failure:
        swings()
    assert failure.value.numbers["cause"] == str(cause)
    assert "1.2 m/s²" in failure.value.reason


def test_reason_states_the_need_of_the_time_at_which_the_target_was_too_fast() -> None:
    """The target is too fast for 4 s, then rests until the end: 8.9 mm of 8 mm RMS."""
    judge = FollowingError(0.008, PATIENCE_S)
    judge.limit = 1.2
    for frame in range(600):
        moves = 60 <= frame < 300
        judge.need = (0.2, 2.0) if moves else (0.0, 0.0)
        judge.take(sample(frame / 60, 0.02 * np.sin(frame / 5) if moves else 0.0))
    with pytest.raises(
        Failure, match=r"too fast for the arm: the target needs 2\.8 m/s²"
    ) as failure:
        judge.refuse_above_bound()
    assert failure.value.numbers["cause"] == "speed"


def test_proportional_control_is_blamed_on_its_gains() -> None:
    """The reason called a target too fast that needs 0.07 m/s² of the arm's 2.2 m/s²."""
    judge = FollowingError(BOUND_M, PATIENCE_S, proportional=True)
    judge.need = (0.2, 0.05)
    judge.limit = 2.2

    def lags() -> None:
        for frame in range(600):
            judge.take(sample(frame / 60, 0.0 if frame < 60 else 0.05)._replace(predicted=None))

    with pytest.raises(
        Failure, match="proportional control by these gains does not follow"
    ) as failure:
        lags()
    assert failure.value.numbers["cause"] == "speed"


def test_oscillating_tool_in_front_of_a_resting_target_is_reported_as_jitter() -> None:
    judge = FollowingError(BOUND_M, PATIENCE_S)

    def swings() -> None:
        for frame in range(600):
            swinging = sample(frame / 60, 0.05 * np.sin(frame / 5))
            judge.take(swinging._replace(target=np.zeros(2)))

    with pytest.raises(Failure, match="rests, but the tool does not") as failure:
        swings()
    assert failure.value.numbers["cause"] == "jitter"


@pytest.mark.parametrize(("width", "bound"), [(0.05, 0.01), (0.004, 2e-3)])
def test_default_bound_is_a_fifth_of_the_width(width: float, bound: float) -> None:
    by_size = FollowingError(None, PATIENCE_S)
    by_size.know_width(width)
    assert by_size.bound == pytest.approx(bound)
    given = FollowingError(BOUND_M, PATIENCE_S)
    given.know_width(1.0)
    assert given.bound == BOUND_M


def after_losses(error: Callable[[float], float]) -> FollowingError:
    """A judge after an arrival and twenty losses, each followed by 0.5 s in view."""
    judge, _, _ = judge_errors(lambda _: 0.0, 2.0, 60)
    assert judge.arrived
    for round_ in range(20):
        judge.interrupt()
        for frame in range(30):
            since = round_ + frame / 60
            judge.take(sample(20.0 + since, error(since)))
    return judge


def test_repeated_losses_fail_eventually() -> None:
    """The target oscillates by 0.1 m; only time in view counts."""
    with pytest.raises(Failure, match=r"for 2\.\d s in view") as caught:
        after_losses(swing(0.1, 1.0))
    assert caught.value.code == "NOT_FOLLOWING"


def test_repeated_losses_are_allowed_while_the_error_decreases() -> None:
    judge = after_losses(lambda time: 0.5 * 0.8**time)
    for frame in range(60):
        judge.take(sample(40.0 + frame / 60, 0.0))
    assert judge.arrived


@pytest.mark.parametrize("slowed", [False, True])
def test_lag_due_to_the_guard_is_not_blamed_on_speed(slowed: bool) -> None:
    judge = FollowingError(BOUND_M, PATIENCE_S)
    judge.need = (0.1, 2.0)
    judge.limit = 2.0

    def lags() -> None:
        for step in range(600):
            error = 0.0 if step < 120 else 1e-4 * (step - 120)
            judge.take(
                sample(step / 60.0, error)._replace(slowed="another arm is near" if slowed else "")
            )

    with pytest.raises(Failure) as failure:
        lags()
    assert failure.value.numbers["cause"] == ("guard" if slowed else "speed")
    assert failure.value.reason.endswith("guard slowed the arm: another arm is near") == slowed
