"""What is believed of a camera, and what its pictures suffer on their way."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from bt_dualarm.errors import WorldError
from bt_dualarm.pose import Pose
from bt_dualarm.spec.spread import Spread
from bt_dualarm.world.hardware.drawn_arm import stream
from bt_dualarm.world.rendering.renderer import Image, Region
from bt_dualarm.world.world import World

EVEN: Final = Spread()
"""Light that does not change."""


@dataclass(frozen=True, eq=False)
class Calibration:
    """A camera as its arm knows it.

    Attributes:
        pose_at: Pose of the camera in the world (x right, y down, z forward) at a time in s, by
            the arm's encoders and the mount of its page.
        fov_rad: Vertical field of view by the file, in rad.
        stamp_s: Seconds by which its clock is ahead of the simulation's.
        noise: Standard deviation of a pixel's noise, of 255 levels.
        light: Spread of the brightness, drawn for each picture.
        rng: Source of noise and light.
    """

    pose_at: Callable[[float], Pose]
    fov_rad: float
    stamp_s: float = 0.0
    noise: float = 0.0
    light: Spread = EVEN
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))

    def suffered(self, image: Image, region: Region) -> Image:
        """The picture as it arrives; what was not exposed stays black."""
        if not (self.noise or self.light.most):
            return image
        left, top, right, bottom = region
        part = image[top:bottom, left:right].astype(np.float32)
        part *= 1.0 + float(self.light.draw(self.rng, 1)[0])
        part += self.rng.normal(0.0, self.noise, part.shape)
        arrived = image.copy()
        arrived[top:bottom, left:right] = np.clip(np.rint(part), 0, 255).astype(np.uint8)
        return arrived


def calibration_of(world: World, name: str, seed: int) -> Calibration:
    """What is believed of the camera of an arm that is in the world, which has one.

    Args:
        world: World that the arm is in.
        name: Name of the arm.
        seed: Seed of the noise of its pictures.
    """
    camera = world.declared_arms[name].camera
    if camera is None:
        raise WorldError(f"arm {name!r} has no camera")
    hardware, nominal = world.hardware[name], world.nominal[name]
    errors, drawn = world.equipment.errors[name].camera, world.equipment.drawn[name]
    return Calibration(
        pose_at=lambda time: nominal.camera_pose_at(hardware.q_at(time)),
        fov_rad=camera.fov_rad,
        stamp_s=drawn.stamp_s,
        noise=errors.noise,
        light=errors.light,
        rng=stream(seed, f"{name}:pixels"),
    )
