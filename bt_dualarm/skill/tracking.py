"""Visual tracking: a wrist camera, a tracker and a servo follow a target in a plane."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bt_dualarm.arm.arm import Arm
from bt_dualarm.control.planar_servo import PlanarServo, PlaneTarget, plane_limits
from bt_dualarm.core.errors import Failure, Number
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.perception.localization import EstimatedPlaneLocalizer, PlaneOfSizeLocalizer
from bt_dualarm.perception.target_filter import DualFilterEstimate, RestDetector, look
from bt_dualarm.perception.tracker import TargetTracker
from bt_dualarm.sim.camera import GuardedCamera
from bt_dualarm.skill.grip import StreamClear
from bt_dualarm.skill.looking import own_camera
from bt_dualarm.spec.values import Color, Plane

_BANDWIDTH = (40.0, 230.0)  # rad/s, least and largest
_BANDWIDTH_PER_FPS = 5.0  # a higher one follows the noise of the estimate, a lower one lags
_OLD_S = 0.06  # latency that halves the bandwidth
_SHAKY_PX = 0.7  # camera shake that halves it
_SLACK_M = 1.5e-4  # with an ideal camera
_CALM = 0.2  # with an ideal camera and sufficient jerk
_CALM_JERK = (1e-2, 2e-3)  # m²/s⁵, with an ideal camera, and the least


@dataclass(frozen=True)
class ServoGains:
    """Gains of the servo and of the target's filters.

    Attributes:
        bandwidth: Largest bandwidth of the servo, rad/s.
        slack: Jump of the estimate for which the servo may use the arm's full jerk, m.
        calmness: Readiness to use the low-gain filter, from 0 to 1.
        calm_jerk: Spectral density of the jerk in the low-gain filter, m²/s⁵. The filter's
            bandwidth grows with its sixth root; older images allow less of it.
    """

    bandwidth: float
    slack: float
    calmness: float
    calm_jerk: float


def servo_gains(camera: GuardedCamera, jerk: float) -> ServoGains:
    """Gains that decrease with the images' period, latency and shake.

    Args:
        camera: Camera of the arm.
        jerk: Largest jerk of the tool in the plane, m/s³.
    """
    from bt_dualarm.control.servo_kernels import jerk_bandwidth

    doubt = 1.0 + camera.noise / _SHAKY_PX + (camera.latency / _OLD_S) ** 2
    least, most = _BANDWIDTH
    bandwidth = max(least, min(most, _BANDWIDTH_PER_FPS / camera.period) / doubt)
    slack = _SLACK_M * doubt**3
    lack = bandwidth / jerk_bandwidth(jerk, slack) - 1.0
    calm_jerk, least_jerk = _CALM_JERK
    return ServoGains(
        bandwidth,
        slack,
        calmness=min(max(lack, _CALM * doubt**3), 1.0),
        calm_jerk=max(calm_jerk / doubt**6, least_jerk),
    )


SEARCH_SPEED = 0.1
"""Highest speed of the search, m/s."""

_LEAST_M = 1e-4  # radius below which the search stays at its center


@dataclass(frozen=True, eq=False)
class Spiral:
    """Search path: straight to the predicted target, outward in one turn, then in circles.

    Args:
        start: Position of the tool in the plane, of shape (2,), m.
        center: Predicted position of the target in the plane, of shape (2,), m.
        radius: Radius of the search, m.
    """

    start: Vector
    center: Vector
    radius: float

    def position(self, elapsed: float) -> Vector:
        """Position in the plane ``elapsed`` seconds after the search began, of shape (2,), m."""
        to_center = self.center - self.start
        distance = float(np.hypot(*to_center))
        beyond = elapsed * SEARCH_SPEED - distance
        if beyond < 0.0:
            on_line: Vector = self.center + to_center * (beyond / distance)
            return on_line
        if self.radius < _LEAST_M:
            return self.center
        angle = beyond / self.radius
        reached = self.radius * min(1.0, angle / (2.0 * np.pi))
        around: Vector = self.center + reached * np.array([np.cos(angle), np.sin(angle)])
        return around


_WINDOW_S = 1.0  # of the mean error: two periods of an arm's slowest oscillation
_ARRIVED_S = 0.5  # within the bound after which the tool has arrived and does not just pass
_FEWEST = 3  # sightings of a mean
_NEARER = 0.9  # fraction of the least error so far, below which the error has decreased


class FollowingError:
    """Monitor of the tracking error that the camera itself measures.

    While the tool approaches a target the error only has to decrease. Once it has stayed within the
    bound for half a second the tool has arrived; from then on its root mean square over each second
    has to stay within the bound. That detects lag, oscillation and a target that moves away alike.

    Args:
        bound: Largest root mean square over a second, m.
        patience: Longest time without a decrease of the error before the arrival, s.

    Attributes:
        arrived: Whether the tool has arrived and follows within the bound.
        largest: Largest error of a sighting since the first arrival, m.
    """

    def __init__(self, bound: float, patience: float) -> None:
        self.arrived = False
        self.largest = 0.0
        self._bound = bound
        self._patience = patience
        self._seen: deque[tuple[float, float]] = deque()
        self._least = math.inf
        self._nearer_at = 0.0
        self._squares = 0.0
        self._count = 0

    def interrupt(self) -> None:
        """Reset, as the target is out of view or reach: the tool has to arrive again."""
        self._seen.clear()
        self.arrived = False
        self._least = math.inf

    def take(self, stamp: float, error: Vector) -> None:
        """Process a sighting.

        Args:
            stamp: Time of exposure, s; later than all before.
            error: Vector from the image center to the target, in the plane, of shape (2,), m.

        Raises:
            Failure: ``NOT_FOLLOWING``.
        """
        square = float(error @ error)
        self._seen.append((stamp, square))
        if len(self._seen) == 1:
            self._nearer_at = stamp
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

    def metrics(self) -> dict[str, Number]:
        """``seen_rms_m`` and ``seen_max_m`` since the arrival; empty without one."""
        if self._count == 0:
            return {}
        rms = math.sqrt(self._squares / self._count)
        return {"seen_rms_m": rms, "seen_max_m": self.largest}

    def _keep(self) -> None:
        rms = self._rms(-math.inf)
        if rms > self._bound:
            raise Failure(
                "NOT_FOLLOWING",
                f"the camera saw the target {1000 * rms:.1f} mm off the image center over "
                f"the last second (root mean square; max_error allows {1000 * self._bound:.1f} mm)",
                seen_rms_m=rms,
                max_error_m=self._bound,
            )

    def _approach(self, stamp: float) -> None:
        rms = self._rms(stamp - _ARRIVED_S)
        if rms <= self._bound and stamp - self._seen[0][0] >= _ARRIVED_S:
            self.arrived = True
            self._drop(stamp - _ARRIVED_S)
        elif rms < _NEARER * self._least:
            self._least = rms
            self._nearer_at = stamp
        elif rms <= self._bound:
            self._nearer_at = stamp
        elif stamp - self._nearer_at > self._patience:
            raise Failure(
                "NOT_FOLLOWING",
                f"for {stamp - self._nearer_at:.1f} s the target has come no closer to the image "
                f"center: {1000 * rms:.1f} mm off (root mean square over "
                f"{_ARRIVED_S} s; max_error allows {1000 * self._bound:.1f} mm)",
                seen_rms_m=rms,
                max_error_m=self._bound,
            )

    def _drop(self, before: float) -> None:
        """Drop sightings before a time, but keep enough of them for a mean."""
        while len(self._seen) > _FEWEST and self._seen[0][0] < before:
            self._seen.popleft()

    def _rms(self, since: float) -> float:
        """Root mean square of the sightings since a time, m."""
        squares = [square for stamp, square in self._seen if stamp >= since]
        if len(squares) < _FEWEST:
            squares = [square for _, square in list(self._seen)[-_FEWEST:]]
        return math.sqrt(math.fsum(squares) / len(squares))


STALE_S = 0.1
"""Age of the newest sighting at actuation, s, beyond which the arm does not follow the target.

