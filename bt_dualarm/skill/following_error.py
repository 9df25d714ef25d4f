"""The tracking error that a camera measures: its bound, its arrival, and what it is due to."""

from __future__ import annotations

import math
from collections import Counter, deque
from enum import StrEnum
from typing import Final, NamedTuple

import numpy as np

from bt_dualarm.core.errors import Failure, Number
from bt_dualarm.core.pose import Vector

_WINDOW_S = 1.0  # window of the mean error: two periods of an arm's slowest oscillation
_WINDOW_FACTOR = 2.0  # allowed excess of one second over the bound, as at a corner of the path
_ARRIVED_S = 0.5  # time within the bound that distinguishes arriving from passing by
_FEWEST = 3  # minimum number of sightings in a mean
_PATIENT_LOSSES = 3  # losses before an arrival after which the approach may begin again
_NEARER = 0.9  # below this fraction of the smallest error so far, the error has decreased
_RESTING = 0.25  # spread of a target at rest, as a fraction of the error
_AT_LIMIT = 0.9  # above this fraction of its limits, the arm limits the tracking

ERROR_SHARE: Final = 0.2
"""Default of the largest error, as a fraction of the target's width."""

LEAST_ERROR_M: Final = 2e-3
"""Minimum default of the largest error, m."""

_UNKNOWN_SIZE_M = 0.05  # default before the size of the target is known


class ErrorCause(StrEnum):
    """Why a target was not followed."""

    SPEED = "speed"
    LATENCY = "latency"
    REACH = "reach"
    OCCLUSION = "occlusion"
    GUARD = "guard"
    JITTER = "jitter"


class FollowingSample(NamedTuple):
    """One sighting of a followed target along the k axes, relative to the start of the tool.

    Attributes:
        stamp: Time of exposure, s.
        error: Vector from the image center, at the distance to be kept, to the target, of shape
            (k,), m.
        target: Position of the target, of shape (k,), m.
        predicted: Position that had been predicted for that time, of shape (k,), m; None if there
            was no prediction.
        within_reach: Whether the target was within reach.
        slowed: Why the guard slowed the arm, empty if it did not.
    """

    stamp: float
    error: Vector
    target: Vector
    predicted: Vector | None
    within_reach: bool = True
    slowed: str = ""


class _Seen(NamedTuple):
    """Sighting in the window of the monitor: its squared error in m², error and target."""

    stamp: float
    square: float
    error: Vector
    target: Vector


