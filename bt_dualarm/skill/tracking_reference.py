"""Where the tool should be while it follows a target: at it, at rest, or searching."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bt_dualarm.motion.setpoints.planar_servo import PlaneTarget
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.skill.spiral_search import Spiral
from bt_dualarm.vision.tracker import TargetTracker

STALE_S = 0.1
"""Age of the newest sighting in seconds, at the moment of actuation, from which nothing moves
towards the target.

Where images that come regularly are older than that already, by latency and frame rate, the limit
is two frames more than the latency: else the arm would never move.
"""

HOLD_S = 0.5
"""How long the tool holds still before the search begins, in seconds."""

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


@dataclass(frozen=True, eq=False)
class PlaneView:
    """The plane as the camera sees it when the tool begins to follow.

    Attributes:
        axes: Unit vectors of the plane in the world, of shape (2, 3).
        ahead: Says which point of the world, of shape (3,), in m, is in the middle of the image, by
            the depth of the target that is believed.
        image_axes: Directions of the image's x and y, as columns, along them, (2, 2).
    """

    axes: Matrix
    ahead: Callable[[], Vector]
    image_axes: Matrix


class TrackingReference:
    """What the servo asks for at the control rate.

    Args:
        tracker: Eyes on the target.
        view: Plane and camera at the start.
        gains: Gains of proportional control; None to predict the target.
        reach: Farthest that the tool leaves its start, in m.
        search_radius: How far the search goes from where the target should be, in m.
        stale_after: Age in s from which a sighting is too old to move by.

    Attributes:
        beyond_since: Simulated time in s since which the target has been out of reach, or None.
        old_data_steps: Count of the control steps that moved towards a target whose newest
            sighting was older than ``STALE_S``.
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
        self._last_place = np.zeros(2)
        self._search: Spiral | None = None
        self._goal = np.zeros(2)
        self._goal_stamp = -np.inf

    def __call__(self, time: float, displacement: Vector) -> PlaneTarget | None:
        """Where the tool should be at ``time``; None to come to rest.

        Args:
            time: Simulated time of actuation, in s.
            displacement: Place of the tool in the plane, from its start, of shape (2,), in m.
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
        if not self._may_go_to(target.position, time):
            return None
        self.old_data_steps += age > STALE_S
        self._last_place = target.position
        return target

    def stale_for(self, time: float) -> float:
        """Seconds since the newest sighting became too old to move by; below 0 it is fresh."""
        return self._tracker.age(time) - self._stale_after

    def _predicted(self, time: float) -> PlaneTarget:
        """Predictive control: where the target is now, by all that was seen of it."""
        view = self._view
        return PlaneTarget(*self._tracker.predict_in(view.axes, view.ahead(), time))

    def _stepped(self, gains: TrackingGains, displacement: Vector) -> PlaneTarget:
        """Proportional control: one step for each new image."""
        detection = self._tracker.detection
        if detection is not None and detection.stamp > self._goal_stamp:
            error = np.where(np.abs(detection.centroid) > gains.dead_band, detection.centroid, 0.0)
            step = (self._view.image_axes @ error) * (gains.u, gains.v)
            self._goal, self._goal_stamp = displacement + step, detection.stamp
        return PlaneTarget(self._goal, np.zeros(2), np.zeros(2))

    def _without_target(self, time: float, displacement: Vector) -> PlaneTarget | None:
        """Come to rest and hold, then search around where the target was last predicted."""
        self.beyond_since = None
        searched_for = self.stale_for(time) - HOLD_S
        if self._search_radius == 0.0 or searched_for < 0.0:
            return None
        if self._search is None:
            self._search = Spiral(displacement.copy(), self._last_place, self._search_radius)
        place = self._search.place(searched_for)
        place *= min(1.0, self._reach / max(float(np.hypot(*place)), 1e-9))
        return PlaneTarget(place, np.zeros(2), np.zeros(2))

    def _may_go_to(self, place: Vector, time: float) -> bool:
        """Whether a place is within reach; notes since when it has not been."""
        x, y = place.tolist()
        if math.hypot(x, y) <= self._reach:
            self.beyond_since = None
        elif self.beyond_since is None:
            self.beyond_since = time
        return self.beyond_since is None


def stale_after(latency: float, period: float) -> float:
    """Age in s from which a sighting is too old.

    Args:
        latency: Age in s of an image when it comes.
        period: Seconds between images.
    """
    if latency + period < STALE_S:
        return STALE_S
    return latency + _PATIENCE_FRAMES * period
