"""Looks at a mark that stands still, by an arm's camera that rests."""

from __future__ import annotations

from collections.abc import Generator
from typing import Final

import numpy as np

from bt_dualarm.arm.arm import Arm
from bt_dualarm.errors import Failure
from bt_dualarm.spec.color import Color
from bt_dualarm.vision.colors import ColorFilter
from bt_dualarm.vision.detect import Detection, detect
from bt_dualarm.vision.hand_eye import MarkView
from bt_dualarm.world.cameras.frame import Frame

FRAMES: Final = 6
"""Pictures that are averaged in one look."""

_WAIT_S: Final = 1.0  # beyond what the pictures take


class MarkViews:
    """Takes looks at a mark of a colour.

    Args:
        arm: Arm with a camera of its own.
        color: Look of the mark.

    Raises:
        Failure: ``NO_CAMERA``.
    """

    def __init__(self, arm: Arm, color: Color) -> None:
        if arm.camera is None or not arm.world.declared_arms[arm.name].carries_camera:
            raise Failure("NO_CAMERA", f"{arm.name} has no camera that moves with it")
        self._arm, self._camera, self._color = arm, arm.camera, ColorFilter(color)

    def look(self) -> Generator[None, None, MarkView | None]:
        """Look from where the arm stands, once a tick; None where the mark is not seen whole."""
        began, found = self._arm.time, list[tuple[Frame, Detection]]()

        def take(frame: Frame) -> None:
            seen = detect(frame, self._color) if frame.stamp >= began else None
            if seen is not None and not seen.touches_border:
                found.append((frame, seen))

        unsubscribe = self._camera.subscribe(take)
        try:
            latest = began + FRAMES * self._camera.period + self._camera.latency + _WAIT_S
            while len(found) < FRAMES and self._arm.time < latest:
                yield
        finally:
            unsubscribe()
        if not found:
            return None
        frame = found[-1][0]
        pixel = np.mean([seen.centroid_px for _, seen in found], axis=0)
        middle = np.array((frame.width, frame.height)) / 2.0
        return MarkView(frame.pose, pixel - middle, frame.focal_px)
