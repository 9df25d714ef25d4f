"""Tracking ends within a bounded time for any images."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import count

import numpy as np
import pytest

from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Vector
from bt_dualarm.perception.target_filter import RestDetector, RestSample
from bt_dualarm.skill.following_error import FollowingError, FollowingSample
from bt_dualarm.skill.tracking_end import EndConditions, TrackingEnd, TrackingStatus

TICK_S = 0.05
FRAME_S = 1.0 / 15.0
CODES = {"LOST", "NOT_SEEN", "UNREACHABLE", "NOT_FOLLOWING", "NOT_MOVED", "NOT_STILL"}

BY_DURATION = EndConditions(
    duration=4.0,
    until_still=None,
    wait=5.0,
    reach_timeout=6.0,
    move_timeout=7.0,
    rest_timeout=40.0,
    lost_timeout=3.0,
    reach=0.3,
)
BY_REST = replace(BY_DURATION, duration=None, until_still=1.0)
BY_BOTH = replace(BY_DURATION, until_still=1.0)
BY_NEITHER = replace(BY_DURATION, duration=None)


def longest(conditions: EndConditions) -> float:
    """The bound that `TrackingEnd` documents, s."""
    unfollowed = conditions.wait + conditions.reach_timeout + conditions.apart
    bounds = []
    if conditions.duration is not None:
        bounds.append(conditions.duration + 2.0 * unfollowed)
    if conditions.until_still is not None:
        bounds.append(conditions.wait + conditions.rest_timeout)
    return min(bounds) + 5.0 * TICK_S


def ended(conditions: EndConditions, statuses: Iterator[TrackingStatus]) -> tuple[str, float]:
    """Code of the end, or ``SUCCESS``, and its time."""
    end = TrackingEnd(conditions, FollowingError(0.01, conditions.lost_timeout), 0.0)
    time = 0.0
    try:
        for status in statuses:
            time = status.time
            assert time <= longest(conditions), "tracking does not end"
            if end.is_over(status):
                return "SUCCESS", time
    except Failure as failure:
        return failure.code, time
    raise AssertionError("no more statuses")


Make = Callable[[np.random.Generator, float], TrackingStatus]


def anything(rng: np.random.Generator, time: float) -> TrackingStatus:
    """Any status, even an impossible one, that alone would not end tracking."""
    in_view, arrived, is_beyond, is_waiting, has_moved = (rng.random(5) < 0.5).tolist()
    return TrackingStatus(
        time, in_view, arrived, is_beyond=is_beyond, is_waiting=is_waiting, has_moved=has_moved
    )


def changing(period: float) -> Make:
    """One status for a while, then another."""

    def make(rng: np.random.Generator, time: float) -> TrackingStatus:
        seed = int(rng.bit_generator.seed_seq.generate_state(1)[0])
        return anything(np.random.default_rng((int(time / period), seed)), time)

    return make


def between(*seconds: float) -> Make:
    """In turn for these durations: followed, in view, unseen, out of reach, waited for."""
    kinds = (
        TrackingStatus(0.0, in_view=True, arrived=True),
        TrackingStatus(0.0, in_view=True, arrived=False),
        TrackingStatus(0.0, in_view=False, arrived=False),
        TrackingStatus(0.0, in_view=True, arrived=False, is_beyond=True),
        TrackingStatus(0.0, in_view=False, arrived=False, is_waiting=True),
    )
    ends = np.cumsum(seconds)

    def make(rng: np.random.Generator, time: float) -> TrackingStatus:
        kind = kinds[int(np.searchsorted(ends, time % ends[-1], side="right"))]
        return kind._replace(time=time, has_moved=bool(rng.random() < 0.5))

    return make


@pytest.mark.parametrize("conditions", [BY_DURATION, BY_REST, BY_BOTH])
@pytest.mark.parametrize(
    "make",
    [
        anything,
        changing(0.5),
        changing(5.0),
        between(0.0, 0.3, 0.2, 0.0, 0.0),  # never in view for long enough
        between(0.0, 0.05, 2.9, 0.0, 0.0),  # hardly ever in view
        between(0.0, 0.3, 0.0, 5.9, 0.0),  # within reach for moments
        between(0.0, 0.0, 0.0, 0.3, 4.9),  # comes into view out of reach, and disappears
        between(0.1, 29.0, 0.8, 5.9, 0.0),  # followed just before each timeout
        between(0.5, 0.0, 0.4, 0.0, 0.0),
    ],
)
def test_tracking_ends_within_its_bound(make: Make, conditions: EndConditions) -> None:
    for seed in range(5):
        rng = np.random.default_rng(seed)
        code, _ = ended(conditions, (make(rng, TICK_S * tick) for tick in count(1)))
        assert code in CODES | {"SUCCESS"}


def test_tracking_without_end_conditions_ends_if_the_target_is_not_followed() -> None:
    """Tracking continues while the target is followed, and otherwise fails after a timeout."""
    end = TrackingEnd(BY_NEITHER, FollowingError(0.01, 3.0), 0.0)
    assert end.progress is None
    for tick in range(1, 20001):
        assert not end.is_over(TrackingStatus(TICK_S * tick, in_view=True, arrived=True))
    late = 1000.0 + 0.99 * BY_NEITHER.apart
    assert not end.is_over(TrackingStatus(late, in_view=True, arrived=False))
    late = 1000.0 + 1.01 * BY_NEITHER.apart
    with pytest.raises(Failure, match="never stayed within") as raised:
        end.is_over(TrackingStatus(late, in_view=True, arrived=False))
    assert raised.value.code == "NOT_FOLLOWING"


def test_failure_code_states_the_cause() -> None:
    rng = np.random.default_rng(0)
    for make, expected in (
        (between(0.0, 0.3, 0.2, 0.0, 0.0), "NOT_FOLLOWING"),
        (between(0.0, 0.2, 0.4, 0.0, 0.0), "LOST"),
        (between(0.0, 0.3, 0.0, 5.9, 0.0), "UNREACHABLE"),
        (between(0.0, 0.0, 0.0, 0.3, 4.9), "NOT_SEEN"),
    ):
        code, _ = ended(BY_DURATION, (make(rng, TICK_S * tick) for tick in count(1)))
        assert code == expected
    moving = (
        TrackingStatus(TICK_S * tick, in_view=True, arrived=True, has_moved=True)
        for tick in count(1)
    )
    assert ended(BY_REST, moving)[0] == "NOT_STILL"


def test_following_a_target_until_it_rests_is_a_success() -> None:
    followed = (
        TrackingStatus(time, in_view=True, arrived=True, has_moved=time > 2.0, still_for=time - 3.0)
        for time in (TICK_S * tick for tick in count(1))
    )
    code, time = ended(BY_REST, followed)
    assert code == "SUCCESS"
    assert time == pytest.approx(4.0, abs=2 * TICK_S)
    arrived = (TrackingStatus(TICK_S * tick, in_view=True, arrived=True) for tick in count(1))
    code, time = ended(BY_DURATION, arrived)
    assert code == "SUCCESS"
    assert time == pytest.approx(4.0, abs=2 * TICK_S)


def scene(name: str, rng: np.random.Generator) -> Iterator[Vector | None]:
    """Offsets of detections from the image center, of shape (2,), m; None without a detection."""
    spot = np.zeros(2)
    for frame in count():
        time = FRAME_S * frame
        if name == "noise":
            yield rng.normal(0.0, 0.05, 2)
        elif name == "jumping":
            spot = rng.normal(0.0, 0.03, 2) if rng.random() < 0.3 else spot
            yield spot
        elif name == "flickering":
            yield rng.normal(0.0, 1e-3, 2) if time % 0.6 < 0.4 else None
        elif name == "rarely":
            yield spot if rng.random() < 0.3 else None
        elif name == "drifting":
            spot = spot + rng.normal(0.0, 4e-3, 2)
            yield spot * min(1.0, 0.02 / float(np.linalg.norm(spot)))
        elif name == "shaking":
            yield rng.normal(0.0, 4e-3, 2)
        else:
            yield None


def watched(name: str, conditions: EndConditions) -> Iterator[TrackingStatus]:
    """Statuses from the monitors for a scene; as in a tracker, three sightings make a target.

    Raises:
        Failure: ``NOT_FOLLOWING``.
    """
    error = FollowingError(0.01, conditions.lost_timeout)
    rest = RestDetector(1.0)
    in_row, last = 3, 0.0
    for frame, offset in enumerate(scene(name, np.random.default_rng(7)), start=1):
        stamp = FRAME_S * frame
        if offset is not None:
            in_row += 1
        elif stamp - last > 0.1:
            in_row = 0
            error.interrupt()
            rest.interrupt()
        locked = in_row >= 3
        if locked and offset is not None:
            last = stamp
            error.take(FollowingSample(stamp, offset, offset, np.zeros(2)))
            rest.take(RestSample(stamp, offset, np.zeros(2), 1.0, 1e-3))
        yield TrackingStatus(
            stamp,
            in_view=locked,
            arrived=locked and error.arrived,
            has_moved=rest.has_moved,
            still_for=rest.still_for,
            unseen_for=stamp - last,
        )


@pytest.mark.parametrize("conditions", [BY_DURATION, BY_REST, BY_BOTH])
@pytest.mark.parametrize(
    "name", ["noise", "jumping", "flickering", "rarely", "drifting", "shaking", "nothing"]
)
def test_tracking_ends_with_real_monitors(name: str, conditions: EndConditions) -> None:
    code, _ = ended(conditions, watched(name, conditions))
    assert code in CODES | {"SUCCESS"}
    if name in {"noise", "flickering", "rarely", "nothing"}:
        assert code != "SUCCESS"


def test_failure_reports_that_the_target_was_out_of_view() -> None:
    """A fast motion could have left the image and returned unseen."""
    end = TrackingEnd(BY_REST, FollowingError(0.01, BY_REST.lost_timeout), 0.0)

    def watch() -> None:
        for number in range(1, 1000):
            time = number * TICK_S
            in_view = not 2.0 < time < 3.5 + 0.5 * TICK_S
            end.is_over(TrackingStatus(time, in_view=in_view, arrived=in_view))

    with pytest.raises(Failure, match=r"out of view for 1\.5 s of that") as caught:
        watch()
    assert caught.value.code == "NOT_MOVED"
    assert caught.value.numbers["unseen_s"] == pytest.approx(1.5)
