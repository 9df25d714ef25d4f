"""Rotations of the tool about a line."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Pose
from bt_dualarm.trajectory.paths import turned_about

TOOL = Pose.from_rpy((0.5, 0.1, 0.7), (0.1, 0.2, 0.3))

axes = st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda axis: math.hypot(*axis) > 0.1)
points = st.tuples(*[st.floats(-0.5, 0.5)] * 3)
angles = st.floats(-7.0, 7.0).filter(lambda angle: abs(angle) > 0.05)


@given(axes, points, angles)
def test_points_on_the_axis_stay_fixed(
    axis: tuple[float, float, float], offset: tuple[float, float, float], angle: float
) -> None:
    point = TOOL.position + np.array(offset)
    path = turned_about(TOOL, point, np.array(axis), angle)
    fixed = TOOL.inverse.apply(point), TOOL.inverse.apply(point + 0.3 * np.array(axis))
    assert path.start.distance(TOOL) < 1e-12
    for pose in path.poses:
        np.testing.assert_allclose(pose.apply(fixed[0]), point, atol=1e-9)
        np.testing.assert_allclose(pose.apply(fixed[1]), point + 0.3 * np.array(axis), atol=1e-9)


@given(axes, angles)
def test_rotation_is_even_and_right_handed(axis: tuple[float, float, float], angle: float) -> None:
    path = turned_about(TOOL, TOOL.position, np.array(axis), angle)
    steps = [
        (b.rotation * a.rotation.inv()).as_rotvec()
        for a, b in zip(path.poses, path.poses[1:], strict=False)
    ]
    np.testing.assert_allclose(steps, np.tile(steps[0], (len(steps), 1)), atol=1e-9)
    unit = np.array(axis) / np.linalg.norm(axis)
    assert np.sum(steps, axis=0) @ unit == pytest.approx(angle)
    assert np.linalg.norm(steps[0]) < 0.031


def test_full_turn_returns_to_the_start() -> None:
    path = turned_about(TOOL, TOOL.position + 0.1, np.array((0.0, 0.0, 1.0)), 2 * math.pi)
    assert path.end.distance(TOOL) < 1e-9
    assert path.length == pytest.approx(2 * math.pi * math.hypot(0.1, 0.1), rel=1e-3)


@pytest.mark.parametrize(("axis", "angle"), [((0, 0, 0), 1.0), ((0, 0, 1), 0.0)])
def test_rotation_without_axis_or_angle_is_refused(axis: tuple[float, ...], angle: float) -> None:
    with pytest.raises(Failure, match="INVALID_TARGET"):
        turned_about(TOOL, TOOL.position, np.array(axis, dtype=float), angle)
