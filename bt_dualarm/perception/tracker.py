"""Tracker of one colored target: detect, localize, filter, and select the next exposure.

`TargetTracker` follows a target through the frames of a camera. It restricts each exposure to a
window around the prediction, gates detections by it, trusts only the visible edges of a partly
occluded target, and after a loss accepts only objects that can be the target (`Distractors`).

`Outline` has the expected size and edges of the target. Occlusion hides an edge, merging with a
neighbor shifts one, and the image border cuts one off. The centroid is then useless, but the
opposite edge is still in its place. The prediction determines which of the two edges to trust.
"""

from __future__ import annotations

import math
from array import array
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import Final, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.perception.detection import ColorFilter, Detection, detect_all
from bt_dualarm.perception.harmonic_motion import HarmonicMotion, fit_harmonic
from bt_dualarm.perception.localization import (
    PIXEL_SIGMA,
    LocalizationError,
    Localizer,
    RunningMean,
    Sighting,
)
from bt_dualarm.perception.target_filter import Motion, TargetEstimate
from bt_dualarm.sim.camera import Camera, GuardedCamera
from bt_dualarm.sim.frame import Frame, FrameFinding, Window
from bt_dualarm.spec.values import Color

EDGE_SIGMA_PX = 0.5
"""Standard deviation of an edge: it is quantized to pixels, with an error that persists."""

_Box: TypeAlias = npt.NDArray[np.float64]  # left, top, right, bottom in px

_NO_BOX: _Box = np.zeros(4)
_LEAST_DEPTH_M = 1e-3
_MEMORY_FRAMES = 10
_STRANGENESS = 2.5  # factor of the doubt for views of another size, if the shape is unknown
_KNOWN_AFTER_FRAMES = 5
# Largest ratio of sides at which a detection may be the target, for an unknown shape, which looks
# different from other directions, and for a known one:
_SAME_SIZE = (1.1, 1.013)  # next image, whole target visible
_SAME_SIZE_FAR = (1.15, 1.12)  # coarse image, or some time after the last detection
_SAME_SIZE_LATE = (1.3, 1.12)  # much later, possibly from another direction
_LATE_S = 1.0
_SLACK_PX = 1.46  # allowed change of width or height, in addition to their uncertainty
_PERSISTENCE = 4.0  # the shift of an occluded target persists for many frames, unlike noise
_SPANS_IMAGE: Final = (
    "it reaches from border to border of the image, which does not show where its center is; it is "
    "too near or too large"
)
_FULL = 0.97  # at this fraction of the target's fill ratio, an outline is as simple as its own
# Time for which whole views of another size mean another depth: of a size that is unlike that of a
# covered part, which loses either width or height, and otherwise.
_ANOTHER_DEPTH_S = (0.05, 0.3)
_OTHER_SIZE_PX = 2.0  # that difference of width and height
# Of views that change smoothly: the longest time between two, the largest factor between their fill
# ratios at once and the logarithm of its growth a second, the largest relative change of size a
# second. The fill ratio of a square that turns by 2 rad/s grows by the factor e⁴ a second.
_SMOOTH_S = 0.1
_SMOOTH_FILL = 1.05
_FILL_GROWTH = 4.0
_GROWTH = 1.5
_TURNED = 1.1  # of a target that turns or tilts; two that merge look larger
_ALIKE = 2.0  # largest factor between the decreases of width and height
_SIMPLE = 0.9  # fraction of the target's fill ratio above which they count as whole
_STEADY_SIZE = 0.015  # largest relative change of that size from image to image
_EDGE_GATE_PX = 1.5  # distance from the prediction, in addition to its uncertainty
_GATE_SIGMAS = 3.0


class VisiblePart(NamedTuple):
    """A detection, its position in the world, and whether it shows the whole target."""

    detection: Detection
    sighting: Sighting
    whole: bool


