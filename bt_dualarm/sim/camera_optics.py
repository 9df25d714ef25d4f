"""From a scene to an image: calibration, lens distortion, shutter, and shake."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from types import ModuleType
from typing import Final, NamedTuple, TypeAlias

import cv2
import mujoco
import numpy as np
import numpy.typing as npt
import scipy

from bt_dualarm.core.errors import WorldError
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.sim.arm_models import random_stream
from bt_dualarm.sim.frame import focal_length_px
from bt_dualarm.sim.renderer import Exposure, Image, Region, Renderer, enter_blocks
from bt_dualarm.sim.world import World
from bt_dualarm.spec.values import Uncertainty

# Radial distortion of the lens, which the calibration does not contain


_RADII: Final = 4096
"""Radii at which the formula is worked out; between two of them it is a line."""


class Lens:
    """Radial distortion, the first two terms of OpenCV's model.

    A point at ``r`` from the middle, in focal lengths, is seen at ``r (1 + k1 r² + k2 r⁴)``
    (Brown, Decentering distortion of lenses, 1966). Where the formula folds the image over,
    nothing is seen. An image that was rectified by a calibration has what that did not know.

    Args:
        k1: Factor of the third power.
        k2: Factor of the fifth power.
        width: Width of the whole image in pixels.
        height: Height of the whole image in pixels.
        focal_px: True focal length in pixels.
    """

    def __init__(self, k1: float, k2: float, width: int, height: int, focal_px: float) -> None:
        y, x = np.indices((height, width)) + 0.5
        x = (x - width / 2) / focal_px
        y = (y - height / 2) / focal_px
        seen_at = np.hypot(x, y)
        scale = _straight(k1, k2, seen_at) / seen_at.clip(1e-12)
        columns = x * scale * focal_px + width / 2
        rows = y * scale * focal_px + height / 2
        self._columns: npt.NDArray[np.float32] = (columns - 0.5).astype(np.float32)
        self._rows: npt.NDArray[np.float32] = (rows - 0.5).astype(np.float32)
        is_seen = np.isfinite(columns)
        self._is_seen = None if is_seen.all() else is_seen
        self._known: tuple[Region, int, _Part] | None = None
        self._pixels: Image = np.zeros((height, width, 3), np.uint8)  # of the latest coarse blocks

    def widened(self, exposure: Exposure) -> Exposure:
        """What has to be drawn so that all of an exposure is there once it is bent."""
        if exposure.is_empty:
            return exposure
        needed = self._part(exposure).needed
        asked = exposure
        return Exposure(
            asked.camera_id, asked.width, asked.height, needed, asked.stride, asked.groups,
            asked.alone,
        )  # fmt: skip

    def distorted(self, image: Image, exposure: Exposure) -> Image:
        """The image behind the lens, black outside of the exposure's region."""
        (left, top, right, bottom) = self.widened(exposure).clipped
        step = exposure.stride
        drawn = image if step > 1 else image[top:bottom, left:right]
        return exposure.paint(lambda _: self._behind(drawn, exposure))

    def seen(self, drawn: Image, exposure: Exposure) -> Image:
        """Colors behind the lens of the blocks of an exposure, of shape (rows, columns, 3).

        Args:
            drawn: Colors before it of the blocks of that exposure, widened.
            exposure: Exposure that is not empty, its corner on the grid of blocks.
        """
        if exposure.stride > 1:
            wide = self.widened(exposure)
            enter_blocks(self._pixels, wide.clipped, wide.stride, drawn, wide.corner)
            drawn = self._pixels
        return self._behind(drawn, exposure)

    def _behind(self, drawn: Image, exposure: Exposure) -> Image:
        """As `seen`, of the pixels that are needed; of a coarse exposure, of the whole image."""
        part = self._part(exposure)
        seen = cv2.remap(
            drawn, part.columns, part.rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        if part.is_seen is not None:
            seen[~part.is_seen] = 0
        return np.asarray(seen, dtype=np.uint8)

    def _part(self, exposure: Exposure) -> _Part:
        """Where the rays of an exposure come from: a target that rests is asked for again."""
        # one ray a block: only its corner counts
        region = exposure.clipped
        step = exposure.stride
        if self._known is None or self._known[:2] != (region, step):
            left, top, right, bottom = _needed()(self._columns, self._rows, region, step)
            # Corners are of blocks.
            needed = left - left % step, top - top % step, right, bottom
            part = slice(region[1], region[3], step), slice(region[0], region[2], step)
            is_seen = None if self._is_seen is None else self._is_seen[part]
            # Less by whole numbers, places are as exact as before.
            left, top = needed[:2] if step == 1 else (0, 0)
            columns = self._columns[part] - np.float32(left)
            rows = self._rows[part] - np.float32(top)
            self._known = region, step, _Part(columns, rows, is_seen, needed)
        return self._known[2]


class _Part(NamedTuple):
    """A part of an image behind a lens.

    Attributes:
        columns: Places before it along x that its blocks show, of shape (rows, columns), px
            from the corner of what is needed, of coarse blocks from that of the image.
        rows: Likewise along y.
        is_seen: Which of them show something, None where all do.
        needed: Part of the image before it that they are made of.
    """

    columns: npt.NDArray[np.float32]
    rows: npt.NDArray[np.float32]
    is_seen: npt.NDArray[np.bool_] | None
    needed: Region


@cache
def _needed() -> Callable[..., Region]:
    """The kernel of the lens: an import statement costs as much as it does."""
    from bt_dualarm.sim.camera_kernels import needed

    return needed


def _straight(k1: float, k2: float, seen_at: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Radii at which it is without the lens; not a number where nothing is seen."""
    # Beyond twice the farthest of the image there is nothing that a lens within the ranges of
    # k1 and k2 would show in it.
    radius = np.linspace(0.0, 2.0 * float(seen_at.max()), _RADII)
    bent = radius * (1.0 + k1 * radius**2 + k2 * radius**4)
    falls = np.flatnonzero(np.diff(bent) <= 0)
    end = int(falls[0]) + 1 if len(falls) else _RADII
    return np.interp(seen_at, bent[:end], radius[:end], right=math.nan)


def warm_up_lens() -> None:
    """Have the kernel of the lens compiled."""
    Lens(0.1, 0.1, 2, 2, 1.0).widened(Exposure(0, 2, 2, (0, 0, 1, 1)))


# Motion blur


SHARP_PX: Final = 0.5
"""Motion during an exposure that no image shows: it is drawn once."""

MOST_PICTURES: Final = 8
"""Images that an exposure is the mean of, at most: farther apart than a pixel only beyond it."""

Draw: TypeAlias = Callable[[mujoco.MjData, Exposure], Image]
"""Draws a camera's image of a state whose kinematics are up to date."""


class Shutter:
    """Takes the mean of images at even times, the stamp in their middle.

    How many there are hangs on how far objects in the image that are not an arm's links move
    across it: one for each pixel. Where they do not, all of it is drawn once.

    Args:
        exposure_s: Seconds for which it is open.
    """

    def __init__(self, exposure_s: float) -> None:
        self._open_s = exposure_s
        self._model: mujoco.MjModel | None = None

    def render(
        self, model: mujoco.MjModel, data: mujoco.MjData, exposure: Exposure, draw: Draw
    ) -> Image:
        """The image of an exposure that has its middle now.

        Velocities are taken to be those of now; ``data`` stays as it is.
        """
        motion = self._open_s * self._speed_px(model, data, exposure)
        if motion < SHARP_PX:
            return draw(data, exposure)
        count = min(1 + math.ceil(motion), MOST_PICTURES)
        total = np.array(count // 2, np.uint16)
        for number in range(count):
            offset = (number + 0.5) / count - 0.5
            total = total + draw(self._state(model, data, offset * self._open_s), exposure)
        return (total // np.uint16(count)).astype(np.uint8)

    def _state(self, model: mujoco.MjModel, data: mujoco.MjData, later: float) -> mujoco.MjData:
        """What everything is in, so many seconds later."""
        scratch = self._scratch
        scratch.qpos[:] = data.qpos
        scratch.mocap_pos[:] = data.mocap_pos
        scratch.mocap_quat[:] = data.mocap_quat
        mujoco.mj_integratePos(model, scratch.qpos, data.qvel, later)
        mujoco.mj_kinematics(model, scratch)
        mujoco.mj_camlight(model, scratch)
        return scratch

    def _speed_px(self, model: mujoco.MjModel, data: mujoco.MjData, exposure: Exposure) -> float:
        """Highest speed of an object across the image, in pixels a second."""
        if self._model is not model:
            self._model = model
            self._scratch = mujoco.MjData(model)
            self._things, self._radii = _things(model)
            self._roots = model.body_rootid.copy()
        camera = exposure.camera_id
        kernels = _kernels()
        size = (exposure.width, exposure.height)
        focal_px = focal_length_px(exposure.height, math.radians(float(model.cam_fovy[camera])))
        speed: float = kernels.fastest(
            self._things, self._radii, int(model.cam_bodyid[camera]),
            kernels.Bodies(data.xpos, data.cvel, data.subtree_com, self._roots),
            data.cam_xpos[camera], data.cam_xmat[camera].reshape(3, 3), focal_px,
            size, exposure.clipped,
        )  # fmt: skip
        return speed


def _things(model: mujoco.MjModel) -> tuple[npt.NDArray[np.int64], Vector]:
    """Bodies that are no link of an arm, the world left out, and how far they extend, m."""
    things = [body for body in range(1, model.nbody) if "/" not in model.body(body).name]
    extents = [
        max(
            (
                float(np.linalg.norm(model.geom_pos[geom]) + model.geom_rbound[geom])
                for geom in np.flatnonzero(model.geom_bodyid == body)
            ),
            default=0.0,
        )
        for body in things
    ]
    return np.array(things, dtype=np.int64), np.array(extents)


@cache
def _kernels() -> ModuleType:
    """The kernel of motion: an import statement costs as much as it does."""
    from bt_dualarm.sim import camera_kernels

    return camera_kernels


def warm_up_shutter() -> None:
    """Have the kernel of motion compiled."""
    spec = mujoco.MjSpec()
    spec.worldbody.add_camera()
    spec.worldbody.add_body(name="thing").add_geom(size=(0.1, 0.1, 0.1))
    model = spec.compile()
    data = mujoco.MjData(model)
    Shutter(1.0).render(model, data, Exposure(0, 2, 2), lambda *_: np.zeros((2, 2, 3), np.uint8))


# Calibration of a camera, and the errors of its images


EVEN: Final = Uncertainty()
"""Light that does not change."""


_BANK: Final = 2**18
"""Values from among which an image's noise begins, of a larger one half as many at least.

To draw it anew for each image costs a rendering.
"""


@dataclass(eq=False)
class Calibration:
    """A camera as its arm knows it.

    Attributes:
        pose_at: Pose of the camera in the world (x right, y down, z forward) at a time in s, by
            the arm's encoders and the mount of its description.
        fov_rad: Vertical field of view by the file, rad.
        stamp_s: Seconds by which its clock is ahead of the simulation's.
        noise: Standard deviation of a pixel's noise, of 255 levels.
        light: Spread of the brightness, drawn for each image.
        exposure_s: Seconds for which the shutter is open.
        distortion: Radial distortion that is not known, OpenCV's k1 and k2.
        rng: Source of noise and light.
    """

    pose_at: Callable[[float], Pose]
    fov_rad: float
    stamp_s: float = 0.0
    noise: float = 0.0
    light: Uncertainty = EVEN
    exposure_s: float = 0.0
    distortion: tuple[float, float] = (0.0, 0.0)
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))
    _bank: npt.NDArray[np.uint8] = field(
        init=False, default_factory=lambda: np.zeros((2, 0), np.uint8)
    )

    def degraded(self, image: Image, region: Region, stride: int = 1) -> Image:
        """The image as it arrives; what was not exposed stays black.

        Args:
            image: Image as it was exposed; it is changed.
            region: Part that was.
            stride: Edge in pixels of the blocks that share a color.
        """
        left, top, right, bottom = region
        blocks = np.ascontiguousarray(image[top:bottom:stride, left:right:stride])
        enter_blocks(image, region, stride, self.degradation(region, stride)(blocks))
        return image

    def degradation(self, region: Region, stride: int = 1) -> Callable[[Image], Image]:
        """What the next image will degrade, as it was drawn now.

        Args:
            region: Part that is exposed.
            stride: Edge in pixels of the blocks that share a color.

        Returns:
            Function of the colors of its blocks, of shape (rows, columns, 3).
        """
        if not self.is_degraded:
            return lambda blocks: blocks
        left, top, right, bottom = region
        light = 1.0 + self.light.draw_one(self.rng)
        shape = -((top - bottom) // stride), -((left - right) // stride), 3
        more, less = self._noise_of(math.prod(shape)).reshape(2, *shape)

        def degrade(blocks: Image) -> Image:
            # OpenCV keeps to the levels that there are.
            bright = cv2.add(cv2.convertScaleAbs(blocks, alpha=light), more)
            return np.asarray(cv2.subtract(bright, less), dtype=np.uint8)

        return degrade

    @property
    def is_degraded(self) -> bool:
        """Whether an image arrives as another than was exposed."""
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
        seed: Seed of the noise of its images.
    """
    camera = world.declared_arms[name].camera
    if camera is None:
        raise WorldError(f"arm {name!r} has no camera")
    hardware = world.hardware[name]
    nominal = world.nominal[name]
    errors = world.devices.errors[name].camera
    drawn = world.devices.sampled[name]
    return Calibration(
        pose_at=lambda time: nominal.camera_pose_at(hardware.q_at(time)),
        fov_rad=camera.fov_rad,
        stamp_s=drawn.stamp_s,
        noise=errors.noise,
        light=errors.light,
        exposure_s=errors.exposure,
        distortion=drawn.distortion,
        rng=random_stream(seed, f"{name}:pixels"),
    )


# Image formation: shake, shutter, lens


class Optics:
    """All that is between the scene and the pixels of one camera.

    Args:
        renderer: Renderer of its images.
        exposure_s: Seconds for which its shutter is open.
        distortion: Radial distortion of its lens, OpenCV's k1 and k2.
    """

    def __init__(
        self,
        renderer: Renderer,
        exposure_s: float = 0.0,
        distortion: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        self._renderer = renderer
        self._shutter = Shutter(exposure_s) if exposure_s else None
        self._distortion = distortion
        self._lens: Lens | None = None

    def render(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        exposure: Exposure,
        shake: Vector,
        degrade: Callable[[Image], Image] | None = None,
    ) -> Image:
        """What an exposure shows: colors of its blocks, of shape (rows, columns, 3).

        Args:
            model: Compiled world.
            data: State of it, its kinematics up to date.
            exposure: Part of the image that is asked for, alone, its corner on the grid of blocks.
            shake: Turn of the camera about its x and y axes meanwhile, of shape (2,), rad.
            degrade: What the colors of its blocks, of shape (rows, columns, 3), degrade besides.
        """
        shakes = shake.any()

        def draw(state: mujoco.MjData, part: Exposure) -> Image:
            if not shakes:
                return self._renderer.render(model, state, part)
            with _turned(state, part.camera_id, shake):
                return self._renderer.render(model, state, part)

        if exposure.is_empty:
            return np.zeros((0, 0, 3), np.uint8)
        if not any(self._distortion):
            blocks = self._exposed(model, data, exposure, draw)
            return blocks if degrade is None else degrade(blocks)
        if self._lens is None:
            fov_rad = math.radians(float(model.cam_fovy[exposure.camera_id]))
            focal_px = focal_length_px(exposure.height, fov_rad)
            self._lens = Lens(*self._distortion, exposure.width, exposure.height, focal_px)
        wide = self._lens.widened(exposure)
        seen = self._lens.seen(self._exposed(model, data, wide, draw), exposure)
        return seen if degrade is None else degrade(seen)

    def _exposed(
        self, model: mujoco.MjModel, data: mujoco.MjData, exposure: Exposure, draw: Draw
    ) -> Image:
        if self._shutter is None:
            return draw(data, exposure)
        return self._shutter.render(model, data, exposure, draw)


@contextmanager
def _turned(data: mujoco.MjData, camera_id: int, angles: Vector) -> Iterator[None]:
    """The camera turned about its x and y axes by ``angles`` of shape (2,), rad, meanwhile."""
    straight = data.cam_xmat[camera_id].copy()
    turn = scipy.spatial.transform.Rotation.from_rotvec([*angles, 0.0]).as_matrix()
    data.cam_xmat[camera_id] = (straight.reshape(3, 3) @ turn).ravel()
    try:
        yield
    finally:
        data.cam_xmat[camera_id] = straight