If latency and period of the images exceed it, the limit is the latency plus two periods; otherwise
the arm would never move.
"""

HOLD_S = 0.5
"""Time for which the tool holds still before the search begins, s."""

_PATIENCE_FRAMES = 2


@dataclass(frozen=True)
class TrackingGains:
    """Proportional image control: ``Δy = -k_y e_x, Δz = -k_z e_y``, e from target to center.

    Attributes:
        u: Step along the plane's first axis for an error of half an image, m.
        v: The same along the second axis.
        dead_band: Normalized error that is ignored.
    """

    u: float
    v: float
    dead_band: float


@dataclass(frozen=True, eq=False)
class PlaneView:
    """Plane of tracking relative to the camera at the start.

    Attributes:
        axes: Unit vectors of the plane in the world, of shape (2, 3).
        ahead: Function that returns the point at the image center at the estimated depth, in the
            world, of shape (3,), m.
        image_axes: Image x and y directions in the plane, as columns, of shape (2, 2).
    """

    axes: Matrix
    ahead: Callable[[], Vector]
    image_axes: Matrix


class TrackingReference:
    """Reference of the servo at the control rate: the target, rest, or the search.

    Args:
        tracker: Tracker of the target.
        view: Plane and camera at the start.
        gains: Gains of proportional control; None to predict the target.
        reach: Largest distance of the tool from its start, m.
        search_radius: Radius of the search around the predicted target, m.
        stale_after: Age beyond which a sighting is too old to follow, s.

    Attributes:
        beyond_since: Simulated time since which the target has been out of reach, s, or None.
        old_data_steps: Number of control steps toward a target whose newest sighting was older
            than `STALE_S`.
    """

    def __init__(
        self,
        tracker: TargetTracker,
        view: PlaneView,
        *,
        gains: TrackingGains | None,
        reach: float,
        search_radius: float,
        stale_after: float,
    ) -> None:
        self.beyond_since: float | None = None
        self.old_data_steps = 0
        self._tracker = tracker
        self._view = view
        self._gains = gains
        self._reach = reach
        self._search_radius = search_radius
        self._stale_after = stale_after
        self._last_position = np.zeros(2)
        self._search: Spiral | None = None
        self._goal = np.zeros(2)
        self._goal_stamp = -np.inf

    def __call__(self, time: float, displacement: Vector) -> PlaneTarget | None:
        """Reference of the tool at a time; None to come to rest.

        Args:
            time: Simulated time of actuation, s.
            displacement: Position of the tool in the plane relative to its start, of shape (2,), m.
        """
        age = self._tracker.age(time)
        if age > self._stale_after or not self._tracker.locked:
            return self._without_target(time, displacement)
        self._search = None
        target = (
            self._predicted(time)
            if self._gains is None
            else self._stepped(self._gains, displacement)
        )
        if not self._is_within_reach(target.position, time):
            return None
        self.old_data_steps += age > STALE_S
        self._last_position = target.position
        return target

    def stale_for(self, time: float) -> float:
        """Seconds since the newest sighting became too old to follow; negative before."""
        return self._tracker.age(time) - self._stale_after

    def _predicted(self, time: float) -> PlaneTarget:
        """Predictive control: current state of the target by the filter."""
        view = self._view
        return PlaneTarget(*self._tracker.predict_in(view.axes, view.ahead(), time))

    def _stepped(self, gains: TrackingGains, displacement: Vector) -> PlaneTarget:
        """Proportional control: one step for each new image."""
        detection = self._tracker.detection
        if detection is not None and detection.stamp > self._goal_stamp:
            error = np.where(np.abs(detection.centroid) > gains.dead_band, detection.centroid, 0.0)
            step = (self._view.image_axes @ error) * (gains.u, gains.v)
            self._goal = displacement + step
            self._goal_stamp = detection.stamp
        return PlaneTarget(self._goal, np.zeros(2), np.zeros(2))

    def _without_target(self, time: float, displacement: Vector) -> PlaneTarget | None:
        """Come to rest and hold, then search around where the target was last predicted."""
        self.beyond_since = None
        searched_for = self.stale_for(time) - HOLD_S
        if self._search_radius == 0.0 or searched_for < 0.0:
            return None
        if self._search is None:
            self._search = Spiral(displacement.copy(), self._last_position, self._search_radius)
        position = self._search.position(searched_for)
        position *= min(1.0, self._reach / max(float(np.hypot(*position)), 1e-9))
        return PlaneTarget(position, np.zeros(2), np.zeros(2))

    def _is_within_reach(self, position: Vector, time: float) -> bool:
        """Whether a position is within reach; updates ``beyond_since``."""
        x, y = position.tolist()
        if math.hypot(x, y) <= self._reach:
            self.beyond_since = None
        elif self.beyond_since is None:
            self.beyond_since = time
        return self.beyond_since is None


def stale_after(latency: float, period: float) -> float:
    """Age beyond which a sighting is too old to follow, s.

    Args:
        latency: Age of an image when it arrives, s.
        period: Time between images, s.
    """
    if latency + period < STALE_S:
        return STALE_S
    return latency + _PATIENCE_FRAMES * period


_FACING = 0.5  # least cosine between the camera's axis and the plane's normal
_GIVEN_DEPTH = 3.0  # factor by which a given depth of the target may be wrong
_MEASURED_DEPTH = 1.3  # the same of a measured depth


class PlaneTracking:
    """Visual tracking of one target by a wrist camera; ``close`` it when done.

    Args:
        arm: Arm with a wrist camera that looks along the plane's normal.
        color: Color of the target.
        plane: Plane in which the tool moves.
        speed: Fraction of the arm's limits.
        distance: Depth of the target in front of the camera, m.
        target_size: Edge of a cubic target with a face parallel to the plane, m: the depth is then
            measured, and the visible flanks are corrected for.
        gains: Gains of proportional control; None to predict the target.
        reach: Largest distance of the tool from its start, m.
        search_radius: Radius of the search around the predicted target, m.
        error: Monitor of the tracking error.

    Raises:
        Failure: ``NO_CAMERA``.
    """

    def __init__(
        self,
        arm: Arm,
        *,
        color: Color,
        plane: Plane,
        speed: float,
        distance: float,
        target_size: float | None,
        gains: TrackingGains | None,
        reach: float,
        search_radius: float,
        error: FollowingError,
    ) -> None:
        self._arm = arm
        self._axes = np.array(plane.axes)
        self._limits = arm.limits(speed)
        camera, view = _facing_camera(arm, plane)
        ahead = view.position + distance * view.turn(np.array((0.0, 0.0, 1.0)))
        normal = np.cross(*self._axes)
        guessed = EstimatedPlaneLocalizer(view.position, ahead, normal)
        localizer = (
            guessed if target_size is None else PlaneOfSizeLocalizer(normal, target_size, cube=True)
        )
        allowed = plane_limits(arm.kinematics, self._limits, arm.setpoint.q, self._axes)
        self._servo_gains = servo_gains(camera, allowed.jerk)
        estimate = DualFilterEstimate(self._servo_gains.calmness, self._servo_gains.calm_jerk)
        self._tracker = TargetTracker(camera, color, localizer, estimate)
        self._reference = TrackingReference(
            self._tracker,
            PlaneView(self._axes, lambda: guessed.ahead, self._axes @ view.rotation_matrix[:, :2]),
            gains=gains,
            reach=reach,
            search_radius=search_radius,
            stale_after=stale_after(camera.latency, camera.period),
        )
        self._latency = camera.latency
        self._middle = np.array((0.0, 0.0, distance))
        self._error = error
        self._stillness = RestDetector(_MEASURED_DEPTH if target_size else _GIVEN_DEPTH)
        self._watched = 0
        self._clear = StreamClear(arm)

    @property
    def locked(self) -> bool:
        """Whether the target is in view and confirmed."""
        return self._tracker.locked

    @property
    def in_view(self) -> bool:
        """Whether the newest sighting is fresh enough to follow."""
        return self._tracker.locked and self._reference.stale_for(self._arm.time) <= 0.0

    @property
    def follows(self) -> bool:
        """Whether the target is in view and within reach."""
        return self.in_view and self._reference.beyond_since is None

    @property
    def arrived(self) -> bool:
        """Whether the target is at the image center, within the bound on the error."""
        return self.follows and self._error.arrived

    @property
    def seen_at(self) -> float:
        """Time of exposure of the newest image that shows the locked target, simulated s."""
        return self._tracker.last_stamp

    @property
    def unseen_for(self) -> float:
        """Seconds for which images have shown no target, latency not included."""
        return max(0.0, self._tracker.age(self._arm.time) - self._latency)

    @property
    def beyond_for(self) -> float:
        """Seconds for which the target has been out of reach."""
        since = self._reference.beyond_since
        return 0.0 if since is None else self._arm.time - since

    @property
    def still_for(self) -> float:
        """Seconds for which a target that has moved has been at rest; 0 before it moved."""
        return self._stillness.still_for if self.in_view else 0.0

    @property
    def target(self) -> Vector:
        """Estimated current position of the target in the world, of shape (3,), m."""
        return self._tracker.predict(self._arm.time).position

    @property
    def refused(self) -> str:
        """Why the last candidate was not accepted as the lost target; empty if there was none."""
        return self._tracker.distractors.reason

    def begin(self) -> None:
        """Begin to follow.

        Raises:
            Failure: ``IN_COLLISION``, see `StreamClear`.
        """
        self._clear.look()
        self._watched = len(self._tracker.sightings)
        servo = PlanarServo(
            self._arm.kinematics,
            self._limits,
            self._arm.period,
            self._arm.setpoint,
            self._axes,
            self._reference,
            self._servo_gains.bandwidth,
            self._servo_gains.slack,
        )
        self._arm.stream(servo)

    def watch(self) -> None:
        """Evaluate new sightings: rest of the target and tracking error; called once per tick.

        Raises:
            Failure: ``NOT_FOLLOWING``; ``IN_COLLISION``, see `StreamClear`.
        """
        self._clear.look()
        seen = self._tracker.sightings
        new = seen.newest(len(seen) - self._watched)
        self._watched = len(seen)
        # Lost frames do not mean that the target is absent, though `in_view` turns false meanwhile.
        if not self._tracker.locked:
            self._stillness.interrupt()
        may_follow = self._tracker.locked and self._reference.beyond_since is None
        if not may_follow:
            self._error.interrupt()
        if not self._tracker.locked:
            return
        for one in new:
            self._stillness.take(look(one, self._axes))
            if may_follow:
                off = one.point - one.camera.apply(self._middle)
                self._error.take(one.stamp, self._axes @ off)

    def close(self) -> None:
        """Unsubscribe from the camera."""
        self._tracker.close()

    def sightings(self) -> tuple[Vector, Matrix]:
        """Times and positions in the world of recent sightings: shapes (n,) and (n, 3)."""
        return self._tracker.sightings.places()

    def forget_sightings(self, until: float) -> None:
        """Drop sightings up to a time, s."""
        self._tracker.sightings.forget(until)

    def metrics(self) -> dict[str, Number]:
        """Numbers of images, losses and refused sightings, and those of `FollowingError`.

        ``old_data_steps`` counts the control steps toward a target whose newest sighting was older
        than `STALE_S`.
        """
        return {
            "frames": self._tracker.frames,
            "lost_count": self._tracker.lost_count,
            "refused_sightings": self._tracker.distractors.count,
            "old_data_steps": self._reference.old_data_steps,
            **self._error.metrics(),
        }


def _facing_camera(arm: Arm, plane: Plane) -> tuple[GuardedCamera, Pose]:
    """Wrist camera and its pose in the world.

    Raises:
        Failure: ``NO_CAMERA``: there is none, or it does not face the plane.
    """
    camera = own_camera(arm)
    view = arm.world.nominal[arm.name].camera_pose_at(arm.q)
    facing = abs(float(np.cross(*plane.axes) @ view.turn(np.array((0.0, 0.0, 1.0)))))
    if facing < _FACING:
        raise Failure(
            "NO_CAMERA",
            f"the camera of {arm.name} looks {np.degrees(np.arccos(facing)):.0f}° past the "
            "normal of the plane: it cannot observe motion in that plane",
            cosine=facing,
        )
    return camera, view
