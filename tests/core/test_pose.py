from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from bt_dualarm.core.pose import Pose

_coordinate = st.floats(-3.0, 3.0)
_triple = st.tuples(_coordinate, _coordinate, _coordinate)
poses = st.builds(Pose.from_rpy, _triple, _triple)


@given(poses, poses)
def test_composition_is_the_product_of_the_matrices(a: Pose, b: Pose) -> None:
    np.testing.assert_allclose((a @ b).matrix, a.matrix @ b.matrix, atol=1e-12)


@given(poses)
def test_pose_and_its_inverse_cancel(a: Pose) -> None:
    np.testing.assert_allclose((a @ a.inverse).matrix, np.eye(4), atol=1e-12)
    assert a.angle(a.inverse.inverse) < 1e-7


@given(poses, _triple)
def test_apply_rotates_and_translates(a: Pose, point: tuple[float, float, float]) -> None:
    expected = a.rotation.apply(point) + a.position
    np.testing.assert_allclose(a.apply(np.array(point)), expected, atol=1e-12)
    np.testing.assert_allclose(a.apply(np.array([point]))[0], expected, atol=1e-12)
    np.testing.assert_allclose(a.turn(np.array(point)), expected - a.position, atol=1e-12)


@given(poses, _triple)
def test_shifted_composes_a_translation_from_the_left(
    a: Pose, offset: tuple[float, float, float]
) -> None:
    shift = Pose.from_rpy(offset)
    np.testing.assert_allclose(a.shifted(shift.position).matrix, (shift @ a).matrix, atol=1e-12)
    up = a.raised(offset[2]).position - a.position
    np.testing.assert_allclose(up, (0.0, 0.0, offset[2]), atol=1e-12)


@given(poses, poses)
def test_angle_agrees_with_scipy(a: Pose, b: Pose) -> None:
    expected = (a.rotation.inv() * b.rotation).magnitude()
    assert abs(a.angle(b) - expected) < 1e-7


@given(poses)
def test_pose_from_a_matrix_has_that_matrix(a: Pose) -> None:
    again = Pose.from_matrix(a.matrix)
    np.testing.assert_allclose(again.matrix, a.matrix, atol=1e-12)


def test_roll_pitch_yaw_are_about_fixed_axes_in_that_order() -> None:
    """URDF: a quarter roll then a quarter yaw takes y to z, then leaves it there."""
    pose = Pose.from_rpy((0, 0, 0), (np.pi / 2, 0, np.pi / 2))
    np.testing.assert_allclose(pose.turn(np.array([0.0, 1.0, 0.0])), (0, 0, 1), atol=1e-12)


@given(poses)
def test_orientation_survives_conversion_to_roll_pitch_yaw(pose: Pose) -> None:
    assert Pose.from_rpy(pose.position.tolist(), pose.rpy).angle(pose) < 1e-7


@given(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.sampled_from((-1.0, 1.0)))
def test_roll_is_zero_at_a_pitch_of_90_degrees(roll: float, yaw: float, up: float) -> None:
    """Roll and yaw turn about the same axis there, so the whole angle is yaw."""
    pose = Pose.from_rpy((0.0, 0.0, 0.0), (roll, up * math.pi / 2.0, yaw))
    assert pose.rpy[0] == 0.0
    assert Pose.from_rpy((0.0, 0.0, 0.0), pose.rpy).angle(pose) < 1e-7
