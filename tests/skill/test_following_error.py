"""When a follower has arrived, and when what it sees is no following any more."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from bt_dualarm.core.errors import Failure
from bt_dualarm.skill.tracking import FollowingError

BOUND_M = 0.01
PATIENCE_S = 2.0
RATES = (5, 15, 60, 200)


def judged(
    error: Callable[[float], float], seconds: float, fps: int, noise: float = 0.0
) -> tuple[FollowingError, Failure | None, float]:
    """The judge after these seconds, or what it failed with, and when."""
    judge = FollowingError(BOUND_M, PATIENCE_S)
    rng = np.random.default_rng(fps)
    for stamp in np.arange(10.0, 10.0 + seconds, 1.0 / fps).tolist():
        try:
            judge.take(stamp, np.array((error(stamp - 10.0), 0.0)) + rng.normal(0.0, noise, 2))
        except Failure as failure:
            return judge, failure, stamp - 10.0
    return judge, None, seconds


def swing(amplitude: float, hertz: float) -> Callable[[float], float]:
    return lambda time: amplitude * np.sin(2 * np.pi * hertz * time)


@pytest.mark.parametrize("fps", RATES)
@pytest.mark.parametrize("start", [0.02, 0.1, 1.0])
def test_on_its_way_any_error_is_allowed(start: float, fps: int) -> None:
    """Slowly: half of it remains after a second."""
    judge, failure, _ = judged(lambda time: start * 0.5**time, 10.0, fps)
    assert failure is None
    assert judge.arrived
    assert float(judge.metrics()["seen_max_m"]) <= BOUND_M * 1.5


@pytest.mark.parametrize("fps", RATES)
@pytest.mark.parametrize(
    "error",
    [
        lambda _: 0.02,  # a tool that does not move
        lambda time: 0.1 * time,  # a target that runs away
        swing(0.03, 2.4),  # more than the bound by twice
        swing(0.03, 0.9),
        lambda time: max(0.1 - 0.1 * time, 0.02),  # it stops on the way
    ],
)
def test_what_comes_no_nearer_fails(error: Callable[[float], float], fps: int) -> None:
    judge, failure, at = judged(error, 10.0, fps)
    assert failure is not None
    assert failure.code == "NOT_FOLLOWING"
    assert "10.0 mm" in str(failure)
    assert not judge.arrived or at > 0.5
    assert PATIENCE_S * 0.2 < at < 2.0 * PATIENCE_S + 1.0


@pytest.mark.parametrize("fps", RATES)
@pytest.mark.parametrize("noise", [0.0, 2e-3])
@pytest.mark.parametrize("late", [swing(0.03, 2.4), swing(0.03, 0.6), lambda time: 0.05 * time])
def test_who_has_arrived_has_to_stay(
    late: Callable[[float], float], noise: float, fps: int
) -> None:
    """Whatever it is that grows: within a second and a half of the error's being too large."""
    judge, failure, at = judged(
        lambda time: 0.0 if time < 3.0 else late(time - 3.0), 9.0, fps, noise
    )
    assert judge.arrived
    assert failure is not None
    assert 3.0 < at < 4.5
    assert float(failure.numbers["seen_rms_m"]) > BOUND_M


@pytest.mark.parametrize("fps", RATES)
@pytest.mark.parametrize("error", [lambda _: 0.009, swing(0.01, 2.4), swing(0.009, 0.5)])
def test_within_the_bound_it_stays(error: Callable[[float], float], fps: int) -> None:
    judge, failure, _ = judged(error, 20.0, fps)
    assert failure is None
    assert judge.arrived


def test_out_of_view_it_has_to_arrive_anew() -> None:
    judge, _, _ = judged(lambda _: 0.0, 2.0, 60)
    assert judge.arrived
    judge.interrupt()
    assert not judge.arrived
    for frame in range(30):
        judge.take(20.0 + frame / 60, np.array((0.2 * 0.9**frame, 0.0)))
    assert not judge.arrived


def test_who_never_arrived_has_no_figures() -> None:
    assert judged(lambda _: 0.02, 1.0, 60)[0].metrics() == {}
