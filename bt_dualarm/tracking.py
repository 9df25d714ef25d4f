"""Following a coloured target in a plane: a wrist camera, a tracker and a servo put together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bt_dualarm.arm import Arm
from bt_dualarm.errors import Failure, Number
from bt_dualarm.motion.servo import PlanarServo, PlaneTarget
from bt_dualarm.motion.spiral import Spiral
from bt_dualarm.pose import Matrix, Pose, Vector
from bt_dualarm.spec.color import Color
from bt_dualarm.spec.plane import Plane
from bt_dualarm.vision.localise import Localiser, OnPlane, OnPlaneOfSize
from bt_dualarm.vision.stillness import Stillness
from bt_dualarm.vision.tracker import TargetTracker
from bt_dualarm.world.camera import camera_pose
from bt_dualarm.world.guarded_camera import GuardedCamera

STALE_S = 0.1
"""Age of the newest sighting in seconds, at the moment of actuation, from which nothing moves
towards the target.

Where images that come regularly are older than that already, by latency and frame rate, the limit
is two frames more than the latency: else the arm would never move.
"""

HOLD_S = 0.5
"""How long the tool holds still before the search begins, in seconds."""

_FACING = 0.5  # cosine between the camera's axis and the plane's normal
_BANDWIDTH = (30.0, 150.0)  # rad/s, least and most
_BANDWIDTH_PER_FPS = 4.0  # above it the noise of the estimate is followed, below it the target lags
_OLD_S = 0.1  # latency that halves the bandwidth
_PATIENCE_FRAMES = 2


@dataclass(frozen=True)
class TrackingGains:
    """Proportional image control: ``Δy = -k_y e_x, Δz = -k_z e_y``, e from target to centre.

    Attributes:
        u: Step along the plane's first axis for an error of half an image, in m.
        v: The same along its second axis.
        dead_band: Normalised error that counts as none.
    """

    u: float
    v: float
    dead_band: float


class PlaneTracking:
    """Follows one target; ``close`` it when done.

    Args:
        arm: With a camera of its own, which looks along the plane's normal.
        color: What the target looks like.
        plane: In which the tool moves.
        speed: Share of the arm's limits.
        distance: Depth of the target in front of the camera in m.
        target_size: Edge in m of a target that is a cube with a face along the plane: measures
            its depth instead, and takes out what is seen of its flanks.
        gains: Of proportional control; None to predict the target.
        reach: Farthest that the tool leaves its start, in m.
        search_radius: How far the search goes from where the target should be, in m.

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
    ) -> None:
        self._arm = arm
        self._axes = np.array(plane.axes)
        self._speed = speed
        self._gains = gains
        self._reach = reach
        self._search_radius = search_radius
        camera, view = _facing_camera(arm, plane)
        forward = view.turn(np.array((0.0, 0.0, 1.0)))
        self._center = self._axes @ (view.position + distance * forward)
        self._image_axes = self._axes @ view.rotation_matrix[:, :2]
        normal = np.cross(*self._axes)
        localiser: Localiser = (
            OnPlane(view.position + distance * forward, normal)
            if target_size is None
            else OnPlaneOfSize(normal, target_size, cube=True)
        )
        self._tracker = TargetTracker(camera, color, localiser)
        self._latency = camera.latency
        self._stale = _stale_after(camera)
        self._old_data_steps = 0
        self._last_place = np.zeros(2)
        self._search: Spiral | None = None
        self._beyond_since: float | None = None
        self._bandwidth = _bandwidth(camera)
        self._servo: PlanarServo | None = None
        self._goal = np.zeros(2)
        self._goal_stamp = -np.inf
        self._stillness = Stillness()
        self._watched = 0

    @property
    def locked(self) -> bool:
        """Whether the target is in view and confirmed."""
        return self._tracker.locked

    @property
    def in_view(self) -> bool:
        """Whether the newest sighting is fresh enough to move towards."""
        return self._tracker.locked and self._stale_for(self._arm.time) <= 0.0

    @property
    def follows(self) -> bool:
        """Whether the target is in view and where the tool may go."""
        return self.in_view and self._beyond_since is None

    @property
    def unseen_for(self) -> float:
        """Seconds for which frames have shown no target; their latency is not its absence."""
        return max(0.0, self._tracker.age(self._arm.time) - self._latency)

    @property
    def beyond_for(self) -> float:
        """Seconds for which the target has been farther away than the tool may go."""
        return 0.0 if self._beyond_since is None else self._arm.time - self._beyond_since

    @property
    def still_for(self) -> float:
        """Seconds for which a target that has moved was seen to be still; 0 before it moved."""
        return self._stillness.still_for if self.in_view else 0.0

    @property
    def target(self) -> Vector:
        """Where the target is believed to be now, in the world, of shape (3,)."""
        return self._tracker.predict(self._arm.time).position

    def begin(self) -> None:
        """Start to move."""
        self._watched = len(self._tracker.sightings)
        self._servo = PlanarServo(
            self._arm.kinematics,
            self._arm.limits(self._speed),
            self._arm.period,
            self._arm.setpoint,
            self._axes,
            self._target,
            self._bandwidth,
        )
        self._arm.stream(self._servo)

    def watch(self) -> None:
        """Note whether the target moves; call it once a tick."""
        new = self._tracker.sightings[self._watched :]
        self._watched += len(new)
        # Frames that got lost are no absence, though a late camera is `in_view` no more meanwhile.
        if not self._tracker.locked:
            self._stillness.interrupt()
            return
        for seen in new:
            sigma = float(np.sqrt((np.square(self._axes) @ np.square(seen.sigma)).max()))
            self._stillness.take(seen.stamp, self._axes @ seen.point, sigma)

    def close(self) -> None:
        """Let go of the camera."""
        self._tracker.close()

    def sightings(self) -> tuple[Vector, Matrix]:
        """When and where in the world the target was seen: shapes (n,) and (n, 3)."""
        seen = self._tracker.sightings
        points = np.array([sighting.point for sighting in seen]).reshape(-1, 3)
        return np.array([sighting.stamp for sighting in seen]), points

    def metrics(self) -> dict[str, Number]:
        """Frames looked at, how often the target was lost, and motion towards old data.

        ``old_data_steps`` counts the control steps that moved towards a target whose newest
        sighting was older than ``STALE_S`` at that step.
        """
        return {
            "frames": self._tracker.frames,
            "lost_count": self._tracker.lost_count,
            "old_data_steps": self._old_data_steps,
        }

    def _predicted(self, time: float) -> PlaneTarget | None:
        """Predictive control: where the target is now, by all that was seen of it."""
        motion = self._tracker.predict(time)
        place = self._axes @ motion.position - self._center
        return PlaneTarget(place, self._axes @ motion.velocity, self._axes @ motion.acceleration)

    def _stepped(self, _: float) -> PlaneTarget | None:
        """Proportional control: one step for each new image."""
        detection, servo, gains = self._tracker.detection, self._servo, self._gains
        if servo is None or gains is None:
            return None
        if detection is not None and detection.stamp > self._goal_stamp:
            error = np.where(np.abs(detection.centroid) > gains.dead_band, detection.centroid, 0.0)
            step = (self._image_axes @ error) * (gains.u, gains.v)
            self._goal, self._goal_stamp = servo.displacement + step, detection.stamp
        return PlaneTarget(self._goal, np.zeros(2), np.zeros(2))

    def _target(self, time: float) -> PlaneTarget | None:
        """Where the tool should be at ``time``; None to come to rest."""
        if not self._tracker.locked or self._stale_for(time) > 0.0:
            return self._without_target(time)
        self._search = None
        target = self._predicted(time) if self._gains is None else self._stepped(time)
        if target is None or not self._may_go_to(target.position, time):
            return None
        self._old_data_steps += self._tracker.age(time) > STALE_S
        self._last_place = target.position
        return target

    def _without_target(self, time: float) -> PlaneTarget | None:
        """Come to rest and hold, then search around where the target was last predicted."""
        self._beyond_since = None
        searched_for = self._stale_for(time) - HOLD_S
        if self._servo is None or self._search_radius == 0.0 or searched_for < 0.0:
            return None
        if self._search is None:
            start = self._servo.displacement.copy()
            self._search = Spiral(start, self._last_place, self._search_radius)
        place = self._search.place(searched_for)
        place *= min(1.0, self._reach / max(float(np.hypot(*place)), 1e-9))
        return PlaneTarget(place, np.zeros(2), np.zeros(2))

    def _stale_for(self, time: float) -> float:
        """Seconds since the newest sighting became too old to move by; below 0 it is fresh."""
        return self._tracker.age(time) - self._stale

    def _may_go_to(self, place: Vector, time: float) -> bool:
        """Whether a place is within reach; notes since when it has not been."""
        if float(np.hypot(*place)) <= self._reach:
            self._beyond_since = None
        elif self._beyond_since is None:
            self._beyond_since = time
        return self._beyond_since is None


