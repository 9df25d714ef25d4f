"""Harmonic motion of a target: what a circle, an ellipse and an oscillation have in common.

A filter knows a target by the last tenths of a second, which predicts it for a few tenths more. A
target that repeats its motion can be predicted for longer: `fit_harmonic` fits one sine per axis,
all of the same frequency, to the last seconds of sightings. It is fitted only when a target goes
out of view, so it costs nothing while the target is seen.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.perception.target_filter import Motion

_WINDOW_S: Final = 2.5
"""Age of the oldest sighting that counts, s."""

_MEMORY_S: Final = 0.25
"""Time constant of the weights, s: the speed on a curve changes from place to place."""

_PACE_S: Final = 0.1
"""Time over which speeds are measured, s."""

_RESTING: Final = 0.2
"""Below this fraction of the largest speed of the last half second, the target rested."""

_LAST_PACES_S: Final = 0.5

_TURNED: Final = 3.7
"""Least phase that must have been seen, rad. A straight motion from rest to rest resembles half a
period, π, of which nothing follows for the time after it."""

_HIGHEST: Final = 12.0
"""Highest angular frequency, rad/s; see `target_filter.Oscillator`."""

_MISFIT: Final = 0.035
"""Largest misfit as a fraction of the amplitude. Circles that an arm draws by its own limits have
about 0.02, other smooth curves mostly more."""

_GROWTH: Final = 2.0
"""Growth of the standard deviation, in misfits per radian. Measured on 237 occlusions of drawn
circles: after 0.2 to 1 s, the root mean square error along an axis was 1.0 to 1.1 times it."""

_FREQUENCY_DOUBT: Final = 0.5
"""Standard deviation of the frequency of a target that reappears, rad/s."""

_FEWEST: Final = 12  # sightings
_FREQUENCIES: Final = 24  # candidates in each of the passes
_PASSES: Final = 3  # each is about ten times as fine


@dataclass(frozen=True, eq=False)
class HarmonicMotion:
    """``center + cosine · cos w(t - stamp) + sine · sin w(t - stamp)``.

    Attributes:
        stamp: Time of the newest sighting, s.
        frequency: Angular frequency ``w``, rad/s.
        center: Center of the motion, of shape (3,), m.
        cosine: Amplitude of the cosine, of shape (3,), m.
        sine: Amplitude of the sine, of shape (3,), m.
        misfit: Root mean square distance of the sightings from the motion, m.
    """

    stamp: float
    frequency: float
    center: Vector
    cosine: Vector
    sine: Vector
    misfit: float

    def predict(self, time: float) -> Motion:
        """Position, velocity and acceleration in the world at a time in s."""
        w = self.frequency
        c = math.cos(w * (time - self.stamp))
        s = math.sin(w * (time - self.stamp))
        swing = self.cosine * c + self.sine * s
        return Motion(self.center + swing, w * (self.sine * c - self.cosine * s), -(w**2) * swing)

    def doubt(self, time: float) -> float:
        """Standard deviation along an axis of the position at a time in s, m."""
        return self.misfit * (1.0 + _GROWTH * self.frequency * abs(time - self.stamp))

    def expect(self, time: float) -> tuple[Matrix, Vector]:
        """State of an `Oscillator` at a time in s, of shape (3, 4), and its deviations, (4,)."""
        w = self.frequency
        state = np.column_stack((*self.predict(time), np.full(3, w)))
        doubt = self.doubt(time)
        return state, np.array((doubt, w * doubt, w**2 * doubt, _FREQUENCY_DOUBT))


def fit_harmonic(stamps: Vector, points: Matrix) -> HarmonicMotion | None:
    """Harmonic motion of a target since it last rested.

    Args:
        stamps: Times of sightings, increasing, of shape (n,), s.
        points: Positions in the world, of shape (n, 3), m.

    Returns:
        None if the target did not move like that, or not for long enough.
    """
    since = _motion_begins(stamps, points)
    t = stamps[since:] - stamps[-1]
    if len(t) < _FEWEST or -t[0] * _HIGHEST < _TURNED:
        return None
    x = points[since:] - points[-1]
    weight = np.exp(t / _MEMORY_S)
    weight /= weight.sum()
    # Least squares for each candidate frequency, by normal equations. Lower ones than are accepted
    # are candidates too, as otherwise the lowest would be found instead.
    lowest, highest = 0.5 * _TURNED / -t[0], _HIGHEST
    for _ in range(_PASSES):
        frequencies = np.geomspace(lowest, highest, _FREQUENCIES)
        phases = frequencies[:, None] * t
        basis = np.stack((np.ones_like(phases), np.cos(phases), np.sin(phases)), axis=1)
        weighted = basis * weight
        parameters = np.linalg.solve(weighted @ basis.swapaxes(1, 2), weighted @ x)
        away = x - basis.swapaxes(1, 2) @ parameters
        misfits = np.sqrt(np.einsum("n,fnk,fnk->f", weight, away, away))
        best = int(np.argmin(misfits))
        lowest = frequencies[max(best - 1, 0)]
        highest = frequencies[min(best + 1, _FREQUENCIES - 1)]
    center, cosine, sine = parameters[best]
    frequency = float(frequencies[best])
    misfit = float(misfits[best])
    amplitude = math.sqrt(float(cosine @ cosine + sine @ sine))
    if -t[0] * frequency < _TURNED or misfit >= _MISFIT * amplitude:
        return None
    return HarmonicMotion(float(stamps[-1]), frequency, points[-1] + center, cosine, sine, misfit)


def _motion_begins(stamps: Vector, points: Matrix) -> int:
    """Index of the first sighting since the target last rested, or since `_WINDOW_S`."""
    first = int(np.searchsorted(stamps, stamps[-1] - _WINDOW_S))
    before = np.searchsorted(stamps, stamps[first:] - _PACE_S)
    # Without a sighting for longer than a pace, the pace is that over the gap.
    before = np.maximum(np.minimum(before, np.arange(first, len(stamps)) - 1), 0)
    passed = np.maximum(stamps[first:] - stamps[before], 1e-6)
    speeds = np.linalg.norm(points[first:] - points[before], axis=1) / passed
    largest = speeds[stamps[first:] >= stamps[-1] - _LAST_PACES_S].max()
    resting = np.flatnonzero(speeds < _RESTING * largest)
    return first if len(resting) == 0 else first + int(resting[-1])
