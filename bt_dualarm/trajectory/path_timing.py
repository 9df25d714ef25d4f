"""Timing of motions with bounded velocity, acceleration and jerk.

A joint path is timed in three steps:

1. TOPP-RA finds the fastest motion under velocity and acceleration limits (Pham and Pham, A new
   approach to time-optimal path parameterization based on reachability analysis, T-RO 2018): a
   backward pass finds at each grid point the largest speed from which the end can still be reached
   at rest, a forward pass takes the largest acceleration that stays below it.
2. The acceleration of that motion jumps. A moving average of its path parameter over time bounds
   the jerk, and keeps every set-point on the path.
3. Time is stretched until the averaged motion keeps all limits. Of all widths of the average, the
   one with the shortest result is taken; then acceleration is redistributed along the path.

`timed_path` is the entry point; its kernels are in `trajectory_kernels`. Motions from point to
point, and to rest, are computed by Ruckig.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt
import ruckig

from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.robots.robot import JointLimits
from bt_dualarm.trajectory.cubic_spline import cubic_spline
from bt_dualarm.trajectory.kernel_arrays import Parabolas, PathOnGrid, Spline
from bt_dualarm.trajectory.trajectory import (
    LONG,
    Rows,
    SetPoints,
    SharesOfLimits,
    Trajectory,
    TrajectoryProtocol,
    joined,
    shares_at,
    shares_of_limits,
)

_STILL = 1e-12
"""Slope dq/ds in rad below which a joint does not bound the path speed."""

_WIDTHS = (14, 7)
"""Number of averaging widths in the coarse search, and in the fine search around the best one."""

_RAMP = 1.1
"""An additional width, as a multiple of the time in which a joint reaches its full acceleration:
too narrow where the acceleration changes sign, but it costs little time at start and end."""

_NODES = 4000
"""Maximum number of samples at which a motion is evaluated; otherwise two per set-point, as the
set-points change their times when time is stretched."""

_NARROWEST = 2.0 / _NODES
"""Minimum width of the average over a long motion, as a fraction of its duration: samples must not
step over what happens within a width."""

_ROUNDS = 10
"""Maximum number of redistributions of the acceleration along a path."""

_IDLE = 3
"""Rounds without improvement after which the search ends."""

_BOUNDED_INTERVALS = 1500
"""Number of grid intervals of a path with a bound of its own: 0.05 mm on a descent of 70 mm."""

_GAIN = 0.55
"""Exponent of a redistribution: a larger one oscillates, a smaller one takes more rounds."""

_BACK = 1.15
"""Largest factor by which a grid point's acceleration share grows in one round."""

_SHORT = 1.01
"""Ratio to the duration without jerk limits below which the search ends."""

_EVALUATED = 30_000
"""Number of set-points of a long motion that are evaluated for the final stretch."""

_SAME_RAD = 1e-9
"""Joint distance below which two configurations are the same, rad."""

_ROUNDING_RAD = 1e-6
"""Most by which a configuration may be beyond a position limit, to which it is then moved, rad."""

_SWING = 0.5
"""Largest swing of a spline beyond its samples, as a fraction of the largest step between two."""

_INWARD = 5.0
"""Largest move of a sample inward from a limit, as a multiple of the swing beyond it."""

_INWARD_ROUNDS = 12
"""Maximum number of times that samples are moved inward from a limit."""

_MARGIN = 1.0 + 1e-4
"""Additional stretch, so that few rounds are needed."""

_LONG_MARGIN = 1.0 + 1e-3
"""Additional stretch of a long motion, of which not every set-point is evaluated."""


class TimedPath(NamedTuple):
    """Motion along a path.

    Attributes:
        motion: Set-points from rest to rest.
        shortest_s: Lower bound of the duration without a jerk limit, by TOPP-RA, s.
    """

    motion: Trajectory
    shortest_s: float


def timed_path(
    q_samples: Matrix, limits: JointLimits, dt: float, closed: bool = False
) -> TimedPath:
    """Motion along a path from rest to rest within the limits.

    Set-points are on the cubic spline through the samples. Where its direction changes by more than
    90° from one sample to the next, the arm stops. A path of zero length gives one set-point.

    Args:
        q_samples: Configurations along the path, of shape (n, dof), rad, dense enough that the
            spline through them is the path; repetitions are ignored.
        limits: Position, velocity, acceleration and jerk limits.
        dt: Time between set-points, s.
        closed: Whether the path ends where it starts and is smooth there.

    Raises:
        ValueError: A sample is not finite or outside the position limits.
    """
    samples = _distinct(_checked(q_samples, limits))
    optimal = [TimeOptimal(path, limits) for path in _pieces(samples, limits, closed)]
    pieces = [_timed(piece, limits, dt) for piece in optimal]
    # A path of zero length has no pieces: the first set-point stands alone.
    motion = joined(dt, (Trajectory.rest(samples[0], dt), *pieces))
    return TimedPath(motion, sum(piece.fastest.duration for piece in optimal))