def _stale_after(camera: GuardedCamera) -> float:
    """Age in s from which a sighting is too old."""
    if camera.latency + camera.period < STALE_S:
        return STALE_S
    return camera.latency + _PATIENCE_FRAMES * camera.period


def _bandwidth(camera: GuardedCamera) -> float:
    """Of the servo, in rad/s: the less, the rarer, the older and the shakier the images are."""
    doubt = 1.0 + camera.noise + camera.latency / _OLD_S
    least, most = _BANDWIDTH
    return max(least, min(most, _BANDWIDTH_PER_FPS / camera.period) / doubt)


def _facing_camera(arm: Arm, plane: Plane) -> tuple[GuardedCamera, Pose]:
    """The camera that moves with the arm, and its pose."""
    if arm.camera is None or not arm.world.declared_arms[arm.name].carries_camera:
        raise Failure("NO_CAMERA", f"{arm.name} has no camera that moves with it")
    view = camera_pose(arm.world.data, arm.world.arms[arm.name].camera_id)
    facing = abs(float(np.cross(*plane.axes) @ view.turn(np.array((0.0, 0.0, 1.0)))))
    if facing < _FACING:
        raise Failure(
            "NO_CAMERA",
            f"the camera of {arm.name} looks {np.degrees(np.arccos(facing)):.0f}° past the "
            "normal of the plane: it cannot see how a target moves there",
            cosine=facing,
        )
    return arm.camera, view
