"""Outline of a target: its expected size and edges, and its position when it is partly visible.

Occlusion hides an edge of a target, merging with a neighbor shifts one, and the image border cuts
one off. The centroid is then useless, but the opposite edge is still in its place. The prediction
tells which of the two edges to trust.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from bt_dualarm.core.pose import Vector
from bt_dualarm.perception.detection import Detection
from bt_dualarm.perception.localization import PIXEL_SIGMA, Localizer, RunningMean, Sighting
from bt_dualarm.sim.frame import Frame

EDGE_SIGMA_PX = 0.5
"""Standard deviation of an edge: it is quantized to pixels, with an error that persists."""

_Box: TypeAlias = npt.NDArray[np.float64]  # left, top, right, bottom in px

_NO_BOX: _Box = np.zeros(4)
_MIN_DEPTH_M = 1e-3
_MEMORY_FRAMES = 10
_STRANGENESS = 2.5  # factor of the doubt for views of another size, if the shape is unknown
_KNOWN_AFTER_FRAMES = 5
# Largest ratio of sides at which a detection may be the target, for an unknown shape, which looks
# different from other directions, and for a known one:
_SAME_SIZE = (1.1, 1.013)  # in the next image, seen whole
_SAME_SIZE_FAR = (1.15, 1.12)  # in a coarse image, or after some time unseen
_SAME_SIZE_LATE = (1.3, 1.12)  # after a longer time, possibly from another direction
_LATE_S = 1.0
_SLACK_PX = 1.46  # by which width or height may change, in addition to their doubt
_PERSISTENCE = 4.0  # the shift of an occluded target persists for many frames, unlike noise
_FULL = 0.97  # share of the target's fill ratio from which on an outline is as simple as its own
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
        # Bounding box less that of the known shape (4), fill ratio of the box, side.
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
        self._look.forget()

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
        """Bounding box of a view less that of the known shape; zeros without one."""
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
        changed = max(abs(change[2] - change[0]), abs(change[3] - change[1]))
        return bool(changed <= self._slack(detection))

    def trusted(
        self, seen: VisiblePart, frame: Frame, expected: Vector, sigma: float
    ) -> VisiblePart | None:
        """Locate the target in a detection that may be of a part of it; arguments as of `fit`.

        Raises:
            LocalizationError: The line of sight does not lead to a point.
        """
        if seen.whole:
            return seen
        if self.known and self.localizer.knows_shape:
            return self.fit(seen.detection, frame, expected, sigma)
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
        pixels = frame.focal_px * local[:, :2] / np.maximum(local[:, 2:], _MIN_DEPTH_M)
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
    """Share of its bounding box that a detection fills."""
    left, top, right, bottom = detection.bounds_px
    return detection.area_px / max((right - left) * (bottom - top), 1)