def time_path(
    q_samples: Matrix, limits: JointLimits, dt: float, closed: bool = False
) -> Trajectory:
    """Motion of `timed_path` without the lower bound."""
    return timed_path(q_samples, limits, dt, closed).motion


SpeedBound: TypeAlias = Callable[[Vector], Vector]
"""Highest speeds of the tool, m/s, at lengths of its path, m; both of shape (n,)."""


def time_path_below(
    q_samples: Matrix, lengths: Vector, most_m_s: SpeedBound, limits: JointLimits, dt: float
) -> Trajectory:
    """Motion along a path from rest to rest within the limits, below a speed that varies along it.

    The moving average that bounds the jerk smooths the speed: where the bound falls suddenly, the
    tool is faster for half of the averaging time.

    Args:
        q_samples: Configurations as for `timed_path`.
        lengths: Length of the tool's path up to each of them, of shape (n,), m, increasing.
        most_m_s: Highest speed of the tool, positive.
        limits: Position, velocity, acceleration and jerk limits.
        dt: Time between set-points, s.

    Raises:
        ValueError: As `timed_path`.
    """
    samples = _checked(q_samples, limits)
    moves = np.any(np.abs(np.diff(samples, axis=0)) > _SAME_RAD, axis=1)
    kept = np.insert(moves, 0, True)
    samples = samples[kept]
    lengths = lengths[kept]
    ends = [0, *_reversals(samples, limits), len(samples) - 1]
    parts = []
    for first, last in itertools.pairwise(ends):
        if last == first:
            continue
        path = spline_through(samples[first : last + 1], limits, closed=False)
        measured = cubic_spline(path.knots, lengths[first : last + 1, None])

        def most_rate(s: Vector, measured: Spline = measured) -> Vector:
            # The tool's speed is the rate of s times the length of its path per s.
            rates: Vector = most_m_s(measured(s)[:, 0]) / measured(s, 1)[:, 0].clip(_STILL)
            return rates

        optimal = TimeOptimal(path, limits, most_rate)
        # A wider average would carry the speed on to where less is allowed.
        search = _Search(optimal, limits, dt)
        parts.append(_keeping(*search.of_width(search.ramp), limits, dt))
    return joined(dt, (Trajectory.rest(samples[0], dt), *parts))


def _pieces(samples: Matrix, limits: JointLimits, closed: bool) -> list[Spline]:
    """Splines from stop to stop; none if the path has no length."""
    # A periodic spline needs the whole path in one piece.
    ends = [0, *_reversals(samples, limits), len(samples) - 1]
    closed = closed and len(ends) == 2
    return [
        spline_through(samples[first : last + 1], limits, closed)
        for first, last in itertools.pairwise(ends)
        if last > first
    ]


def _timed(optimal: TimeOptimal, limits: JointLimits, dt: float) -> TrajectoryProtocol:
    """Jerk-limited motion along one piece, stretched until all set-points keep the limits."""
    return _keeping(*shortest_motion(optimal, limits, dt), limits, dt)


def _keeping(
    average: AveragedMotion, stretch: float, limits: JointLimits, dt: float
) -> TrajectoryProtocol:
    """An averaged motion, stretched until all set-points keep the limits."""
    motion = StretchedMotion(average, dt, stretch)
    if len(motion) > LONG:
        motion = StretchedMotion(average, dt, stretch * _LONG_MARGIN)
    # Set-points fall on other points of the path after stretching: check again until they keep the
    # limits.
    while True:
        excess = stretch_of(motion, limits)
        if excess <= 1.0:
            return motion
        motion = StretchedMotion(average, dt, motion.stretch * (excess * _MARGIN))


def _reversals(samples: Matrix, limits: JointLimits) -> list[int]:
    """Samples at which the direction in joint space changes by more than 90°."""
    # Scaled by the velocity limits, so that fast wrist joints do not dominate the angle.
    steps = np.diff(samples, axis=0) / limits.velocity
    back = (steps[1:] * steps[:-1]).sum(axis=1) < 0.0
    return [int(i) + 1 for i in np.flatnonzero(back)]


