"""Motion blur is centered at the position at the time of the stamp."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest

from bt_dualarm.core.pose import Pose
from bt_dualarm.sim.camera import MAX_SUBIMAGES, Calibration, Camera
from bt_dualarm.sim.frame import Exposure, Image
from bt_dualarm.sim.renderers import RayRenderer
from bt_dualarm.spec.document import CameraSpec

WIDTH = 160
HEIGHT = 120
FOV_DEG = 60.0
DEPTH_M = 0.5
FOCAL_PX = HEIGHT / 2 / math.tan(math.radians(FOV_DEG) / 2)
SCENE = f"""
<mujoco>
  <option gravity="0 0 0"/>
  <worldbody>
    <body name="arm1/hand">
      <freejoint/>
      <geom size=".001" mass="1" rgba="0 0 0 1"/>
      <camera name="arm/camera" xyaxes="1 0 0 0 1 0" fovy="{FOV_DEG}"/>
    </body>
    <body name="cube" pos="0 0 -{DEPTH_M + 0.02}">
      <freejoint/>
      <geom type="box" size=".04 .04 .02" rgba="1 1 0 1"/>
    </body>
    <body name="arm1/finger" pos="0.2 0.15 -{DEPTH_M}">
      <freejoint/>
      <geom size=".02" rgba="1 1 0 1"/>
    </body>
  </worldbody>
</mujoco>
"""


class Counting(RayRenderer):
    """A renderer that counts its images."""

    count = 0

    def render(self, model: mujoco.MjModel, data: mujoco.MjData, exposure: Exposure) -> Image:
        self.count += 1
        return super().render(model, data, exposure)


def render(exposure_s: float, **speeds: tuple[float, ...]) -> tuple[Image, int]:
    """Camera image of bodies with given velocities, and the number of rendered images."""
    model = mujoco.MjModel.from_xml_string(SCENE)
    data = mujoco.MjData(model)
    for name, velocity in speeds.items():
        body = model.body(name.replace("_", "/"))
        data.qvel[body.dofadr[0] : body.dofadr[0] + 6] = velocity
    mujoco.mj_forward(model, data)
    before = data.qpos.copy()
    known = Calibration(lambda _: Pose.identity(), math.radians(FOV_DEG), exposure_s=exposure_s)
    renderer = Counting()
    spec: Any = CameraSpec(resolution=(WIDTH, HEIGHT), fov=FOV_DEG)
    camera = Camera("arm/camera", spec, renderer, calibration=known)
    world: Any = SimpleNamespace(model=model, data=data)
    frame = camera.capture(world)
    assert (data.qpos == before).all()
    return frame.image, renderer.count


def lit(image: Image) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Fraction of the cube's color in each column, averaged over the middle rows."""
    row = image[HEIGHT // 2 - 5 : HEIGHT // 2 + 5, :, 0].mean(axis=0)
    fraction: np.ndarray[Any, np.dtype[np.float64]] = row / row.max()
    return fraction


SIDEWAYS = (0.5, 0.0, 0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    "speeds",
    [
        {"cube": SIDEWAYS},
        {"arm1_hand": tuple(-v for v in SIDEWAYS)},  # the camera moves instead of the cube
        {"arm1_hand": (0, 0, 0, 0, 0.5 / DEPTH_M, 0)},  # the camera rotates
    ],
    ids=["cube", "camera", "turn"],
)
def test_blurred_edge_is_as_wide_as_its_motion_and_centered(speeds: Any) -> None:
    """A blurred edge is a ramp as wide as the speed in pixels times the exposure time."""
    sharp, once = render(0.0, **speeds)
    blurred, several = render(0.034, **speeds)
    moved = 0.034 * 0.5 / DEPTH_M * FOCAL_PX
    assert (once, several) == (1, 1 + math.ceil(moved))
    before = lit(sharp)
    after = lit(blurred)
    width = 3.0 * (after * (1.0 - after)).sum()  # sum over two ramps, each a sixth of its width
    assert width == pytest.approx(moved, abs=0.5)
    assert 3.0 * (before * (1.0 - before)).sum() < 1.5
    columns = np.arange(WIDTH)
    middle = [(level * columns).sum() / level.sum() for level in (before, after)]
    assert middle[1] == pytest.approx(middle[0], abs=0.3)
    assert after.sum() == pytest.approx(before.sum(), rel=0.05)


@pytest.mark.parametrize(
    "speeds",
    [
        {},
        {"cube": SIDEWAYS, "arm1_hand": SIDEWAYS},  # same velocity: it does not move in the image
        {"arm1_finger": SIDEWAYS},
    ],
    ids=["still", "alike", "a link"],
)
def test_image_without_moving_objects_is_rendered_once(speeds: Any) -> None:
    image, count = render(0.02, **speeds)
    assert count == 1
    np.testing.assert_array_equal(image, render(0.0, **speeds)[0])


def test_number_of_subimages_is_limited() -> None:
    assert render(0.1, cube=(2.0, 0, 0, 0, 0, 0))[1] == MAX_SUBIMAGES