class FollowingError:
    """Monitor of the tracking error that the camera itself measures.

    While the tool approaches a target the error only has to decrease. Once it has stayed within the
    bound for half a second the tool has arrived. From then on, but at the latest ``patience`` after
    the start, the error counts until the end: its root mean square over all that time has to be
    within the bound, that over any second within twice the bound. Time without the target counts
    as well, with a path interpolated between two sightings.

    Args:
        bound: Largest root mean square, m; None for `ERROR_SHARE` of the target's width, at least
            `LEAST_ERROR_M`.
        patience: Longest time without a decrease of the error before the arrival, s.
        proportional: Whether gains move the tool, not a prediction.

    Attributes:
        arrived: Whether the tool has arrived and follows within the bound.
        largest: Largest error of a sighting since the first arrival, m.
        bound: Largest root mean square, m.
        counts_from: Time from which errors count, s; None before.
        need: Velocity and acceleration that the target needs, root mean squares, m/s and m/s².
        limit: Acceleration that the arm has in the plane, m/s².
        speed_share: Speed of the arm's fastest joint as a fraction of its limit.
    """

    def __init__(self, bound: float | None, patience: float, *, proportional: bool = False) -> None:
        self.arrived = False
        self.largest = 0.0
        self.bound = _UNKNOWN_SIZE_M if bound is None else bound
        self.counts_from: float | None = None
        self.need = (0.0, 0.0)
        self.limit = math.inf
        self.speed_share = 0.0
        self._proportional = proportional
        self._by_size = bound is None
        self._patience = patience
        self._seen: deque[_Seen] = deque()
        self._began: float | None = None
        self._least = math.inf
        self._nearer_at = 0.0
        self._interrupted_at = 0.0
        self._losses = 0  # since the last arrival
        self._squares = 0.0
        self._count = 0
        self._last: float | None = None
        self._time = 0.0
        self._integrals = dict.fromkeys(ErrorCause, 0.0)
        self._returns = False  # whether the target was out of view
        self._slowed_by = ""  # why the guard slowed the arm last
        self._latest: deque[dict[ErrorCause, float]] = deque(maxlen=_FEWEST)
        self._newest = 0.0  # stamp of the newest sighting
        self._too_fast_at = -math.inf
        self._too_fast_by = ""  # what the target needed then

    @property
    def rms(self) -> float:
        """Root mean square of the error over all time that counts, m; 0 before."""
        return math.sqrt(sum(self._integrals.values()) / self._time) if self._time > 0.0 else 0.0

    def know_width(self, width: float) -> None:
        """Set the default bound by the target's width in m; ignored once errors count."""
        if self._by_size and self.counts_from is None:
            self.bound = max(ERROR_SHARE * width, LEAST_ERROR_M)

    def interrupt(self) -> None:
        """Reset, as the target is out of view: the tool has to arrive again.

        After some losses without an arrival the error has to decrease all the same: a tool that
        swings about the target, and loses and finds it again and again, must not do so forever.
        """
        if self._seen:
            self._interrupted_at = self._seen[-1].stamp
            self._losses = 1 if self.arrived else self._losses + 1
        if self._losses <= _PATIENT_LOSSES:
            self._least = math.inf
        self._seen.clear()
        self.arrived = False

    def postpone(self) -> None:
        """Begin again, unless errors count: the target is still where the arm need not follow."""
        self._least = math.inf
        if self.counts_from is None:
            self._began = None

    def miss(self, stamps: Vector, errors: Vector) -> None:
        """Count time without the target: as occlusion, unless it was not followed before.

        A target that the arm or the prediction is too slow for leaves the image, or the window in
        which it is expected. What it was too fast for then also causes the time without it.

        Args:
            stamps: Times, increasing, of shape (n,), s.
            errors: Distances of the tool from the interpolated target then, of shape (n,), m.
        """
        before: Counter[ErrorCause] = Counter()
        for squares in self._latest:
            before.update(squares)
        total = before.total()
        followed = total <= len(self._latest) * self.bound**2
        self._returns = followed
        shares = {ErrorCause.OCCLUSION: 1.0}
        if not followed:
            shares = {cause: square / total for cause, square in before.items()}
        for stamp, error in zip(stamps.tolist(), errors.tolist(), strict=True):
            self._integrate(stamp, {cause: share * error**2 for cause, share in shares.items()})

    def take(self, sample: FollowingSample) -> None:
        """Process a sighting, later than all before.

        Raises:
            Failure: ``NOT_FOLLOWING``.
        """
        stamp = sample.stamp
        square = float(sample.error @ sample.error)
        self._began = stamp if self._began is None else self._began
        if self.counts_from is None and stamp - self._began > self._patience:
            self.counts_from = stamp
        self._newest = stamp
        if self._needed > _AT_LIMIT * self.limit or self.speed_share > _AT_LIMIT:
            self._too_fast_at = stamp
            self._too_fast_by = self._describe_need()
        attributed = self._attributed(sample, square)
        self._slowed_by = sample.slowed or self._slowed_by
        self._latest.append(attributed)
        # Until the tool has arrived again its error is due to the time without the target.
        self._integrate(stamp, {ErrorCause.OCCLUSION: square} if self._returns else attributed)
        if not sample.within_reach:
            self.interrupt()
            self._least = math.inf
            return
        if not self._seen:  # time out of view does not count
            fresh = math.isinf(self._least)
            self._nearer_at = stamp if fresh else self._nearer_at + stamp - self._interrupted_at
        self._seen.append(_Seen(stamp, square, sample.error, sample.target))
        self._drop(stamp - _WINDOW_S)
        if len(self._seen) < _FEWEST:
            return
        if self.arrived:
            self._count += 1
            self._squares += square
            self.largest = max(self.largest, math.sqrt(square))
            self._keep()
        else:
            self._approach(stamp)

    def refuse_above_bound(self) -> None:
        """Check the error over all the time that counts.

        Raises:
            Failure: ``NOT_FOLLOWING``.
        """
        if self.rms > self.bound:
            cause = self.cause
            raise Failure(
                "NOT_FOLLOWING",
                f"the target was {1e3 * self.rms:.1f} mm off the image center over the "
                f"{self._time:.1f} s of tracking (root mean square; max_error allows "
                f"{1e3 * self.bound:.1f} mm): {self.explain(cause)}",
                error_rms_m=self.rms,
                max_error_m=self.bound,
                cause=str(cause),
            )

    def refuse_apart(self, apart: float, unseen: float) -> None:
        """Refuse a target within reach at which the tool has not arrived.

        Args:
            apart: Time since it was last followed, s.
            unseen: Part of that without the target, s.

        Raises:
            Failure: ``NOT_FOLLOWING``.
        """
        # An error within the bound, but never for long enough in view.
        is_hidden = unseen > 0.0 and self.rms <= self.bound
        cause = ErrorCause.OCCLUSION if is_hidden else self.cause
        raise Failure(
            "NOT_FOLLOWING",
            f"in {apart:.1f} s the target has never stayed within {1e3 * self.bound:.1f} mm of the "
            f"image center for {_ARRIVED_S} s; it was out of view for {unseen:.1f} s: "
            f"{self.explain(cause)}",
            unseen_s=unseen,
            max_error_m=self.bound,
            cause=str(cause),
        )

    @property
    def cause(self) -> ErrorCause:
        """What most of the error is due to."""
        total = sum(self._integrals.values())
        for cause in (ErrorCause.OCCLUSION, ErrorCause.REACH, ErrorCause.GUARD):
            if self._integrals[cause] > 0.5 * total:
                return cause
        if self._trembles():
            return ErrorCause.JITTER
        by_arm = self._integrals[ErrorCause.SPEED] > self._integrals[ErrorCause.LATENCY]
        if self._proportional or by_arm or self._was_too_fast:
            return ErrorCause.SPEED
        return ErrorCause.LATENCY

    def explain(self, cause: ErrorCause) -> str:
        """A clause that names a cause with its numbers."""
        if cause is ErrorCause.OCCLUSION:
            return "most of that while the target was not in view"
        if cause is ErrorCause.REACH:
            return "most of that while the target was out of reach"
        if cause is ErrorCause.GUARD:
            return f"most of that while the guard slowed the arm: {self._slowed_by}"
        if cause is ErrorCause.JITTER:
            return "the target rests, but the tool does not"
        if cause is ErrorCause.LATENCY:
            need = self._describe_need()
            return f"its motion cannot be predicted from images so late, rare or unsteady; {need}"
        if self._proportional and not self._was_too_fast:
            return f"proportional control by these gains does not follow; {self._describe_need()}"
        return f"it is too fast for the arm: {self._too_fast_by}"

    def metrics(self) -> dict[str, Number]:
        """``seen_rms_m`` and ``seen_max_m`` since the arrival, ``error_rms_m`` over all time.

        Those that have no value yet are missing; ``max_error_m`` is the bound.
        """
        metrics: dict[str, Number] = {"max_error_m": self.bound}
        if self._time > 0.0:
            metrics["error_rms_m"] = self.rms
        if self._count > 0:
            metrics["seen_rms_m"] = math.sqrt(self._squares / self._count)
            metrics["seen_max_m"] = self.largest
        return metrics

    @property
    def _needed(self) -> float:
        """Largest acceleration of a sinusoidal motion with the target's root mean square."""
        return math.sqrt(2.0) * self.need[1]

    def _describe_need(self) -> str:
        """What the target needs now, and what the arm has."""
        velocity, acceleration = self.need
        hertz = acceleration / max(2.0 * math.pi * velocity, 1e-6)
        need = (
            f"the target needs {self._needed:.2g} m/s² at {hertz:.2g} Hz, the arm has "
            f"{self.limit:.2g} m/s² there"
        )
        if self.speed_share > _AT_LIMIT:
            need += f", and a joint moves at {100.0 * self.speed_share:.0f} % of its velocity limit"
        return need

    @property
    def _was_too_fast(self) -> bool:
        """Whether the target needed more than the arm has, so recently that the arm still lags."""
        return self._newest - self._too_fast_at <= _WINDOW_S

    def _attributed(self, sample: FollowingSample, square: float) -> dict[ErrorCause, float]:
        """Squared error of a sighting in m², shared among prediction and arm."""
        if not sample.within_reach:
            return {ErrorCause.REACH: square}
        late = 0.0
        if sample.predicted is not None:
            off = sample.predicted - sample.target
            late = min(float(off @ off), square)
        if sample.slowed:
            arm = ErrorCause.GUARD
        elif self._proportional or self._was_too_fast:
            arm = ErrorCause.SPEED
        else:
            return {ErrorCause.LATENCY: square}
        return {ErrorCause.LATENCY: late, arm: square - late}

    def _integrate(self, stamp: float, squares: dict[ErrorCause, float]) -> None:
        """Add squared errors, in m², that hold since the last call, if they count."""
        if self.counts_from is not None and self._last is not None:
            passed = stamp - max(self._last, self.counts_from)
            self._time += max(passed, 0.0)
            for cause, square in squares.items():
                self._integrals[cause] += square * max(passed, 0.0)
        self._last = stamp

    def _trembles(self) -> bool:
        """Whether the target has been at rest over the window while the error has varied."""
        if len(self._seen) < _FEWEST:
            return False
        errors = np.array([one.error for one in self._seen])
        varied = float(np.sqrt(errors.var(axis=0).sum()))
        rms = float(np.sqrt(np.mean(np.sum(errors**2, axis=1))))
        spread = np.array([one.target for one in self._seen]).var(axis=0).sum()
        return rms > self.bound and varied > 0.5 * rms and float(np.sqrt(spread)) < _RESTING * rms

    def _keep(self) -> None:
        rms = self._rms(-math.inf)
        if rms > _WINDOW_FACTOR * self.bound:
            self._fail(
                f"the camera saw the target {1000 * rms:.1f} mm off the image center over "
                f"the last second (root mean square; max_error allows {1000 * self.bound:.1f} mm "
                f"over all time, and twice that over a second)",
                rms,
            )

    def _approach(self, stamp: float) -> None:
        rms = self._rms(stamp - _ARRIVED_S)
        if rms <= self.bound and stamp - self._seen[0].stamp >= _ARRIVED_S:
            self.arrived = True
            self._returns = False
            self.counts_from = stamp if self.counts_from is None else self.counts_from
            self._drop(stamp - _ARRIVED_S)
        elif rms < _NEARER * self._least:
            self._least = rms
            self._nearer_at = stamp
        elif rms <= self.bound:
            self._nearer_at = stamp
        elif stamp - self._nearer_at > self._patience:
            self._fail(
                f"for {stamp - self._nearer_at:.1f} s in view the target has come no closer to the "
                f"image center: {1000 * rms:.1f} mm off (root mean square over {_ARRIVED_S} s; "
                f"max_error allows {1000 * self.bound:.1f} mm)",
                rms,
            )

    def _fail(self, reason: str, rms: float) -> None:
        cause = self.cause
        raise Failure(
            "NOT_FOLLOWING",
            f"{reason}: {self.explain(cause)}",
            seen_rms_m=rms,
            max_error_m=self.bound,
            cause=str(cause),
        )

    def _drop(self, before: float) -> None:
        """Drop sightings before a time, but keep enough of them for a mean."""
        while len(self._seen) > _FEWEST and self._seen[0].stamp < before:
            self._seen.popleft()

    def _rms(self, since: float) -> float:
        """Root mean square of the sightings since a time, m."""
        squares = [one.square for one in self._seen if one.stamp >= since]
        if len(squares) < _FEWEST:
            squares = [one.square for one in list(self._seen)[-_FEWEST:]]
        return math.sqrt(math.fsum(squares) / len(squares))