def _checked(q_samples: Matrix, limits: JointLimits) -> Matrix:
    samples = np.atleast_2d(np.asarray(q_samples, dtype=float))
    if samples.shape[-1] != len(limits.lower):
        raise ValueError(
            f"the path has the shape {samples.shape}: it needs {len(limits.lower)} angles in each "
            "configuration"
        )
    if not np.isfinite(samples).all():
        raise ValueError("a configuration of the path is not finite")
    beyond = float(np.maximum(limits.lower - samples, samples - limits.upper).max(initial=-np.inf))
    if beyond > _ROUNDING_RAD:
        raise ValueError("a configuration of the path is outside the position limits")
    # Inverse kinematics that ends at a limit may be beyond it by its own rounding.
    return np.clip(samples, limits.lower, limits.upper) if beyond > _SAME_RAD else samples


def _distinct(samples: Matrix) -> Matrix:
    """Samples without repetitions of the previous one."""
    moves: npt.NDArray[np.bool_] = np.any(np.abs(np.diff(samples, axis=0)) > _SAME_RAD, axis=1)
    if not moves[-1:].all() or not (moves[1:] | moves[:-1]).all():
        return _one_by_one(samples)
    distinct: Matrix = samples[np.insert(moves, 0, True)]
    return distinct


def _one_by_one(samples: Matrix) -> Matrix:
    """Result of `_distinct` for several close samples in a row, or close ones at the end.

    Each sample is compared with the last one that was kept; the end point is always kept.
    """
    kept = [0]
    for i in range(1, len(samples)):
        if np.abs(samples[i] - samples[kept[-1]]).max() > _SAME_RAD:
            kept.append(i)
    kept[-1] = len(samples) - 1 if len(kept) > 1 else 0
    return samples[kept]


def spline_through(samples: Matrix, limits: JointLimits, closed: bool) -> Spline:
    """Cubic spline over the path length, each joint scaled by its velocity limit.

    The Euclidean norm makes this length smooth along the path. With the maximum over joints it
    would have kinks where the fastest joint changes, which would cost jerk.

    Where a joint turns off at a position limit and stays there, the spline would swing beyond it:
    samples near the limit are moved inward by a few times as much, if that keeps it within.
    """
    steps = np.diff(samples, axis=0)
    s = np.concatenate(((0.0,), np.cumsum(np.linalg.norm(steps / limits.velocity, axis=1))))
    closed = closed and len(samples) > 3
    if closed:
        samples = samples.copy()
        samples[-1] = samples[0]
    path = cubic_spline(s, samples, closed=closed)
    swing = _SWING * np.abs(steps).max(axis=0)
    if ((samples > limits.lower + swing) & (samples < limits.upper - swing)).all():
        return path
    inside, inward = path, np.zeros((2, samples.shape[1]))
    most = _INWARD * np.maximum(_beyond(path, limits), _ROUNDING_RAD)
    for round_ in range(_INWARD_ROUNDS):
        beyond = _beyond(inside, limits)
        if not (beyond > _SAME_RAD).any():
            return inside
        # Ever farther than the spline is beyond: next to an end, it hardly follows.
        inward += np.where(beyond > _SAME_RAD, 2.0**round_ * beyond + _ROUNDING_RAD, 0.0)
        if (inward > most).any():
            break
        moved = samples.clip(limits.lower + inward[0], limits.upper - inward[1])
        moved[[0, -1]] = samples[[0, -1]]  # where the arm is, and where it has to arrive
        inside = cubic_spline(s, moved, closed=closed)
    return path


def _beyond(path: Spline, limits: JointLimits) -> Matrix:
    """Distance by which a spline exceeds the lower and the upper position limits, rad.

    Returns:
        Shape (2, dof); zero or less within the limits.
    """
    width = np.diff(path.knots)[:, None]
    a, b, c, d = (path.pieces[:, i] for i in range(4))
    # Where the derivative 3 a t² + 2 b t + c is zero, also if a is.
    with np.errstate(divide="ignore", invalid="ignore"):
        root = -(b + np.copysign(np.sqrt(b * b - 3.0 * a * c), b))
        times = np.stack(
            (root / (3.0 * a), c / root, np.zeros_like(a), np.broadcast_to(width, a.shape))
        )
    times = np.where(np.isfinite(times), np.clip(times, 0.0, width), 0.0)
    values = ((a * times + b) * times + c) * times + d
    return np.stack(
        (limits.lower - values.min(axis=(0, 1)), values.max(axis=(0, 1)) - limits.upper)
    )


