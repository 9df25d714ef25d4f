"""Kalman filters of a target: its position and motion now, their prediction, and its rest.

`TargetEstimate` is an extended Kalman filter over a `MotionModel`, by default an `Oscillator`, with
independent axes. `DualFilterEstimate` runs a second filter of low gain in parallel, which takes
over while the target rests. Rest is detected by a statistical test for a change of the mean
position.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from types import ModuleType
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.perception.localization import Sighting

# Motion models
#
# Axes are independent. A state has four numbers per axis: position, velocity and acceleration in SI
# units, and one that is the model's own. Process noise is continuous, so that results do not depend
# on the frame rate.


Stack = npt.NDArray[np.float64]
"""One 4 by 4 matrix per axis, of shape (n, 4, 4)."""

_STATES = 4


class MotionModel(Protocol):
    """Model of a target's motion between two images."""

    @property
    def spread(self) -> tuple[float, float, float]:
        """Initial standard deviations of velocity, acceleration and the last state."""

    def start(self, position: Vector) -> Matrix:
        """Initial state, of shape (n, 4), of a target first seen at a position of shape (n,), m."""

    def move(self, state: Matrix, dt: float) -> Matrix:
        """The state, of shape (n, 4), ``dt`` seconds on."""

    def jacobian(self, state: Matrix, dt: float) -> Stack:
        """Derivative of ``move`` by the state, of shape (n, 4, 4) or (1, 4, 4)."""

    def noise(self, dt: float) -> Matrix:
        """Covariance of the process noise over ``dt`` seconds, of shape (4, 4)."""

    def propagate(self, state: Matrix, covariance: Stack, dt: float) -> tuple[Matrix, Stack]:
        """State and covariance, of shapes (n, 4) and (n, 4, 4), ``dt`` seconds on."""

    def confine(self, state: Matrix) -> Matrix:
        """The nearest valid state, of shape (n, 4)."""


@dataclass(frozen=True)
class Oscillator:
    """A sine of unknown angular frequency w, the fourth state in rad/s: p''' = -w² p'.

    The jerk has white noise of ``jerk_density`` in m²/s⁵. The frequency is a random walk of
    ``frequency_density`` in rad²/s³ between 0 and ``highest_frequency``.
    """

    jerk_density: float = 10.0
    frequency_density: float = 0.5
    start_frequency: float = 4.0
    highest_frequency: float = 12.0
    spread: tuple[float, float, float] = (0.5, 3.0, 2.0)

    def start(self, position: Vector) -> Matrix:
        """At rest, with the frequency of a slow curve."""
        state = at_rest(position)
        state[:, 3] = self.start_frequency
        return state

    def move(self, state: Matrix, dt: float) -> Matrix:
        """Evaluate the sine through position, velocity and acceleration."""
        moved = np.empty_like(state)
        kernels().swing(state, dt, moved)
        return moved

    def jacobian(self, state: Matrix, dt: float) -> Stack:
        """Analytic derivative of the sine."""
        jacobian = np.empty((len(state), _STATES, _STATES))
        kernels().differentiate(state, dt, jacobian)
        return jacobian

    def noise(self, dt: float) -> Matrix:
        """White noise through three integrators, and independently that of the frequency."""
        noise = np.zeros((_STATES, _STATES))
        noise[:3, :3] = self.jerk_density * chain_noise(dt)[1:, 1:]
        noise[3, 3] = self.frequency_density * abs(dt)
        return noise

    def propagate(self, state: Matrix, covariance: Stack, dt: float) -> tuple[Matrix, Stack]:
        """Like `propagated`, by a compiled kernel."""
        moved = np.empty_like(state)
        spread = np.empty_like(covariance)
        densities = self.jerk_density, self.frequency_density
        kernels().propagate(state, covariance, dt, densities, moved, spread)
        return moved, spread

    def confine(self, state: Matrix) -> Matrix:
        """Clip the frequency to what an arm can follow: beyond it the filter diverges."""
        confined = state.copy()
        frequency = confined[:, 3]
        np.minimum(np.maximum(frequency, 0.0), self.highest_frequency, out=frequency)
        return confined


