"""Visual tracking: a wrist camera, a tracker and a servo follow a target in a plane or in space."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bt_dualarm.arm.arm import Arm
from bt_dualarm.collision.checker import CollisionChecker
from bt_dualarm.control.facing_servo import Facing, FacingServo, facing_limits
from bt_dualarm.control.kernel_rows import PlaneLimits
from bt_dualarm.control.planar_servo import (
    PlanarServo,
    PlaneTarget,
    plane_limits,
    stopping_positions,
)
from bt_dualarm.core.errors import Failure, Number
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.perception.harmonic_motion import HarmonicMotion
from bt_dualarm.perception.localization import (
    EstimatedPlaneLocalizer,
    FacingCubeLocalizer,
    Localizer,
    PlaneOfSizeLocalizer,
    Sighting,
)
from bt_dualarm.perception.target_filter import DualFilterEstimate, RestDetector, RestSample, look
from bt_dualarm.perception.tracker import TargetTracker
from bt_dualarm.sim.camera import GuardedCamera
from bt_dualarm.skill.following_error import FollowingError, FollowingSample
from bt_dualarm.skill.looking import own_camera
from bt_dualarm.skill.tracking_end import TrackingStatus
from bt_dualarm.spec.values import Color, Plane
from bt_dualarm.trajectory.set_points import SetPoint

_BANDWIDTH = (40.0, 230.0)  # rad/s, least and largest
_BANDWIDTH_PER_FPS = 5.0  # a higher one follows the noise of the estimate, a lower one lags
_OLD_S = 0.06  # latency that halves the bandwidth
_SHAKY_PX = 0.7  # camera shake that halves it
_SLACK_M = 1.5e-4  # jump of the estimate with an ideal camera
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

_LEAST_M = 1e-4  # below this radius the search stays at its center


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


STALE_S = 0.1
"""Age of the newest sighting at actuation, s, beyond which the arm does not follow the target.