def shortest_motion(
    optimal: TimeOptimal, limits: JointLimits, dt: float
) -> tuple[AveragedMotion, float]:
    """Shortest jerk-limited motion found along a path, and the time stretch that it needs.

    The worst point determines the stretch of the whole motion. At such points (tips of narrow
    curves, changes from acceleration to deceleration) the acceleration is reduced, and the
    time-optimal motion computed again.

    Args:
        optimal: Fastest motions along the path without a jerk limit.
        limits: Velocity, acceleration and jerk limits.
        dt: Time between set-points, s.
    """
    return _Search(optimal, limits, dt).shortest()


class _Search:
    """Search of `shortest_motion` along one path."""

    def __init__(self, optimal: TimeOptimal, limits: JointLimits, dt: float) -> None:
        self._optimal = optimal
        self._dt = dt
        self._path = optimal.path
        self._limits = np.array((limits.velocity, limits.acceleration, limits.jerk))
        self.ramp = _RAMP * float((limits.acceleration / limits.jerk).max())

    def shortest(self) -> tuple[AveragedMotion, float]:
        """Result of `shortest_motion`."""
        fastest = self._optimal.fastest
        best, stretch = self._best_width(fastest)
        narrowest = self._narrowest(fastest)
        # Redistribute from the additional width as well as from the best one.
        for width in (max(self.ramp, narrowest), best.width):
            if best.unstretched * stretch < _SHORT * fastest.duration:
                break
            tried, needed = self.of_width(width)
            if tried.unstretched * needed < best.unstretched * stretch:
                return tried, needed
        return best, stretch

    def of_width(self, width: float) -> tuple[AveragedMotion, float]:
        """Shortest motion found with an averaging width in s, and the time stretch it needs."""
        return self._redistributed(AveragedMotion(self._path, self._optimal.fastest, width))

    def _best_width(self, profile: Profile) -> tuple[AveragedMotion, float]:
        """Motion with the best averaging width, and the time stretch that it needs."""
        low = min(self._narrowest(profile), 0.1 * profile.duration)
        high = 2.0 * profile.duration
        best = AveragedMotion(self._path, profile, high)
        stretch = np.inf
        least = np.inf
        for count in _WIDTHS:
            for width in np.geomspace(low, high, count).tolist():
                motion = AveragedMotion(self._path, profile, width)
                # A width that is worse than the best one so far is abandoned at its first excess.
                needed = float(self._stretch_needed(motion, least / motion.unstretched)[1].max())
                if motion.unstretched * needed < least:
                    best = motion
                    stretch = needed
                    least = motion.unstretched * needed
            # One coarse step on both sides of the best width.
            reach = (high / low) ** (1.0 / (count - 1))
            low = best.width / reach
            high = best.width * reach
        return best, stretch

    def _narrowest(self, profile: Profile) -> float:
        """Minimum width of the average, s: one period, or more for a long motion."""
        dt = self._dt
        duration = profile.duration
        return dt if duration <= LONG * dt else max(dt, _NARROWEST * duration)

    def _redistributed(self, motion: AveragedMotion) -> tuple[AveragedMotion, float]:
        """Shortest motion of the same width, and the time stretch that it needs."""
        share = np.ones_like(self._optimal.grid)
        best = motion
        least = float("inf")
        since = 0
        for _ in range(_ROUNDS):
            places, needed = self._stretch_needed(motion)
            stretch = float(needed.max())
            since += 1
            # Less than 0.2 % is not an improvement.
            if motion.unstretched * stretch < 0.998 * best.unstretched * least:
                best = motion
                least = stretch
                since = 0
            if since == _IDLE:
                break
            share = np.clip(share * self._shares_needed(motion, places, needed), 1e-2, 1.0)
            motion = AveragedMotion(self._path, self._optimal.profile(share), motion.width)
        return best, least

    def _stretch_needed(
        self, motion: AveragedMotion, most: float = np.inf
    ) -> tuple[Vector, Vector]:
        """Path parameters, and the time stretch that is needed there, of shape (n,) each.

        Ends at the first one that needs more than ``most``.
        """
        from bt_dualarm.trajectory.trajectory_kernels import (
            write_average,
            write_joints,
            write_shares,
        )

        # Two samples per set-point, fewer for a long motion, but at least one per width.
        step = min(max(0.5 * self._dt, motion.unstretched / _NODES), motion.width)
        count = len(StretchedMotion(motion, step, 1.0))
        course = np.empty((3, count))
        shares = np.empty((3, count))
        v = np.empty((count, self._limits.shape[1]))
        a = np.empty((count, self._limits.shape[1]))
        profile = motion.profile
        parabolas = Parabolas(profile.time, profile.place, profile.rate, *profile.pieces)
        write_average(parabolas, motion.width, step, course)
        write_joints(self._path, course, v, a)
        count = write_shares(v, a, step, self._limits, most, shares)
        velocity, acceleration, jerk = shares[:, :count]
        return course[0, :count], _needed((velocity, acceleration, jerk))

    def _shares_needed(self, motion: AveragedMotion, places: Vector, needed: Vector) -> Vector:
        """Factors of the acceleration share at each grid point, of shape (n,)."""
        # A set-point is an average over the width: every point within it contributes.
        reach = max(int(0.5 * motion.width / motion.unstretched * len(needed)), 1)
        responsible = largest_within(needed, reach)
        # Stretching time by r divides accelerations by r².
        shares: Vector = np.interp(self._optimal.grid, places, responsible) ** (-2.0 * _GAIN)
        return np.clip(shares, 1e-2, _BACK)


