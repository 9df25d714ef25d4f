"""Which pixels have the colour that is looked for."""

from __future__ import annotations

from typing import TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

from bt_dualarm.spec.color import Color
from bt_dualarm.world.rendering.renderer import Image

Mask: TypeAlias = npt.NDArray[np.uint8]
"""255 where a pixel belongs, else 0, of shape (height, width)."""


class ColorFilter:
    """A colour, ready for use on many images.

    Args:
        color: A pixel that lies in any of its ranges has it.

    Attributes:
        name: Text of its ranges, which tells it from others.
    """

    def __init__(self, color: Color) -> None:
        self._boxes = color.bounds
        self.name = " ".join(f"{low.tolist()}-{high.tolist()}" for low, high in self._boxes)

    def mask(self, image: Image) -> Mask:
        """Which pixels have the colour, of an image (red, green, blue) of shape (h, w, 3)."""
        hsv = cv2.cvtColor(image, cv2.COLOR_RGB2HSV)
        mask = cv2.inRange(hsv, *self._boxes[0])
        for box in self._boxes[1:]:
            cv2.bitwise_or(mask, cv2.inRange(hsv, *box), dst=mask)
        return np.asarray(mask, dtype=np.uint8)