@cache
def kernels() -> ModuleType:
    """The compiled kernels, imported once: an import statement costs as much as a kernel."""
    from bt_dualarm.perception import perception_kernels

    return perception_kernels


def propagated(
    model: MotionModel, state: Matrix, covariance: Stack, dt: float
) -> tuple[Matrix, Stack]:
    """State and covariance ``dt`` seconds on, by a model's Jacobian and noise (EKF prediction)."""
    jacobian = model.jacobian(state, dt)
    spread: Stack = jacobian @ covariance @ jacobian.swapaxes(1, 2) + model.noise(dt)
    return model.move(state, dt), spread


def at_rest(position: Vector) -> Matrix:
    """State of shape (n, 4) of a target at rest at a position of shape (n,), m."""
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
    """Compile the kernels of filters."""
    compiled = kernels()
    model = Oscillator()
    state = np.ones((1, _STATES))
    spread = np.ones((1, _STATES, _STATES))
    model.move(state, 1.0)
    model.jacobian(state, 1.0)
    model.propagate(state, spread, 1.0)
    compiled.blend(state, 1.0, state, 1.0, 0.5, np.empty((3, 1)))
    axes = np.ones((2, 1))
    motion = np.empty((3, 2))
    compiled.blend_in_plane(state, 1.0, state, 1.0, 0.5, axes, np.ones(1), motion)
    compiled.correct(state, spread, np.ones(1), np.ones(1))


# Filters

_HISTORY = 8  # number of past measurements kept, so that late ones can be inserted


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
    """Position of a target: stamp in s, position in m and its variance in m², of shape (n,)."""

    stamp: float
    position: Vector
    variance: Vector

    @classmethod
    def of(cls, stamp: float, position: Vector, sigma: float | Vector) -> Measurement:
        """Create a measurement; ``sigma`` in m is one for all axes or one per axis."""
        variance = np.empty(len(position))
        variance[:] = np.square(sigma)
        return cls(stamp, np.array(position, dtype=float), variance)


