"""Detection of colored targets in a frame.

Pixels within a color range are cleaned by opening and closing, and grouped by contours (OpenCV).
Holes count as part of a target: a print on its face hides its color there, not its outline.
Centroid and area are weighted by the fraction of each pixel that the target covers, which makes
them much finer than a pixel.
"""

from __future__ import annotations

import colorsys
import math
from dataclasses import dataclass, replace
from functools import cache
from types import ModuleType
from typing import TYPE_CHECKING, Final, TypeAlias

import numpy as np
import numpy.typing as npt

from bt_dualarm.core.errors import DualArmError
from bt_dualarm.core.later import Later
from bt_dualarm.sim.frame import Frame, Image, JsonList, Region
from bt_dualarm.spec.document import ObjectSpec
from bt_dualarm.spec.values import Color

if TYPE_CHECKING:
    import cv2
else:
    cv2 = Later("cv2")

# Colors

_HUE_MARGIN: Final = 14.0
"""Tolerance of the hue to either side in degrees, for light and camera noise."""

_MIN_SATURATION: Final = 0.55
_MIN_VALUE: Final = 0.35  # below these values a color is too gray or too dark for a reliable hue


class ColorlessError(DualArmError):
    """An object has no color by which a camera could distinguish it."""


def color_of(obj: ObjectSpec) -> Color:
    """The color range of a declared object.

    Raises:
        ColorlessError: The object is gray, white, black or nearly so.
    """
    if isinstance(obj.color, str):
        try:
            return Color.named(obj.color)
        except ValueError:
            raise ColorlessError(f"{obj.color} is not a color that a camera can find") from None
    hue, saturation, value = colorsys.rgb_to_hsv(*obj.rgba[:3])
    if saturation < _MIN_SATURATION or value < _MIN_VALUE:
        red, green, blue = obj.rgba[:3]
        written = f"[{red:g}, {green:g}, {blue:g}]"
        raise ColorlessError(f"{written} is too gray or too dark for a camera to find")
    middle = 360.0 * hue
    bounds = [math.fmod(middle + side * _HUE_MARGIN + 360.0, 360.0) for side in (-1.0, 1.0)]
    return Color.model_validate([{"hue": bounds}])


Mask: TypeAlias = npt.NDArray[np.uint8]
"""255 for selected pixels, else 0, of shape (height, width)."""


class ColorFilter:
    """A color range, ready to be applied to images.

    Args:
        color: Color; a pixel in any of its ranges matches.

    Attributes:
        name: Text of its ranges, which identifies it.
    """

    def __init__(self, color: Color) -> None:
        self._boxes = color.bounds
        self.name = " ".join(f"{low.tolist()}-{high.tolist()}" for low, high in self._boxes)

    def mask(self, image: Image) -> Mask:
        """Mask of the matching pixels of an image (red, green, blue) of shape (h, w, 3)."""
        hsv = cv2.cvtColor(image, cv2.COLOR_RGB2HSV)
        mask = cv2.inRange(hsv, *self._boxes[0])
        for box in self._boxes[1:]:
            cv2.bitwise_or(mask, cv2.inRange(hsv, *box), dst=mask)
        return np.asarray(mask, dtype=np.uint8)


# Targets

_KERNEL = np.ones((3, 3), np.uint8)
_MARGIN_PX = 3
_CLEANING_REACH_PX = 2  # around matching pixels, of opening and closing

# Share of the matching pixels that opening removes, above which rims may be thin.
_THIN_SHARE: Final = 0.02

# Half the width in samples of the gaps that a rim around a hole may have: one ray per block of a
# coarse image misses a thin rim here and there.
_RIM_GAP: Final = 1
_RIM_GAP_COARSE: Final = 2
_THIN_RIM_GAP_COARSE: Final = 3  # of rims only one or two blocks thick, as solid objects are not


