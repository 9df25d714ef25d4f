"""The part of the next picture in which a target can be seen."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from bt_dualarm.world.cameras.frame import Window

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
        place: Where that is from the camera: x right, y down, z forward, in m.
        about_px: Half of the target's width, and of what is left free about it, in pixels.
        astray_m: How far from there the target may be, in m.
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
    x, y = width / 2.0 + scale * x, height / 2.0 + scale * y
    if not (-half < x < width + half and -half < y < height + half):
        return otherwise
    return Window(
        (math.floor(x - half), math.floor(y - half), math.ceil(x + half), math.ceil(y + half))
    )