def largest_within(values: Vector, reach: int) -> Vector:
    """Largest of each value and its neighbors, of the shape of the values, (n,).

    SciPy's ``maximum_filter1d`` is in a package that takes longer to import than a path to time.

    Args:
        values: Numbers, of shape (n,).
        reach: How many neighbors count on each side, at least 1.
    """
    largest = np.pad(values, reach, constant_values=-np.inf)
    window = 1
    while 2 * window <= 2 * reach + 1:
        largest = np.maximum(largest[:-window], largest[window:])
        window *= 2
    rest = 2 * reach + 1 - window  # two overlapping windows make the last one
    whole: Vector = np.maximum(largest[: len(largest) - rest], largest[rest:])
    return whole


class TimeOptimal:
    """Fastest motions along a path under velocity and acceleration limits, by TOPP-RA.

    Args:
        path: Joint positions in rad over a path parameter that starts at zero.
        limits: Velocity and acceleration limits; jerk is not considered.
        most_rate: Bound of ds/dt at path parameters, in addition.

    Attributes:
        path: The path.
        grid: Path parameters of the grid points, of shape (n,).
    """

    def __init__(
        self,
        path: Spline,
        limits: JointLimits,
        most_rate: Callable[[Vector], Vector] | None = None,
    ) -> None:
        self.path = path
        # Eight grid intervals per sample resolve a path that bends at each sample; paths with many
        # samples are smooth, so that two are sufficient.
        samples = len(path.knots)
        intervals = min(max(200, 2 * samples, min(8 * samples, 500)), 1500)
        if most_rate is not None:
            intervals = _BOUNDED_INTERVALS
        self.grid = np.linspace(0.0, path.knots[-1], intervals + 1)
        slope = path(self.grid, 1)
        fastest = (limits.velocity / np.maximum(np.abs(slope), _STILL)).min(axis=1)
        if most_rate is not None:
            fastest = np.minimum(fastest, most_rate(self.grid))
        self._on_grid = PathOnGrid(self.grid, slope, path(self.grid, 2), fastest**2)
        self._acceleration = limits.acceleration

    @cached_property
    def fastest(self) -> Profile:
        """Fastest motion with all of the acceleration: a lower bound for any other."""
        return self.profile(np.ones_like(self.grid))

    def profile(self, share: Vector) -> Profile:
        """Fastest rest-to-rest motion with a share of the acceleration limits.

        Args:
            share: Share that may be used at each grid point, of shape (n,), in (0, 1].
        """
        from bt_dualarm.trajectory.trajectory_kernels import squares_of_rates

        squares = squares_of_rates(self._on_grid, self._acceleration, share)
        return Profile.from_rates(self.grid, np.sqrt(squares))


