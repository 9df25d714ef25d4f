"""Pictures by an arm's own camera while the arm rests, merged into one with less noise."""

from __future__ import annotations

from collections.abc import Generator
from typing import Final

from bt_dualarm.arm.arm import Arm
from bt_dualarm.errors import Failure
from bt_dualarm.vision.edges import merged
from bt_dualarm.world.cameras.frame import Frame
from bt_dualarm.world.cameras.guarded_camera import GuardedCamera

_WAIT_S: Final = 1.0
"""Simulated seconds beyond what the pictures take, for those that get lost."""


def own_camera(arm: Arm) -> GuardedCamera:
    """The camera that moves with an arm.

    Raises:
        Failure: ``NO_CAMERA``.
    """
    if arm.camera is None or not arm.world.declared_arms[arm.name].carries_camera:
        raise Failure("NO_CAMERA", f"{arm.name} has no camera that moves with it")
    return arm.camera


def still_picture(arm: Arm, count: int) -> Generator[None, None, Frame | None]:
    """Take pictures from where the arm stands, and merge them; yields once a tick.

    Args:
        arm: Arm at rest, with a camera of its own.
        count: Number of pictures.

    Returns:
        The picture, of those that arrived in time; None where none did.

    Raises:
        Failure: ``NO_CAMERA``.
    """
    camera, began, taken = own_camera(arm), arm.time, list[Frame]()

    def take(frame: Frame) -> None:
        if frame.stamp >= began and frame.stride == 1:
            taken.append(frame)

    unsubscribe = camera.subscribe(take)
    try:
        latest = began + count * camera.period + camera.latency + _WAIT_S
        while len(taken) < count and arm.time < latest:
            yield
    finally:
        unsubscribe()
    return merged(taken) if taken else None
