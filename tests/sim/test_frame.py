"""Frames: their pixels, rays and axes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_dualarm.core.pose import Pose
from bt_dualarm.sim.frame import Frame

FOV_RAD = np.radians(60.0)


def frame_of(width: int, height: int, rpy: tuple[float, float, float] = (0, 0, 0)) -> Frame:
    image = np.zeros((height, width, 3), np.uint8)
    pose = Pose.from_rpy((0.3, -0.2, 1.0), rpy)
    return Frame(0.0, image, pose, FOV_RAD, (0, 0, width, height))


def test_ray_passes_through_its_pixel() -> None:
    """The center of the bottom edge is half the field of view down, and y points down."""
    frame = frame_of(80, 60)
    assert frame.ray((40.0, 30.0)) == pytest.approx([0, 0, 1], abs=1e-12)
    assert frame.ray((40.0, 60.0)) == pytest.approx([0, np.tan(FOV_RAD / 2), 1], abs=1e-12)
    assert frame.focal_px == pytest.approx(30.0 / np.tan(FOV_RAD / 2))


@given(
    rpy=st.tuples(*[st.floats(-np.pi, np.pi)] * 3),
    x=st.floats(0.0, 80.0),
    y=st.floats(0.0, 60.0),
)
def test_point_on_a_ray_projects_to_its_pixel(
    rpy: tuple[float, float, float], x: float, y: float
) -> None:
    """For any pose, a point on the ray, in the camera frame, projects to the pixel."""
    frame = frame_of(80, 60, rpy)
    point = frame.pose.position + 0.7 * frame.ray((x, y))
    local = frame.world_in_camera.apply(point)
    assert local[2] == pytest.approx(0.7)
    pixel = frame.focal_px * local[:2] / local[2] + (40.0, 30.0)
    assert pixel == pytest.approx([x, y], abs=1e-9)
    assert frame.right == pytest.approx(frame.pose.turn(np.array((1.0, 0.0, 0.0))), abs=1e-12)