@dataclass
class Outline:
    """Running means of the target's outline over the last images that showed all of it.

    Views are weighted by their doubt: a target that was seen only obliquely may look different from
    the front.

    Args:
        localizer: Localizer, which may know the shape.
    """

    localizer: Localizer

    def __post_init__(self) -> None:
        self._count = 0
        self._better_in_row = 0
        self._resized: tuple[float, float] | None = None  # since when, and by which factor now
        # The last of the views that change smoothly since a whole one: its time, the root of its
        # area in px, its fill ratio.
        self._smooth = -math.inf, 0.0, 1.0
        # Bounding box minus that of the known shape (4), fill ratio of the box, side.
        self._look = RunningMean(6)

    @property
    def side(self) -> float:
        """Square root of the visible area, m."""
        return float(self._look.value[5])

    @property
    def _rest(self) -> _Box:
        return self._look.value[:4]

    @property
    def known(self) -> bool:
        """Whether enough views were averaged to distinguish a part from the whole."""
        return self._count >= _KNOWN_AFTER_FRAMES

    def forget(self) -> None:
        """Reset: the next detection may have any size."""
        self._count = self._better_in_row = 0
        self._resized = None
        self._look.forget()

    def is_at_another_depth(self, seen: VisiblePart, frame: Frame) -> bool:
        """Whether a known shape looked whole, but of another size, for some time; or changed.

        Its depth has changed then, or was learned from a view that misled. What covers a part of a
        target, or merges with it, changes its proportions, or its size from one image to the next.
        A target that comes nearer or goes away, and tilts, changes its width and height alike,
        smoothly from a whole view.
        """
        if frame.stride > 1:
            return False
        resized = self._is_smoothly_resized(seen, frame)
        if not self.known:
            return False
        if resized:
            return True
        detection = seen.detection
        factor = seen.sighting.side / self.side
        full = _SIMPLE < _fill(detection) / float(self._look.value[4]) < 1.0 / _SIMPLE
        if (
            seen.whole
            or detection.touches_border
            or not full
            or _misproportion(self._beside(seen, frame)) > _SLACK_PX
        ):
            self._resized = None
            return False
        since, before = self._resized or (frame.stamp, factor)
        if abs(factor / before - 1.0) > _STEADY_SIZE:
            since = frame.stamp
        self._resized = since, factor
        bigger_px = abs(1.0 - 1.0 / factor) * math.sqrt(detection.area_px)
        return frame.stamp - since >= _ANOTHER_DEPTH_S[bigger_px < _OTHER_SIZE_PX]

    def _is_changing(self, stamp: float) -> bool:
        """Whether the view at a time is one of those that change smoothly since a whole one."""
        return self._smooth[0] == stamp

    def _is_smoothly_resized(self, seen: VisiblePart, frame: Frame) -> bool:
        """Whether width and height have both changed since a whole view, smoothly until now."""
        detection = seen.detection
        root = math.sqrt(detection.area_px)
        fill = _fill(detection)
        stamp, last_root, last_fill = self._smooth
        passed = frame.stamp - stamp
        is_smooth = (
            passed <= _SMOOTH_S
            and not detection.touches_border
            and abs(math.log(fill / last_fill)) < math.log(_SMOOTH_FILL) + _FILL_GROWTH * passed
            and abs(root - last_root) < _GROWTH * passed * last_root + _SLACK_PX
        )
        if not (seen.whole or is_smooth):
            self._smooth = -math.inf, 0.0, 1.0
            return False
        self._smooth = frame.stamp, root, fill
        if seen.whole:
            return False
        left, top, right, bottom = (self._beside(seen, frame) - self._rest).tolist()
        wider, higher = right - left, bottom - top
        if min(wider, higher) > _OTHER_SIZE_PX:
            return True
        # What covers a part leaves either width or height, or makes a less simple outline; of a
        # face that stands on a corner it changes one of them more than the other.
        less, more = sorted((-wider, -higher))
        full = fill > _SIMPLE * float(self._look.value[4])
        return bool(full and self._slack(detection) < less and more < _ALIKE * less)

    def learn(self, seen: VisiblePart, frame: Frame) -> None:
        """Add a view of the whole target to the means; coarse images are ignored.

        If the shape is unknown, a view of another size is added too, with a low weight. If it is
        known, repeated views of another size reset everything when they fit its proportions better
        than the means: these were of a part of the target, or of more than it.
        """
        strange = self.known and not seen.whole
        if frame.stride > 1:
            return
        detection = seen.detection
        sighting = seen.sighting
        rest = self._beside(seen, frame)
        if strange and self.localizer.knows_shape:
            better = _misproportion(rest) + _SLACK_PX < _misproportion(self._rest)
            self._better_in_row = self._better_in_row + 1 if better else 0
            if self._better_in_row == _MEMORY_FRAMES:
                self.forget()
                self.localizer.forget()
            return
        self._count += 1
        self._better_in_row = 0
        look = np.array((*rest, _fill(detection), sighting.side))
        doubt = PIXEL_SIGMA / math.sqrt(detection.area_px)
        doubt += self.localizer.doubt(sighting.point, frame)
        self._look.take(look, _STRANGENESS * doubt if strange else doubt, _MEMORY_FRAMES)

    def _beside(self, seen: VisiblePart, frame: Frame) -> _Box:
        """Bounding box of a view minus that of the known shape; zeros without one."""
        if not self.localizer.knows_shape:
            return _NO_BOX
        rest: _Box = np.array(seen.detection.bounds_px) - self._box(seen.sighting.point, frame)
        return rest

    @property
    def well_known(self) -> bool:
        """Whether the size is reliable: averaged over many views, and of the right proportions."""
        if self._count < _MEMORY_FRAMES:
            return False
        return not self.localizer.knows_shape or _misproportion(self._rest) <= _SLACK_PX

    def alike(self, sighting: Sighting, late: float) -> bool:
        """Whether an object may be the target by its size; always true before that is known.

        Args:
            sighting: The object.
            late: Seconds since the target was seen.
        """
        most = (_SAME_SIZE_LATE if late > _LATE_S else _SAME_SIZE_FAR)[self.localizer.knows_shape]
        return not self.known or 1 / most < sighting.side / self.side < most

    def shows_whole(self, detection: Detection, sighting: Sighting, frame: Frame) -> bool:
        """Whether a detection shows all edges of the target, and nothing else."""
        if detection.touches_border or not self.known:
            return not detection.touches_border
        most = _SAME_SIZE[self.localizer.knows_shape] + self._look.doubt
        if not 1 / most < sighting.side / self.side < most:
            return False
        if not self.localizer.knows_shape:
            return True
        change = np.array(detection.bounds_px) - self._box(sighting.point, frame) - self._rest
        wider = change[2] - change[0]
        higher = change[3] - change[1]
        slack = self._slack(detection)
        # A face that turns about the line of sight keeps its area, and its box becomes as much
        # wider as higher; what covers a part of it, or merges with it, changes the area.
        turned = abs(wider - higher) <= slack
        return bool(turned or max(abs(wider), abs(higher)) <= slack)

    def trusted(
        self, seen: VisiblePart, frame: Frame, expected: Vector, sigma: float
    ) -> VisiblePart | None:
        """Locate the target in a detection that may be of a part of it; arguments as for `fit`.

        Raises:
            LocalizationError: The line of sight does not lead to a point.
        """
        if seen.whole:
            return seen
        if self.known and self.localizer.knows_shape:
            fitted = self.fit(seen.detection, frame, expected, sigma)
            bigger = seen.sighting.side / self.side
            turns = self._is_changing(frame.stamp) and bigger < _TURNED
            if fitted is not None or not turns:
                return fitted
            # It turns or tilts, and looks like no upright cube: where it is, is known less well.
        sighting = seen.sighting
        strange = abs(1.0 - (sighting.side / self.side) ** 2) if self.known else 0.0
        if seen.detection.touches_border:
            strange = max(strange, 0.5)
        shift = _PERSISTENCE * 0.5 * strange * max(self.side, sighting.side)
        return seen._replace(sighting=replace(sighting, sigma=np.hypot(sighting.sigma, shift)))

    def fit(
        self, detection: Detection, frame: Frame, expected: Vector, sigma: float
    ) -> VisiblePart | None:
        """Locate the target by the edges of a detection that agree with the prediction.

        Args:
            detection: Detection of a part of the target, or of more than it.
            frame: Frame in which it was detected.
            expected: Predicted position of the target in the world, of shape (3,), m.
            sigma: Standard deviation of the prediction, m.

        Returns:
            None if no edge agrees, along either direction of the image.

        Raises:
            LocalizationError: The line of sight does not lead to a point.
        """
        local = frame.world_in_camera.apply(expected)
        across = float(local[2]) / frame.focal_px
        box = self._box(expected, frame) + self._rest
        shift = np.array(detection.bounds_px) - box
        if self._is_another(detection, shift):
            return None
        shift[self._cut_off(detection, frame)] = math.inf
        gate = _EDGE_GATE_PX + _GATE_SIGMAS * sigma / across
        pairs = shift.reshape(2, 2)  # low and high edges; x and y
        moved = pairs[np.abs(pairs).argmin(axis=0), (0, 1)]
        if np.abs(moved).max() > gate:
            return None
        x = frame.width / 2.0 + local[0] / across + moved[0]
        y = frame.height / 2.0 + local[1] / across + moved[1]
        face = replace(
            detection,
            centroid=(2.0 * x / frame.width - 1.0, 2.0 * y / frame.height - 1.0),
            centroid_px=(float(x), float(y)),
            area_px=(self.side / across) ** 2,
        )
        sighting = self.localizer.meet(face, frame)
        coarser = EDGE_SIGMA_PX / PIXEL_SIGMA
        return VisiblePart(face, replace(sighting, sigma=coarser * sighting.sigma), whole=False)

    def _is_another(self, detection: Detection, shift: _Box) -> bool:
        """Whether a detection is another whole object, whose width and height both differ.

        Such an object occludes the target completely, or was left behind by it. An object that
        occludes a part of the target, or merges with it, makes a less simple outline or leaves
        either width or height unchanged.
        """
        change = np.abs(shift[2:] - shift[:2])
        full = _fill(detection) > _FULL * float(self._look.value[4])
        return full and bool(change.min() > self._slack(detection))

    def _slack(self, detection: Detection) -> float:
        """Tolerance of width and height in px; the whole doubt may be at one edge."""
        return _SLACK_PX + 2.0 * self._look.doubt * math.sqrt(detection.area_px)

    def _box(self, point: Vector, frame: Frame) -> _Box:
        """Predicted bounding box of the known shape at a point: left, top, right, bottom in px."""
        local = frame.world_in_camera.apply(self.localizer.corners(point, frame))
        pixels = frame.focal_px * local[:, :2] / np.maximum(local[:, 2:], _LEAST_DEPTH_M)
        pixels += (frame.width / 2.0, frame.height / 2.0)
        return np.concatenate((pixels.min(axis=0), pixels.max(axis=0)))

    @staticmethod
    def _cut_off(detection: Detection, frame: Frame) -> npt.NDArray[np.bool_]:
        """Which of the four edges are at the border of the exposed region."""
        left, top, right, bottom = detection.bounds_px
        limits = frame.region
        return np.array(
            (left <= limits[0], top <= limits[1], right >= limits[2], bottom >= limits[3])
        )


