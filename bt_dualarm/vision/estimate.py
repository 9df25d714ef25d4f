"""Where the target is, how fast it goes and where it will be: a Kalman filter over detections."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np

from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.vision.motion_model import MotionModel, Oscillator, Stack

_HISTORY = 8


class Motion(NamedTuple):
    """Position in m, velocity in m/s, acceleration in m/s², each of shape (n,)."""

    position: Vector
    velocity: Vector
    acceleration: Vector


class _Belief(NamedTuple):
    stamp: float
    state: Matrix
    covariance: Stack


class Measurement(NamedTuple):
    """Where a target was: stamp in s, position in m and its variance in m², each of shape (n,)."""

    stamp: float
    position: Vector
    variance: Vector

    @classmethod
    def of(cls, stamp: float, position: Vector, sigma: float | Vector) -> Measurement:
        """One with a standard deviation in m for all axes, or one an axis."""
        variance = np.empty(len(position))
        variance[:] = np.square(sigma)
        return cls(stamp, np.array(position, dtype=float), variance)


class TargetEstimate:
    """A Kalman filter (extended, where the model bends) with axes independent of each other.

    Measurements may come late and out of order: a short history is kept and run again.

    Args:
        model: How targets move; an oscillator by default.
    """

    def __init__(self, model: MotionModel | None = None) -> None:
        self._model: MotionModel = model or Oscillator()
        self._beliefs: list[_Belief] = []
        self._measurements: list[Measurement] = []
        # What was asked of a time is asked of it again: by gate, window and the next measurement.
        self._foreseen: tuple[_Belief, _Belief] | None = None

    @property
    def seen(self) -> bool:
        """Whether there has been a measurement."""
        return bool(self._beliefs)

    @property
    def stamp(self) -> float:
        """Time of the newest measurement in s.

        Raises:
            ValueError: There has been none.
        """
        return self._last.stamp

    def anew(self) -> TargetEstimate:
        """One for another target, of the same model, that has not seen anything yet."""
        return TargetEstimate(self._model)

    def update(self, stamp: float, position: Vector, sigma: float | Vector) -> None:
        """Take in a measurement.

        Args:
            stamp: When it was true, in s; one older than the history is ignored.
            position: Position in m, of shape (n,).
            sigma: Standard deviation in m: one for all axes or one an axis.
        """
        self.enter(Measurement.of(stamp, position, sigma))

    def enter(self, measurement: Measurement) -> None:
        """As `update`, what several estimates take in."""
        stamp, known = measurement.stamp, self._measurements
        later = [one for one in known if one.stamp > stamp] if known else []
        if later and len(later) == len(known):
            return
        for _ in later:
            self._beliefs.pop()
            known.pop()
        for one in (measurement, *later):
            self._take(one)
        del self._beliefs[:-_HISTORY], known[:-_HISTORY]

    def predict(self, time: float) -> Motion:
        """The target at any time, of the past too.

        Raises:
            ValueError: There has been no measurement.
        """
        last = self._last
        state = self._model.move(last.state, time - last.stamp)
        return Motion(state[:, 0], state[:, 1], state[:, 2])

    def predict_in(self, axes: Matrix, origin: Vector, time: float) -> Matrix:
        """Position, velocity and acceleration along two axes at any time, of shape (3, 2).

        Args:
            axes: Unit vectors in the world, of shape (2, n).
            origin: Where positions count from, of shape (n,), m.
            time: Time, s.

        Raises:
            ValueError: There has been no measurement.
        """
        position, *rates = self.predict(time)
        motion: Matrix = np.array((position - origin, *rates)) @ axes.T
        return motion

    def variance(self, time: float) -> Vector:
        """Variance of the position at ``time``, of shape (n,), in m².

        Raises:
            ValueError: There has been no measurement.
        """
        variance: Vector = self._moved(self._last, time).covariance[:, 0, 0]
        return variance

    def surprise(self, stamp: float, position: Vector, sigma: float | Vector) -> float:
        """Squared Mahalanobis distance of a measurement from its prediction.

        Chi-squared with n degrees of freedom if the measurement belongs to the target.

        Raises:
            ValueError: There has been no measurement.
        """
        return float(np.sum(np.square(self.innovation(stamp, position, sigma))))

    def innovation(self, stamp: float, position: Vector, sigma: float | Vector) -> Vector:
        """A measurement less its prediction, (n,), each axis in its standard deviations.

        Raises:
            ValueError: There has been no measurement.
        """
        belief = self._moved(self._last, stamp)
        variance = belief.covariance[:, 0, 0] + np.square(sigma)
        innovation: Vector = (position - belief.state[:, 0]) / np.sqrt(variance)
        return innovation

    @property
    def _last(self) -> _Belief:
        if not self._beliefs:
            raise ValueError("the target has not been seen yet")
        return self._beliefs[-1]

    def _take(self, measurement: Measurement) -> None:
        if self._beliefs:
            belief = self._moved(self._last, measurement.stamp)
            self._foreseen = None  # it is changed in place
            _correct()(belief.state, belief.covariance, measurement.position, measurement.variance)
            state = self._model.confine(belief.state)
            belief = _Belief(belief.stamp, state, belief.covariance)
        else:
            belief = self._first(measurement)
        self._beliefs.append(belief)
        self._measurements.append(measurement)

    def _first(self, measurement: Measurement) -> _Belief:
        axes = len(measurement.position)
        covariance = np.zeros((axes, 4, 4))
        covariance[:, 0, 0] = measurement.variance
        covariance[:, [1, 2, 3], [1, 2, 3]] = np.square(self._model.spread)
        return _Belief(measurement.stamp, self._model.start(measurement.position), covariance)

    def _moved(self, belief: _Belief, time: float) -> _Belief:
        known = self._foreseen
        if known is not None and known[0] is belief and known[1].stamp == time:
            return known[1]
        carried = self._model.carry(belief.state, belief.covariance, time - belief.stamp)
        moved = _Belief(time, *carried)
        self._foreseen = belief, moved
        return moved


@cache
def _correct() -> Callable[[Matrix, Stack, Vector, Vector], None]:
    """The kernel that corrects: an import statement costs as much as it does."""
    from bt_dualarm.vision.filter_kernels import correct

    return correct