If latency and period of the images exceed it, the limit is the latency plus two periods; otherwise
the arm would never move.
"""

FORESEEN_M = 0.02
"""Standard deviation of the predicted position, m, up to which a target out of view is followed."""

HARMONIC_M = 0.04
"""The same of a target that repeats its motion, m. It errs mostly along its curve, so that the arm
that goes on is nearer to it, and moves as it does, when it reappears."""

HARMONIC_S = 1.5
"""Longest time for which such a target is followed out of view, s: by default half of the time
after which it is lost, so that the other half is left for the search."""

HOLD_S = 0.5
"""Time for which the tool holds still before the search begins, s."""

_PATIENCE_FRAMES = 2
_PREDICTIONS = 1024  # set-points that are kept to compare with late images: two seconds
_SAME_TIME_S = 0.02  # maximum time between a prediction and a sighting to compare
_NEEDS_EVERY_S = 0.1  # sampling period
# Time constant of the mean squares of the target's velocity and acceleration, s: a tool that cannot
# follow is out of bounds within half a second of the start of the motion.
_NEED_S = 0.3
_ASKED_EVERY_S = 0.06  # period of checks of whether the way to the target is free again
_BEYOND_M = 0.03  # by which it has to be free beyond the target
_SLOWED = 0.95  # fraction of its speed below which the guard counts as having slowed the arm
_MISSED = 4096  # ticks without the target that are kept


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
    """Axes of tracking relative to the camera at the start.

    Attributes:
        axes: Unit vectors in the world, of shape (k, 3): two of a plane, or three.
        ahead: Function that returns the point at the image center at the estimated depth, or at the
            distance to be kept in space, in the world, of shape (3,), m.
        image_axes: Image x and y directions along the first two, as columns, of shape (2, 2).
    """

    axes: Matrix
    ahead: Callable[[], Vector]
    image_axes: Matrix


_CHECKED_EVERY_S = 0.06
_HURRIED_EVERY_S = 0.02  # where the tool closes in, and may accelerate the more
_CHECKED_ROWS = 8  # configurations of the braking motion that are checked
_CLEAR_M = 0.003  # by which an arm that hurries stops before a collision: it lags and overshoots


class StreamClear:
    """Collision check of the tool and held objects of an arm that follows a target.

    Its motion is not planned. The controller slows the arm near objects by its links and keeps it
    from other arms; this checks the whole arm on the motion with which the servo would brake.

    Args:
        arm: Arm that follows.
        axes: Axes along which it follows, of shape (k, 3).
    """

    def __init__(self, arm: Arm, axes: Matrix) -> None:
        self._arm = arm
        self._axes = axes
        self._limits = arm.limits(1.0)
        self._next = -np.inf

    def look(self, *, closes_in: bool) -> None:
        """Check if a check is due; to be called once per tick.

        Args:
            closes_in: Whether the tool has not reached its target yet.

        Raises:
            Failure: ``IN_COLLISION`` with what would collide.
        """
        arm = self._arm
        if arm.time < self._next:
            return
        every_s = _HURRIED_EVERY_S if closes_in else _CHECKED_EVERY_S
        self._next = arm.time + every_s - 1e-9
        q, v, a = arm.setpoint
        limits = self._limits
        # Until the next check the arm continues, and accelerates as now.
        later = np.clip(v + every_s * a, -limits.velocity, limits.velocity)
        then = SetPoint(q + 0.5 * every_s * (v + later), later, a)
        checker = CollisionChecker(arm.world, arm.name)
        if closes_in:
            checker.keep_clear(_CLEAR_M)
        rows = stopping_positions(arm.kinematics, limits, self._axes, then, _CHECKED_ROWS)
        found = checker.first_contact(rows)
        if found is not None:
            raise found[1].failure()


class TrackingReference:
    """Reference of the servo at the control rate: the target, rest, or the search.

    Args:
        tracker: Tracker of the target.
        view: Plane and camera at the start.
        gains: Gains of proportional control; None to predict the target.
        reach: Largest distance of the tool from its start, m.
        search_radius: Radius of the search around the predicted target, m.
        stale_after: Age beyond which a sighting is too old to follow, s.
        facing: Orientation of a camera that turns toward its target, whose motion the reference
            then is; None for a tool that keeps its orientation.

    Attributes:
        beyond_since: Simulated time since which the target has been out of reach, s, or None.
        old_data_steps: Number of control steps toward a target whose newest sighting was older
            than `STALE_S`, and whose position was uncertain by more than `FORESEEN_M`.
        foreseen_s: Time for which a target out of view was followed by its prediction, s.
        foreseen_by: Harmonic motion by which it was last followed out of view; None if the filter
            predicted it.
        is_blocked: Whether something is in the way to the target; the tool then comes to rest.
        displacement: Position of the tool along the axes relative to its start when it was last
            called, of shape (k,), m.
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
        facing: Facing | None = None,
    ) -> None:
        self.beyond_since: float | None = None
        self.old_data_steps = 0
        self.foreseen_s = 0.0
        self.foreseen_by: HarmonicMotion | None = None
        self.is_blocked = False
        self.displacement = np.zeros(len(view.axes))
        self._called_at = -math.inf
        self._braked_at: float | None = None
        self._tracker = tracker
        self._view = view
        self._gains = gains
        self._reach = reach
        self._search_radius = search_radius
        self._stale_after = stale_after
        self._facing = facing
        self._last_position = np.zeros(len(view.axes))
        self._predictions: deque[tuple[float, Vector]] = deque(maxlen=_PREDICTIONS)
        self._search: Spiral | None = None
        self._search_depth = np.zeros(0)
        self._goal = np.zeros(2)
        self._goal_stamp = -np.inf

    def __call__(self, time: float, displacement: Vector) -> PlaneTarget | None:
        """Reference of the tool at a time; None to come to rest.

        Args:
            time: Simulated time of actuation, s.
            displacement: Position of the tool along the axes relative to its start, of shape
                (k,), m.
        """
        passed = max(time - self._called_at, 0.0)
        self._called_at = time
        self.displacement = displacement
        if self.is_blocked:
            self.beyond_since = time if self.beyond_since is None else self.beyond_since
            return None
        age = self._tracker.age(time)
        if age > self._stale_after or not self._tracker.locked:
            foreseen = self._foreseen(time)
            if foreseen is not None:
                self.foreseen_s += passed
                return foreseen
            return self._without_target(time, displacement)
        self._search = None
        self._braked_at = None
        target = (
            self._predicted(time)
            if self._gains is None
            else self._stepped(self._gains, displacement)
        )
        seen_at = target.position
        if self._facing is not None:
            target = self._facing.camera_motion(target)
        if not self._is_within_reach(target.position, time):
            return None
        self.old_data_steps += age > STALE_S and self._tracker.doubt(time) > FORESEEN_M
        self._last_position = target.position
        if self._gains is None:  # a proportional controller predicts nothing
            self._predictions.append((time, seen_at))
        return target

    def predicted_at(self, time: float) -> Vector | None:
        """Position predicted for a time, of shape (k,), m; None if there was none.

        Args:
            time: Time of a sighting, s, later than in all previous calls.
        """
        past = self._predictions
        while len(past) > 1 and past[1][0] <= time:
            past.popleft()
        if not past or abs(past[0][0] - time) > _SAME_TIME_S:
            return None
        return past[0][1]

    @property
    def origin(self) -> Vector:
        """Point in the world from which positions along the axes count, of shape (3,), m."""
        return self._view.ahead()

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

    def _foreseen(self, time: float) -> PlaneTarget | None:
        """Motion of a target out of view while its prediction is good; None from then on."""
        if self._gains is not None or self._braked_at is not None:
            return None
        if math.isinf(self._tracker.age(time)):
            return None
        harmonic = self.foreseen_by = self._tracker.harmonic_motion()
        if harmonic is not None:
            if harmonic.doubt(time) > HARMONIC_M or self._tracker.age(time) > HARMONIC_S:
                return None
            position, *rates = harmonic.predict(time)
            axes = self._view.axes
            target = PlaneTarget(*(np.array((position - self._view.ahead(), *rates)) @ axes.T))
        elif self._tracker.doubt(time) <= FORESEEN_M:
            target = self._predicted(time)
        else:
            return None
        if self._facing is not None:
            target = self._facing.camera_motion(target)
            if not self._facing.allows(target.position):
                return None
        if math.hypot(*target.position) > self._reach:
            return None
        self._last_position = target.position
        return target

    def _without_target(self, time: float, displacement: Vector) -> PlaneTarget | None:
        """Come to rest and hold, then search around where the target was last predicted."""
        self.beyond_since = None
        if math.isinf(self._tracker.age(time)):  # nothing is known of it
            return None
        self._braked_at = time if self._braked_at is None else self._braked_at
        searched_for = time - self._braked_at - HOLD_S
        if self._search_radius == 0.0 or searched_for < 0.0:
            return None
        if self._facing is not None:
            return self._facing_search(self._facing, searched_for, displacement)
        if self._search is None:
            start = displacement.copy()
            self._search = Spiral(start[:2], self._last_position[:2], self._search_radius)
            self._search_depth = start[2:]  # where the target was last seen, or nearer
        position = np.concatenate((self._search.position(searched_for), self._search_depth))
        position *= min(1.0, self._reach / max(math.hypot(*position), 1e-9))
        still = np.zeros(len(position))
        return PlaneTarget(position, still, still)

    def _facing_search(
        self, facing: Facing, searched_for: float, displacement: Vector
    ) -> PlaneTarget | None:
        """The search across the line of sight with which the target was last predicted."""
        across = facing.rotation(self._last_position)
        if self._search is None:
            start = across.T @ (displacement - self._last_position)
            self._search = Spiral(start[:2], np.zeros(2), self._search_radius)
            self._search_depth = start[2:]
        local = np.concatenate((self._search.position(searched_for), self._search_depth))
        position = self._last_position + across @ local
        position *= min(1.0, self._reach / max(math.hypot(*position), 1e-9))
        still = np.zeros(3)
        return PlaneTarget(position, still, still) if facing.allows(position) else None

    def _is_within_reach(self, position: Vector, time: float) -> bool:
        """Whether a position is within reach; updates ``beyond_since``."""
        may_be = self._facing is None or self._facing.allows(position)
        if may_be and math.hypot(*position.tolist()) <= self._reach:
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


