"""Scoring of tracking against the true path of the target, which the arm does not know."""

from __future__ import annotations

import math
from array import array
from typing import Final, NamedTuple

import numpy as np
import scipy

from bt_dualarm.arm.arm import Arm
from bt_dualarm.core.errors import Failure, Number
from bt_dualarm.core.pose import Matrix, Vector, camera_pose
from bt_dualarm.skill.tracking import PlaneTracking
from bt_dualarm.trajectory.cubic_spline import cubic_spline

LAG_S: Final = 0.5
"""Largest lag that is searched, s."""

OVERLAP: Final = 256
"""Earlier samples that a stretch has to contain before the new ones."""

_MOST_KEPT: Final = 8192
"""Largest number of samples of the thinned path."""

SETTLE_S = 1.0
"""Seconds after the lock from which errors count: before, the tool is still approaching."""

_NEAR_M = 0.3  # largest distance of the target from its estimate
_STILL_M = 2e-4  # with less motion, no lag is defined
_MIN_SAMPLES = 8
_MOST = 4608  # samples kept at full rate: a minute and a half


class TrackingScore:
    """Compares the tool's path with the target's true path, in the plane of tracking or in space.

    A constant offset, the mean over all samples that count, is subtracted. For a long motion, only
    sums and a thinned path are kept, so memory stays bounded.

    Args:
        arm: Arm that tracks.
        axes: Unit vectors in the world along which the tool follows, of shape (k, 3).
        target: Name of the object; None for the one nearest to the first estimate.
    """

    def __init__(self, arm: Arm, axes: Matrix, target: str | None) -> None:
        self._arm = arm
        self._axes = axes
        self._is_yz = not np.any(self._axes[:, 0])
        self._target = target
        self._from: float | None = None
        self._sampled: float | None = None
        self._gone_s = 0.0
        self._times = array("d")
        self._tool = array("d")
        self._truth = array("d")
        self._judged = Moments(len(axes))
        self._depths = Moments(1)  # of a turning camera, with `_aim_square`: Σ sin² of the angle
        self._aim_square = 0.0
        self._sums: PathSums | None = None
        self._summed = 0  # kept samples that are already in the sums

    def sample(self, tracking: PlaneTracking) -> None:
        """Take one sample, once per tick; the clock starts with the first lock."""
        world = self._arm.world
        if self._from is None:
            if not tracking.in_view:
                return
            self._from = self._arm.time + SETTLE_S
            self._target = self._target or self._nearest(tracking.target)
        now = self._arm.time
        since = self._sampled
        self._sampled = now
        if self._target is not None and self._target not in world.objects:
            self._gone_s += 0.0 if since is None else now - since
        if self._target is None or self._target not in world.objects:
            return
        tool = world.data.site_xpos[world.arms[self._arm.name].tool_site]
        truth = world.object_middle(self._target)
        if tracking.turns:
            tool = self._tracked(tracking, truth)
        if tracking.error.counts_from is not None:
            self._judged.take((self._axes @ (tool - truth))[None])
        if now < self._from:
            return
        if len(self._times) == _MOST:
            self._sum_up(tracking, _MOST - OVERLAP)
        self._times.append(now)
        self._tool.extend(tool.tolist())
        self._truth.extend(truth.tolist())

    def _tracked(self, tracking: PlaneTracking, truth: Vector) -> Vector:
        """Point that has the error of a turning camera, in the axes at the start, of shape (3,), m.

        Constant offsets, such as that between the center of the target and of its face, turn with
        the camera, and so are constant in its axes only.
        """
        world = self._arm.world
        camera = camera_pose(world.data, world.model.camera(f"{self._arm.name}/camera").id)
        seen = camera.rotation_matrix.T @ (truth - camera.position)
        if tracking.error.counts_from is not None:
            self._aim_square += float(seen[:2] @ seen[:2]) / float(seen @ seen)
            self._depths.take(seen[None, 2:])
        tracked: Vector = truth + (tracking.middle - seen) @ self._axes
        return tracked

    def metrics(self, tracking: PlaneTracking) -> dict[str, Number]:
        """Metrics of the samples; none after too short a motion.

        ``score_gone_s``, only if above zero, is the time during which the target was not in the
        world; the others refer to the rest. ``true_rms_m`` is the error in the plane, less its
        mean, while the camera's error counts: it turns a false SUCCESS into a failure.
        ``plane_rms_m`` and ``plane_max_m`` are errors in the plane, or in space, also given as
        ``yz_rms_m`` and ``yz_max_m`` in the world's yz plane; ``lag_s`` is the delay of the tool;
        ``sighting_sd_m`` is the standard deviation of a single sighting along an axis. Of a camera
        that faces its target, ``aim_rms_rad`` is the angle between its optical axis and the true
        target's center, ``distance_rms_m`` the error of the distance, less its mean, and the others
        are in its axes.
        """
        gone: dict[str, Number] = {"score_gone_s": self._gone_s} if self._gone_s > 0.0 else {}
        if self._judged.count > 0:
            gone["true_rms_m"] = self.true_rms
        if self._depths.count > 0:
            gone["aim_rms_rad"] = math.sqrt(self._aim_square / float(self._depths.count))
            gone["distance_rms_m"] = math.sqrt(float(self._depths.variance.sum()))
        if len(self._times) < 2:
            return gone
        if self._sums is None:
            tool = _points(self._tool) @ self._axes.T
            truth = _points(self._truth) @ self._axes.T
            away = self.errors()
            rms = float(np.sqrt(np.mean(away**2)))
            most = float(away.max())
            late = lag(truth, tool, float(np.median(np.diff(self._times))))
            spread = self._sighting_sd(*tracking.sightings())
        else:
            self._sum_up(tracking, len(self._times))
            rms, most = self._sums.errors()
            late = self._sums.lag(_STILL_M)
            spread = self._sums.sighting_sd()
        return {
            **gone,
            **({"yz_rms_m": rms, "yz_max_m": most} if self._is_yz else {}),
            "plane_rms_m": rms,
            "plane_max_m": most,
            "lag_s": late,
            "sighting_sd_m": spread,
        }

    @property
    def true_rms(self) -> float:
        """Root mean square of the true error, less its mean, while errors count, m."""
        return float(np.sqrt(self._judged.variance.sum()))

    def refuse_above_bound(self, tracking: PlaneTracking) -> None:
        """Referee of a SUCCESS by the true path: no motion of the arm depends on it.

        Raises:
            Failure: ``NOT_FOLLOWING``: the true error is above the bound.
        """
        error = tracking.error
        if self.true_rms > error.bound:
            cause = error.cause
            raise Failure(
                "NOT_FOLLOWING",
                f"the tool was {1e3 * self.true_rms:.1f} mm off the true target (root mean square, "
                f"less the mean; max_error allows {1e3 * error.bound:.1f} mm), though the camera "
                f"saw {1e3 * error.rms:.1f} mm: {error.explain(cause)}",
                true_rms_m=self.true_rms,
                max_error_m=error.bound,
                cause=str(cause),
            )

    @property
    def times(self) -> Vector:
        """Simulated seconds of the samples that `errors` and `paths` have, of shape (n,)."""
        return self._path.times

    def errors(self) -> Vector:
        """Error in the plane, m, at ``times``, without the constant offset; of shape (n,)."""
        path = self._path
        error = (path.tool - path.truth) @ self._axes.T
        if not len(error):
            return np.zeros(0)
        mean = error.mean(axis=0) if self._sums is None else self._axes @ self._sums.offset
        away: Vector = np.linalg.norm(error - mean, axis=1)
        return away

    def paths(self) -> dict[str, Matrix]:
        """``target`` and ``tracked`` in the world, each of shape (n, 3), at ``times``.

        The mean offset is subtracted from the tool's path.
        """
        _, tool, truth = self._path
        if not len(tool):
            return {}
        offset = (tool - truth).mean(axis=0) if self._sums is None else self._sums.offset
        return {"target": truth, "tracked": tool - offset}

    @property
    def _kept(self) -> Stretch:
        """Samples that are kept in full."""
        return Stretch(np.array(self._times), _points(self._tool), _points(self._truth))

    @property
    def _path(self) -> Stretch:
        """All samples, the older ones thinned."""
        if self._sums is None or self._sums.path is None:
            return self._kept
        return self._sums.path.then(self._kept.part(self._summed))

    def _sum_up(self, tracking: PlaneTracking, end: int) -> None:
        """Add samples up to ``end``, and sightings of that time, to the sums."""
        kept = self._kept
        if self._sums is None:
            self._sums = PathSums(self._axes, float(np.median(np.diff(kept.times))))
        self._sums.take(kept, self._summed, end)
        stamps, points = tracking.sightings()
        during = (stamps >= kept.times[0]) & (stamps <= kept.times[end - 1])
        self._sums.see(kept, stamps[during], points[during])
        tracking.forget_sightings(float(kept.times[end - 1]))
        gone = max(end - OVERLAP, 0)
        self._summed = end - gone
        del self._times[:gone], self._tool[: 3 * gone], self._truth[: 3 * gone]

    def _sighting_sd(self, stamps: Vector, points: Matrix) -> float:
        times = np.array(self._times)
        truth = _points(self._truth) @ self._axes.T
        during = (stamps >= times[0]) & (stamps <= times[-1])
        if not during.any():
            return 0.0
        # Linear interpolation over 20 ms would have a larger error than a sighting.
        true = cubic_spline(times, truth)(stamps[during])
        error = points[during] @ self._axes.T - true
        return float(np.sqrt(np.mean(error.var(axis=0))))

    def _nearest(self, point: Vector) -> str | None:
        world = self._arm.world
        away = {
            name: float(np.linalg.norm(world.object_middle(name) - point)) for name in world.objects
        }
        name = min(away, key=away.__getitem__, default=None)
        return name if name is not None and away[name] < _NEAR_M else None


