"""What a tracker believes, and where it looks next."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class TrackerSettings:
    """When to believe a sighting, and where to look for the next.

    Args:
        lost_after: Unseen for longer, in s, the target is lost.
        confirm: Sightings in a row that make a lock.
        gate: Largest squared Mahalanobis distance from the prediction.
        gate_sigma: What the gate allows for at least, in m: a real target may jerk.
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
