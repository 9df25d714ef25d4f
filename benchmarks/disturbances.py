"""Disturbances of tracking: a screen in front of the target, a twin that crosses the view."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Final
from unittest.mock import patch

import numpy as np

from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.experiments.trials import Cell, Trial, run_trial
from bt_dualarm.perception.tracker import TargetTracker
from bt_dualarm.runtime.arm_runtime import IdleObserver
from bt_dualarm.sim.world import World
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.document import ObjectSpec
from bt_dualarm.spec.values import PoseSpec

AWAY = PoseSpec(xyz=(3.0, 3.0, 0.5))
SCREEN = ObjectSpec(
    shape="box", size=(0.002, 0.6, 0.6), mass=1, color="gray", pose=AWAY, fixed=True
)
BEHIND_SCREEN_M = 0.85  # x of the screen, between the cube and the camera
TWIN_X_M = (0.60, 0.76)  # behind and in front of the cube


class Mover(IdleObserver):
    """Moves a fixed object, and lets it pass through everything.

    Args:
        world: World of the object.
        name: Name of the object.
        place: Position at a time, of shape (3,), m.
    """

    def __init__(self, world: World, name: str, place: Callable[[float], Vector]) -> None:
        self._world = world
        self._name = name
        self._place = place

    def after_step(self, now: float) -> None:
        """Set its position for the next step."""
        model = self._world.model
        body = self._world.object_body(self._name)
        geom = self._world.object_geom(self._name)
        model.geom_contype[geom] = model.geom_conaffinity[geom] = 0
        model.body_pos[body] = self._place(now)


COVERED_CELL: Final = Cell("circle", 0.5, more={"turns": "4"})
"""The tracked curve: about seven seconds, beginning at the third."""

COVERED_FROM_S: Final = (4.0, 6.5)
"""Range of the start of an occlusion; all end at least two seconds before the curve."""

BACK_AFTER_S: Final = 1.0
"""Time after the end of an occlusion by which the target has to be tracked as before, s."""

BACK_M: Final = 0.01
"""Largest distance from the earlier relative position that counts as before, m."""

_TWIN_SPEED = 0.3  # m/s
_TWIN_PASSES_S = 6.0  # when it is in the middle
_STOLEN_M = 0.025  # half an edge: nearer to the twin, and farther from the target
_STOLEN_SAMPLES = 5  # 0.1 s


def covered(registry: Registry, seed: int, begin: float, length: float) -> Trial:
    """A trial in which a screen hides the target for some time.

    Args:
        registry: Installed skills.
        seed: Seed of the trial.
        begin: Simulated time at which the occlusion begins, s.
        length: Duration of the occlusion, s.

    Raises:
        TrialError: Nothing could be measured.
    """

    def place(now: float) -> Vector:
        hidden = begin <= now < begin + length
        return np.array([BEHIND_SCREEN_M, 0.11, 0.70] if hidden else AWAY.xyz)

    objects = {"screen": SCREEN}
    return run_trial(COVERED_CELL, seed, registry, objects, lambda w: Mover(w, "screen", place))


def came_back(trial: Trial, begin: float, length: float) -> bool:
    """Whether the target was tracked as before, soon after the occlusion."""
    times = trial.times + trial.began
    gap = trial.tracked - trial.cube
    before = gap[times < begin].mean(axis=0)
    after = np.linalg.norm(gap[times > begin + length + BACK_AFTER_S] - before, axis=1)
    return trial.outcome == "SUCCESS" and len(after) > 0 and float(after.max()) < BACK_M


def _twin_at(now: float, height: float) -> Vector:
    """Position of the twin, y and z, m."""
    return np.array((0.11 + _TWIN_SPEED * (now - _TWIN_PASSES_S), 0.70 + height))


def was_stolen(trial: Trial, height: float) -> bool:
    """Whether the tool followed the twin instead of the target."""
    times = trial.times + trial.began
    gap = trial.tracked - trial.cube
    tool = trial.cube + gap - np.median(gap, axis=0)
    twin = np.array([_twin_at(now, height) for now in times])
    astray = np.linalg.norm(tool - trial.cube, axis=1) > _STOLEN_M
    with_twin = np.linalg.norm(tool - twin, axis=1) < _STOLEN_M
    moving = np.linalg.norm(np.gradient(tool, times, axis=0), axis=1) > 0.5 * _TWIN_SPEED
    return int((astray & with_twin & moving).sum()) >= _STOLEN_SAMPLES


def crossed(registry: Registry, seed: int, height: float, depth: float) -> Trial:
    """A trial in which a cube like the target crosses the image.

    Args:
        registry: Installed skills.
        seed: Seed of the trial.
        height: Height above the curve's center, m.
        depth: Position along x, m.

    Raises:
        TrialError: Nothing could be measured.
    """
    twin = ObjectSpec(
        shape="box", size=(0.05, 0.05, 0.05), mass=1, color="yellow", pose=AWAY, fixed=True
    )

    def place(now: float) -> Vector:
        y, z = _twin_at(now, height)
        return np.array([depth, y, z] if abs(y - 0.11) < 0.35 else AWAY.xyz)

    objects = {"twin": twin}
    return run_trial(COVERED_CELL, seed, registry, objects, lambda w: Mover(w, "twin", place))


@dataclass
class Ages:
    """Ages of the newest sightings from which set-points were computed.

    Attributes:
        asked: Number of set-points.
        oldest: Largest age, s.
    """

    asked: int = 0
    oldest: float = 0.0


@contextmanager
def ages_of_data() -> Iterator[Ages]:
    """Context that records the age of the data of every prediction for a set-point."""
    ages = Ages()
    plain = TargetTracker.predict_in

    def watched(tracker: TargetTracker, axes: Matrix, origin: Vector, time: float) -> Matrix:
        ages.asked += 1
        ages.oldest = max(ages.oldest, tracker.age(time))
        return plain(tracker, axes, origin, time)

    with patch.object(TargetTracker, "predict_in", watched):
        yield ages