def _points(numbers: array[float]) -> Matrix:
    """Points of shape (n, 3) from a flat array of coordinates."""
    return np.array(numbers).reshape(-1, 3)


def lag(leader: Matrix, follower: Matrix, period: float) -> float:
    """Delay of the follower, s, by the shift with the smallest difference; 0 if nothing moves.

    The mean difference over the overlap is used, since plain cross-correlation would favor small
    shifts, which overlap more.

    Args:
        leader: Samples of shape (n, k), evenly spaced.
        follower: Samples of shape (n, k), at the same times.
        period: Seconds between samples.
    """
    if float(np.ptp(leader, axis=0).max()) < _STILL_M or len(leader) < _MIN_SAMPLES:
        return 0.0
    most = min(round(LAG_S / period), len(leader) // 2)
    shifts = range(-most, most + 1)
    differences = [_difference(leader, follower, shift) for shift in shifts]
    return least_at(np.array(differences), period)


def _difference(leader: Matrix, follower: Matrix, shift: int) -> float:
    """Variance of the follower minus the leader ``shift`` samples earlier."""
    n = len(leader)
    late = max(shift, 0)
    early = max(-shift, 0)
    away = follower[late : n - early] - leader[early : n - late]
    return float(away.var(axis=0).sum())


class Stretch(NamedTuple):
    """Consecutive samples of a motion.

    Attributes:
        times: Simulated seconds, of shape (n,).
        tool: Positions of the tool in the world, of shape (n, 3), m.
        truth: True positions of the target in the world, of shape (n, 3), m.
    """

    times: Vector
    tool: Matrix
    truth: Matrix

    def part(self, begin: int, end: int | None = None, step: int = 1) -> Stretch:
        """Slice of the samples."""
        some = slice(begin, end, step)
        return Stretch(self.times[some], self.tool[some], self.truth[some])

    def then(self, other: Stretch) -> Stretch:
        """Concatenation with later samples."""
        pairs = zip(self, other, strict=True)
        return Stretch(*(np.concatenate(pair) for pair in pairs))


class Moments:
    """Running count, mean and variance of points along each axis.

    Args:
        shape: Shape of the mean.
    """

    def __init__(self, *shape: int) -> None:
        self.count = np.zeros(shape[:-1])
        self.mean = np.zeros(shape)
        self._squares = np.zeros(shape)

    @property
    def variance(self) -> Vector:
        """Variance along each axis, of the shape of the mean."""
        variance: Vector = self._squares / np.maximum(self.count, 1.0)[..., None]
        return variance

    def take(self, points: Matrix, at: int | tuple[()] = ()) -> None:
        """Add points of shape (n, k), with the pairwise update of Chan et al. (1979)."""
        if not len(points):
            return
        count = self.count[at]
        total = count + len(points)
        if len(points) == 1:  # at each tick: NumPy's mean and variance cost ten times as much
            mean = points[0]
        else:
            mean = points.mean(axis=0)
            self._squares[at] += len(points) * points.var(axis=0)
        apart = mean - self.mean[at]
        self._squares[at] += apart**2 * (count * len(points) / total)
        self.mean[at] += apart * (len(points) / total)
        self.count[at] = total


class PathSums:
    """Error and lag sums of a motion that is added piece by piece, in constant memory.

    Args:
        axes: Unit vectors in the world along which the tool follows, of shape (k, 3).
        period: Seconds between samples.
    """

    def __init__(self, axes: Matrix, period: float) -> None:
        self._axes = axes
        self._period = period
        self._most = min(round(LAG_S / period), OVERLAP)
        self.path: Stretch | None = None
        self._stride = 1
        self._taken = 0
        self._errors = Moments(len(axes))
        self._sightings = Moments(len(axes))
        self._lags = Moments(2 * self._most + 1, len(axes))
        self._offsets = Moments(3)
        self._outermost = np.zeros((0, len(axes)))
        self._low = np.full(len(axes), np.inf)
        self._high = np.full(len(axes), -np.inf)

    @property
    def offset(self) -> Vector:
        """Mean vector from the target to the tool, of shape (3,), m."""
        return self._offsets.mean

    def take(self, stretch: Stretch, begin: int, end: int) -> None:
        """Add the samples from `begin` to before `end` of a stretch.

        Before `begin` the stretch has to contain `OVERLAP` samples, or all earlier ones.
        """
        new = stretch.part(begin, end)
        leader = stretch.truth @ self._axes.T
        follower = stretch.tool @ self._axes.T
        error = follower[begin:end] - leader[begin:end]
        self._errors.take(error)
        self._offsets.take(new.tool - new.truth)
        self._outermost = _outermost(np.vstack((self._outermost, error)))
        self._low = np.minimum(self._low, leader[begin:end].min(axis=0, initial=np.inf))
        self._high = np.maximum(self._high, leader[begin:end].max(axis=0, initial=-np.inf))
        for shift in range(-self._most, self._most + 1):
            late = max(shift, 0)
            early = max(-shift, 0)
            first = max(begin, late + early)
            away = follower[first - early : end - early] - leader[first - late : end - late]
            self._lags.take(away, shift + self._most)
        self._thin(new)

    def see(self, stretch: Stretch, stamps: Vector, points: Matrix) -> None:
        """Add sightings, of shapes (n,) and (n, 3), within the time of a stretch."""
        if len(stamps):
            # Linear interpolation over 20 ms would have a larger error than a sighting.
            truth = cubic_spline(stretch.times, stretch.truth @ self._axes.T)
            self._sightings.take(points @ self._axes.T - truth(stamps))

    def errors(self) -> tuple[float, float]:
        """Root mean square and maximum of the errors without their mean, m."""
        rms = float(np.sqrt(self._errors.variance.sum()))
        return rms, float(np.linalg.norm(self._outermost - self._errors.mean, axis=1).max())

    def lag(self, still: float) -> float:
        """Delay of the tool, s; 0 if the target moves no farther than `still`, m."""
        if float((self._high - self._low).max()) < still:
            return 0.0
        return least_at(self._lags.variance.sum(axis=1), self._period)

    def sighting_sd(self) -> float:
        """Standard deviation of a sighting along an axis, m."""
        return float(np.sqrt(np.mean(self._sightings.variance)))

    def _thin(self, new: Stretch) -> None:
        kept = new.part(-self._taken % self._stride, None, self._stride)
        self._taken += len(new.times)
        self.path = kept if self.path is None else self.path.then(kept)
        while len(self.path.times) > _MOST_KEPT:
            self.path = self.path.part(0, None, 2)
            self._stride *= 2


def least_at(differences: Vector, period: float) -> float:
    """Lag, s, with the smallest difference, by a parabola through it and its neighbors.

    Args:
        differences: Difference at each shift, from the most negative one on.
        period: Seconds between samples.
    """
    best = int(np.argmin(differences))
    middle = len(differences) // 2
    if not 0 < best < len(differences) - 1:
        return float((best - middle) * period)
    left, least, right = differences[best - 1 : best + 2]
    vertex = 0.5 * (left - right) / (left - 2 * least + right)
    return float((best - middle + vertex) * period)


def _outermost(points: Matrix) -> Matrix:
    """Corners of the convex hull of points, of shape (n, k): the farthest from any point is one."""
    try:
        outer: Matrix = points[scipy.spatial.ConvexHull(points).vertices]
    except scipy.spatial.QhullError:  # on a line, or too few
        ends = [*points.argmin(axis=0), *points.argmax(axis=0)]
        outer = points[np.unique(ends)]
    return outer
