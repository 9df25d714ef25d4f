"""What is believed of a camera, and what its pictures suffer on their way."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from bt_dualarm.errors import WorldError
from bt_dualarm.pose import Pose
from bt_dualarm.spec.spread import Spread
from bt_dualarm.world.hardware.drawn_arm import stream
from bt_dualarm.world.rendering.renderer import Image, Region, enter_blocks
from bt_dualarm.world.world import World

EVEN: Final = Spread()
"""Light that does not change."""


_BANK: Final = 2**18
"""Values from among which a picture's noise begins, of a larger one half as many at least.

To draw it anew for each picture costs a rendering.
"""


@dataclass(eq=False)
class Calibration:
    """A camera as its arm knows it.

    Attributes:
        pose_at: Pose of the camera in the world (x right, y down, z forward) at a time in s, by
            the arm's encoders and the mount of its page.
        fov_rad: Vertical field of view by the file, in rad.
        stamp_s: Seconds by which its clock is ahead of the simulation's.
        noise: Standard deviation of a pixel's noise, of 255 levels.
        light: Spread of the brightness, drawn for each picture.
        exposure_s: Seconds for which the shutter is open.
        bend: Radial distortion that is not known, OpenCV's k1 and k2.
        rng: Source of noise and light.
    """

    pose_at: Callable[[float], Pose]
    fov_rad: float
    stamp_s: float = 0.0
    noise: float = 0.0
    light: Spread = EVEN
    exposure_s: float = 0.0
    bend: tuple[float, float] = (0.0, 0.0)
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))
    _bank: npt.NDArray[np.uint8] = field(
        init=False, default_factory=lambda: np.zeros((2, 0), np.uint8)
    )

    def suffered(self, image: Image, region: Region, stride: int = 1) -> Image:
        """The picture as it arrives; what was not exposed stays black.

        Args:
            image: Picture as it was exposed; it is changed.
            region: Part that was.
            stride: Edge in pixels of the blocks that share a colour.
        """
        left, top, right, bottom = region
        blocks = np.ascontiguousarray(image[top:bottom:stride, left:right:stride])
        enter_blocks(image, region, stride, self.suffering(region, stride)(blocks))
        return image

    def suffering(self, region: Region, stride: int = 1) -> Callable[[Image], Image]:
        """What the next picture will suffer, as it was drawn now.

        Args:
            region: Part that is exposed.
            stride: Edge in pixels of the blocks that share a colour.

        Returns:
            Function of the colours of its blocks, of shape (rows, columns, 3).
        """
        if not self.suffers:
            return lambda blocks: blocks
        left, top, right, bottom = region
        light = 1.0 + self.light.draw_one(self.rng)
        shape = -((top - bottom) // stride), -((left - right) // stride), 3
        more, less = self._noise_of(math.prod(shape)).reshape(2, *shape)

        def suffer(blocks: Image) -> Image:
            # OpenCV keeps to the levels that there are.
            bright = cv2.add(cv2.convertScaleAbs(blocks, alpha=light), more)
            return np.asarray(cv2.subtract(bright, less), dtype=np.uint8)

        return suffer

    @property
    def suffers(self) -> bool:
        """Whether a picture arrives as another than was exposed."""
        return bool(self.noise or self.light.most)

    def _noise_of(self, count: int) -> npt.NDArray[np.uint8]:
        """What so many pixels have more and less, of shape (2, count).

        It is a stretch of noise that is drawn once, from anywhere in it.
        """
        if self._bank.shape[1] < count + _BANK // 2:
            drawn = self.rng.standard_normal(count + _BANK, dtype=np.float32)
            self._bank = _more_and_less(drawn, self.noise)
        begin = int(self.rng.integers(self._bank.shape[1] - count))
        return self._bank[:, begin : begin + count]


def _more_and_less(drawn: npt.NDArray[np.float32], sigma: float) -> npt.NDArray[np.uint8]:
    """What values have more and less, in whole levels, of shape (2, n).

    Args:
        drawn: Values with a standard deviation of one, of shape (n,); they are changed.
        sigma: Standard deviation that they are to have.
    """
    # In place: by way of new arrays it takes several times as long.
    levels = np.empty((2, len(drawn)), np.uint8)
    np.multiply(drawn, sigma, out=drawn)
    np.rint(drawn, out=drawn)
    np.clip(drawn, 0, 255, out=levels[0], casting="unsafe")
    np.negative(drawn, out=drawn)
    np.clip(drawn, 0, 255, out=levels[1], casting="unsafe")
    return levels


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
        exposure_s=errors.exposure,
        bend=drawn.bend,
        rng=stream(seed, f"{name}:pixels"),
    )
