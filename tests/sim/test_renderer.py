from __future__ import annotations

import os
from dataclasses import replace
from typing import Any

import cv2
import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bt_dualarm.core.errors import RendererError
from bt_dualarm.robots.mjspec import OBJECT_GROUP, SCENE_GROUP, VISUAL_GROUP
from bt_dualarm.sim import renderers
from bt_dualarm.sim.frame import Exposure, Image, Region, Renderer, clip_region
from bt_dualarm.sim.renderers import (
    GL_PACKAGES,
    GlRenderer,
    RayRenderer,
    camera_rays,
    choose_renderer,
)

SCENE = """
<mujoco>
  <asset>
    <texture name="sky" type="skybox" builtin="gradient" rgb1=".6 .7 .8" rgb2=".2 .3 .4"
             width="64" height="64"/>
    <texture name="tiles" type="2d" builtin="checker" rgb1=".4 .4 .45" rgb2=".5 .5 .55"
             width="64" height="64"/>
    <material name="tiles" texture="tiles"/>
    <material name="steel" rgba=".2 .4 .6 1"/>
  </asset>
  <worldbody>
    <light pos="0 0 3" dir="0 0 -1" diffuse=".5 .5 .5"/>
    <light type="directional" dir="0 1 -1" diffuse=".2 .2 .2"/>
    <geom type="plane" size="3 3 .1" material="tiles"/>
    <camera name="camera" pos="0 -0.35 0.5" xyaxes="1 0 0 0 0 1" fovy="50"/>
    <geom type="box" size=".025 .025 .025" pos=".03 .02 .52" euler="0 10 20" rgba="1 .85 0 1"/>
    <geom type="sphere" size=".03" pos="-.1 .02 .45" material="steel"/>
    <geom type="box" size=".02 .02 .02" pos="0 -.05 .5" rgba="1 0 0 1" group="2"/>
    <geom type="box" size=".02 .02 .02" pos="0 -.05 .42" rgba="0 0 1 1" group="3"/>
  </worldbody>
</mujoco>
"""


@pytest.fixture(scope="module")
def scene() -> tuple[Any, Any]:
    model = mujoco.MjModel.from_xml_string(SCENE)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


@pytest.fixture(scope="module")
def context() -> renderers.GlContext:
    try:
        return renderers.open_context()
    except RendererError as error:
        pytest.skip(str(error))


@pytest.fixture(params=["ray", "gl"])
def renderer(request: pytest.FixtureRequest) -> Renderer:
    if request.param == "ray":
        return RayRenderer()
    return GlRenderer(request.getfixturevalue("context"))


def no_context() -> Any:
    raise RendererError("EGL: libEGL.so.1 not found")


def moments(image: Image, low: tuple[int, int, int], high: tuple[int, int, int]) -> Any:
    """Area, x and y of the center of the pixels in an HSV range."""
    mask = cv2.inRange(cv2.cvtColor(image, cv2.COLOR_RGB2HSV), low, high)
    found = cv2.moments(mask, binaryImage=True)
    area = found["m00"]
    return (area, *(found[key] / area + 0.5 for key in ("m10", "m01"))) if area else (0.0, 0, 0)


YELLOW = ((20, 100, 40), (35, 255, 255))
RED = ((0, 100, 40), (5, 255, 255))
BLUE = ((115, 150, 40), (125, 255, 255))


def test_ray_renderer_never_opens_opengl() -> None:
    choice = choose_renderer("ray", find_context=lambda: pytest.fail("asked for OpenGL"))
    assert choice.create().name == "ray"
    assert "ray casting" in choice.message


def test_auto_falls_back_to_rays_with_advice() -> None:
    choice = choose_renderer("auto", find_context=no_context)
    assert choice.create().name == "ray"
    assert GL_PACKAGES in choice.message
    assert "libEGL.so.1" in choice.message


def test_gl_fails_without_a_context() -> None:
    with pytest.raises(RendererError, match="libegl1 and libgl1") as caught:
        choose_renderer("gl", find_context=no_context)
    assert "libEGL.so.1 not found" in str(caught.value)


