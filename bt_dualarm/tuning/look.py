"""What a camera that looks for a colour finds in a picture, and that as a picture for people."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import cv2
import numpy as np

from bt_dualarm.spec.color import Color
from bt_dualarm.spec.source import Data
from bt_dualarm.vision.colors import ColorFilter, Mask
from bt_dualarm.vision.detect import Detection, detect_all
from bt_dualarm.world.cameras.frame import Frame
from bt_dualarm.world.rendering.renderer import Image

_LEAST_WIDTH_PX: Final = 480
_BAR_PX: Final = 26
_WHITE, _GREEN, _ORANGE = (245, 245, 245), (0, 230, 90), (255, 160, 0)


@dataclass(frozen=True, eq=False)
class Look:
    """A colour looked for in a frame.

    Attributes:
        frame: The picture.
        color: Colour that is looked for.
    """

    frame: Frame
    color: Color

    @cached_property
    def mask(self) -> Mask:
        """Which pixels have the colour."""
        return ColorFilter(self.color).mask(self.frame.image)

    @cached_property
    def found(self) -> tuple[Detection, ...]:
        """Every candidate, the largest first: the one that a tracker takes to begin with."""
        found = detect_all(self.frame, ColorFilter(self.color))
        return tuple(sorted(found, key=lambda detection: -detection.area_px))

    @property
    def table(self) -> list[dict[str, Data]]:
        """The candidates, ready for JSON."""
        return [
            {
                "centroid_px": [round(at, 2) for at in one.centroid_px],
                "area_px": round(one.area_px, 1),
                "bounds_px": list(one.bounds_px),
                "confidence": round(one.confidence, 3),
                "touches_border": one.touches_border,
            }
            for one in self.found
        ]

    def picture(self, title: str) -> Image:
        """Image, mask and overlay side by side, each at least 480 pixels wide, below a title."""
        zoom = max(1, -(-_LEAST_WIDTH_PX // self.frame.width))
        panels = [
            _titled(_zoomed(self.frame.image, zoom), title),
            _titled(_zoomed(np.dstack([self.mask] * 3), zoom), self.color.notation),
            _titled(self._overlay(zoom), self._summary()),
        ]
        gap = np.full((panels[0].shape[0], 4, 3), 128, np.uint8)
        return np.hstack([panels[0], gap, panels[1], gap, panels[2]])

    def _overlay(self, zoom: int) -> Image:
        """The image, dark where the colour is not, with a box and a cross at each candidate."""
        share = np.where(self.mask > 0, 1.0, 0.35)[..., None]
        picture = np.ascontiguousarray(_zoomed((self.frame.image * share).astype(np.uint8), zoom))
        for number, one in reversed(list(enumerate(self.found, start=1))):
            color = _GREEN if number == 1 else _ORANGE
            left, top, right, bottom = (edge * zoom for edge in one.bounds_px)
            cv2.rectangle(picture, (left, top), (right - 1, bottom - 1), color, 1)
            at = tuple(round(coordinate * zoom) for coordinate in one.centroid_px)
            cv2.drawMarker(picture, at, color, cv2.MARKER_CROSS, 14, 1, cv2.LINE_AA)
            corner = (left, top - 6 if top > 20 else bottom + 16)
            _write(picture, f"{number}: {one.area_px:.0f} px2", corner, color)
        return picture

    def _summary(self) -> str:
        if not self.found:
            return "nothing of this colour"
        x, y = self.found[0].centroid_px
        others = f", {len(self.found) - 1} more" if len(self.found) > 1 else ""
        return f"largest at {x:.1f}, {y:.1f}: {self.found[0].area_px:.0f} px2{others}"


def png(image: Image) -> bytes:
    """An image (red, green, blue, or one channel) as the content of a file."""
    in_order = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    return bytes(cv2.imencode(".png", in_order)[1])


def _zoomed(image: Image, zoom: int) -> Image:
    return np.asarray(image.repeat(zoom, axis=0).repeat(zoom, axis=1), np.uint8)


def _titled(image: Image, title: str) -> Image:
    """The image with a bar above it; a title that is too long is set smaller."""
    bar = np.full((_BAR_PX, image.shape[1], 3), 40, np.uint8)
    (width, _), _ = cv2.getTextSize(title, cv2.FONT_HERSHEY_SIMPLEX, 0.5, 1)
    _write(bar, title, (6, 18), _WHITE, min(0.5, 0.5 * (image.shape[1] - 12) / max(width, 1)))
    return np.vstack([bar, image])


def _write(
    image: Image, text: str, corner: tuple[int, int], color: tuple[int, int, int], size: float = 0.5
) -> None:
    cv2.putText(image, text, corner, cv2.FONT_HERSHEY_SIMPLEX, size, color, 1, cv2.LINE_AA)
