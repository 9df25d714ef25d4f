"""Scores of a motion from all of its samples and from running sums agree."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bt_dualarm.core.pose import Vector
from bt_dualarm.perception.tracker import PLACES, Sightings
from bt_dualarm.skill import scoring
from bt_dualarm.skill.scoring import OVERLAP, TrackingScore
from bt_dualarm.spec.values import Plane

PERIOD_S = 0.02
LATE_S = 0.05
COUNT = 3000
OFFSET = np.array((0.35, 0.01, -0.02))


def target_position(time: float) -> Any:
    """Target position on a slowly drifting curve, so that errors differ from minute to minute."""
    return np.array((0.7, 0.1 * np.sin(2.0 * time) + 1e-3 * time, 0.05 * np.cos(3.1 * time)))


def followed(count: int, *, still: bool = False) -> tuple[TrackingScore, Any]:
    """A score of `count` samples of an arm with latency, and the tracking state."""
    rng = np.random.default_rng(4)
    seen = Sightings()
    tracking: Any = SimpleNamespace(
        in_view=True,
        target=target_position(0.0),
        sightings=seen.places,
        forget_sightings=seen.forget,
        turns=False,
        error=SimpleNamespace(counts_from=0.0),
    )
    world: Any = SimpleNamespace(objects={"cube"}, arms={"arm": SimpleNamespace(tool_site=0)})
    truth: list[Vector] = []
    world.object_middle = lambda _: truth[-1]
    arm: Any = SimpleNamespace(world=world, name="arm", time=0.0)
    score = TrackingScore(arm, np.array(Plane.model_validate("yz").axes), "cube")
    for step in range(count + round(scoring.SETTLE_S / PERIOD_S)):
        arm.time = step * PERIOD_S
        true = target_position(0.0 if still else arm.time)
        tool = (
            target_position(0.0 if still else arm.time - LATE_S) + OFFSET + rng.normal(0.0, 1e-4, 3)
        )
        truth.append(true)
        world.data = SimpleNamespace(site_xpos=tool[None])
        stamp = arm.time - 0.013
        point = target_position(0.0 if still else stamp) + rng.normal(0.0, 2e-4, 3)
        seen.append(SimpleNamespace(stamp=stamp, point=point))  # type: ignore[arg-type]
        score.sample(tracking)
    return score, tracking


@pytest.mark.parametrize("still", [False, True], ids=["moving", "still"])
def test_running_sums_give_the_same_score_as_all_samples(
    still: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, by = followed(COUNT, still=still)
    expected = whole.metrics(by)
    monkeypatch.setattr(scoring, "_MOST", 2 * OVERLAP + 111)
    score, tracking = followed(COUNT, still=still)
    assert len(tracking.sightings()[0]) < 2 * OVERLAP + 200
    assert score.metrics(tracking) == pytest.approx(expected, rel=1e-9)
    assert (score.times == whole.times).all()
    assert score.errors() == pytest.approx(whole.errors(), rel=1e-9, abs=1e-12)
    for name, path in whole.paths().items():
        assert score.paths()[name] == pytest.approx(path, abs=1e-12)


def test_memory_is_bounded_and_paths_are_thinned_evenly(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scoring, "_MOST", 3 * OVERLAP)
    monkeypatch.setattr("bt_dualarm.skill.scoring._MOST_KEPT", 500)
    score, _ = followed(COUNT)
    assert len(score.times) < 500 + 3 * OVERLAP
    steps = np.round(np.diff(score.times) / PERIOD_S)
    thinned = steps[:200]  # more than half of the path is thinned, for any length
    assert (thinned == thinned[0]).all()
    assert thinned[0] > 1


def test_old_sightings_are_dropped() -> None:
    seen = Sightings()
    one = SimpleNamespace(stamp=0.0, point=np.zeros(3))
    for _ in range(2 * PLACES):
        seen.append(one)  # type: ignore[arg-type]
    assert len(seen) == 2 * PLACES
    assert len(seen.places()[0]) <= PLACES
