"""Keep one coloured target in view: detect, localise, filter, and aim the next exposure at it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from bt_dualarm.pose import Pose, Vector
from bt_dualarm.spec.color import Color
from bt_dualarm.vision.colors import ColorFilter
from bt_dualarm.vision.detect import Detection, detect_all
from bt_dualarm.vision.estimate import Motion, TargetEstimate
from bt_dualarm.vision.localise import LocaliseError, Localiser, Sighting
from bt_dualarm.world.camera import Camera, Frame, Window
from bt_dualarm.world.guarded_camera import GuardedCamera

_MIN_DEPTH_M = 0.02
_SIDE_MEMORY_FRAMES = 10
_STRANGE_MEMORY_FRAMES = 60  # another size is believed only if it stays
_STRANGE = 1.1  # times the side of one, or less than one by it: merged, or covered in part
_PERSISTENCE = 4.0  # the shift of a covered target is the same for many frames: unlike noise


@dataclass(frozen=True)
class TrackerSettings:
    """When to believe a sighting, and where to look for the next.

    Args:
        lost_after: Unseen for longer, in s, the target is lost.
        confirm: Sightings in a row that make a lock.
        gate: Largest squared Mahalanobis distance from the prediction.
        gate_sigma: What the gate allows for at least, in m: a real target may jerk.
        min_area: Smallest area in square pixels.
        max_area: Largest.
        window_sigmas: Half-width of the search window in standard deviations of the prediction.
        window_margin_px: And in pixels besides.
        window_shakes: And in standard deviations of the camera's shake.
        search_stride: Coarseness of the image while there is nothing to aim at.
    """

    lost_after: float = 0.1
    confirm: int = 3
    gate: float = 25.0
    gate_sigma: float = 0.004
    min_area: float = 12.0
    max_area: float = math.inf
    window_sigmas: float = 4.0
    window_margin_px: float = 6.0
    window_shakes: float = 4.0
    search_stride: int = 3


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
        self.sightings: list[Sighting] = []
        self._color = ColorFilter(color)
        self._localiser = localiser
        self._estimate = estimate or TargetEstimate()
        self._settings = settings or TrackerSettings()
        self._in_row = 0
        self._side = 0.0
        self._sized = 0
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
        return self.lost_since is None and self._in_row >= self._settings.confirm

    def age(self, time: float) -> float:
        """Seconds since the exposure in which the target was last seen; inf if it never was."""
        return time - self.last_stamp

    def predict(self, time: float) -> Motion:
        """Position, velocity and acceleration in the world at ``time``, each of shape (3,).

        Raises:
            ValueError: The target has never been seen.
        """
        return self._estimate.predict(time)

    def variance(self, time: float) -> Vector:
        """Variance of the predicted position along x, y, z, of shape (3,), in m².

        Raises:
            ValueError: The target has never been seen.
        """
        return self._estimate.variance(time)

    def close(self) -> None:
        """Stop listening to the camera and aiming it; harmless when repeated."""
        self._unsubscribe()
        if self._camera.aim == self.window:
            self._camera.aim = None

    def on_frame(self, frame: Frame) -> None:
        """Take in one frame."""
        self.frames += 1
        self._focal_px, self._noise_px = frame.focal_px, frame.noise_px
        chosen = self._choose(frame, self._candidates(frame))
        if chosen is None:
            self.detection = None
            self._missed(frame.stamp)
            return
        self.detection, sighting = chosen
        if self._seen(self.detection, sighting):
            self._localiser.learn(self.detection, frame)

    def window(self, stamp: float, camera: Pose, width: int, height: int) -> Window:
        """Where the target will be seen at ``stamp``, wide enough for what is not known."""
        everything = Window(None, self._settings.search_stride)
        if self._hunting:
            return everything
        point = camera.inverse.apply(self._estimate.predict(stamp).position)
        if point[2] < _MIN_DEPTH_M:
            return everything
        scale = self._focal_px / point[2]
        sigma = math.sqrt(float(self._estimate.variance(stamp).max()))
        settings = self._settings
        half = 0.5 * self._extent_px + settings.window_margin_px
        half += settings.window_sigmas * sigma * scale + settings.window_shakes * self._noise_px
        x, y = width / 2.0 + scale * point[0], height / 2.0 + scale * point[1]
        if not (-half < x < width + half and -half < y < height + half):
            return everything
        return Window(
            (
                math.floor(x - half),
                math.floor(y - half),
                math.ceil(x + half),
                math.ceil(y + half),
            )
        )

    @property
    def _hunting(self) -> bool:
        """Nothing to aim at: never seen, or lost."""
        return self.lost_since is not None or not self._estimate.started

    def _candidates(self, frame: Frame) -> list[tuple[Detection, Sighting]]:
        settings = self._settings
        found = []
        for detection in detect_all(frame, self._color, settings.min_area, settings.max_area):
            try:
                sighting = self._localiser.locate(detection, frame)
            except LocaliseError:
                # A patch of the right colour where the target cannot be is not the target.
                continue
            found.append((detection, self._doubted(detection, sighting)))
        return found

    def _doubted(self, detection: Detection, sighting: Sighting) -> Sighting:
        """Allow for the shift of the centre of a target that is cut off, covered or merged."""
        whole = self._side**2
        # Less is seen than there is: something covers it. More: something alike stands beside it.
        strange = abs(1.0 - sighting.side**2 / whole) if whole > 0.0 else 0.0
        if detection.touches_border:
            strange = max(strange, 0.5)
        if strange < 0.1:
            return sighting
        shift = _PERSISTENCE * 0.5 * strange * max(self._side, sighting.side)
        return replace(sighting, sigma=np.hypot(sighting.sigma, shift))

    def _choose(
        self, frame: Frame, found: list[tuple[Detection, Sighting]]
    ) -> tuple[Detection, Sighting] | None:
        """The candidate that fits the prediction best; the largest where there is none."""
        if self._hunting:
            return max(found, key=lambda pair: pair[0].area_px, default=None)
        rated = [(self._surprise(frame.stamp, pair[1]), index) for index, pair in enumerate(found)]
        best = min(rated, default=(math.inf, -1))
        return found[best[1]] if best[0] <= self._settings.gate else None

    def _surprise(self, stamp: float, sighting: Sighting) -> float:
        sigma = np.hypot(sighting.sigma, self._settings.gate_sigma)
        return self._estimate.surprise(stamp, sighting.point, sigma)

    def _seen(self, detection: Detection, sighting: Sighting) -> bool:
        """Take in a sighting; whether the target was seen whole in it."""
        if self._hunting:
            self._estimate.reset()
            self.lost_since = None
            self._in_row = 0
            self._side, self._sized = sighting.side, 0
        self._estimate.update(sighting.stamp, sighting.point, sighting.sigma)
        self.sightings.append(sighting)
        self._in_row += 1
        self.last_stamp = max(self.last_stamp, sighting.stamp)
        whole = not detection.touches_border and self._learn_size(sighting)
        left, top, right, bottom = detection.bounds_px
        # Cut off at the window's edge it is larger than it looks.
        growth = 2.0 if detection.touches_border else 1.0
        self._extent_px = growth * max(right - left, bottom - top)
        return whole

    def _learn_size(self, sighting: Sighting) -> bool:
        """Take in the size of a target seen to its edges; whether it is the one that is known."""
        self._sized += 1
        known = self._sized > _SIDE_MEMORY_FRAMES
        strange = not self._side / _STRANGE < sighting.side < _STRANGE * self._side
        memory = _STRANGE_MEMORY_FRAMES if known and strange else _SIDE_MEMORY_FRAMES
        self._side += (sighting.side - self._side) / min(self._sized, memory)
        return not (known and strange)

    def _missed(self, stamp: float) -> None:
        if self._hunting:
            return
        if self._in_row < self._settings.confirm:
            # A speck that did not stay: not yet a target, so not a loss either.
            self._estimate.reset()
            self._in_row = 0
        elif stamp - self.last_stamp > self._settings.lost_after:
            self.lost_since = self.last_stamp
            self.lost_count += 1