def test_unknown_renderer_error_names_the_choices() -> None:
    with pytest.raises(RendererError, match=r"'vulkan'.*'auto', 'gl' and 'ray'"):
        choose_renderer("vulkan")  # type: ignore[arg-type]


def test_gl_is_chosen_where_it_works(context: renderers.GlContext) -> None:
    choice = choose_renderer("auto", find_context=lambda: context)
    assert choice.create().name == "gl"
    assert context.platform in choice.message


def test_opening_gl_does_not_set_mujoco_gl(context: renderers.GlContext) -> None:
    """A wrong MUJOCO_GL would break ``import mujoco`` in every child process."""
    assert context is not None
    assert "MUJOCO_GL" not in os.environ


def test_error_names_missing_libraries(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(name: str) -> Any:
        raise OSError(name)

    monkeypatch.setattr("ctypes.CDLL", refuse)
    with pytest.raises(RendererError, match=r"EGL: libEGL.so.1 not found; OSMesa: libOSMesa"):
        renderers.open_context()


@pytest.mark.parametrize("size", [(320, 240), (640, 480)])
def test_both_renderers_agree(
    scene: tuple[Any, Any], context: renderers.GlContext, size: tuple[int, int]
) -> None:
    """Centers within 0.5 px and areas within 2 %."""
    ray = moments(RayRenderer().render(*scene, Exposure(0, *size)), *YELLOW)
    gl = moments(GlRenderer(context).render(*scene, Exposure(0, *size)), *YELLOW)
    assert ray[1:] == pytest.approx(gl[1:], abs=0.5)
    assert ray[0] == pytest.approx(gl[0], rel=0.02)


def test_colors_of_both_renderers_agree(
    scene: tuple[Any, Any], context: renderers.GlContext
) -> None:
    """Flat surfaces have the same color within an eighth of the range; highlights may differ."""
    ray = RayRenderer().render(*scene, Exposure(0, 160, 120))
    gl = GlRenderer(context).render(*scene, Exposure(0, 160, 120))
    x, y = (round(value) for value in moments(ray, *YELLOW)[1:])
    assert ray[y, x].astype(int) == pytest.approx(gl[y, x].astype(int), abs=32)


@given(
    left=st.integers(-20, 90),
    top=st.integers(-20, 70),
    width=st.integers(0, 120),
    height=st.integers(0, 90),
)
@settings(max_examples=25, deadline=None)
def test_region_equals_that_of_the_whole_image(
    scene: tuple[Any, Any], left: int, top: int, width: int, height: int
) -> None:
    """Outside of the region, the image is black."""
    renderer = RayRenderer()
    whole = renderer.render(*scene, Exposure(0, 80, 60))
    region = (left, top, left + width, top + height)
    part = renderer.render(*scene, Exposure(0, 80, 60, region))
    x0, y0, x1, y1 = clip_region(region, 80, 60)
    assert (part[y0:y1, x0:x1] == whole[y0:y1, x0:x1]).all()
    part[y0:y1, x0:x1] = 0
    assert not part.any()


def test_region_rendered_by_gl_equals_that_of_the_whole_image(
    scene: tuple[Any, Any], context: renderers.GlContext
) -> None:
    renderer = GlRenderer(context)
    whole = renderer.render(*scene, Exposure(0, 80, 60)).astype(int)
    part = renderer.render(*scene, Exposure(0, 80, 60, (11, 7, 64, 39))).astype(int)
    # Rounding of the narrowed view may move an edge by one sample of a pixel.
    assert np.abs(part[7:39, 11:64] - whole[7:39, 11:64]).mean() < 1.0
    part[7:39, 11:64] = 0
    assert not part.any()


def test_pixels_of_a_block_share_a_color(scene: tuple[Any, Any], renderer: Renderer) -> None:
    """Stride 3 in an image whose sides are not multiples of it."""
    image = renderer.render(*scene, Exposure(0, 80, 61, stride=3))
    blocks = image[:60, :78].reshape(20, 3, 26, 3, 3)
    assert (blocks == blocks[:, :1, :, :1]).all()
    assert image[60].any()


@pytest.mark.parametrize("stride", [1, 4])
@pytest.mark.parametrize("region", [None, (12, 8, 61, 50), (90, 8, 95, 50)])
def test_image_can_be_rebuilt_from_its_blocks(
    scene: tuple[Any, Any], renderer: Renderer, region: Region | None, stride: int
) -> None:
    exposure = Exposure(0, 80, 60, region, stride)
    image = renderer.render(*scene, exposure)
    blocks = renderer.render(*scene, replace(exposure, alone=True))
    left, top, right, bottom = exposure.clipped
    if exposure.is_empty:
        assert blocks.shape == (0, 0, 3)
    else:
        assert (blocks == image[top:bottom:stride, left:right:stride]).all()
        assert (exposure.image_of(blocks) == image).all()


def test_blocks_preserve_centroids(scene: tuple[Any, Any], renderer: Renderer) -> None:
    fine = moments(renderer.render(*scene, Exposure(0, 320, 240)), *YELLOW)
    coarse = moments(renderer.render(*scene, Exposure(0, 320, 240, stride=3)), *YELLOW)
    assert coarse[1:] == pytest.approx(fine[1:], abs=0.5)


def test_region_of_blocks_lies_on_their_grid(scene: tuple[Any, Any], renderer: Renderer) -> None:
    """A region that cuts through blocks shows the same blocks as the whole image."""
    whole = renderer.render(*scene, Exposure(0, 80, 60, stride=4)).astype(int)
    part = renderer.render(*scene, Exposure(0, 80, 60, (10, 7, 61, 50), stride=4)).astype(int)
    assert np.abs(part[7:50, 10:61] - whole[7:50, 10:61]).mean() < 1.0
    part[7:50, 10:61] = 0
    assert not part.any()


def test_geom_groups_are_rendered_separately(scene: tuple[Any, Any], renderer: Renderer) -> None:
    """Group 3 is for simulated cameras, group 2 for images for users."""
    loop = renderer.render(*scene, Exposure(0, 80, 60))
    people = (SCENE_GROUP, OBJECT_GROUP, VISUAL_GROUP)
    image = renderer.render(*scene, Exposure(0, 80, 60, groups=people))
    assert moments(loop, *BLUE)[0] > 0.0
    assert moments(loop, *RED)[0] == 0.0
    assert moments(image, *RED)[0] > 0.0
    assert moments(image, *BLUE)[0] == 0.0


def test_recompiled_model_is_rendered(scene: tuple[Any, Any], renderer: Renderer) -> None:
    """After a recompilation, nothing of the old model may be visible."""
    before = renderer.render(*scene, Exposure(0, 80, 60))
    model = mujoco.MjModel.from_xml_string(SCENE.replace("1 .85 0 1", "0 .85 0 1"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    after = renderer.render(model, data, Exposure(0, 80, 60))
    assert moments(before, *YELLOW)[0] > 0.0
    assert moments(after, *YELLOW)[0] == 0.0


def test_images_larger_than_the_offscreen_buffer_are_rendered(
    scene: tuple[Any, Any], renderer: Renderer
) -> None:
    """MuJoCo's default buffer is 640 by 480."""
    renderer.render(*scene, Exposure(0, 80, 60))
    image = renderer.render(*scene, Exposure(0, 800, 500, (380, 200, 420, 240)))
    assert image.shape == (500, 800, 3)
    assert image[200:240, 380:420].any()


def test_renderer_can_be_closed_twice_and_reused(
    scene: tuple[Any, Any], renderer: Renderer
) -> None:
    renderer.render(*scene, Exposure(0, 80, 60))
    renderer.close()
    renderer.close()
    assert renderer.render(*scene, Exposure(0, 80, 60)).any()


@given(fovy=st.floats(10.0, 120.0), stride=st.integers(1, 4))
@settings(max_examples=20, deadline=None)
def test_ray_passes_through_its_block(fovy: float, stride: int) -> None:
    width = 16
    height = 12
    rays = camera_rays(width, height, fovy, stride)
    focal = height / 2.0 / np.tan(np.radians(fovy) / 2.0)
    x = width / 2.0 - focal * rays[0] / rays[2]
    y = height / 2.0 + focal * rays[1] / rays[2]
    rows, columns = np.indices(x.shape)
    assert (np.floor(x / stride + 1e-9) == columns).all()
    assert (np.floor(y / stride + 1e-9) == rows).all()