@dataclass(frozen=True)
class Detection:
    """A target in an image.

    Attributes:
        stamp: Simulated time of the exposure in s.
        centroid: Normalized offset from the image center, x to the right, y down; edges at -1, 1.
        centroid_px: Centroid in pixels from the top left corner of the image.
        area_px: Area in square pixels, with partly covered pixels counted by their share.
        size: Square root of the area over the image height.
        bounds_px: Bounding box: left, top, right, bottom (right and bottom outside).
        confidence: Fraction of the filled outline that has the color, 0 to 1.
        touches_border: Whether it reaches the border of the exposed region, which shifts its
            centroid.
    """

    stamp: float
    centroid: tuple[float, float]
    centroid_px: tuple[float, float]
    area_px: float
    size: float
    bounds_px: Region
    confidence: float
    touches_border: bool

    @classmethod
    def at(
        cls,
        frame: Frame,
        place: tuple[float, float],
        area: float,
        bounds: Region,
        confidence: float = 1.0,
        touches_border: bool = False,
    ) -> Detection:
        """Create a detection from measurements: position and bounds in px, area in square px."""
        x, y = place
        return cls(
            stamp=frame.stamp,
            centroid=(2.0 * x / frame.width - 1.0, 2.0 * y / frame.height - 1.0),
            centroid_px=(x, y),
            area_px=area,
            size=math.sqrt(area) / frame.height,
            bounds_px=bounds,
            confidence=confidence,
            touches_border=touches_border,
        )

    def spans(self, frame: Frame) -> bool:
        """Whether it reaches from one border of the whole image to the opposite one."""
        left, top, right, bottom = self.bounds_px
        across = left <= 0 and right >= frame.width
        return across or (top <= 0 and bottom >= frame.height)

    @property
    def plain(self) -> JsonList:
        """The measurements in JSON's types, for `Frame.answer`."""
        measured = [self.centroid_px, self.area_px, self.bounds_px, self.confidence]
        return [*measured, self.touches_border]

    @classmethod
    def of_plain(cls, frame: Frame, plain: JsonList) -> Detection:
        """Restore a detection from `plain`, bit for bit."""
        (x, y), area, (left, top, right, bottom), confidence, touches_border = plain
        box = (left, top, right, bottom)
        return cls.at(frame, (x, y), area, box, confidence, touches_border)


def detect(
    frame: Frame,
    color: ColorFilter,
    min_area: float = 12.0,
    max_area: float = math.inf,
    expected_px: tuple[float, float] | None = None,
) -> Detection | None:
    """Detect one target.

    Args:
        frame: Frame; only its exposed region is processed.
        color: Color of the target.
        min_area: Minimum area of a target, in square pixels.
        max_area: Largest area of a target, in square pixels.
        expected_px: Predicted pixel of the target: the nearest candidate is chosen. Without it, the
            largest is.

    Returns:
        The detection, or None if the target is not in the image.
    """
    found = detect_all(frame, color, min_area, max_area)
    if expected_px is None:
        return max(found, key=lambda seen: seen.area_px, default=None)
    return min(found, key=lambda seen: math.dist(seen.centroid_px, expected_px), default=None)


def detect_all(
    frame: Frame, color: ColorFilter, min_area: float = 12.0, max_area: float = math.inf
) -> list[Detection]:
    """Detect all targets of a color and of an area within bounds, in no particular order."""
    if frame.memory is None:
        return [found for found, _ in detect_blobs(frame, color, min_area, max_area)]

    def look() -> JsonList:
        return [found.plain for found, _ in detect_blobs(frame, color, min_area, max_area)]

    found = frame.answer(f"detect {color.name} from {min_area!r} to {max_area!r} px", look)
    return [Detection.of_plain(frame, each) for each in found]


def detect_blobs(
    frame: Frame, color: ColorFilter, min_area: float = 12.0, max_area: float = math.inf
) -> list[tuple[Detection, Blob]]:
    """Like `detect_all`, with the pixels of each target."""
    step = frame.stride
    part = frame.blocks
    if part.size == 0:
        return []
    raw = color.mask(part)
    x, y, width, height = cv2.boundingRect(raw)
    if width == 0:
        return []
    left = max(x - _CLEANING_REACH_PX, 0)
    top = max(y - _CLEANING_REACH_PX, 0)
    near = raw[top : y + height + _CLEANING_REACH_PX, left : x + width + _CLEANING_REACH_PX]
    whole = near
    if step > 1:
        cleaned = whole = _with_holes_filled(near, coarse=True)
    else:
        cleaned = _open_and_close(near)
        # A rim that opening keeps is a closed contour anyway.
        if cv2.countNonZero(near & ~cleaned) > _THIN_SHARE * cv2.countNonZero(near):
            whole = _with_holes_filled(near, coarse=False)
            cleaned = _open_and_close(whole)
    contours, _ = cv2.findContours(
        cleaned, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE, offset=(left, top)
    )
    found = []
    for contour in contours:
        x, y, width, height = cv2.boundingRect(contour)
        if width * height * step**2 >= min_area:
            blob = Blob.cut(part, raw, contour, (x, y, x + width, y + height))
            if whole is not near:
                blob = blob.painted()
            found.append((_measure(frame, blob), blob))
    return [(d, blob) for d, blob in found if min_area <= d.area_px <= max_area]