@dataclass(frozen=True, eq=False)
class Profile:
    """Path parameter s over time, with constant d²s/dt² between knots, at rest at both ends.

    Attributes:
        time: Knots, of shape (n,), s, increasing from zero.
        place: Path parameter s at the knots, of shape (n,).
        rate: Path speed ds/dt at the knots, of shape (n,).
    """

    time: Vector
    place: Vector
    rate: Vector

    @classmethod
    def from_rates(cls, place: Vector, rate: Vector) -> Profile:
        """Profile from ds/dt as a function of s; zero only at the ends."""
        steps = 2.0 * np.diff(place) / (rate[1:] + rate[:-1])
        return cls(np.concatenate(((0.0,), np.cumsum(steps))), place, rate)

    @property
    def duration(self) -> float:
        """Time from start to end, s."""
        return float(self.time[-1])

    def smoothed(self, times: Vector, width: float) -> tuple[Vector, Vector, Vector]:
        """s, ds/dt and d²s/dt² of the moving average over ``width`` seconds, at ``times``.

        At rest before zero and after ``duration + width``. Its third derivative is bounded by the
        change of d²s/dt² within ``width``, divided by ``width``. As only s is averaged, every point
        remains on the path (Biagiotti and Melchiorri 2012: multi-segment trajectories as filters).
        """
        # The average of s is the difference of its integral at both ends, divided by the width.
        now = self._integrals(times)
        before = self._integrals(times - width)
        area, place, rate = (
            (late - early) / width for late, early in zip(now, before, strict=True)
        )
        return area, place, rate

    def _integrals(self, times: Vector) -> tuple[Vector, Vector, Vector]:
        """Integral of s, s, and ds/dt at times that may be before or after the profile."""
        inside = np.clip(times, 0.0, self.duration)
        i = np.clip(np.searchsorted(self.time, inside, side="right") - 1, 0, len(self.time) - 2)
        bends, areas = self.pieces
        t = inside - self.time[i]
        rate_at = self.rate[i]
        place_at = self.place[i]
        bend = bends[i]
        rate = rate_at + bend * t
        place = place_at + (rate_at + bend * t / 2.0) * t
        area = areas[i] + (place_at + (rate_at / 2.0 + bend * t / 6.0) * t) * t
        area += (times > self.duration) * (times - inside) * self.place[-1]
        return area, place, rate

    @cached_property
    def pieces(self) -> tuple[Vector, Vector]:
        """d²s/dt² after each knot, (n - 1,), and the integral of s up to each knot, (n,)."""
        step = np.diff(self.time)
        bend = np.diff(self.rate) / step
        areas = (self.place[:-1] + (self.rate[:-1] / 2.0 + bend * step / 6.0) * step) * step
        return bend, np.concatenate(((0.0,), np.cumsum(areas)))


@dataclass(frozen=True, eq=False)
class AveragedMotion:
    """Path, profile along it, and width of the moving average over the profile in s."""

    path: Spline
    profile: Profile
    width: float

    @property
    def unstretched(self) -> float:
        """Duration before time is stretched, s."""
        return self.profile.duration + self.width

    def derivatives(self, s: Vector, rate: Matrix, bend: Matrix) -> tuple[Matrix, Matrix]:
        """Joint velocities and accelerations, each of shape (n, dof), by the chain rule.

        Args:
            s: Path parameters, of shape (n,).
            rate: ds/dt, of shape (n, 1).
            bend: d²s/dt², of shape (n, 1).
        """
        q1 = self.path(s, 1)
        q2 = self.path(s, 2)
        return q1 * rate, q1 * bend + q2 * rate**2


@dataclass(frozen=True, eq=False)
class StretchedMotion:
    """Set-points of an averaged motion with stretched time, see `TrajectoryProtocol`.

    Attributes:
        motion: Averaged motion.
        dt: Time between set-points, s.
        stretch: Factor of the duration.
    """

    motion: AveragedMotion
    dt: float
    stretch: float

    def __len__(self) -> int:
        duration = self.motion.unstretched * self.stretch
        return max(int(np.ceil(duration / self.dt - 1e-9)), 1) + 1

    def rows(self, index: Rows) -> SetPoints:
        """Positions, velocities and accelerations of some set-points, each of shape (n, dof)."""
        motion = self.motion
        stretch = self.stretch
        times = np.minimum(index * self.dt / stretch, motion.unstretched)
        s, rate, bend = motion.profile.smoothed(times, motion.width)
        rate = rate[:, None] / stretch
        bend = bend[:, None] / stretch**2
        ends = (index == 0) | (index == len(self) - 1)
        rate[ends] = 0.0  # exactly at rest: the average leaves a rounding error
        bend[ends] = 0.0
        return (motion.path(s), *motion.derivatives(s, rate, bend))

    def whole(self) -> Trajectory:
        """All set-points at once."""
        return Trajectory(self.dt, *self.rows(np.arange(len(self))))


def stretch_of(motion: StretchedMotion, limits: JointLimits) -> float:
    """Further time stretch that is needed to keep the limits; at most 1 if they are kept.

    Only some set-points of a long motion are evaluated, each with the next: it is smooth in
    between.
    """
    if len(motion) <= LONG:
        return float(stretches(motion.whole(), limits).max())
    index = np.linspace(0, len(motion) - 1, _EVALUATED).astype(int)
    return float(_needed(shares_at(motion, index, motion.dt, limits)).max())


def stretches(motion: Trajectory, limits: JointLimits) -> Vector:
    """Time stretch that each set-point needs to keep the limits, of shape (n,)."""
    return _needed(shares_of_limits(motion, limits))


