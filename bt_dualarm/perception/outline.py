"""The outline of a target, and where the target is when only a part of it can be trusted.

What covers a target hides an edge, what merges with it shifts one, the border of an image cuts one
off: its centroid is then worth nothing. The opposite edge still is where it was, though, and which
of the two it is tells the prediction.
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
"""Standard deviation of an edge: of its whole pixels, which stay wrong for many frames."""

_Box: TypeAlias = npt.NDArray[np.float64]  # left, top, right, bottom in px

_NO_BOX: _Box = np.zeros(4)
_MIN_DEPTH_M = 1e-3
_MEMORY_FRAMES = 10
_STRANGENESS = 2.5  # times the doubt: another size of a shape that is not known, until it stays
_KNOWN_AFTER_FRAMES = 5
# Of a shape that is not known, and looks different from elsewhere, and of one that is:
_ALIKE = (1.1, 1.013)  # times the side of one, or less than one by it: the same, seen whole
_ALIKE_FAR = (1.15, 1.12)  # the same in a coarse image, or after some time unseen
_ALIKE_LATE = (1.3, 1.12)  # and after longer, when it may be seen from elsewhere: with its flanks
_LATE_S = 1.0
_SLACK_PX = 1.46  # by which width or height may change, besides what they are in doubt by
_PERSISTENCE = 4.0  # the shift of a covered target is the same for many frames: unlike noise
_FULL = 0.97  # of the share of its box that the target fills: an object as simple as itself
_EDGE_GATE_PX = 1.5  # from its prediction, besides what that is uncertain by
_GATE_SIGMAS = 3.0


class VisiblePart(NamedTuple):
    """A detection, where it is in the world, and whether it shows the target whole."""

    detection: Detection
    sighting: Sighting
    whole: bool


@dataclass
class Outline:
    """Running means over the last images that showed the target whole, and showed it well.

    One that was seen from aside only may look different from ahead: by what is in doubt.

    Args:
        localizer: Localizer, which knows the shape if anybody does.
    """

    localizer: Localizer

    def __post_init__(self) -> None:
        self._count = 0
        self._better_in_row = 0
        # Of the box, what is beside the shape that is known; share of the box that is filled; side.
        self._look = RunningMean(6)

    @property
    def side(self) -> float:
        """Root of the area, m."""
        return float(self._look.value[5])

    @property
    def _rest(self) -> _Box:
        return self._look.value[:4]

    @property
    def known(self) -> bool:
        """Whether enough was seen to tell a part from the whole."""
        return self._count >= _KNOWN_AFTER_FRAMES

    def forget(self) -> None:
        """What comes next may have any size."""
        self._count = self._better_in_row = 0
        self._look.forget()

    def learn(self, seen: VisiblePart, frame: Frame) -> None:
        """Take in the target seen whole; a coarse image tells too little.

        Of a shape that is not known, one that looks strange is taken in as well, slowly. Of one
        that is known, all is forgotten where what looks strange has its proportions, and what is
        remembered has not: that was a part of it, or more than it.
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
        """What is beside the shape that is known; nothing where none is."""
        if not self.localizer.knows_shape:
            return _NO_BOX
        rest: _Box = np.array(seen.detection.bounds_px) - self._box(seen.sighting.point, frame)
        return rest

    @property
    def well_known(self) -> bool:
        """Whether its size is that of all of it: seen often, and no strip where it is square."""
        if self._count < _MEMORY_FRAMES:
            return False
        return not self.localizer.knows_shape or _misproportion(self._rest) <= _SLACK_PX

    def alike(self, sighting: Sighting, late: float) -> bool:
        """Whether an object may be the target by its size; anything may before that is known.

        Args:
            sighting: The object.
            late: Seconds for which the target was not seen.
        """
        most = (_ALIKE_LATE if late > _LATE_S else _ALIKE_FAR)[self.localizer.knows_shape]
        return not self.known or 1 / most < sighting.side / self.side < most

    def shows_whole(self, detection: Detection, sighting: Sighting, frame: Frame) -> bool:
        """Whether a detection is the target with all its edges, and nothing else."""
        if detection.touches_border or not self.known:
            return not detection.touches_border
        most = _ALIKE[self.localizer.knows_shape] + self._look.doubt
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
        """The target in what may be a part of it, or more than it; arguments as of ``fit``.

        Raises:
            LocalizeError: The line of sight leads nowhere.
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
        """The target by those edges of a detection that are its own.

        Args:
            detection: Detection of a part of the target, or of more than it.
            frame: Frame in which it was detected.
            expected: Point of the world where the target should be, of shape (3,), m.
            sigma: Standard deviation of that, m.

        Returns:
            ``None`` where it cannot be told, along either direction of the image.

        Raises:
            LocalizeError: The line of sight leads nowhere.
        """
        local = frame.world_in_camera.apply(expected)
        across = float(local[2]) / frame.focal_px
        box = self._box(expected, frame) + self._rest
        shift = np.array(detection.bounds_px) - box
        if self._is_another(detection, shift):
            return None
        shift[self._cut_off(detection, frame)] = math.inf
        gate = _EDGE_GATE_PX + _GATE_SIGMAS * sigma / across
        pairs = shift.reshape(2, 2)  # of low and high edges along x and y
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
        """Whether it is a whole object of another width and of another height.

        One that covers the target, or one that the target has left: what covers a part of it, or
        stands beside it, makes a more complicated outline, or leaves one of the two as it is.
        """
        change = np.abs(shift[2:] - shift[:2])
        full = _fill(detection) > _FULL * float(self._look.value[4])
        return full and bool(change.min() > self._slack(detection))

    def _slack(self, detection: Detection) -> float:
        """Change in px that width and height may have: a strip at one edge is all of the doubt."""
        return _SLACK_PX + 2.0 * self._look.doubt * math.sqrt(detection.area_px)

    def _box(self, point: Vector, frame: Frame) -> _Box:
        """Where the edges of the shape that is known would be, if it were at a point."""
        local = frame.world_in_camera.apply(self.localizer.corners(point, frame))
        pixels = frame.focal_px * local[:, :2] / np.maximum(local[:, 2:], _MIN_DEPTH_M)
        pixels += (frame.width / 2.0, frame.height / 2.0)
        return np.concatenate((pixels.min(axis=0), pixels.max(axis=0)))

    @staticmethod
    def _cut_off(detection: Detection, frame: Frame) -> npt.NDArray[np.bool_]:
        """Which of the four edges are those of what was exposed."""
        left, top, right, bottom = detection.bounds_px
        limits = frame.region
        return np.array(
            (left <= limits[0], top <= limits[1], right >= limits[2], bottom >= limits[3])
        )


def _misproportion(rest: _Box) -> float:
    """Excess in px of a box's width over its height, or of its height over its width."""
    return abs(float((rest[2] - rest[0]) - (rest[3] - rest[1])))


def _fill(detection: Detection) -> float:
    """Share of its box that a detection fills."""
    left, top, right, bottom = detection.bounds_px
    return detection.area_px / max((right - left) * (bottom - top), 1)
