"""What somebody found in one frame of a camera: noted for the record, no part of any decision."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Look:
    """A target, or none, in one frame.

    Attributes:
        stamp: Simulated time of the exposure in s.
        pixel: Centre of what was taken for the target, from the image's top left corner; None
            where nothing was.
        area_px: Area of it in square pixels, 0 where nothing was.
        point: Estimated position of the target at the exposure, in the world, m; None before it
            was first seen.
        locked: Whether it had been seen in enough frames in a row.
    """

    stamp: float
    pixel: tuple[float, float] | None
    area_px: float
    point: tuple[float, float, float] | None
    locked: bool