@dataclass(frozen=True, eq=False)
class Blob:
    """One contour and the pixels around it; all arrays have the same height and width.

    Attributes:
        rgb: Colors.
        raw: Mask of the pixels that match the color.
        filled: Mask of the pixels within the contour.
        origin: Position of the arrays' top left sample in the exposed region.
        bounds: Bounding box of the contour in the exposed region.
        limits: Width and height of the exposed region in samples.
    """

    rgb: Image
    raw: Mask
    filled: Mask
    origin: tuple[int, int]
    bounds: Region
    limits: tuple[int, int]

    @classmethod
    def cut(cls, rgb: Image, raw: Mask, contour: cv2.typing.MatLike, bounds: Region) -> Blob:
        """Cut out the part of an image around one contour."""
        height, width = raw.shape
        left = max(bounds[0] - _MARGIN_PX, 0)
        top = max(bounds[1] - _MARGIN_PX, 0)
        part = slice(top, bounds[3] + _MARGIN_PX), slice(left, bounds[2] + _MARGIN_PX)
        filled = np.zeros_like(raw[part])
        cv2.drawContours(filled, [contour], -1, 255, cv2.FILLED, offset=(-left, -top))
        colors = np.ascontiguousarray(rgb[part])
        alike = np.ascontiguousarray(raw[part])
        return cls(colors, alike, filled, (left, top), bounds, (width, height))

    def painted(self) -> Blob:
        """The same with the mean of the matching colors in what the outline surrounds.

        Otherwise a print would count as background beside a thin rim.
        """
        hidden = (cv2.erode(self.filled, _KERNEL) != 0) & (self.raw == 0)
        shown = (self.filled != 0) & (self.raw != 0)
        if not hidden.any() or not shown.any():
            return self
        rgb = self.rgb.copy()
        rgb[hidden] = np.rint(self.rgb[shown].mean(axis=0))
        return replace(self, rgb=rgb)


def _measure(frame: Frame, blob: Blob) -> Detection:
    step = frame.stride
    (left, top) = frame.region[:2]
    area, by_column, by_row, filled, colored = _kernels().measure_coverage(
        blob.rgb, blob.raw, blob.filled
    )
    total = max(area, 1e-9)
    # Half a sample is added: moments have a pixel's center at its index, frames at index + 0.5.
    x = left + step * (blob.origin[0] + by_column / total + 0.5)
    y = top + step * (blob.origin[1] + by_row / total + 0.5)
    x0, y0, x1, y1 = blob.bounds
    return Detection.at(
        frame,
        (x, y),
        total * step**2,
        (left + x0 * step, top + y0 * step, left + x1 * step, top + y1 * step),
        colored / max(filled, 1),
        x0 == 0 or y0 == 0 or x1 == blob.limits[0] or y1 == blob.limits[1],
    )


def coverage(blob: Blob) -> npt.NDArray[np.float32]:
    """Fraction of each pixel that the target covers, 0 to 1, of the shape of the blob's arrays.

    It is 1 inside the contour. A pixel at the edge is a linear mixture of target and background: on
    the line between their mean colors, its position between the extremes of its neighborhood is the
    share.
    """
    share = np.empty(blob.filled.shape, dtype=np.float32)
    _kernels().cover(blob.rgb, blob.filled, share)
    return share


@cache
def _kernels() -> ModuleType:
    """The compiled kernels, imported once: an import statement costs as much as a kernel."""
    from bt_dualarm.perception import perception_kernels

    return perception_kernels


def warm_up_detection() -> None:
    """Compile the kernels of detection."""
    empty = np.zeros((3, 3), np.uint8)
    _kernels().measure_coverage(np.zeros((3, 3, 3), np.uint8), empty, empty)
    coverage(Blob(np.zeros((3, 3, 3), np.uint8), empty, empty, (0, 0), (0, 0, 3, 3), (3, 3)))


def _with_holes_filled(mask: Mask, *, coarse: bool) -> Mask:
    """Fill what rims of matching pixels surround; the mask itself if there is no such rim.

    What covers a part of a target from outside leaves no closed rim, and is not filled.
    """
    rims = _rims(mask, _RIM_GAP_COARSE if coarse else _RIM_GAP)
    if coarse and not rims:
        solid = cv2.dilate(cv2.morphologyEx(mask, cv2.MORPH_OPEN, _KERNEL), _KERNEL)
        rims = _rims(cv2.bitwise_and(mask, cv2.bitwise_not(solid)), _THIN_RIM_GAP_COARSE)
    if not rims:
        return mask
    filled = mask.copy()
    cv2.drawContours(filled, rims, -1, 255, cv2.FILLED)
    return filled


def _rims(mask: cv2.typing.MatLike, gap: int) -> list[cv2.typing.MatLike]:
    """Outer contours of what has holes once gaps of twice ``gap`` samples are closed."""
    beyond = 2 * gap  # so that closing ends before the border
    padded = np.pad(np.asarray(mask), beyond)
    kernel = np.ones((2 * gap + 1, 2 * gap + 1), np.uint8)
    closed = cv2.morphologyEx(padded, cv2.MORPH_CLOSE, kernel)
    contours, links = cv2.findContours(
        closed, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE, offset=(-beyond, -beyond)
    )
    if not contours:
        return []
    return [rim for rim, (_, _, hole, _) in zip(contours, links[0], strict=True) if hole >= 0]


def _open_and_close(mask: Mask) -> Mask:
    """Remove specks, then fill pinholes."""
    opened = cv2.morphologyEx(mask, cv2.MORPH_OPEN, _KERNEL)
    return np.asarray(cv2.morphologyEx(opened, cv2.MORPH_CLOSE, _KERNEL), dtype=np.uint8)
