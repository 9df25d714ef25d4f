"""Where a target is, by two filters: a lively one, and a calm one for as long as it is right.

A filter that keeps up with a leading arm at full speed takes the noise of sightings for
acceleration, and an arm that follows it trembles before a target at rest. A calm one does not, but
it is late where the target turns. Its own innovations tell: as long as the target moves as it
assumes they come from both sides, and their mean over a while is next to nothing (Bar-Shalom, Li,
Kirubarajan, Estimation with Applications to Tracking and Navigation, 5.4).
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from types import ModuleType

import numpy as np

from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.vision.estimate import Measurement, Motion, TargetEstimate
from bt_dualarm.vision.motion_model import Oscillator

CALM_JERK = 0.01
"""Density of the jerk of a target that rests or goes on evenly, m²/s⁵."""

_BELIEVED = (1.0, 3.0)  # mean squared distance: calm up to the one, lively from the other on
_MOST = 10.0  # what is more counts as so much
_MEAN_S = 0.3  # of innovations
_FADES_S = 0.5  # in which a doubt does


class CalmEstimate(TargetEstimate):
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
        self._lively, self._calmness, self._jerk = lively, calmness, jerk
        self._calm = TargetEstimate(replace(lively, jerk_density=jerk))
        self._mean: Vector = np.zeros(1)
        self._doubt = 0.0
        self._share = self._believed()

    @property
    def calm_share(self) -> float:
        """Weight of the calm filter, from 0 to 1."""
        return self._share

    def anew(self) -> CalmEstimate:
        """One for another target, of the same models, that has not seen anything yet."""
        return CalmEstimate(self._calmness, self._jerk, self._lively)

    def update(self, stamp: float, position: Vector, sigma: float | Vector) -> None:
        """Take in a measurement, as `TargetEstimate` does."""
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
        lively, calm = self._last, self._calm._last
        motion = np.empty((3, len(lively.state)))
        _kernels().blend(
            lively.state, time - lively.stamp, calm.state, time - calm.stamp, share, motion
        )  # fmt: skip
        return Motion(motion[0], motion[1], motion[2])

    def predict_in(self, axes: Matrix, origin: Vector, time: float) -> Matrix:
        """The same in a plane, as `TargetEstimate` does.

        Raises:
            ValueError: There has been no measurement.
        """
        lively, calm = self._last, self._calm._last
        motion = np.empty((3, 2))
        ahead = lively.state, time - lively.stamp, calm.state, time - calm.stamp
        _kernels().blend_in_plane(*ahead, self._share, axes, origin, motion)
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
def _kernels() -> ModuleType:
    """The kernels that blend: an import statement costs as much as they do."""
    from bt_dualarm.vision import oscillator_kernels

    return oscillator_kernels