def _needed(shares: SharesOfLimits) -> Vector:
    """Time stretch from shares of the limits, of shape (n,)."""
    # A stretch by r divides velocity by r, acceleration by r² and jerk by r³.
    velocity, acceleration, jerk = shares
    needed: Vector = np.maximum(np.maximum(velocity, np.sqrt(acceleration)), np.cbrt(jerk))
    return needed


def warm_up_timing() -> None:
    """Compile the timing kernels, by timing a short path."""
    far = np.full(2, np.inf)
    limits = JointLimits(-far, far, *np.ones((4, 2)))
    time_path(np.array(((0.0, 0.0), (0.5, 0.2), (1.0, 1.0))), limits, dt=0.1)


__all__ = ["TimedPath", "point_to_point", "stop", "time_path", "timed_path"]

_LESS_JERK = (1.0, 0.999, 0.99, 0.9)
"""Shares of the jerk limits that are tried in turn."""

_ZERO_RAD = 1e-12
"""Joint distance below which there is no motion, rad."""


def solve_ruckig(
    request: ruckig.InputParameter, jerk: Vector, solver: ruckig.Ruckig | None = None
) -> ruckig.Trajectory:
    """Ruckig's trajectory for a request.

    If a phase of the solution has exactly zero duration, Ruckig may find no root; slightly less
    jerk avoids that case.

    Args:
        request: State, target and all limits except jerk.
        jerk: Jerk limits, of shape (dof,), rad/s³.
        solver: Ruckig instance for as many joints, to reuse.

    Raises:
        Failure: ``NO_PLAN`` with Ruckig's message.
    """
    solver = solver or ruckig.Ruckig(request.degrees_of_freedom)
    trajectory = ruckig.Trajectory(request.degrees_of_freedom)
    refusal = ""
    for share in _LESS_JERK:
        request.max_jerk = (share * jerk).tolist()
        try:
            result = solver.calculate(request, trajectory)
        except ruckig.RuckigError as error:
            refusal = str(error)
            continue
        if result in (ruckig.Result.Working, ruckig.Result.Finished):
            return trajectory
        refusal = result.name
    raise Failure(
        "NO_PLAN", f"Ruckig finds no motion within the limits: {' '.join(refusal.split())}"
    )


def point_to_point(
    q0: Vector, q1: Vector, limits: JointLimits, dt: float, min_duration: float = 0.0
) -> Trajectory:
    """Fastest rest-to-rest motion on a straight line in joint space within the limits.

    Args:
        q0: Start, of shape (dof,), rad, within the position limits.
        q1: Goal, of shape (dof,), rad, within the position limits.
        limits: Position, velocity, acceleration and jerk limits.
        dt: Time between set-points, s.
        min_duration: Lower bound of the duration, s.

    Raises:
        Failure: ``NO_PLAN`` if Ruckig finds no motion.
        ValueError: A configuration is not finite or outside the position limits.
    """
    for name, q in (("start", q0), ("goal", q1)):
        if not np.all((q >= limits.lower - 1e-9) & (q <= limits.upper + 1e-9)):
            raise ValueError(f"the {name} {np.round(q, 4).tolist()} is outside the position limits")
    displacement = q1 - q0
    if float(np.abs(displacement).max()) < _ZERO_RAD:
        return Trajectory.rest(q1, dt)
    # Not sampled here: a long motion computes its set-points on demand.
    line = _Straight(q0, q1, _limits_along(displacement, limits), min_duration, dt)
    return joined(dt, (line,))