class TargetEstimate:
    """A Kalman filter with independent axes, extended for nonlinear motion models.

    Measurements may arrive late and out of order: a short history is kept, and filtered again.

    Args:
        model: Motion model of the target; an oscillator by default.
    """

    def __init__(self, model: MotionModel | None = None) -> None:
        self._model: MotionModel = model or Oscillator()
        self._beliefs: list[_Belief] = []
        self._measurements: list[Measurement] = []
        # Cached prediction: gate, search window and the next measurement ask for the same time.
        self._predicted: tuple[_Belief, _Belief] | None = None

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
        """A new filter with the same model, for another target."""
        return TargetEstimate(self._model)

    def resumed(self, stamp: float, state: Matrix, spread: Vector) -> TargetEstimate:
        """A new filter with the same model, for this target after it was out of view.

        Args:
            stamp: Time of its next measurement, s.
            state: Expected state then, of shape (n, 4).
            spread: Standard deviations of the four states, of shape (4,).
        """
        resumed = self.fresh()
        resumed._begin(stamp, state, spread)
        return resumed

    def expect(self, time: float) -> tuple[Matrix, Vector]:
        """Expected state at a time, of shape (n, 4), and its standard deviations, of shape (4,).

        The deviations are the largest of all axes.

        Raises:
            ValueError: There has been no measurement.
        """
        belief = self._moved(self._last, time)
        variances = belief.covariance.diagonal(axis1=1, axis2=2)
        return belief.state.copy(), np.sqrt(variances.max(axis=0))

    def update(self, stamp: float, position: Vector, sigma: float | Vector) -> None:
        """Process a measurement.

        Args:
            stamp: Time of the measurement, s; one older than the history is ignored.
            position: Position in m, of shape (n,).
            sigma: Standard deviation in m: one for all axes or one per axis.
        """
        self.enter(Measurement.of(stamp, position, sigma))

    def enter(self, measurement: Measurement) -> None:
        """Like `update`, with a measurement that several filters share."""
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
        """Motion of the target at any time, past or future.

        Raises:
            ValueError: There has been no measurement.
        """
        last = self._last
        state = self._model.move(last.state, time - last.stamp)
        return Motion(state[:, 0], state[:, 1], state[:, 2])

    def predict_in(self, axes: Matrix, origin: Vector, time: float) -> Matrix:
        """Position, velocity and acceleration along k axes at any time, of shape (3, k).

        Args:
            axes: Unit vectors in the world, of shape (k, n).
            origin: Origin of the positions, of shape (n,), m.
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
        """A measurement minus its prediction, over the standard deviation of each axis, (n,).

        Raises:
            ValueError: There has been no measurement.
        """
        belief = self._moved(self._last, stamp)
        variance = belief.covariance[:, 0, 0] + np.square(sigma)
        innovation: Vector = (position - belief.state[:, 0]) / np.sqrt(variance)
        return innovation

    def _begin(self, stamp: float, state: Matrix, spread: Vector) -> None:
        covariance = np.zeros((len(state), _STATES, _STATES))
        covariance[:, range(_STATES), range(_STATES)] = np.square(spread)
        self._beliefs = [_Belief(stamp, state, covariance)]

    @property
    def _last(self) -> _Belief:
        if not self._beliefs:
            raise ValueError("the target has not been seen yet")
        return self._beliefs[-1]

    def _take(self, measurement: Measurement) -> None:
        if self._beliefs:
            belief = self._moved(self._last, measurement.stamp)
            self._predicted = None  # the correction changes its arrays in place
            kernels().correct(
                belief.state, belief.covariance, measurement.position, measurement.variance
            )
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
        known = self._predicted
        if known is not None and known[0] is belief and known[1].stamp == time:
            return known[1]
        moved = _Belief(
            time, *self._model.propagate(belief.state, belief.covariance, time - belief.stamp)
        )
        self._predicted = belief, moved
        return moved


# Dual filter
#
# A filter that follows a fast target mistakes the noise of sightings for acceleration, and an arm
# that tracks a target at rest with it trembles. A slow filter, of low gain, does not, but it lags
# where the target turns. Its normalized innovations show that: while the target moves as assumed
# they have both signs, and their moving average is nearly zero (Bar-Shalom, Li, Kirubarajan,
# Estimation with Applications to Tracking and Navigation, 5.4).


CALM_JERK = 0.01
"""Jerk density of the slow filter, for targets at rest or in uniform motion, m²/s⁵."""

_TRUST_BOUNDS = (1.0, 3.0)  # below: only the slow filter counts; above: it does not
_MAX_STATISTIC = 10.0  # a larger one is clipped, so that trust returns in time
_MEAN_S = 0.3  # time constant of the moving average of innovations
_FADE_S = 0.5  # time constant with which a large statistic decays


class DualFilterEstimate(TargetEstimate):
    """A blend of a fast filter and a slow one, which counts while its innovations are consistent.

    Args:
        calmness: Readiness to use the slow filter, from 0 (never) to 1.
        jerk: Jerk density of the slow filter, in m²/s⁵.
        model: Motion model of the fast filter; an oscillator by default.
    """

    def __init__(
        self, calmness: float = 1.0, jerk: float = CALM_JERK, model: Oscillator | None = None
    ) -> None:
        fast = model or Oscillator()
        super().__init__(fast)
        self._fast = fast
        self._calmness = calmness
        self._jerk = jerk
        self._slow = TargetEstimate(replace(fast, jerk_density=jerk))
        self._mean: Vector = np.zeros(1)
        self._statistic = 0.0
        self._share = self._trusted_share()

    @property
    def slow_share(self) -> float:
        """Weight of the slow filter, from 0 to 1."""
        return self._share

    def fresh(self) -> DualFilterEstimate:
        """A new filter with the same models, for another target."""
        return DualFilterEstimate(self._calmness, self._jerk, self._fast)

    def resumed(self, stamp: float, state: Matrix, spread: Vector) -> DualFilterEstimate:
        """A new filter with the same models, and as much trust in the slow one, after a loss."""
        resumed = self.fresh()
        resumed._begin(stamp, state, spread)
        resumed._slow._begin(stamp, state, spread)
        resumed._statistic = self._statistic
        resumed._share = self._share
        return resumed

    def update(self, stamp: float, position: Vector, sigma: float | Vector) -> None:
        """Process a measurement, as `TargetEstimate` does."""
        if self.seen and self.stamp < stamp:
            self._assess(stamp - self.stamp, self._slow.innovation(stamp, position, sigma))
        measurement = Measurement.of(stamp, position, sigma)
        self._slow.enter(measurement)
        self.enter(measurement)

    def predict(self, time: float) -> Motion:
        """Motion of the target at any time, past or future.

        Raises:
            ValueError: There has been no measurement.
        """
        fast = self._last
        slow = self._slow._last
        motion = np.empty((3, len(fast.state)))
        kernels().blend(
            fast.state, time - fast.stamp, slow.state, time - slow.stamp, self._share, motion
        )
        return Motion(motion[0], motion[1], motion[2])

    def predict_in(self, axes: Matrix, origin: Vector, time: float) -> Matrix:
        """Motion along some axes, as `TargetEstimate.predict_in`.

        Raises:
            ValueError: There has been no measurement.
        """
        fast = self._last
        slow = self._slow._last
        motion = np.empty((3, len(axes)))
        states = fast.state, time - fast.stamp, slow.state, time - slow.stamp
        kernels().blend_in_plane(*states, self._share, axes, origin, motion)
        return motion

    def _assess(self, passed: float, innovation: Vector) -> None:
        """Update the consistency statistic by the slow filter's innovation, of shape (n,)."""
        kept = math.exp(-passed / _MEAN_S)
        self._mean = kept * self._mean + (1.0 - kept) * innovation
        # Effective number of samples in the exponential average: the variance of the mean of that
        # many independent values is that of the average.
        count = (1.0 + kept) / (1.0 - kept)
        statistic = min(count * float(self._mean @ self._mean), _MAX_STATISTIC)
        self._statistic = max(statistic, self._statistic * math.exp(-passed / _FADE_S))
        self._share = self._trusted_share()

    def _trusted_share(self) -> float:
        """Weight of the slow filter, from 0 to 1, by the consistency statistic."""
        if self._calmness == 0.0:
            return 0.0
        low, high = (self._calmness * bound for bound in _TRUST_BOUNDS)
        return min(max((high - self._statistic) / (high - low), 0.0), 1.0)


