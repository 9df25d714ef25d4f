"""Keeps one colored target in view: detect, localize, filter, and aim the next exposure."""

from __future__ import annotations

import math
from array import array
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import islice
from typing import Final

import numpy as np

from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.perception.detection import ColorFilter, Detection, detect_all
from bt_dualarm.perception.localization import LocalizationError, Localizer, Sighting
from bt_dualarm.perception.outline import Outline, VisiblePart
from bt_dualarm.perception.target_filter import Motion, TargetEstimate
from bt_dualarm.sim.camera import Camera, GuardedCamera
from bt_dualarm.sim.frame import Frame, FrameFinding, Window
from bt_dualarm.spec.values import Color

NEWEST: Final = 1024
"""Sightings that are kept whole: of several seconds, whatever the camera."""

PLACES: Final = 2**16
"""Sightings of which time and place are kept, at most: of half an hour at 30 Hz."""

_NUMBERS: Final = 4  # stamp, x, y, z


class Sightings:
    """What a tracker has seen, oldest first; 32 bytes of each are kept until they are forgotten."""

    def __init__(self) -> None:
        self._newest: deque[Sighting] = deque(maxlen=NEWEST)
        self._places = array("d")
        self._count = 0

    def __len__(self) -> int:
        """Number of those that were taken up, ever."""
        return self._count

    def append(self, sighting: Sighting) -> None:
        """Take one up; where nobody lets go of any, the older half of the places goes."""
        if len(self._places) == _NUMBERS * PLACES:
            del self._places[: _NUMBERS * PLACES // 2]
        self._count += 1
        self._newest.append(sighting)
        self._places.extend((sighting.stamp, *sighting.point.tolist()))

    def newest(self, count: int = NEWEST) -> list[Sighting]:
        """So many of the latest, or all that are kept whole, oldest first."""
        latest = list(islice(reversed(self._newest), count))
        latest.reverse()
        return latest

    def places(self) -> tuple[Vector, Matrix]:
        """When and where in the world it was seen, of those that are kept: s and m.

        Returns:
            Arrays of shapes (n,) and (n, 3).
        """
        rows = np.array(self._places).reshape(-1, _NUMBERS)
        return rows[:, 0], rows[:, 1:]

    def forget(self, until: float) -> None:
        """Let go of the places up to a time in s."""
        stamps, _ = self.places()
        del self._places[: _NUMBERS * int(np.searchsorted(stamps, until, side="right"))]


_MIN_DEPTH_M: Final = 0.02


def window_about(
    place: Sequence[float],
    about_px: float,
    astray_m: float,
    focal_px: float,
    size: tuple[int, int],
    otherwise: Window,
) -> Window:
    """A square about where a target is predicted.

    Args:
        place: Where that is from the camera: x right, y down, z forward, m.
        about_px: Half of the target's width, and of what is left free about it, in pixels.
        astray_m: How far from there the target may be, m.
        focal_px: Focal length in pixels.
        size: Width and height of the whole image in pixels.
        otherwise: Window for a target that is not before the camera.
    """
    x, y, depth = place
    if depth < _MIN_DEPTH_M:
        return otherwise
    width, height = size
    scale = focal_px / depth
    half = about_px + scale * astray_m
    x = width / 2.0 + scale * x
    y = height / 2.0 + scale * y
    if not (-half < x < width + half and -half < y < height + half):
        return otherwise
    return Window(
        (math.floor(x - half), math.floor(y - half), math.ceil(x + half), math.ceil(y + half))
    )


@dataclass(frozen=True)
class TrackerSettings:
    """When to believe a sighting, and where to look for the next.

    Args:
        lost_after: Unseen for longer, s, the target is lost.
        confirm: Sightings in a row that make a lock.
        gate: Largest squared Mahalanobis distance from the prediction.
        gate_sigma: What the gate allows for at least, m: a real target may jerk.
        min_area: Smallest area in square pixels.
        max_area: Largest.
        window_sigmas: Half-width of the search window in standard deviations of the prediction.
        window_speed: And no more, of what is in view, than it moves otherwise than predicted, m/s.
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
    window_speed: float = 1.0
    window_margin_px: float = 6.0
    window_shakes: float = 4.0
    search_stride: int = 3

    def about_px(self, extent_px: float, noise_px: float) -> float:
        """Half of a window about a target of which the place is known, in pixels.

        Args:
            extent_px: Width of the target, or its height.
            noise_px: Standard deviation of the camera's shake.
        """
        return 0.5 * extent_px + self.window_margin_px + self.window_shakes * noise_px


FORESEEN_S: Final = 0.5
"""A target that was lost is looked for where it should be after this long."""

AWAY_M: Final = 0.2
"""Distance from where it should be by then, or was seen before, at which it may appear again."""

_LEAST_M: Final = 0.03
"""Distance at which a target may be seen off its way at once, or its own width if that is more:
what covers a part of it shifts its middle."""

_ACCELERATION: Final = 5.0
"""m/s² by which a target goes otherwise than it went, while it is not seen."""

_FASTEST: Final = 1.0
"""m/s at which an object that is not the target is followed."""

_REMEMBERED_S: Final = 0.5
"""Seconds unseen after which an object that was not the target is forgotten: it may be hidden."""


@dataclass
class _Other:
    """One such object, as it was seen last."""

    stamp: float
    point: Vector


@dataclass
class Distractors:
    """Objects that have the target's look, seen while it was lost where it cannot have been.

    Attributes:
        reason: Why the last one was refused; empty where none was.
        count: How often one was refused in a frame.
    """

    reason: str = ""
    count: int = 0
    _others: list[_Other] = field(default_factory=list)

    def forget(self) -> None:
        """The target is found again: what else is in view is told apart by where that is."""
        self._others.clear()
        self.reason = ""

    def refuse(self, why: str) -> None:
        """Count something in a frame that is not the target, and keep why."""
        self.count += 1
        self.reason = why

    def follow(self, stamp: float, seen: list[Sighting]) -> list[bool]:
        """Which of the objects in a frame are those that were refused before, each at most one."""
        self._others = [one for one in self._others if stamp - one.stamp <= _REMEMBERED_S]
        known = [False] * len(seen)
        for other in self._others:
            away = [
                math.inf if known[i] else float(np.linalg.norm(one.point - other.point))
                for i, one in enumerate(seen)
            ]
            nearest = min(range(len(seen)), key=lambda i: away[i], default=None)
            if nearest is None:
                break
            if away[nearest] <= _LEAST_M + _FASTEST * (stamp - other.stamp):
                known[nearest] = True
                other.stamp = stamp
                other.point = seen[nearest].point
        return known

    def add(self, stamp: float, sighting: Sighting) -> None:
        """Remember an object that cannot be the target: later it is no more so."""
        self._others.append(_Other(stamp, sighting.point))


def off_its_way(
    lost: TargetEstimate, stamp: float, sighting: Sighting, been: Matrix, *, depth: bool
) -> float | None:
    """Distance in m of an object from where a lost target can be by then; None if it can be there.

    Within the first tenths of a second it is near the way that it was on, from where it was last
    seen to where it would be by now, wherever on that it stopped. Later it may be anywhere near
    where it should be or has been.

    Args:
        lost: What was known of the target when it was lost.
        stamp: When the object is seen, s.
        sighting: The object.
        been: Places at which the target was seen, of shape (n, 3), m.
        depth: Whether the target's depth was known; else places count as the camera sees them.
    """
    begin = lost.predict(lost.stamp).position
    expected = lost.predict(min(stamp, lost.stamp + FORESEEN_S)).position
    point = sighting.point
    ahead = point - sighting.camera.position
    across = np.eye(3) if depth else np.eye(3) - np.outer(ahead, ahead) / float(ahead @ ahead)
    away = _from_segment(across @ point, across @ begin, across @ expected)
    late = stamp - lost.stamp
    free = max(_LEAST_M, sighting.side) + 0.5 * _ACCELERATION * late**2
    if free < AWAY_M:
        return away if away > free else None
    near = np.vstack((expected[None], been))
    nearest = float(np.linalg.norm((near - point) @ across, axis=1).min())
    return nearest if nearest > AWAY_M else None


def _from_segment(point: Vector, begin: Vector, end: Vector) -> float:
    way = end - begin
    length = float(way @ way)
    share = 0.0 if length == 0.0 else min(max(float((point - begin) @ way) / length, 0.0), 1.0)
    return float(np.linalg.norm(point - begin - share * way))


# most sightings, and oldest, that make an estimate anew
_RELOCATED = 60
_RELOCATED_S = 1.0
_RESIZED = 0.01  # by less, what is known of its size still fits
_FORGOTTEN_S = 1.0  # and after this long one that was hardly seen may be of any size


class TargetTracker:
    """Follows one target through the frames of one camera; ``close`` it when done.

    Args:
        camera: Subscribed to, and aimed, until ``close``.
        color: What the target looks like.
        localizer: Brings detections into the world.
        estimate: The filter; with an oscillator's model by default.
        settings: Gates and windows.
    """

    def __init__(
        self,
        camera: Camera | GuardedCamera,
        color: Color,
        localizer: Localizer,
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
        self._localizer = localizer
        self._outline = Outline(localizer)
        self._estimate = estimate or TargetEstimate()
        self._before_loss: TargetEstimate | None = None
        self.distractors = Distractors()
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
        self._focal_px = frame.focal_px
        self._noise_px = frame.noise_px
        chosen = self._choose(frame)
        self.detection = None if chosen is None else chosen.detection
        if chosen is None:
            self._missed(frame.stamp)
        else:
            self._take(chosen, frame)
        self._camera.findings.append(self._look(frame.stamp))

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
        """How far from where it is predicted the target may be seen, m.

        Of one that may be covered in part the filter doubts where the middle is, not where it was
        seen: what is in view does not leave that place faster than anything moves.
        """
        sigma = math.sqrt(float(self._estimate.variance(stamp).max()))
        seen = self.detection
        doubt = self._settings.window_sigmas * sigma
        reach = self._settings.window_speed * (stamp - self._estimate.stamp)
        if doubt <= reach or seen is None or seen.touches_border or not self.locked:
            return doubt
        (newest,) = self.sightings.newest(1)
        late = newest.point - self._estimate.predict(newest.stamp).position
        return min(doubt, reach + math.sqrt(late.dot(late)))

    def _choose(self, frame: Frame) -> VisiblePart | None:
        """What the frame shows of the target."""
        found = self._found(frame)
        if not self._hunting:
            return self._fitting(found, frame)
        if self._before_loss is None:
            return max(found, key=lambda seen: seen.detection.area_px, default=None)
        return self._returning(found, self._before_loss, frame.stamp)

    def _look(self, stamp: float) -> FrameFinding:
        """What the last frame has come to, for the record."""
        seen = self.detection
        point = None
        if not self._hunting:
            x, y, z = self._estimate.predict(stamp).position.tolist()
            point = x, y, z
        if seen is None:
            return FrameFinding(stamp, None, 0.0, point, self.locked)
        return FrameFinding(stamp, seen.centroid_px, seen.area_px, point, self.locked)

    def _found(self, frame: Frame) -> list[VisiblePart]:
        """All that has the color and can be where the target can be."""
        settings = self._settings
        found = []
        for detection in detect_all(frame, self._color, settings.min_area, settings.max_area):
            try:
                sighting = self._localizer.locate(detection, frame)
            except LocalizationError:
                # A patch of the right color where the target cannot be is not the target.
                continue
            whole = self._outline.shows_whole(detection, sighting, frame)
            found.append(VisiblePart(detection, sighting, whole))
        return found

    def _fitting(self, found: list[VisiblePart], frame: Frame) -> VisiblePart | None:
        """The one that fits the prediction best, by position, size and edges."""
        expected = self._estimate.predict(frame.stamp).position
        sigma = math.sqrt(float(self._estimate.variance(frame.stamp).max()))
        best = None
        least = self._settings.gate
        for seen in found:
            try:
                trusted = self._outline.trusted(seen, frame, expected, sigma)
            except LocalizationError:
                continue
            if trusted is not None:
                surprise = self._surprise(frame.stamp, trusted.sighting)
                if surprise <= least:
                    best = trusted
                    least = surprise
        return best

    def _returning(
        self, found: list[VisiblePart], lost: TargetEstimate, stamp: float
    ) -> VisiblePart | None:
        """The one of the right size that is nearest to where a lost target should be, if near."""
        late = stamp - lost.stamp
        if late > _FORGOTTEN_S and not self._outline.well_known:
            self._outline.forget()
        if not found:
            return None
        expected = lost.predict(min(stamp, lost.stamp + FORESEEN_S)).position
        been = np.array([one.point for one in self.sightings.newest()])
        others = self.distractors.follow(stamp, [seen.sighting for seen in found])
        best = None
        least = math.inf
        for seen, is_other in zip(found, others, strict=True):
            sighting = seen.sighting
            if is_other:
                self.distractors.refuse("it came from where the target cannot have been")
                continue
            off = off_its_way(lost, stamp, sighting, been, depth=self._outline.known)
            if off is not None:
                self.distractors.add(stamp, sighting)
                self.distractors.refuse(f"it appeared {off:.2f} m from where the target can be")
                continue
            if not self._outline.alike(sighting, late):
                share = sighting.side / self._outline.side
                self.distractors.refuse(f"it looks {share:.2f} times as wide")
                continue
            away = float(np.linalg.norm(sighting.point - expected))
            if away < least:
                best = seen
                least = away
        return best

    def _surprise(self, stamp: float, sighting: Sighting) -> float:
        sigma = np.hypot(sighting.sigma, self._settings.gate_sigma)
        return self._estimate.surprise(stamp, sighting.point, sigma)

    def _take(self, seen: VisiblePart, frame: Frame) -> None:
        if self._hunting:
            self._estimate = self._estimate.fresh()
            self._hunting = False
            self._in_row = 0
        detection = seen.detection
        sighting = seen.sighting
        self._estimate.update(sighting.stamp, sighting.point, sighting.sigma)
        self.sightings.append(sighting)
        self._in_row += 1
        if self.locked:
            self.last_stamp = max(self.last_stamp, sighting.stamp)
            self.lost_since = self._before_loss = None
            self.distractors.forget()
        if seen.whole:
            if self._localizer.learn(detection, frame):
                self._relocate(sighting.stamp)
            # By what is known now: else the size would be one that fits a depth of before.
            seen = seen._replace(sighting=self._localizer.locate(detection, frame))
        if not detection.touches_border:
            self._outline.learn(seen, frame)
        left, top, right, bottom = detection.bounds_px
        # Cut off at the window's edge it is larger than it looks.
        growth = 2.0 if detection.touches_border else 1.0
        self._extent_px = growth * max(right - left, bottom - top)

    def _relocate(self, stamp: float) -> None:
        """Estimate anew from what was seen of late, where it was by what is known now."""
        (newest,) = self.sightings.newest(1)
        if abs(self._localizer.relocate(newest).side / newest.side - 1.0) > _RESIZED:
            self._outline.forget()
        self._estimate = self._estimate.fresh()
        for sighting in self.sightings.newest(min(_RELOCATED, self._in_row)):
            if sighting.stamp > stamp - _RELOCATED_S:
                now = self._localizer.relocate(sighting)
                self._estimate.update(now.stamp, now.point, now.sigma)

    def _missed(self, stamp: float) -> None:
        if self._hunting:
            return
        if self._in_row < self._settings.confirm:
            # A speck that did not stay: not yet a target, so not a loss either.
            self._estimate = self._before_loss or self._estimate.fresh()
            self._hunting = True
        elif stamp - self.last_stamp > self._settings.lost_after:
            self.lost_since = self.last_stamp
            self.lost_count += 1
            self._before_loss = self._estimate
            self._hunting = True
