"""Kalman filters of a target: where it is, how fast it moves and where it will be."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from types import ModuleType
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from bt_dualarm.core.pose import Matrix, Vector

# Motion models of a target between two images, for each axis separately.
#
# A state has four numbers an axis, of which the first three are position, velocity and acceleration
# in SI units. Noise is continuous, so that results do not depend on the frame rate.


Stack = npt.NDArray[np.float64]
"""One 4 by 4 matrix an axis, of shape (n, 4, 4)."""

_STATES = 4


class MotionModel(Protocol):
    """What a filter needs to know about motion."""

    @property
    def spread(self) -> tuple[float, float, float]:
        """Standard deviation of velocity, acceleration and the last state of a new target."""

    def start(self, position: Vector) -> Matrix:
        """State of shape (n, 4) of a target first seen at ``position`` of shape (n,)."""

    def move(self, state: Matrix, dt: float) -> Matrix:
        """The state, of shape (n, 4), ``dt`` seconds on."""

    def jacobian(self, state: Matrix, dt: float) -> Stack:
        """Derivative of ``move`` by the state, of shape (n, 4, 4) or (1, 4, 4)."""

    def noise(self, dt: float) -> Matrix:
        """Covariance that ``dt`` seconds add, of shape (4, 4)."""

    def carry(self, state: Matrix, covariance: Stack, dt: float) -> tuple[Matrix, Stack]:
        """State and covariance, of shapes (n, 4) and (n, 4, 4), ``dt`` seconds on."""

    def confine(self, state: Matrix) -> Matrix:
        """The nearest state, of shape (n, 4), that a target can have."""


@dataclass(frozen=True)
class Oscillator:
    """A sine of unknown frequency w, the fourth state in rad/s: p''' = -w² p'.

    Three integrators with white noise ``jerk_density`` in m²/s⁵, and a frequency that wanders
    with ``frequency_density`` in rad²/s³, between 0 and ``highest_frequency``.
    """

    jerk_density: float = 10.0
    frequency_density: float = 0.5
    start_frequency: float = 4.0
    highest_frequency: float = 12.0
    spread: tuple[float, float, float] = (0.5, 3.0, 2.0)

    def start(self, position: Vector) -> Matrix:
        """At rest, at the frequency of a slow curve."""
        state = at_rest(position)
        state[:, 3] = self.start_frequency
        return state

    def move(self, state: Matrix, dt: float) -> Matrix:
        """The sine through position, velocity and acceleration."""
        moved = np.empty_like(state)
        _kernels().swing(state, dt, moved)
        return moved

    def jacobian(self, state: Matrix, dt: float) -> Stack:
        """Exact, by differentiating the sine."""
        jacobian = np.empty((len(state), _STATES, _STATES))
        _kernels().differentiate(state, dt, jacobian)
        return jacobian

    def noise(self, dt: float) -> Matrix:
        """White noise through three integrators, and apart from it the frequency's."""
        noise = np.zeros((_STATES, _STATES))
        noise[:3, :3] = self.jerk_density * chain_noise(dt)[1:, 1:]
        noise[3, 3] = self.frequency_density * abs(dt)
        return noise

    def carry(self, state: Matrix, covariance: Stack, dt: float) -> tuple[Matrix, Stack]:
        """As `carried`, in machine code."""
        moved = np.empty_like(state)
        spread = np.empty_like(covariance)
        densities = self.jerk_density, self.frequency_density
        _kernels().carry(state, covariance, dt, densities, moved, spread)
        return moved, spread

    def confine(self, state: Matrix) -> Matrix:
        """Frequencies that an arm can reach: beyond, the linearised filter would run away."""
        confined = state.copy()
        frequency = confined[:, 3]
        np.minimum(np.maximum(frequency, 0.0), self.highest_frequency, out=frequency)
        return confined


@cache
def _kernels() -> ModuleType:
    """The kernels of an oscillator: an import statement costs as much as they do."""
    from bt_dualarm.perception import tracking_kernels

    return tracking_kernels


def carried(
    model: MotionModel, state: Matrix, covariance: Stack, dt: float
) -> tuple[Matrix, Stack]:
    """State and covariance ``dt`` seconds on, by a model's derivative there and its noise."""
    jacobian = model.jacobian(state, dt)
    spread: Stack = jacobian @ covariance @ jacobian.swapaxes(1, 2) + model.noise(dt)
    return model.move(state, dt), spread


def at_rest(position: Vector) -> Matrix:
    """State of shape (n, 4) of a target that stands at a position of shape (n,), m."""
    state = np.zeros((len(position), _STATES))
    state[:, 0] = position
    return state


@lru_cache(maxsize=256)
def chain_noise(dt: float) -> Matrix:
    """Covariance of four integrators driven by white noise of density one, of shape (4, 4).

    The integral over t of c c' with c = (t³/6, t²/2, t, 1).
    """
    order = np.array([3, 2, 1, 0])
    factorial = np.array([6.0, 2.0, 1.0, 1.0])
    power = order[:, None] + order[None, :] + 1
    noise: Matrix = abs(dt) ** power / (power * factorial[:, None] * factorial[None, :])
    return noise


def warm_up_prediction() -> None:
    """Have all kernels of motion models compiled."""
    from bt_dualarm.perception.tracking_kernels import blend, blend_in_plane, correct

    model = Oscillator()
    state = np.ones((1, _STATES))
    spread = np.ones((1, _STATES, _STATES))
    model.move(state, 1.0)
    model.jacobian(state, 1.0)
    model.carry(state, spread, 1.0)
    blend(state, 1.0, state, 1.0, 0.5, np.empty((3, 1)))
    axes = np.ones((2, 1))
    motion = np.empty((3, 2))
    blend_in_plane(state, 1.0, state, 1.0, 0.5, axes, np.ones(1), motion)
    correct(state, spread, np.ones(1), np.ones(1))


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

    def fresh(self) -> TargetEstimate:
        """One for another target, of the same model, that has not seen anything yet."""
        return TargetEstimate(self._model)

    def update(self, stamp: float, position: Vector, sigma: float | Vector) -> None:
        """Process a measurement.

        Args:
            stamp: When it was true, s; one older than the history is ignored.
            position: Position in m, of shape (n,).
            sigma: Standard deviation in m: one for all axes or one an axis.
        """
        self.enter(Measurement.of(stamp, position, sigma))

    def enter(self, measurement: Measurement) -> None:
        """As `update`, what several estimates take in."""
        stamp = measurement.stamp
        known = self._measurements
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
    from bt_dualarm.perception.tracking_kernels import correct

    return correct


# Two filters in parallel: one of high gain, and one of low gain for as long as it is consistent.
#
# A filter that follows a fast target takes the noise of sightings for acceleration, and an arm that
# tracks a target at rest with it trembles. A low-gain filter does not, but it lags where the target
# turns. Its innovations show that: while the target moves as assumed they have both signs, and
# their mean over a while is nearly zero (Bar-Shalom, Li, Kirubarajan, Estimation with Applications
# to Tracking and Navigation, 5.4).


CALM_JERK = 0.01
"""Density of the jerk of a target that rests or goes on evenly, m²/s⁵."""

_BELIEVED = (1.0, 3.0)  # mean squared distance: calm up to the one, lively from the other on
_MOST = 10.0  # what is more counts as so much
_MEAN_S = 0.3  # of innovations
_FADES_S = 0.5  # in which a doubt does


class DualFilterEstimate(TargetEstimate):
    """The lively filter's estimate, or the calm one's where it has been right for a while.

    Args:
        calmness: How easily the calm one is believed, from 0 (never) to 1.
        jerk: Density of a calm target's jerk, in m²/s⁵.
        model: How targets move at their liveliest; an oscillator by default.
    """

    def __init__(
        self, calmness: float = 1.0, jerk: float = CALM_JERK, model: Oscillator | None = None
    ) -> None:
        lively = model or Oscillator()
        super().__init__(lively)
        self._lively = lively
        self._calmness = calmness
        self._jerk = jerk
        self._calm = TargetEstimate(replace(lively, jerk_density=jerk))
        self._mean: Vector = np.zeros(1)
        self._doubt = 0.0
        self._share = self._believed()

    @property
    def slow_share(self) -> float:
        """Weight of the calm filter, from 0 to 1."""
        return self._share

    def fresh(self) -> DualFilterEstimate:
        """One for another target, of the same models, that has not seen anything yet."""
        return DualFilterEstimate(self._calmness, self._jerk, self._lively)

    def update(self, stamp: float, position: Vector, sigma: float | Vector) -> None:
        """Process a measurement, as `TargetEstimate` does."""
        if self.seen and self.stamp < stamp:
            self._judge(stamp - self.stamp, self._calm.innovation(stamp, position, sigma))
        measurement = Measurement.of(stamp, position, sigma)
        self._calm.enter(measurement)
        self.enter(measurement)

    def predict(self, time: float) -> Motion:
        """The target at any time, of the past too.

        Raises:
            ValueError: There has been no measurement.
        """
        share = self._share
        lively = self._last
        calm = self._calm._last
        motion = np.empty((3, len(lively.state)))
        _blend_kernels().blend(
            lively.state, time - lively.stamp, calm.state, time - calm.stamp, share, motion
        )  # fmt: skip
        return Motion(motion[0], motion[1], motion[2])

    def predict_in(self, axes: Matrix, origin: Vector, time: float) -> Matrix:
        """The same in a plane, as `TargetEstimate` does.

        Raises:
            ValueError: There has been no measurement.
        """
        lively = self._last
        calm = self._calm._last
        motion = np.empty((3, 2))
        ahead = lively.state, time - lively.stamp, calm.state, time - calm.stamp
        _blend_kernels().blend_in_plane(*ahead, self._share, axes, origin, motion)
        return motion

    def _judge(self, passed: float, innovation: Vector) -> None:
        """Take the calm filter's newest innovation, of shape (n,), into account."""
        kept = math.exp(-passed / _MEAN_S)
        self._mean = kept * self._mean + (1.0 - kept) * innovation
        count = (1.0 + kept) / (1.0 - kept)  # of independent numbers with a mean as sure as this
        doubt = min(count * float(self._mean @ self._mean), _MOST)
        self._doubt = max(doubt, self._doubt * math.exp(-passed / _FADES_S))
        self._share = self._believed()

    def _believed(self) -> float:
        """How far the calm filter is believed, from 0 to 1, by what speaks against it."""
        if self._calmness == 0.0:
            return 0.0
        low, high = (self._calmness * bound for bound in _BELIEVED)
        return min(max((high - self._doubt) / (high - low), 0.0), 1.0)


@cache
def _blend_kernels() -> ModuleType:
    """The kernels that blend: an import statement costs as much as they do."""
    from bt_dualarm.perception import tracking_kernels

    return tracking_kernels