class _Straight:
    """Rest-to-rest motion on a straight line in joint space, see `TrajectoryProtocol`.

    A one-dimensional motion along the line: Ruckig's phase synchronization silently leaves the line
    if one joint limits the velocity and another one the acceleration.

    Args:
        q0: Start, of shape (dof,), rad.
        q1: Goal, of shape (dof,), rad.
        limits: Velocity, acceleration and jerk of the line parameter in [0, 1], each (1,).
        min_duration: Lower bound of the duration, s.
        dt: Time between set-points, s.

    Raises:
        Failure: ``NO_PLAN`` if Ruckig finds no motion.
    """

    def __init__(
        self,
        q0: Vector,
        q1: Vector,
        limits: tuple[Vector, Vector, Vector],
        min_duration: float,
        dt: float,
    ) -> None:
        velocity, acceleration, jerk = limits
        request = _request(np.zeros(1), np.zeros(1), np.zeros(1), velocity, acceleration)
        request.target_position = [1.0]
        if min_duration > 0.0:
            request.minimum_duration = min_duration
        self._given = (q0, q1, limits, min_duration, dt)
        self._ends = (q0, q1)
        self._share = solve_ruckig(request, jerk)
        self._dt = dt

    def __reduce__(self) -> tuple[type[_Straight], tuple[object, ...]]:
        """Pickled as its arguments: Ruckig's trajectories cannot be pickled."""
        return _Straight, self._given

    def __len__(self) -> int:
        return _count(self._share, self._dt) + 1

    def rows(self, index: Rows) -> SetPoints:
        """Positions, velocities and accelerations of some set-points, each of shape (n, dof)."""
        q0, q1 = self._ends
        last = index == len(self) - 1
        place, rate, bend = _at(self._share, index, self._dt)
        # The last set-point may be up to a period after the end: exactly at the goal, at rest.
        place[last] = 1.0
        rate[last] = 0.0
        bend[last] = 0.0
        q = q0 + place * (q1 - q0)
        q[last] = q1
        return q, rate * (q1 - q0), bend * (q1 - q0)


def stop(q: Vector, v: Vector, a: Vector, limits: JointLimits, dt: float) -> Trajectory:
    """Braking trajectory: each joint comes to rest as fast as its limits allow.

    Keeps velocity, acceleration and jerk limits if ``v`` and ``a`` do. Position limits are not
    considered: a joint that is too fast near one passes it.

    Args:
        q: Position of shape (dof,), rad.
        v: Velocity of shape (dof,), rad/s.
        a: Acceleration of shape (dof,), rad/s².
        limits: Velocity, acceleration and jerk limits.
        dt: Time between set-points, s.

    Raises:
        Failure: ``NO_PLAN`` if Ruckig finds no motion.
    """
    motion = _braking(q, v, a, limits)
    position, velocity, acceleration = _at(motion, np.arange(_count(motion, dt) + 1), dt)
    velocity[-1] = 0.0
    acceleration[-1] = 0.0
    return Trajectory(dt, position, velocity, acceleration)


def _braking(q: Vector, v: Vector, a: Vector, limits: JointLimits) -> ruckig.Trajectory:
    """Ruckig's trajectory of `stop`."""
    request = _request(q, v, a, limits.velocity, limits.acceleration)
    request.control_interface = ruckig.ControlInterface.Velocity
    # Each joint brakes at its own limits: the arm leaves its path, but stops soonest.
    request.synchronization = ruckig.Synchronization.No
    return solve_ruckig(request, limits.jerk)


def _limits_along(displacement: Vector, limits: JointLimits) -> tuple[Vector, Vector, Vector]:
    """Velocity, acceleration and jerk limits of the parameter of a line, each of shape (1,)."""
    # Along q0 + s (q1 - q0), each joint bounds the rates of s by its limit over its displacement.
    moving = np.abs(displacement) > 0.0
    velocity, acceleration, jerk = (
        np.array([(limit[moving] / np.abs(displacement[moving])).min()])
        for limit in (limits.velocity, limits.acceleration, limits.jerk)
    )
    return velocity, acceleration, jerk


def _request(
    q: Vector, v: Vector, a: Vector, velocity: Vector, acceleration: Vector
) -> ruckig.InputParameter:
    """Ruckig request with a state and limits, each of shape (dof,), that ends at rest.

    Ruckig accepts lists of the wrong length and ignores elements that are set in place: each list
    is assigned as a whole, from an array whose shape was checked.

    Raises:
        ValueError: Shapes differ, or a value is not finite.
    """
    for values in (q, v, a):
        if values.shape != velocity.shape or not np.isfinite(values).all():
            raise ValueError(f"not {len(velocity)} finite numbers: {values.tolist()}")
    request = ruckig.InputParameter(len(velocity))
    request.current_position = q.tolist()
    request.current_velocity = v.tolist()
    request.current_acceleration = a.tolist()
    request.target_velocity = request.target_acceleration = [0.0] * len(velocity)
    request.max_velocity = velocity.tolist()
    request.max_acceleration = acceleration.tolist()
    return request


def _count(motion: ruckig.Trajectory, dt: float) -> int:
    """Number of steps of ``dt`` of a motion, rounded up."""
    return int(np.ceil(motion.duration / dt - 1e-9))


def _at(motion: ruckig.Trajectory, index: Rows, dt: float) -> SetPoints:
    times = np.minimum(index * dt, motion.duration).tolist()
    rows = np.array([motion.at_time(time) for time in times])
    return rows[:, 0], rows[:, 1], rows[:, 2]