_FACING = 0.5  # minimum cosine between the camera's axis and the plane's normal
_GIVEN_DEPTH = 3.0  # factor by which a given depth of the target may be wrong
_MEASURED_DEPTH = 1.3  # the same of a measured depth


class PlaneTracking:
    """Visual tracking of one target by a wrist camera, in a plane or in space; ``close`` it at end.

    In space, the camera keeps the target at the image center and at ``distance``; it keeps its
    orientation, or turns to face the target.

    Args:
        arm: Arm with a wrist camera that looks along the plane's normal.
        color: Color of the target.
        plane: Plane in which the tool moves; None for all directions of space.
        speed: Fraction of the arm's limits.
        distance: Depth of the target in front of the camera, m.
        target_size: Edge of a cubic target with a face parallel to the plane, or to the image in
            space, m: the depth is then measured, and the visible flanks are corrected for.
            Required in space.
        gains: Gains of proportional control, in a plane only; None to predict the target.
        reach: Largest distance of the tool from its start, m.
        search_radius: Radius of the search around the predicted target, m.
        error: Monitor of the tracking error.
        facing: Whether the camera turns with its position to face the target, see `Facing`, in
            space only. The target is then assumed to show the camera the same outline from there.

    Raises:
        Failure: ``NO_CAMERA``.
        ValueError: In space, there is no ``target_size``, or there are ``gains``; in a plane, the
            camera is to turn.
    """

    def __init__(
        self,
        arm: Arm,
        *,
        color: Color,
        plane: Plane | None,
        speed: float,
        distance: float,
        target_size: float | None,
        gains: TrackingGains | None,
        reach: float,
        search_radius: float,
        error: FollowingError,
        facing: bool = False,
    ) -> None:
        if facing and plane is not None:
            raise ValueError("a camera turns toward its target in space only, not in a plane")
        self._arm = arm
        self._limits = arm.limits(speed)
        camera, view = _facing_camera(arm, plane)
        self._axes = np.array(plane.axes) if plane else view.rotation_matrix.T.copy()
        self._distance = distance
        normal = np.cross(*self._axes[:2])
        ahead = view.apply(np.array((0.0, 0.0, distance)))
        guessed = self._guessed = EstimatedPlaneLocalizer(view.position, ahead, normal)
        localizer: Localizer = guessed
        if plane is None:
            if target_size is None or gains is not None:
                raise ValueError("tracking in space needs the target's size, and predicts it")
            localizer = FacingCubeLocalizer(None if facing else normal, target_size)
        elif target_size is not None:
            localizer = PlaneOfSizeLocalizer(normal, target_size, cube=True)
        self._facing = (
            Facing.of_arm(arm.kinematics, arm.setpoint.q, view, distance) if facing else None
        )
        self._view = view
        allowed = self._limits_of_motion()
        self._servo_gains = servo_gains(camera, allowed.jerk)
        estimate = DualFilterEstimate(self._servo_gains.calmness, self._servo_gains.calm_jerk)
        depth = None if target_size is None else distance
        self._tracker = TargetTracker(camera, color, localizer, estimate, depth=depth)
        self._reference = TrackingReference(
            self._tracker,
            PlaneView(
                self._axes, lambda: guessed.ahead, self._axes[:2] @ view.rotation_matrix[:, :2]
            ),
            gains=gains,
            reach=reach,
            search_radius=search_radius,
            stale_after=stale_after(camera.latency, camera.period),
            facing=self._facing,
        )
        self._latency = camera.latency
        self._error = error
        doubt = _MEASURED_DEPTH if target_size else _GIVEN_DEPTH
        # In space, one for the directions across the line of sight and one for the depth.
        self._rest_detectors = (
            [RestDetector(doubt)] if plane else [RestDetector(1.0), RestDetector(1.0)]
        )
        self._target_size = target_size
        self._watched = 0
        self._last_seen: Sighting | None = None
        self._missed: deque[tuple[float, Vector]] = deque(maxlen=_MISSED)
        self._needs_at = -math.inf
        self._was_beyond = False
        self._servo: PlanarServo | None = None
        self._obstacle: Failure | None = None
        self._asked_at = -math.inf
        self._waits_since: float | None = None
        self._clear = StreamClear(arm, self._axes)

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
        """Seconds for which images have shown no target, latency not included; 0 while it waits."""
        if self._waits_since is not None:
            return 0.0
        return max(0.0, self._tracker.age(self._arm.time) - self._latency)

    @property
    def beyond_for(self) -> float:
        """Seconds for which the target has been out of reach."""
        since = self._reference.beyond_since
        return 0.0 if since is None else self._arm.time - since

    @property
    def status(self) -> TrackingStatus:
        """What is known of target and tool now."""
        still = min((one.still_for for one in self._rest_detectors if one.has_moved), default=0.0)
        return TrackingStatus(
            self._arm.time,
            self.in_view,
            self.arrived,
            is_beyond=self._reference.beyond_since is not None,
            is_waiting=self._waits_since is not None,
            has_moved=any(one.has_moved for one in self._rest_detectors),
            still_for=still if self.in_view else 0.0,
            unseen_for=self.unseen_for,
            refused=self._tracker.refused,
            obstacle=self._obstacle,
        )

    @property
    def axes(self) -> Matrix:
        """Unit vectors in the world along which the tool follows, of shape (k, 3)."""
        return self._axes

    @property
    def turns(self) -> bool:
        """Whether the camera turns to face its target."""
        return self._facing is not None

    @property
    def middle(self) -> Vector:
        """Where the target is to be, in the camera frame, of shape (3,), m.

        It is at the depth estimated now: seen obliquely, the point at the image center that is at
        another depth is beside the target in the plane.
        """
        return np.array((0.0, 0.0, self._guessed.share * self._distance))

    @property
    def target(self) -> Vector:
        """Estimated current position of the target in the world, of shape (3,), m."""
        return self._tracker.predict(self._arm.time).position

    def begin(self) -> None:
        """Begin to follow.

        Raises:
            Failure: ``IN_COLLISION``, see `StreamClear`.
        """
        self._clear.look(closes_in=True)
        self._watched = len(self._tracker.sightings)
        arm, gains = self._arm, self._servo_gains
        servo: PlanarServo
        if self._facing is None:
            servo = PlanarServo(
                arm.kinematics,
                self._limits,
                arm.period,
                arm.setpoint,
                self._axes,
                self._reference,
                gains.bandwidth,
                gains.slack,
            )
        else:
            servo = FacingServo(
                arm.kinematics,
                self._limits,
                arm.period,
                arm.setpoint,
                self._view,
                self._facing,
                self._reference,
                gains.bandwidth,
                gains.slack,
            )
        self._servo = servo
        arm.stream(servo)

    def watch(self) -> None:
        """Evaluate new sightings: rest of the target and tracking error; called once per tick.

        Raises:
            Failure: ``NOT_FOLLOWING``; ``IN_COLLISION``, see `StreamClear`, of a tool that has
                reached its target before.
        """
        self._look_ahead()
        seen = self._tracker.sightings
        new = seen.newest(len(seen) - self._watched)
        self._watched = len(seen)
        # Lost frames do not mean that the target is absent, though `in_view` turns false meanwhile.
        if not self._tracker.locked:
            for detector in self._rest_detectors:
                detector.interrupt()
        within_reach = self._reference.beyond_since is None
        if not (self._tracker.locked and within_reach):
            self._error.interrupt()
        if not within_reach:
            self._error.postpone()
        if self.in_view:
            self._was_beyond = not within_reach
            self._waits_since = None
        elif (
            self._was_beyond
            and not self._tracker.locked
            and self._error.counts_from is None
            and self._waits_since is None
        ):
            # It was never followed, and may look different where it comes within reach.
            self._tracker.restart()
            self._waits_since = self._arm.time
            self._last_seen = None
        if self._waits_since is not None:
            return
        if not self._tracker.locked:
            self._missed.append((self._arm.time, self._middle_now()))
            return
        width = self._target_size or self._tracker.width
        if width is not None:
            self._error.know_width(width)
        self._learn_needs()
        for one in new:
            for detector, sample in zip(self._rest_detectors, self._looks(one), strict=True):
                detector.take(sample)
            now = one
            if self._guessed.share < 1.0:  # it may be from before that was known
                now = self._guessed.relocate(one)
            self._count_missed(now)
            self._error.take(self._sample(now, within_reach=within_reach))
            self._last_seen = now

    def _look_ahead(self) -> None:
        """Stop before what is in the way to the target, and go on once nothing is."""
        if self._obstacle is not None:
            if self._is_way_free():
                self._obstacle = None
                self._reference.is_blocked = False
            return
        closes_in = self._error.counts_from is None
        try:
            self._clear.look(closes_in=closes_in)
        except Failure as failure:
            # A target that comes may come from where the arm cannot go: it is waited for.
            if not closes_in or self._facing is not None:
                raise
            self._obstacle = failure.with_traceback(None)
            self._reference.is_blocked = True

    def _is_way_free(self) -> bool:
        """Whether the tool can go straight to where the target is now, asked a few times a second.

        So that it can follow from there, it can go on by `_BEYOND_M`, too.
        """
        arm = self._arm
        if not self._tracker.locked or arm.time - self._asked_at < _ASKED_EVERY_S:
            return False
        self._asked_at = arm.time
        position, *_ = self._tracker.predict_in(self._axes, self._reference.origin, arm.time)
        step = position - self._reference.displacement
        step *= 1.0 + _BEYOND_M / max(math.hypot(*step), 1e-9)
        here = arm.commanded_tool_pose
        try:
            rows = arm.line_on(here.shifted(step @ self._axes))
        except Failure:
            return False
        checker = arm.checker()
        checker.keep_clear(_CLEAR_M)
        return checker.first_contact(rows) is None

    @property
    def error(self) -> FollowingError:
        """Monitor of the tracking error."""
        return self._error

    def _sample(self, one: Sighting, *, within_reach: bool) -> FollowingSample:
        """A sighting relative to image center and prediction."""
        return FollowingSample(
            one.stamp,
            self._axes @ (one.point - one.camera.apply(self.middle)),
            self._axes @ (one.point - self._reference.origin),
            self._reference.predicted_at(one.stamp),
            within_reach,
            slowed=self._slowed_by(),
        )

    def _slowed_by(self) -> str:
        """Why the guard slows the arm now; empty if it does not."""
        if self._servo is None or self._servo.time_scale >= _SLOWED:
            return ""
        return str(self._arm.controller.guard["last_reason"])

    def _looks(self, one: Sighting) -> list[RestSample]:
        """A sighting for each detector of rest."""
        if len(self._axes) == 2:
            return [look(one, self._axes)]
        # Each image tells the depth, so that positions count as they are.
        x, y, z = (self._axes @ one.point).tolist()
        sigma = np.sqrt(np.square(self._axes) @ np.square(one.sigma))
        level = np.zeros(2)
        return [
            RestSample(one.stamp, np.array((x, y)), level, 1.0, float(sigma[:2].max())),
            RestSample(one.stamp, np.array((z, 0.0)), level, 1.0, float(sigma[2])),
        ]

    def _middle_now(self) -> Vector:
        """Point at the image center now, from the encoders, along the axes, of shape (k,), m."""
        arm = self._arm
        view = arm.world.nominal[arm.name].camera_pose_at(arm.q)
        middle: Vector = self._axes @ view.apply(self.middle)
        return middle

    def _count_missed(self, regained: Sighting) -> None:
        """Count the time without the target as error, by its interpolated path.

        A target that repeats its motion has presumably done so meanwhile; what it deviates by when
        it reappears, has grown linearly. The path of any other is straight.
        """
        before = self._last_seen
        if not self._missed or before is None:
            return
        times = np.array([time for time, _ in self._missed])
        tool = np.array([middle for _, middle in self._missed])
        self._missed.clear()
        during = (times > before.stamp) & (times < regained.stamp)
        share = (times[during] - before.stamp) / (regained.stamp - before.stamp)
        ends = np.array((before.point, regained.point))
        path = np.zeros((len(share), 3))
        harmonic = self._reference.foreseen_by
        if harmonic is not None and harmonic.stamp == before.stamp:
            path = np.array([harmonic.predict(time).position for time in times[during]])
            expected = [harmonic.predict(one.stamp).position for one in (before, regained)]
            ends -= expected
        path += ends[0] + share[:, None] * (ends[1] - ends[0])
        away = np.linalg.norm(path @ self._axes.T - tool[during], axis=1)
        self._error.miss(times[during], away)

    def _learn_needs(self) -> None:
        """Update what the target needs and what the arm has, for the reason of a failure."""
        now = self._arm.time
        passed = now - self._needs_at
        if passed < _NEEDS_EVERY_S:
            return
        self._needs_at = now
        kept = math.exp(-passed / _NEED_S)
        motion = PlaneTarget(*self._tracker.predict_in(self._axes, self._reference.origin, now))
        _, *rates = motion if self._facing is None else self._facing.camera_motion(motion)
        error = self._error
        squares = [
            kept * was**2 + (1.0 - kept) * float(rate @ rate)
            for was, rate in zip(error.need, rates, strict=True)
        ]
        error.need = math.sqrt(squares[0]), math.sqrt(squares[1])
        error.limit = self._limits_of_motion().acceleration
        error.speed_share = float(np.abs(self._arm.setpoint.v / self._limits.velocity).max())

    def _limits_of_motion(self) -> PlaneLimits:
        """Limits of the motion along the followed axes where the arm is now."""
        arm = self._arm
        kinematics = arm.kinematics
        limits = self._limits
        q = arm.setpoint.q
        axes = self._axes
        facing = self._facing
        if facing is None:
            return plane_limits(kinematics, limits, q, axes)
        start = self._view.position
        camera = arm.world.nominal[arm.name].camera_pose_at(q)
        at = axes @ (camera.position - start)
        return facing_limits(kinematics, limits, q, camera, facing, at)

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

        ``similar_objects`` is the number of other objects of about its size and color that were in
        view when the target was chosen: above zero the choice, the image center, was ambiguous.
        ``old_data_steps`` counts the control steps toward a target whose newest sighting was older
        than `STALE_S`, and whose position was uncertain by more than `FORESEEN_M`; ``foreseen_s``
        is the time for which a target out of view was followed by its prediction. ``beyond_s``,
        only if above zero, is the time for which the target has been out of reach at the end;
        ``spanned_images``, only if above zero, the number of images in which an object of its color
        reached from border to border.
        """
        rare: dict[str, float] = {
            "beyond_s": self.beyond_for,
            "spanned_images": self._tracker.spanned_images,
        }
        return {
            **{name: number for name, number in rare.items() if number > 0},
            "frames": self._tracker.frames,
            "lost_count": self._tracker.lost_count,
            "refused_sightings": self._tracker.distractors.count,
            "similar_objects": len(self._tracker.similar),
            "old_data_steps": self._reference.old_data_steps,
            "foreseen_s": self._reference.foreseen_s,
            **self._error.metrics(),
        }


def _facing_camera(arm: Arm, plane: Plane | None) -> tuple[GuardedCamera, Pose]:
    """Wrist camera and its pose in the world; any camera faces space.

    Raises:
        Failure: ``NO_CAMERA``: there is none, or it does not face the plane.
    """
    camera = own_camera(arm)
    view = arm.world.nominal[arm.name].camera_pose_at(arm.q)
    if plane is None:
        return camera, view
    facing = abs(float(np.cross(*plane.axes) @ view.turn(np.array((0.0, 0.0, 1.0)))))
    if facing < _FACING:
        raise Failure(
            "NO_CAMERA",
            f"the camera of {arm.name} looks {np.degrees(np.arccos(facing)):.0f}° past the "
            "normal of the plane: it cannot observe motion in that plane",
            cosine=facing,
        )
    return camera, view
