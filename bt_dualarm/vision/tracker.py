"""Keep one coloured target in view: detect, localise, filter, and aim the next exposure at it."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from bt_dualarm.pose import Matrix, Pose, Vector
from bt_dualarm.spec.color import Color
from bt_dualarm.vision.colors import ColorFilter
from bt_dualarm.vision.detect import Detection, detect_all
from bt_dualarm.vision.estimate import Motion, TargetEstimate
from bt_dualarm.vision.localise import LocaliseError, Localiser, Sighting
from bt_dualarm.vision.outline import Outline, Seen
from bt_dualarm.vision.search_window import window_about
from bt_dualarm.vision.sightings import Sightings
from bt_dualarm.vision.tracker_settings import TrackerSettings
from bt_dualarm.world.cameras.camera import Camera
from bt_dualarm.world.cameras.frame import Frame, Window
from bt_dualarm.world.cameras.guarded_camera import GuardedCamera
from bt_dualarm.world.cameras.look import Look

_FORESEEN_S = 0.5  # a target that was lost is looked for where it should be after this long
_AWAY_M = 0.2  # from where it should be by then, or was seen before, at which it may appear again
_RELOCATED, _RELOCATED_S = 60, 1.0  # most sightings, and oldest, that make an estimate anew
_RESIZED = 0.01  # by less, what is known of its size still fits
_FORGOTTEN_S = 1.0  # and after this long one of another size is taken for it, too


class TargetTracker:
    """Follows one target through the frames of one camera; ``close`` it when done.

    Args:
        camera: Subscribed to, and aimed, until ``close``.
        color: What the target looks like.
        localiser: Brings detections into the world.
        estimate: The filter; with an oscillator's model by default.
        settings: Gates and windows.
    """

    def __init__(
        self,
        camera: Camera | GuardedCamera,
        color: Color,
        localiser: Localiser,
        estimate: TargetEstimate | None = None,
        settings: TrackerSettings | None = None,
    ) -> None:
        self.detection: Detection | None = None
        self.frames = 0
        self.lost_count = 0
        self.last_stamp = -math.inf
        self.lost_since: float | None = None
        self.sightings = Sightings()
        self._color = ColorFilter(color)
        self._localiser = localiser
        self._outline = Outline(localiser)
        self._estimate = estimate or TargetEstimate()
        self._before_loss: TargetEstimate | None = None
        self._settings = settings or TrackerSettings()
        self._hunting = True
        self._in_row = 0
        self._extent_px = 0.0
        self._focal_px = 0.0
        self._noise_px = 0.0
        self._camera = camera
        self._unsubscribe: Callable[[], None] = camera.subscribe(self.on_frame)
        camera.aim = self.window

    @property
    def locked(self) -> bool:
        """Whether the target was seen in enough frames in a row, and not lost since.

        Frames that never come are not noticed here: ask ``age`` before moving.
        """
        return not self._hunting and self._in_row >= self._settings.confirm

    def age(self, time: float) -> float:
        """Seconds since the exposure that last showed a locked target; inf if none ever did."""
        return time - self.last_stamp

    def predict(self, time: float) -> Motion:
        """Position, velocity and acceleration in the world at ``time``, each of shape (3,).

        Raises:
            ValueError: The target has never been seen.
        """
        return self._estimate.predict(time)

    def predict_in(self, axes: Matrix, origin: Vector, time: float) -> Matrix:
        """The same along two axes, of shape (3, 2); see `TargetEstimate.predict_in`."""
        return self._estimate.predict_in(axes, origin, time)

    def close(self) -> None:
        """Stop listening to the camera and aiming it; harmless when repeated."""
        self._unsubscribe()
        self._unsubscribe = lambda: None  # what refers back to this would keep it in memory
        if self._camera.aim == self.window:
            self._camera.aim = None

    def on_frame(self, frame: Frame) -> None:
        """Take in one frame."""
        self.frames += 1
        self._focal_px, self._noise_px = frame.focal_px, frame.noise_px
        chosen = self._choose(frame)
        self.detection = None if chosen is None else chosen.detection
        if chosen is None:
            self._missed(frame.stamp)
        else:
            self._take(chosen, frame)
        self._camera.looks.append(self._look(frame.stamp))

    def window(self, stamp: float, camera: Pose, width: int, height: int) -> Window:
        """Where the target will be seen at ``stamp``, wide enough for what is not known."""
        settings = self._settings
        everything = Window(None, settings.search_stride)
        if self._hunting:
            return everything
        offset = self._estimate.predict(stamp).position - camera.position
        place = offset.dot(camera.rotation_matrix).tolist()
        about = settings.about_px(self._extent_px, self._noise_px)
        eye = self._focal_px, (width, height)
        return window_about(place, about, self._astray(stamp), *eye, everything)

    def _astray(self, stamp: float) -> float:
        """How far from where it is predicted the target may be seen, in m.

        Of one that may be covered in part the filter doubts where the middle is, not where it was
        seen: what is in view does not leave that place faster than anything moves.
        """
        sigma, seen = math.sqrt(float(self._estimate.variance(stamp).max())), self.detection
        doubt = self._settings.window_sigmas * sigma
        reach = self._settings.window_speed * (stamp - self._estimate.stamp)
        if doubt <= reach or seen is None or seen.touches_border or not self.locked:
            return doubt
        (newest,) = self.sightings.newest(1)
        late = newest.point - self._estimate.predict(newest.stamp).position
        return min(doubt, reach + math.sqrt(late.dot(late)))

    def _choose(self, frame: Frame) -> Seen | None:
        """What the frame shows of the target."""
        found = self._found(frame)
        if not self._hunting:
            return self._fitting(found, frame)
        if self._before_loss is None:
            return max(found, key=lambda seen: seen.detection.area_px, default=None)
        return self._returning(found, self._before_loss, frame.stamp)

    def _look(self, stamp: float) -> Look:
        """What the last frame has come to, for the record."""
        seen, point = self.detection, None
        if not self._hunting:
            x, y, z = self._estimate.predict(stamp).position.tolist()
            point = x, y, z
        if seen is None:
            return Look(stamp, None, 0.0, point, self.locked)
        return Look(stamp, seen.centroid_px, seen.area_px, point, self.locked)

    def _found(self, frame: Frame) -> list[Seen]:
        """All that has the colour and can be where the target can be."""
        settings = self._settings
        found = []
        for detection in detect_all(frame, self._color, settings.min_area, settings.max_area):
            try:
                sighting = self._localiser.locate(detection, frame)
            except LocaliseError:
                # A patch of the right colour where the target cannot be is not the target.
                continue
            whole = self._outline.shows_whole(detection, sighting, frame)
            found.append(Seen(detection, sighting, whole))
        return found

    def _fitting(self, found: list[Seen], frame: Frame) -> Seen | None:
        """The one that fits the prediction best, by position, size and edges."""
        expected = self._estimate.predict(frame.stamp).position
        sigma = math.sqrt(float(self._estimate.variance(frame.stamp).max()))
        best, least = None, self._settings.gate
        for seen in found:
            try:
                trusted = self._outline.trusted(seen, frame, expected, sigma)
            except LocaliseError:
                continue
            if trusted is not None:
                surprise = self._surprise(frame.stamp, trusted.sighting)
                if surprise <= least:
                    best, least = trusted, surprise
        return best

    def _returning(self, found: list[Seen], lost: TargetEstimate, stamp: float) -> Seen | None:
        """The one of the right size that is nearest to where a lost target should be, if near."""
        if stamp - lost.stamp > _FORGOTTEN_S:
            self._outline.forget()
        if not found:
            return None
        expected = lost.predict(min(stamp, lost.stamp + _FORESEEN_S)).position
        # Where it can have gone, or has been: what looks like it anywhere else is something else.
        been = np.array([expected, *(one.point for one in self.sightings.newest())])
        alike = (seen for seen in found if self._outline.alike(seen.sighting))
        return min(
            (
                seen
                for seen in alike
                if float(np.linalg.norm(been - seen.sighting.point, axis=1).min()) <= _AWAY_M
            ),
            key=lambda seen: float(np.linalg.norm(seen.sighting.point - expected)),
            default=None,
        )

    def _surprise(self, stamp: float, sighting: Sighting) -> float:
        sigma = np.hypot(sighting.sigma, self._settings.gate_sigma)
        return self._estimate.surprise(stamp, sighting.point, sigma)

    def _take(self, seen: Seen, frame: Frame) -> None:
        if self._hunting:
            self._estimate = self._estimate.anew()
            self._hunting, self._in_row = False, 0
        detection, sighting = seen.detection, seen.sighting
        self._estimate.update(sighting.stamp, sighting.point, sighting.sigma)
        self.sightings.append(sighting)
        self._in_row += 1
        if self.locked:
            self.last_stamp = max(self.last_stamp, sighting.stamp)
            self.lost_since = self._before_loss = None
        if seen.whole:
            if self._localiser.learn(detection, frame):
                self._relocate(sighting.stamp)
            # By what is known now: else the size would be one that fits a depth of before.
            seen = seen._replace(sighting=self._localiser.locate(detection, frame))
        if not detection.touches_border:
            self._outline.learn(seen, frame)
        left, top, right, bottom = detection.bounds_px
        # Cut off at the window's edge it is larger than it looks.
        growth = 2.0 if detection.touches_border else 1.0
        self._extent_px = growth * max(right - left, bottom - top)

    def _relocate(self, stamp: float) -> None:
        """Estimate anew from what was seen of late, where it was by what is known now."""
        (newest,) = self.sightings.newest(1)
        if abs(self._localiser.relocate(newest).side / newest.side - 1.0) > _RESIZED:
            self._outline.forget()
        self._estimate = self._estimate.anew()
        for sighting in self.sightings.newest(min(_RELOCATED, self._in_row)):
            if sighting.stamp > stamp - _RELOCATED_S:
                now = self._localiser.relocate(sighting)
                self._estimate.update(now.stamp, now.point, now.sigma)

    def _missed(self, stamp: float) -> None:
        if self._hunting:
            return
        if self._in_row < self._settings.confirm:
            # A speck that did not stay: not yet a target, so not a loss either.
            self._estimate = self._before_loss or self._estimate.anew()
            self._hunting = True
        elif stamp - self.last_stamp > self._settings.lost_after:
            self.lost_since = self.last_stamp
            self.lost_count += 1
            self._before_loss = self._estimate
            self._hunting = True
