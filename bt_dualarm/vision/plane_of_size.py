"""Locating a target of known size on a plane of known direction, whose place the size tells."""

from __future__ import annotations

import math

import numpy as np

from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.vision.detect import Detection
from bt_dualarm.vision.front_face import cube_corners, flank_share, front_face, square_corners
from bt_dualarm.vision.localise import PIXEL_SIGMA, Localiser, OfSize, OnPlane, Sighting
from bt_dualarm.vision.running_mean import RunningMean
from bt_dualarm.world.cameras.frame import Frame

_PLANE_MEMORY_FRAMES = 30
_FLANK_ROUNDS = 2
_KNOWN_AFTER_FRAMES = 10
_KNOWN_TO = 0.01  # share of the depth
_HELD_TO = 0.002  # of the depth, too: a mean that has gone no farther leaves the plane where it is


class OnPlaneOfSize(Localiser):
    """The target stays on a plane of known direction, whose place its known size tells.

    The place is a running mean over the last ``_PLANE_MEMORY_FRAMES`` that were learnt: much
    steadier than one image's. A cube seen from ahead counts for far more than one whose flanks may
    be in view: whether they are in the dark, or stand on something, its size does not tell. All is
    located on one plane until the mean has gone elsewhere: then all of it has been there before,
    too, as a depth that is better known is no motion of the target.

    Args:
        normal: Unit vector of the plane, of shape (3,).
        side: Root of its outline's area in m, as for ``OfSize``.
        cube: Whether the target is a cube with a face parallel to the plane: what is seen of its
            flanks is allowed for, and the centre of the front face located.
    """

    def __init__(self, normal: Vector, side: float, *, cube: bool = False) -> None:
        self._normal = np.array(normal, dtype=float)
        self._by_size = OfSize(side)
        self._cube = cube
        self._place = RunningMean(1)
        self._plane: OnPlane | None = None
        self._count = 0
        self._faced: tuple[Detection, Detection] | None = None

    def locate(self, detection: Detection, frame: Frame) -> Sighting:
        """Where the line of sight meets the plane; see ``Localiser``."""
        return self.meet(self._face(detection, frame), frame)

    def meet(self, face: Detection, frame: Frame) -> Sighting:
        """On the plane, as soon as it is known; see ``Localiser``."""
        if self._count == 0 or self._plane is None:
            return self._by_size.locate(face, frame)
        return self._plane.locate(face, frame)

    def learn(self, detection: Detection, frame: Frame) -> bool:
        """Take its size into the mean; one that is cut off says nothing."""
        if detection.touches_border:
            return False
        found = self._by_size.locate(self._face(detection, frame), frame)
        grain = PIXEL_SIGMA * frame.stride / math.sqrt(detection.area_px)
        doubt = grain + self.doubt(found.point, frame)
        self._place.take(self._normal[None] @ found.point, doubt, _PLANE_MEMORY_FRAMES)
        self._count += 1
        self._faced = None
        return self._hold(frame)

    def relocate(self, sighting: Sighting) -> Sighting:
        """On the plane as it is known now; see ``Localiser``."""
        return sighting if self._plane is None else self._plane.relocate(sighting)

    def forget(self) -> None:
        """Drop where the plane is."""
        self._place.forget()
        self._count = 0
        self._faced = None

    @property
    def knows_shape(self) -> bool:
        """Whether it is a cube."""
        return self._cube

    def corners(self, point: Vector, frame: Frame) -> Matrix:
        """Those of the cube, or of a square in the plane."""
        of_shape = cube_corners if self._cube else square_corners
        return of_shape(frame, point, self._normal, self._by_size.side)

    def doubt(self, point: Vector, frame: Frame) -> float:
        """What a cube's flanks may add: which of them have its colour is not known."""
        if not self._cube:
            return 0.0
        return flank_share(frame, point, self._normal, self._by_size.side)

    def _hold(self, frame: Frame) -> bool:
        """Put the plane where the mean is by now, if it is elsewhere; whether it was."""
        place = self._place.value[0] * self._normal
        known = self._plane
        if known is not None:
            moved, depth = (self._normal @ (place - p) for p in (known.point, frame.pose.position))
            if abs(moved) <= _HELD_TO * abs(depth):
                return False
        self._plane = OnPlane(place, self._normal)
        return known is not None

    def _face(self, detection: Detection, frame: Frame) -> Detection:
        if not self._cube:
            return detection
        # What was located is learnt from next, most times: once is enough until something is.
        if self._faced is None or self._faced[0] is not detection:
            self._faced = detection, self._without_flanks(detection, frame)
        return self._faced[1]

    def _without_flanks(self, detection: Detection, frame: Frame) -> Detection:
        """Better each time, as the place gets better; a third would change micrometres."""
        # Until the place of the plane is known, the area cannot tell near from flanks in view.
        known = self._count >= _KNOWN_AFTER_FRAMES and self._place.doubt <= _KNOWN_TO
        flanks = None if known else 1.0
        corrected = detection
        for _ in range(_FLANK_ROUNDS):
            point = self.meet(corrected, frame).point
            corrected = front_face(
                detection, frame, point, self._normal, self._by_size.side, flanks=flanks
            )
        return corrected
