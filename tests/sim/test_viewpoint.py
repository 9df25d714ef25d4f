"""Viewpoints of images for users show all moving bodies of any scene."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from bt_dualarm.core.pose import Matrix
from bt_dualarm.sim.frame import Viewpoint, fitted
from bt_dualarm.sim.painter import StillRenderer, best_viewpoint

POINTS = arrays(float, st.tuples(st.integers(1, 9), st.just(3)), elements=st.floats(-3, 3))

SCENE = """
<mujoco>
  <worldbody>
    <geom type="plane" size="4 4 .1"/>
    <body name="arm"><geom type="box" size=".05 .05 .4" pos="0 0 .4" group="3"/></body>
    <body name="screen" pos=".5 0 .3"><geom type="box" size=".01 .3 .3"/></body>
    <body name="ball" pos="{ball}"><freejoint/><geom size=".04" group="1"/></body>
  </worldbody>
</mujoco>
"""


def still(ball: str) -> StillRenderer:
    model = mujoco.MjModel.from_xml_string(SCENE.format(ball=ball))
    return StillRenderer(model, model.qpos0.copy(), 0.0)


@given(POINTS, st.floats(0.0, 7.0))
def test_every_point_is_inside_the_image(points: Matrix, azimuth: float) -> None:
    direction = np.array([np.cos(azimuth), np.sin(azimuth), 0.5])
    spread = np.vstack((points, points[0] + (0.0, 0.0, 0.1)))
    x, y = fitted(spread, direction, 40.0, 4 / 3).pixels(spread, 640, 480).T
    assert x.min() >= 0
    assert x.max() <= 640
    assert y.min() >= 0
    assert y.max() <= 480


def test_image_is_upright() -> None:
    """Seen from +x, y is to the right, z up, and the target at the center."""
    view = Viewpoint(np.array([2.0, 0, 0]), np.zeros(3), 90.0)
    points = np.array([[0, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    assert view.pixels(points, 200, 100) == pytest.approx(
        np.array([[100, 50], [125, 50], [100, 25]])
    )


def test_viewpoint_avoids_occlusion() -> None:
    """The ball is behind a screen for an eye at positive x."""
    view = best_viewpoint([still(".4 0 .05")], 4 / 3)
    assert view is not None
    assert view.eye[0] < view.look_at[0] or abs(view.eye[1]) > view.eye[0]
    image = still(".4 0 .05").draw(view, 160, 120)
    assert image.shape == (120, 160, 3)


def test_fallen_object_does_not_enlarge_the_view() -> None:
    near, far = (
        best_viewpoint([still("1 0 .04"), still(ball)], 4 / 3) for ball in ("1 0 .04", "1 0 -500")
    )
    assert near is not None
    assert far is not None
    assert far.eye == pytest.approx(near.eye)


def test_empty_world_has_no_viewpoint() -> None:
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    assert best_viewpoint([StillRenderer(model, model.qpos0.copy(), 0.0)], 1.0) is None
