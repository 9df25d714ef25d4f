"""Marking a motion against the truth that the simulator knows and the arm does not."""

from __future__ import annotations

from array import array

import numpy as np
import scipy

from bt_dualarm.arm.arm import Arm
from bt_dualarm.errors import Number
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.skill.path_sums import LAG_S, OVERLAP, PathSums, Stretch, least_at
from bt_dualarm.skill.visual_servoing import PlaneTracking
from bt_dualarm.spec.plane import Plane

SETTLE_S = 1.0
"""Seconds after the lock from which errors count: before, the tool is still on its way."""

_NEAR_M = 0.3  # an object farther from where the target is believed to be is not the target
_STILL_M = 2e-4  # who moves less has no lag
_MIN_SAMPLES = 8
_MOST = 4608  # samples that are kept as they are: of a minute and a half


class TrackingScore:
    """Compares the tool's path with the true path of the target, in the plane of tracking.

    A constant offset is taken out once: the mean over all samples that count.

    Args:
        arm: Arm that tracks.
        plane: Plane of tracking.
        target: Name of the object; None for the one nearest to where the target is first believed
            to be.

    Of a long motion sums remain, and a path that is the more thinned the longer it is.
    """

    def __init__(self, arm: Arm, plane: Plane, target: str | None) -> None:
        self._arm = arm
        self._axes = np.array(plane.axes)
        self._is_yz = not np.any(self._axes[:, 0])
        self._target = target
        self._from: float | None = None
        self._sampled: float | None = None
        self._gone_s = 0.0
        self._times = array("d")
        self._tool = array("d")
        self._truth = array("d")
        self._sums: PathSums | None = None
        self._summed = 0  # samples of those that are kept

    def sample(self, tracking: PlaneTracking) -> None:
        """Take one sample, once a tick; the clock starts with the first lock."""
        world = self._arm.world
        if self._from is None:
            if not tracking.in_view:
                return
            self._from = self._arm.time + SETTLE_S
            self._target = self._target or self._nearest(tracking.target)
        now = self._arm.time
        since, self._sampled = self._sampled, now
        if self._target is not None and self._target not in world.objects:
            self._gone_s += 0.0 if since is None else now - since
        if self._target not in world.objects or now < self._from:
            return
        if len(self._times) == _MOST:
            self._sum_up(tracking, _MOST - OVERLAP)
        data, tool = world.data, world.arms[self._arm.name].tool_site
        self._times.append(now)
        self._tool.extend(data.site_xpos[tool].tolist())
        self._truth.extend(data.xpos[world.object_body(self._target)].tolist())

    def metrics(self, tracking: PlaneTracking) -> dict[str, Number]:
        """Metrics of the samples; none when nothing was followed long enough.

        ``score_gone_s``, above zero only, is how long what the skill is scored against was not in
        the world; the others are of the rest of the time. They are
        ``plane_rms_m`` and ``plane_max_m`` in the plane, as ``yz_rms_m`` and ``yz_max_m``, too,
        where that is the world's; ``lag_s``; and ``sighting_sd_m``: how far a single sighting is
        off along an axis of the plane, as standard deviation.
        """
        gone: dict[str, Number] = {"score_gone_s": self._gone_s} if self._gone_s > 0.0 else {}
        if len(self._times) < 2:
            return gone
        if self._sums is None:
            tool, truth = _points(self._tool) @ self._axes.T, _points(self._truth) @ self._axes.T
            away = self.errors()
            rms, most = float(np.sqrt(np.mean(away**2))), float(away.max())
            late = lag(truth, tool, float(np.median(np.diff(self._times))))
            spread = self._sighting_sd(*tracking.sightings())
        else:
            self._sum_up(tracking, len(self._times))
            (rms, most), late = self._sums.errors(), self._sums.lag(_STILL_M)
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
    def times(self) -> Vector:
        """Simulated seconds of the samples that `errors` and `paths` have, of shape (n,)."""
        return self._path.times

    def errors(self) -> Vector:
        """Distance from the truth in the plane in m at ``times``, a constant offset aside."""
        path = self._path
        error = (path.tool - path.truth) @ self._axes.T
        if not len(error):
            return np.zeros(0)
        mean = error.mean(axis=0) if self._sums is None else self._axes @ self._sums.offset
        away: Vector = np.linalg.norm(error - mean, axis=1)
        return away

    def paths(self) -> dict[str, Matrix]:
        """``target`` and ``tracked`` in the world, each of shape (n, 3), at ``times``.

        The tool's path is moved by the mean offset, so that the two lie upon each other.
        """
        _, tool, truth = self._path
        if not len(tool):
            return {}
        offset = (tool - truth).mean(axis=0) if self._sums is None else self._sums.offset
        return {"target": truth, "tracked": tool - offset}

    @property
    def _kept(self) -> Stretch:
        """The samples that are kept as they are."""
        return Stretch(np.array(self._times), _points(self._tool), _points(self._truth))

    @property
    def _path(self) -> Stretch:
        """All samples, the older ones thinned."""
        if self._sums is None or self._sums.path is None:
            return self._kept
        return self._sums.path.then(self._kept.part(self._summed))

    def _sum_up(self, tracking: PlaneTracking, end: int) -> None:
        """Sum up samples, and sightings before the last of them, and forget those before."""
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
        times, truth = np.array(self._times), _points(self._truth) @ self._axes.T
        during = (stamps >= times[0]) & (stamps <= times[-1])
        if not during.any():
            return 0.0
        # A straight line between samples 20 ms apart would be wrong by more than a sighting is.
        true = scipy.interpolate.CubicSpline(times, truth)(stamps[during])
        error = points[during] @ self._axes.T - true
        return float(np.sqrt(np.mean(error.var(axis=0))))

    def _nearest(self, point: Vector) -> str | None:
        world = self._arm.world
        away = {
            name: float(np.linalg.norm(world.object_pose(name).position - point))
            for name in world.objects
        }
        name = min(away, key=away.__getitem__, default=None)
        return name if name is not None and away[name] < _NEAR_M else None


def _points(numbers: array[float]) -> Matrix:
    """Points, of shape (n, 3), whose coordinates stand one after the other."""
    return np.array(numbers).reshape(-1, 3)


def lag(leader: Matrix, follower: Matrix, period: float) -> float:
    """Seconds by which the follower is late, by cross-correlation; 0 where nothing moves.

    The shift at which the two differ least where they overlap: plain correlation would favour
    small shifts, as they overlap more.

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
    """Mean square of follower less leader ``shift`` samples earlier, a constant offset aside."""
    n = len(leader)
    late, early = max(shift, 0), max(-shift, 0)
    away = follower[late : n - early] - leader[early : n - late]
    return float(away.var(axis=0).sum())
