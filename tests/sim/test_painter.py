"""Images for users have shadows, and otherwise equal what cameras see."""

from __future__ import annotations

from itertools import product

import cv2
import mujoco
import numpy as np
import numpy.typing as npt
import pytest

from bt_dualarm.core.pose import Matrix
from bt_dualarm.robots.mjspec import COLLISION_GROUP, LOOP_GROUPS, OBJECT_GROUP
from bt_dualarm.sim.frame import Image, Viewpoint
from bt_dualarm.sim.painter import ScenePainter
from bt_dualarm.sim.renderers import RayScene, Shading, fan_of
from tests.families import some

SIZE = (240, 180)
VIEW = Viewpoint(np.array((1.5, -1.0, 1.4)), np.array((0.0, 0.0, 0.1)), 50.0)
BALL = np.array((0.1, 0.0, 0.4))
RADIUS = 0.15
SCENE = """
<mujoco>
  <visual><headlight ambient=".4 .4 .4" diffuse="0 0 0"/></visual>
  <worldbody>
    {lights}
    <geom type="plane" size="4 4 .1" rgba=".8 .8 .8 1"/>
    <geom type="sphere" size=".15" pos="0.1 0 0.4" group="1" rgba=".6 .2 .2 1"/>
  </worldbody>
</mujoco>
"""
LAMP = '<light pos="{place}" dir="0 0 -1" diffuse=".5 .5 .5" castshadow="{casts}"/>'
SUN = '<light dir="{place}" type="directional" diffuse=".5 .5 .5"/>'


def painted(lights: str, finer: int = 1) -> tuple[Image, Image, Matrix, npt.NDArray[np.bool_]]:
    """Image, the same without shadows, points hit by rays, and whether these are on the ground."""
    model = mujoco.MjModel.from_xml_string(SCENE.format(lights=lights))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_camlight(model, data)
    fan = fan_of(VIEW, *SIZE)
    hits = RayScene(model, LOOP_GROUPS).trace(data, fan)
    plain = Shading(model).colors(data, fan, hits)
    rays = np.einsum("ij,jrc->rci", fan.axes, fan.rays)
    distances = np.where(hits.geoms < 0, 0.0, hits.distances)  # for the sky: the eye itself
    points = fan.eye + rays * distances[..., None]
    return ScenePainter(model).draw(data, VIEW, SIZE, finer), plain, points, hits.geoms == 0


def hidden_m(points: Matrix, lamp: Matrix) -> Matrix:
    """Depth of points in the shadow of the ball by the closed form, negative outside, m."""
    toward = lamp - points
    toward = toward / np.linalg.norm(toward, axis=-1, keepdims=True)
    along = ((BALL - points) * toward).sum(axis=-1)
    miss = np.linalg.norm(BALL - points - along[..., None] * toward, axis=-1)
    return np.where(along > 0, RADIUS - miss, -np.inf)


@pytest.mark.parametrize(
    ("place", "distant", "finer"),
    some(product([(0.3, -0.4, 2.0), (-0.5, 0.2, 1.5), (0.1, 0.0, 3.0)], [False, True], [1, 2]), 3),
)
def test_ground_is_dark_where_a_ball_hides_the_lamp(
    place: tuple[float, float, float], distant: bool, finer: int
) -> None:
    """It agrees with the closed form up to two pixels at an edge (10 to 20 mm each)."""
    lamp = np.array(place)
    form, parameter = (SUN, -lamp) if distant else (LAMP, lamp)
    lights = form.format(place=" ".join(map(str, parameter)), casts="true")
    image, plain, points, ground = painted(lights, finer)
    ball = cv2.dilate((~ground).astype(np.uint8), np.ones((2 * finer + 1,) * 2, np.uint8)) > 0
    deep = hidden_m(points, 1e4 * lamp if distant else lamp)
    change = plain.astype(int) - image
    dark = ~ball & (deep > 0.02 * finer)
    lit = ~ball & (deep < -0.02 * finer)
    assert dark.sum() > 150
    assert lit.sum() > 10_000
    assert change[dark].min() > 40
    np.testing.assert_array_equal(image[lit], plain[lit])


def test_surface_facing_the_lamp_has_no_shadow() -> None:
    """No shadow acne: the ball's side toward the lamp is as without shadows."""
    image, plain, points, _ = painted(LAMP.format(place="0.3 -0.4 2", casts="true"))
    normals = (points - BALL) / RADIUS
    lamp = np.array((0.3, -0.4, 2.0))
    facing = (normals * (lamp - points)).sum(axis=-1) / np.linalg.norm(lamp - points, axis=-1)
    on_ball = np.abs(np.linalg.norm(points - BALL, axis=-1) - RADIUS) < 1e-6
    lit = on_ball & (facing > 0.2)
    assert lit.sum() > 400
    np.testing.assert_array_equal(image[lit], plain[lit])


@pytest.mark.parametrize(
    "lights",
    [LAMP.format(place="0.3 -0.4 2", casts="false"), ""],
    ids=["casts none", "no lamp"],
)
def test_image_without_shadows_equals_that_of_cameras(lights: str) -> None:
    image, plain, _, _ = painted(lights)
    np.testing.assert_array_equal(image, plain)


def test_two_lamps_cast_separate_shadows() -> None:
    """Where one lamp is hidden, the light of the other one remains."""
    lamps = np.array(((0.6, -0.4, 2.0), (-0.6, 0.3, 2.0)))
    both = "".join(LAMP.format(place=" ".join(map(str, lamp)), casts="true") for lamp in lamps)
    image, plain, points, ground = painted(both)
    first, second = ((hidden_m(points, lamp) > 0.02) & ground for lamp in lamps)
    for one, other in ((first, second), (second, first)):
        alone = one & ~other
        assert alone.sum() > 200
        change = plain[alone].astype(int) - image[alone]
        assert 40 < np.median(change) < 110, "about half of 255, reduced by oblique incidence"


def test_an_object_far_away_does_not_blur_the_shadows_of_the_others() -> None:
    """A fault takes objects 50 m away, and the map of the shadows has only so many points."""
    box = '<body pos="{pos}">{joint}<geom type="box" size=".1 .1 .1" group="{group}"/></body>'
    arm = box.format(pos="0.5 0.5 0.1", joint="", group=COLLISION_GROUP)
    far = box.format(pos="0 0 50", joint="<freejoint/>", group=OBJECT_GROUP)
    lights = LAMP.format(place="0.3 -0.4 2", casts="true")
    np.testing.assert_array_equal(painted(lights + arm + far)[0], painted(lights + arm)[0])
