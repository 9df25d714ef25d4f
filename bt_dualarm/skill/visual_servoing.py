"""Following a coloured target in a plane: a wrist camera, a tracker and a servo put together."""

from __future__ import annotations

import numpy as np

from bt_dualarm.arm.arm import Arm
from bt_dualarm.errors import Failure, Number
from bt_dualarm.motion.setpoints.planar_servo import PlanarServo, plane_reach
from bt_dualarm.pose import Matrix, Pose, Vector
from bt_dualarm.skill.briskness import briskness
from bt_dualarm.skill.following_error import FollowingError
from bt_dualarm.skill.tracking_reference import (
    PlaneView,
    TrackingGains,
    TrackingReference,
    stale_after,
)
from bt_dualarm.spec.color import Color
from bt_dualarm.spec.plane import Plane
from bt_dualarm.vision.calm_estimate import CalmEstimate
from bt_dualarm.vision.guessed_plane import OnGuessedPlane
from bt_dualarm.vision.plane_of_size import OnPlaneOfSize
from bt_dualarm.vision.stillness import Stillness, look
from bt_dualarm.vision.tracker import TargetTracker
from bt_dualarm.world.cameras.guarded_camera import GuardedCamera

_FACING = 0.5  # cosine between the camera's axis and the plane's normal
_GIVEN_DEPTH, _MEASURED_DEPTH = 3.0, 1.3  # factors by which a target's depth may be wrong


class PlaneTracking:
    """Follows one target; ``close`` it when done.

    Args:
        arm: Arm with a camera of its own, which looks along the plane's normal.
        color: Look of the target.
        plane: Plane in which the tool moves.
        speed: Share of the arm's limits.
        distance: Depth of the target in front of the camera in m.
        target_size: Edge in m of a target that is a cube with a face along the plane: measures
            its depth instead, and takes out what is seen of its flanks.
        gains: Gains of proportional control; None to predict the target.
        reach: Farthest that the tool leaves its start, in m.
        search_radius: How far the search goes from where the target should be, in m.
        error: Judges how far off the middle of the image the target is seen.

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
        guessed = OnGuessedPlane(view.position, ahead, normal)
        localiser = (
            guessed if target_size is None else OnPlaneOfSize(normal, target_size, cube=True)
        )
        allowed = plane_reach(arm.kinematics, self._limits, arm.setpoint.q, self._axes)
        self._briskness = briskness(camera, allowed.jerk)
        estimate = CalmEstimate(self._briskness.calmness, self._briskness.calm_jerk)
        self._tracker = TargetTracker(camera, color, localiser, estimate)
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
        self._stillness = Stillness(_MEASURED_DEPTH if target_size else _GIVEN_DEPTH)
        self._watched = 0

    @property
    def locked(self) -> bool:
        """Whether the target is in view and confirmed."""
        return self._tracker.locked

    @property
    def in_view(self) -> bool:
        """Whether the newest sighting is fresh enough to move towards."""
        return self._tracker.locked and self._reference.stale_for(self._arm.time) <= 0.0

    @property
    def follows(self) -> bool:
        """Whether the target is in view and where the tool may go."""
        return self.in_view and self._reference.beyond_since is None

    @property
    def arrived(self) -> bool:
        """Whether the target is where it should be in the image, within the bound on the error."""
        return self.follows and self._error.arrived

    @property
    def seen_at(self) -> float:
        """When the newest image that shows the locked target was exposed, in simulated s."""
        return self._tracker.last_stamp

    @property
    def unseen_for(self) -> float:
        """Seconds for which frames have shown no target; their latency is not its absence."""
        return max(0.0, self._tracker.age(self._arm.time) - self._latency)

    @property
    def beyond_for(self) -> float:
        """Seconds for which the target has been farther away than the tool may go."""
        since = self._reference.beyond_since
        return 0.0 if since is None else self._arm.time - since

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
        servo = PlanarServo(
            self._arm.kinematics,
            self._limits,
            self._arm.period,
            self._arm.setpoint,
            self._axes,
            self._reference,
            self._briskness.bandwidth,
            self._briskness.slack,
        )
        self._arm.stream(servo)

    def watch(self) -> None:
        """Note whether the target moves and how well it is followed; call it once a tick.

        Raises:
            Failure: ``NOT_FOLLOWING``.
        """
        seen = self._tracker.sightings
        new, self._watched = seen.newest(len(seen) - self._watched), len(seen)
        # Frames that got lost are no absence, though a late camera is `in_view` no more meanwhile.
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
        """Let go of the camera."""
        self._tracker.close()

    def sightings(self) -> tuple[Vector, Matrix]:
        """When and where in the world the target was seen of late: shapes (n,) and (n, 3)."""
        return self._tracker.sightings.places()

    def forget_sightings(self, until: float) -> None:
        """Let go of those up to a time, in s: they are asked for no more."""
        self._tracker.sightings.forget(until)

    def metrics(self) -> dict[str, Number]:
        """Frames looked at, how often the target was lost, and motion towards old data.

        Beside them what `FollowingError` has measured.

        ``old_data_steps`` counts the control steps that moved towards a target whose newest
        sighting was older than ``STALE_S`` (``tracking_reference``) at that step.
        """
        return {
            "frames": self._tracker.frames,
            "lost_count": self._tracker.lost_count,
            "old_data_steps": self._reference.old_data_steps,
            **self._error.metrics(),
        }


def _facing_camera(arm: Arm, plane: Plane) -> tuple[GuardedCamera, Pose]:
    """The camera that moves with the arm, and its pose."""
    if arm.camera is None or not arm.world.declared_arms[arm.name].carries_camera:
        raise Failure("NO_CAMERA", f"{arm.name} has no camera that moves with it")
    view = arm.world.nominal[arm.name].camera_pose_at(arm.q)
    facing = abs(float(np.cross(*plane.axes) @ view.turn(np.array((0.0, 0.0, 1.0)))))
    if facing < _FACING:
        raise Failure(
            "NO_CAMERA",
            f"the camera of {arm.name} looks {np.degrees(np.arccos(facing)):.0f}° past the "
            "normal of the plane: it cannot see how a target moves there",
            cosine=facing,
        )
    return arm.camera, view