def _misproportion(rest: _Box) -> float:
    """Difference in px between the deviations of a box's width and height."""
    return abs(float((rest[2] - rest[0]) - (rest[3] - rest[1])))


def _fill(detection: Detection) -> float:
    """Fraction of its bounding box that a detection fills."""
    left, top, right, bottom = detection.bounds_px
    return detection.area_px / max((right - left) * (bottom - top), 1)


NEWEST: Final = 1024
"""Number of complete sightings that are kept, enough for several seconds of any camera."""

PLACES: Final = 2**16
"""Largest number of sightings whose time and position are kept: half an hour at 30 Hz."""

_COLUMNS: Final = 4  # stamp, x, y, z


class Sightings:
    """Sightings of a tracker, oldest first; of old ones only time and position are kept."""

    def __init__(self) -> None:
        self._newest: deque[Sighting] = deque(maxlen=NEWEST)
        self._places = array("d")
        self._count = 0

    def __len__(self) -> int:
        """Number of all sightings so far, also of those that were dropped."""
        return self._count

    def append(self, sighting: Sighting) -> None:
        """Add a sighting; at `PLACES` sightings the older half of the positions is dropped."""
        if len(self._places) == _COLUMNS * PLACES:
            del self._places[: _COLUMNS * PLACES // 2]
        self._count += 1
        self._newest.append(sighting)
        self._places.extend((sighting.stamp, *sighting.point.tolist()))

    def newest(self, count: int = NEWEST) -> list[Sighting]:
        """The latest complete sightings, oldest first."""
        latest = list(islice(reversed(self._newest), count))
        latest.reverse()
        return latest

    def places(self) -> tuple[Vector, Matrix]:
        """Times and positions of the sightings that are kept.

        Returns:
            Times, of shape (n,), s, and positions in the world, of shape (n, 3), m.
        """
        rows = np.array(self._places).reshape(-1, _COLUMNS)
        return rows[:, 0], rows[:, 1:]

    def forget(self, until: float) -> None:
        """Drop the positions up to a time in s."""
        stamps, _ = self.places()
        del self._places[: _COLUMNS * int(np.searchsorted(stamps, until, side="right"))]


_MIN_DEPTH_M: Final = 0.02


def window_about(
    place: Sequence[float],
    about_px: float,
    astray_m: float,
    focal_px: float,
    size: tuple[int, int],
    otherwise: Window,
) -> Window:
    """Square search window around the predicted position of a target.

    Args:
        place: Predicted position in the camera (x right, y down, z forward), m.
        about_px: Half the target's width plus a margin, in pixels.
        astray_m: Largest expected distance from the prediction, m.
        focal_px: Focal length in pixels.
        size: Width and height of the whole image in pixels.
        otherwise: Window for a target that is not in front of the camera, or not in the image.
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
    """Parameters of gating and of the search window.

    Args:
        lost_after: Time without a sighting after which the target is lost, s.
        confirm: Consecutive sightings that make a lock.
        gate: Largest squared Mahalanobis distance from the prediction.
        gate_sigma: Minimum standard deviation of the gate, m: a real target may jerk.
        min_area: Minimum area in square pixels.
        max_area: Largest area in square pixels.
        window_sigmas: Half-width of the search window in standard deviations of the prediction.
        window_speed: Largest deviation from the predicted velocity, which also limits the
            half-width while the target is in view, m/s.
        window_margin_px: Margin that is added, in pixels.
        window_shakes: Margin that is added, in standard deviations of the camera's shake.
        search_stride: Edge of the blocks of pixels while the target is lost.
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
        """Half-width of the window around a precisely predicted target, in pixels.

        Args:
            extent_px: Width or height of the target, whichever is larger.
            noise_px: Standard deviation of the camera's shake.
        """
        return 0.5 * extent_px + self.window_margin_px + self.window_shakes * noise_px


FORESEEN_S: Final = 0.5
"""Time for which the motion of a lost target is extrapolated."""

AWAY_M: Final = 0.2
"""Largest distance from the extrapolated position, or from an earlier one, at which a lost target
may reappear."""

_MIN_DEVIATION_M: Final = 0.03
"""Deviation from its path at which a target may reappear at once, or its own width if larger: an
occluded part shifts its center."""

_ACCELERATION: Final = 5.0
"""Largest unpredicted acceleration of a target while it is not visible, m/s²."""

_DISTRACTOR_SPEED: Final = 1.0
"""Largest speed of a distractor, m/s."""

_DISTRACTOR_MEMORY_S: Final = 0.5
"""Time without a sighting after which a distractor is forgotten: it may be occluded meanwhile."""


_COMPARABLE_AREA: Final = 0.25
"""Area relative to the largest object of its color from which an object may be the target at first:
smaller ones are specks."""

_CUT_OFF_S: Final = 0.5
"""Time for which an object at the border of the image is not the target at first, s: one that comes
into view is whole by then. Before, neither its center nor its depth is known, and it seems to move
much faster than it does."""

_SIMILAR_SIDE: Final = 1.3
"""Ratio of sides up to which two objects cannot be distinguished at first."""


@dataclass
class _Distractor:
    """Last sighting of one distractor."""

    stamp: float
    point: Vector


@dataclass
class Distractors:
    """Objects that look like a lost target, but appeared where it cannot be.

    Attributes:
        reason: Why the last candidate was refused; empty if none was.
        count: Number of refused candidates, over all frames.
    """

    reason: str = ""
    count: int = 0
    _others: list[_Distractor] = field(default_factory=list)

    def forget(self) -> None:
        """Reset after the target is found again: its prediction then excludes other objects."""
        self._others.clear()
        self.reason = ""

    def refuse(self, why: str) -> None:
        """Count a candidate that is not the target, and keep the reason."""
        self.count += 1
        self.reason = why

    def follow(self, stamp: float, seen: list[Sighting]) -> list[bool]:
        """Associate the objects in a frame with distractors, by nearest position.

        Returns:
            For each object whether it is a known distractor.
        """
        self._others = [one for one in self._others if stamp - one.stamp <= _DISTRACTOR_MEMORY_S]
        known = [False] * len(seen)
        for other in self._others:
            away = [
                math.inf if known[i] else float(np.linalg.norm(one.point - other.point))
                for i, one in enumerate(seen)
            ]
            nearest = min(range(len(seen)), key=lambda i: away[i], default=None)
            if nearest is None:
                break
            if away[nearest] <= _MIN_DEVIATION_M + _DISTRACTOR_SPEED * (stamp - other.stamp):
                known[nearest] = True
                other.stamp = stamp
                other.point = seen[nearest].point
        return known

    def add(self, stamp: float, sighting: Sighting) -> None:
        """Remember an object that cannot be the target now: it is not the target later, either."""
        self._others.append(_Distractor(stamp, sighting.point))


def distance_from_reach(
    lost: TargetEstimate, stamp: float, sighting: Sighting, been: Matrix, *, depth: bool
) -> float | None:
    """Distance in m of an object from the region where a lost target can be; None if it is inside.

    In the first tenths of a second the target is near the segment from its last position to the
    extrapolated one, wherever it stopped. Later it may be near the extrapolated position, or near
    any position where it was before.

    Args:
        lost: Filter of the target when it was lost.
        stamp: Time of the sighting, s.
        sighting: The object.
        been: Positions of earlier sightings of the target, of shape (n, 3), m.
        depth: Whether the target's depth was known; otherwise only distances across the line of
            sight count.
    """
    begin = lost.predict(lost.stamp).position
    expected = lost.predict(min(stamp, lost.stamp + FORESEEN_S)).position
    point = sighting.point
    ahead = point - sighting.camera.position
    across = np.eye(3) if depth else np.eye(3) - np.outer(ahead, ahead) / float(ahead @ ahead)
    away = _from_segment(across @ point, across @ begin, across @ expected)
    late = stamp - lost.stamp
    free = max(_MIN_DEVIATION_M, sighting.side) + 0.5 * _ACCELERATION * late**2
    if free < AWAY_M:
        return away if away > free else None
    near = np.vstack((expected[None], been))
    nearest = float(np.linalg.norm((near - point) @ across, axis=1).min())
    return nearest if nearest > AWAY_M else None


def _from_segment(point: Vector, begin: Vector, end: Vector) -> float:
    segment = end - begin
    square = float(segment @ segment)
    share = 0.0 if square == 0.0 else min(max(float((point - begin) @ segment) / square, 0.0), 1.0)
    return float(np.linalg.norm(point - begin - share * segment))


_REFILTERED = 60  # largest number of sightings from which the filter is restarted
_REFILTERED_S = 1.0  # and their largest age
_RESUMED_M = 0.04  # largest doubt of a prediction by which the filter resumes after a loss
_RESIZED = 0.01  # relative change of the size beyond which the outline is discarded
_SIZE_MEMORY_S = 1.0  # time after a loss for which an unreliable size counts


class TargetTracker:
    """Follows one target through the frames of one camera; `close` it when done.

    Args:
        camera: Camera, which is subscribed to and aimed until `close`.
        color: Color of the target.
        localizer: Localizer of detections.
        estimate: Filter; by default one with an oscillator model.
        settings: Parameters of gating and search window.
        depth: Expected depth of the target in front of the camera, m: among several objects of
            known size, those at this depth are preferred initially.

    Attributes:
        detection: Detection in the last frame, if any.
        frames: Number of frames so far.
        lost_count: Number of losses so far.
        spanned_images: Number of frames in which an object of its color reached from one border of
            the image to the opposite one.
        last_stamp: Stamp of the last sighting of the locked target, s; -inf before the first.
        lost_since: Stamp of the last sighting before the current loss, s; None if not lost.
        sightings: Sightings so far.
        distractors: Objects that were refused after a loss.
        similar: Sightings of the other objects of about the target's size when it was first seen:
            which of them is the target was ambiguous.
    """

    def __init__(
        self,
        camera: Camera | GuardedCamera,
        color: Color,
        localizer: Localizer,
        estimate: TargetEstimate | None = None,
        settings: TrackerSettings | None = None,
        depth: float | None = None,
    ) -> None:
        self.similar: list[Sighting] = []
        self._depth = depth
        self.detection: Detection | None = None
        self.frames = 0
        self.lost_count = 0
        self.spanned_images = 0
        self.last_stamp = -math.inf
        self.lost_since: float | None = None
        self.sightings = Sightings()
        self._color = ColorFilter(color)
        self._localizer = localizer
        self._outline = Outline(localizer)
        self._estimate = estimate or TargetEstimate()
        self._before_loss: TargetEstimate | None = None
        # With the time of the newest sighting that it was fitted to.
        self._harmonic: tuple[float, HarmonicMotion | None] = -math.inf, None
        self.distractors = Distractors()
        self._settings = settings or TrackerSettings()
        self._hunting = True
        self._spans_image = False
        self._cut_off_since: float | None = None
        self._in_row = 0
        self._extent_px = 0.0
        self._focal_px = 0.0
        self._noise_px = 0.0
        self._camera = camera
        self._unsubscribe: Callable[[], None] = camera.subscribe(self.on_frame)
        camera.aim = self.window

    @property
    def locked(self) -> bool:
        """Whether the target was detected in enough consecutive frames, and not lost since.

        This does not notice missing frames: check `age` before moving.
        """
        return not self._hunting and self._in_row >= self._settings.confirm

    def age(self, time: float) -> float:
        """Seconds since the last exposure that showed the locked target; inf before the first."""
        return time - self.last_stamp

    @property
    def refused(self) -> str:
        """Why an object of its color in view is not the target; empty if there is none."""
        return _SPANS_IMAGE if self._spans_image else self.distractors.reason

    @property
    def width(self) -> float | None:
        """Square root of the target's visible area, m; None before enough images showed it."""
        return self._outline.side if self._outline.known else None

    def predict(self, time: float) -> Motion:
        """Position, velocity and acceleration in the world at ``time``, each of shape (3,).

        Raises:
            ValueError: The target has never been seen.
        """
        return self._estimate.predict(time)

    def predict_in(self, axes: Matrix, origin: Vector, time: float) -> Matrix:
        """Predicted motion along k axes, of shape (3, k); see `TargetEstimate.predict_in`.

        Of a lost target, by what was known of it when it was lost.
        """
        return self._confirmed.predict_in(axes, origin, time)

    def doubt(self, time: float) -> float:
        """Largest standard deviation along an axis of the position that `predict_in` returns, m."""
        return math.sqrt(float(self._confirmed.variance(time).max()))

    def harmonic_motion(self) -> HarmonicMotion | None:
        """Harmonic motion of the locked target until it was last seen, if it moved like that."""
        if self._harmonic[0] != self.last_stamp:
            seen = [one for one in self.sightings.newest() if one.stamp <= self.last_stamp]
            relocated = [self._localizer.relocate(one) for one in seen]
            stamps = np.array([one.stamp for one in relocated])
            points = np.array([one.point for one in relocated])
            self._harmonic = self.last_stamp, fit_harmonic(stamps, points)
        return self._harmonic[1]

    @property
    def _confirmed(self) -> TargetEstimate:
        """Filter of the target; after a loss the one from before, until it is found again."""
        return self._before_loss or self._estimate

    def restart(self) -> None:
        """Choose a target anew, as at the start; sightings and counts are kept."""
        self._hunting = True
        self._before_loss = self._cut_off_since = self.lost_since = None
        self._in_row = 0
        self.last_stamp = -math.inf
        self._outline.forget()
        self._localizer.forget()
        self.distractors.forget()

    def close(self) -> None:
        """Unsubscribe from the camera and stop aiming it; harmless when repeated."""
        self._unsubscribe()
        self._unsubscribe = lambda: None  # breaks a reference cycle
        if self._camera.aim == self.window:
            self._camera.aim = None

    def on_frame(self, frame: Frame) -> None:
        """Process one frame."""
        self.frames += 1
        self._focal_px = frame.focal_px
        self._noise_px = frame.noise_px
        chosen = self._choose(frame)
        self.spanned_images += self._spans_image
        self.detection = None if chosen is None else chosen.detection
        if chosen is None:
            self._missed(frame.stamp)
        else:
            self._take(chosen, frame)
        self._camera.findings.append(self._finding(frame.stamp))

    def window(self, stamp: float, camera: Pose, width: int, height: int) -> Window:
        """Search window around the target at ``stamp``, or the whole image if lost."""
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
        """Largest expected distance of the target from its prediction, m.

        If the target is partly occluded, the filter is uncertain about its center, but its visible
        part cannot move faster than any target: then that limits the distance.
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
        """Select the detection that is the target, if any."""
        found = self._found(frame)
        if self._learn_depth_anew(found, frame):
            found = self._found(frame)
        if not self._hunting:
            chosen = self._fitting(found, frame)
            is_guess = self._before_loss is None and self._in_row < self._settings.confirm
            if chosen is None and found and is_guess:
                # What a coarse image shows of a thin rim is a part of it, at a wrong depth.
                self._forget_guess()
                chosen = self._first(self._found(frame), frame.stamp)
            return chosen
        if self._before_loss is None:
            return self._first(found, frame.stamp)
        return self._returning(found, self._before_loss, frame.stamp)

    def _forget_guess(self) -> None:
        """Discard the sightings of a target that the next image has not confirmed."""
        self._estimate = self._estimate.fresh()
        self._in_row = 0
        self._outline.forget()
        self._localizer.forget()

    def _learn_depth_anew(self, found: list[VisiblePart], frame: Frame) -> bool:
        """Forget size and depth of a target that is at another depth; returns whether it is."""
        if not found or not self._localizer.knows_shape:
            return False
        if self._hunting and self._before_loss is None:
            return False
        estimate = self._confirmed
        expected = estimate.predict(min(frame.stamp, estimate.stamp + FORESEEN_S)).position
        away = [float(np.linalg.norm(seen.sighting.point - expected)) for seen in found]
        nearest = found[int(np.argmin(away))]
        if min(away) > max(_MIN_DEVIATION_M, nearest.sighting.side):
            return False
        if not self._outline.is_at_another_depth(nearest, frame):
            return False
        self._outline.forget()
        self._localizer.forget()
        if not self._hunting and self._localizer.learn(nearest.detection, frame):
            self._relocate(frame.stamp)
        return True

    def _first(self, found: list[VisiblePart], stamp: float) -> VisiblePart | None:
        """The object at the image center, of those of the right size, or else of any size."""
        largest = max((seen.detection.area_px for seen in found), default=0.0)
        able = [seen for seen in found if seen.detection.area_px >= _COMPARABLE_AREA * largest]
        if self._depth is not None:
            right = [seen for seen in able if _alike(_depth_of(seen.sighting), self._depth)]
            able = right or able
        best = min(able, key=lambda seen: math.hypot(*seen.detection.centroid), default=None)
        if best is None or not best.detection.touches_border:
            self._cut_off_since = None
        else:
            if self._cut_off_since is None:
                self._cut_off_since = stamp
            if stamp - self._cut_off_since < _CUT_OFF_S:
                return None
        if best is not None:
            area = best.detection.area_px
            self.similar = [
                seen.sighting
                for seen in found
                if seen is not best and _alike(math.sqrt(seen.detection.area_px), math.sqrt(area))
            ]
        return best

    def _is_similar_object(self, sighting: Sighting, expected: Vector) -> bool:
        """Whether an object is where another one was at first, and the target is not expected."""
        near = max(_MIN_DEVIATION_M, sighting.side)
        if float(np.linalg.norm(sighting.point - expected)) < near:
            return False
        return any(
            float(np.linalg.norm(sighting.point - other.point)) < near for other in self.similar
        )

    def _finding(self, stamp: float) -> FrameFinding:
        """Annotation of the last frame, for the record."""
        seen = self.detection
        point = None
        if not self._hunting:
            x, y, z = self._estimate.predict(stamp).position.tolist()
            point = x, y, z
        if seen is None:
            return FrameFinding(stamp, None, 0.0, point, self.locked)
        return FrameFinding(stamp, seen.centroid_px, seen.area_px, point, self.locked)

    def _found(self, frame: Frame) -> list[VisiblePart]:
        """All detections of the color that can be localized."""
        settings = self._settings
        found = []
        self._spans_image = False
        for detection in detect_all(frame, self._color, settings.min_area, settings.max_area):
            if detection.spans(frame):
                self._spans_image = True
                continue
            try:
                sighting = self._localizer.locate(detection, frame)
            except LocalizationError:
                # A region of the right color where no target can be is not the target.
                continue
            whole = self._outline.shows_whole(detection, sighting, frame)
            found.append(VisiblePart(detection, sighting, whole))
        return found

    def _fitting(self, found: list[VisiblePart], frame: Frame) -> VisiblePart | None:
        """The detection that fits the prediction best, by position, size and edges."""
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
        """The detection that may be the lost target and is nearest to its extrapolated position."""
        late = stamp - lost.stamp
        if late > _SIZE_MEMORY_S and not self._outline.well_known:
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
                self.distractors.refuse("it came from a place where the target cannot have been")
                continue
            if self._is_similar_object(sighting, expected):
                self.distractors.add(stamp, sighting)
                self.distractors.refuse("it is where another object of that size was at first")
                continue
            off = distance_from_reach(lost, stamp, sighting, been, depth=self._outline.known)
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
            self._estimate = self._resumed(seen.sighting)
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
            # Localize again by what was learned: the size must fit the new depth.
            seen = seen._replace(sighting=self._localizer.locate(detection, frame))
        if not detection.touches_border:
            self._outline.learn(seen, frame)
        left, top, right, bottom = detection.bounds_px
        # A target that the window cuts off is larger than it appears.
        growth = 2.0 if detection.touches_border else 1.0
        self._extent_px = growth * max(right - left, bottom - top)

    def _resumed(self, sighting: Sighting) -> TargetEstimate:
        """Filter of a target that reappears: it moves as predicted if it is where predicted."""
        lost = self._before_loss
        if lost is None:
            return self._estimate.fresh()
        harmonic = self.harmonic_motion()
        stamp = sighting.stamp
        state, spread = lost.expect(stamp) if harmonic is None else harmonic.expect(stamp)
        off = (sighting.point - state[:, 0]) / math.hypot(spread[0], self._settings.gate_sigma)
        if spread[0] > _RESUMED_M or float(off @ off) > self._settings.gate:
            return self._estimate.fresh()
        return lost.resumed(stamp, state, spread)

    def _relocate(self, stamp: float) -> None:
        """Restart the filter from recent sightings, relocated by what is known now."""
        (newest,) = self.sightings.newest(1)
        if abs(self._localizer.relocate(newest).side / newest.side - 1.0) > _RESIZED:
            self._outline.forget()
        self._estimate = self._estimate.fresh()
        for sighting in self.sightings.newest(min(_REFILTERED, self._in_row)):
            if sighting.stamp > stamp - _REFILTERED_S:
                now = self._localizer.relocate(sighting)
                self._estimate.update(now.stamp, now.point, now.sigma)

    def _missed(self, stamp: float) -> None:
        if self._hunting:
            return
        if self._in_row < self._settings.confirm:
            # A detection that was not confirmed is not a target, so this is not a loss.
            self._estimate = self._before_loss or self._estimate.fresh()
            self._hunting = True
        elif stamp - self.last_stamp > self._settings.lost_after:
            self.lost_since = self.last_stamp
            self.lost_count += 1
            self._before_loss = self._estimate
            self._hunting = True


def _depth_of(sighting: Sighting) -> float:
    """Depth of a sighting in front of its camera, m."""
    local = sighting.camera.inverse.apply(sighting.point)
    return float(local[2])


def _alike(one: float, other: float) -> bool:
    """Whether two lengths differ by at most `_SIMILAR_SIDE`."""
    return 1.0 / _SIMILAR_SIDE < one / other < _SIMILAR_SIDE