_STILL_M = 0.0025  # displacement within which the target is at rest
_MOVED_M = 0.007  # displacement beyond which it has moved for the first time
_NEWEST = 48  # number of newest sightings; means of 3, 6, 12, 24 and 48 are compared
_FEWEST = 3
_FIRST = 24  # first sightings that are averaged
_MAX_SLOPES = 64  # slopes for which first sightings are kept

# Columns of a row
_SLOPE = slice(2, 4)
_COLUMNS = 5


@dataclass(frozen=True, eq=False)
class RestSample:
    """One sighting, projected onto the plane of motion.

    Attributes:
        stamp: Time of exposure, s.
        eye: Position of the camera along the plane, of shape (2,), m.
        slope: Displacement of the line of sight along the plane for each meter of depth, (2,).
        depth: Estimated depth of the target in front of the camera, m.
        sigma: Expected standard deviation of the target's position along an axis, m.
    """

    stamp: float
    eye: Vector
    slope: Vector
    depth: float
    sigma: float


def look(sighting: Sighting, axes: Matrix) -> RestSample:
    """Project a sighting onto a plane.

    Args:
        sighting: Sighting in the world.
        axes: Unit vectors of the plane in the world, of shape (2, 3).
    """
    line = sighting.point - sighting.camera.position
    (a, b, c), (x, y, z) = axes.tolist()
    normal = np.array((b * z - c * y, c * x - a * z, a * y - b * x))
    depth = abs(float(normal @ line))
    sigma = float(np.sqrt((np.square(axes) @ np.square(sighting.sigma)).max()))
    return RestSample(
        sighting.stamp, axes @ sighting.camera.position, axes @ line / depth, depth, sigma
    )


class RestDetector:
    """Measures how long one target has been at rest.

    The target has moved if the mean of its newest sightings, over any of several windows, differs
    from the mean of the first ones since the last motion by more than their scatter explains: the
    likelihood-ratio test for a change of mean (Basseville and Nikiforov, Detection of Abrupt
    Changes, 1993, 2.4).

    It uses sightings, not the filter's estimate, which is extrapolated over the latency: the
    estimated velocity would amplify the camera's shake several times.

    A difference that another depth explains is not a motion either. At the depth z the target would
    be at c + z s, seen along the slope s from the camera position c; of all depths that it may
    have, the one with the smallest motion counts. A camera that centers a resting target in its
    image changes c by about -z s, and a wrong depth explains much of that. Therefore first
    sightings are kept for each slope: a target that moves is sooner or later seen along an old
    slope from another camera position.

    Args:
        depth_doubt: Factor by which the depth may be larger or smaller than estimated.
    """

    def __init__(self, depth_doubt: float) -> None:
        self._doubt = depth_doubt
        self._depth = 0.0  # the first estimate: later ones would look like motion
        self._firsts = np.zeros((0, _COLUMNS))  # means of first sightings since the last motion
        self._rows = np.empty((_FIRST + _NEWEST, _COLUMNS))  # recent sightings, oldest first
        self._count = 0
        self._leaving = 0  # number of them that are not among the newest, nor in a mean yet
        self._stamp = 0.0
        self._moved_at: float | None = None

    @property
    def still_for(self) -> float:
        """Seconds since the last motion; 0 before the first motion, and while undecided."""
        if self._moved_at is None or self._count - self._leaving <= _FEWEST:
            return 0.0
        return self._stamp - self._moved_at

    @property
    def has_moved(self) -> bool:
        """Whether the target has moved since it was first seen."""
        return self._moved_at is not None

    def interrupt(self) -> None:
        """Reset after the target was out of view, since it may have moved."""
        if self._moved_at is not None:
            self._forget()

    def take(self, look: RestSample) -> None:
        """Process a sighting, later than all previous ones."""
        self._depth = self._depth or look.depth
        self._stamp = look.stamp
        row = np.array((*look.eye, *look.slope, look.sigma**2))
        resumed = self._moved_at is not None and not self._count
        if self._count - self._leaving == _NEWEST:
            self._leave()
        self._append(row)
        if resumed or self._has_moved():
            self._moved_at = look.stamp
            self._forget()
            self._append(row)

    def _append(self, row: Vector) -> None:
        self._rows[self._count] = row
        self._count += 1

    def _forget(self) -> None:
        self._firsts = self._firsts[:0]
        self._count = self._leaving = 0

    def _leave(self) -> None:
        """Retire the oldest of the newest sightings; average the retired ones once they suffice."""
        from bt_dualarm.perception.perception_kernels import scatter

        self._leaving += 1
        if self._leaving < _FIRST:
            return
        mean = np.mean(self._rows[:_FIRST], axis=0)
        # The first mean along a slope is kept: later ones would hide slow motion.
        newest = self._rows[_FIRST - 1 : self._count]
        apart = scatter(newest, self._depth) * np.sqrt(2.0 / _FIRST) / self._depth
        known = np.linalg.norm(self._firsts[:, _SLOPE] - mean[_SLOPE], axis=1) < apart
        if len(self._firsts) < _MAX_SLOPES and not known.any():
            self._firsts = np.vstack((self._firsts, mean))
        self._rows[: self._count - _FIRST] = self._rows[_FIRST : self._count].copy()
        self._count -= _FIRST
        self._leaving = 0

    def _has_moved(self) -> bool:
        from bt_dualarm.perception.perception_kernels import has_moved

        # After the first motion the estimated depth is good enough.
        doubt, far = (self._doubt, _MOVED_M) if self._moved_at is None else (1.0, _STILL_M)
        rows = self._rows[: self._count]
        return has_moved(rows, self._leaving, self._firsts, self._depth, doubt, far)


def warm_up_rest_detection() -> None:
    """Compile the kernels of rest detection."""
    still = RestDetector(1.0)
    for stamp in range(_FIRST + _NEWEST + 1):
        still.take(RestSample(float(stamp), np.zeros(2), np.zeros(2), 1.0, 1.0))
