"""Kernels of grasps agree with plain Python and with independent formulas."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.grasping.candidates import finger_points, palm_points
from bt_dualarm.grasping.grasp import Box, Solid, pinching_forces
from bt_dualarm.grasping.grasp_kernels import (
    BOX,
    CAPSULE,
    CYLINDER,
    distance,
    distances,
    hold,
    lower_clearances,
    pinch,
    press,
    reach,
)
from tests.grasping.families import JAW, hulls, poses, primitives
from tests.plain_kernels import plain

FEW = settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.too_slow])
SOLIDS = st.one_of(primitives(), hulls())


def expected_distances(solid: Solid, points: Matrix) -> Vector:
    """Distances from a box, a cylinder or a capsule by NumPy, of shape (n,)."""
    kind = solid.form.kind
    (numbers,) = solid.form.numbers
    across = np.hypot(points[:, 0], points[:, 1])
    if kind == CAPSULE:
        axis = np.clip(points[:, 2], -numbers[1], numbers[1])
        away: Vector = np.hypot(across, points[:, 2] - axis) - numbers[0]
        return away
    flat = np.column_stack((across, np.abs(points[:, 2])))
    beyond = np.abs(points) - numbers if kind == BOX else flat - numbers
    assert kind in (BOX, CYLINDER)
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
    signed: Vector = outside + np.minimum(beyond.max(axis=1), 0.0)
    return signed


@FEW
@given(SOLIDS, poses(), st.integers(0, 99))
def test_distance_and_reach_agree_with_plain_python(solid: Solid, pose: Pose, seed: int) -> None:
    points = np.random.default_rng(seed).uniform(-0.08, 0.08, (20, 3))
    found = distances(*solid.form, points)
    for point, away in zip(points, found, strict=True):
        assert plain(distance)(*solid.form, *point) == pytest.approx(away, abs=1e-15)
    direction = pose.turn(np.array((0.0, 0.0, 1.0)))
    farthest = reach(*solid.form, direction)
    assert plain(reach)(*solid.form, direction) == pytest.approx(farthest, abs=1e-15)


@FEW
@given(primitives(), st.integers(0, 99))
def test_distances_agree_with_the_formulas(solid: Solid, seed: int) -> None:
    points = np.random.default_rng(seed).uniform(-0.08, 0.08, (200, 3))
    assert solid.distance(points) == pytest.approx(expected_distances(solid, points), abs=1e-15)


@settings(max_examples=3, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(SOLIDS, poses())
def test_contact_of_pads_agrees_with_plain_python(solid: Solid, pose: Pose) -> None:
    axis, along = (np.ascontiguousarray(one) for one in pose.rotation_matrix.T[:2])
    given = (*solid.form, np.zeros(3), axis, along, np.array((0.02, 0.01)))
    for kernel in (press, hold):
        one = np.zeros(6)
        other = np.zeros(6)
        assert kernel(*given, one) == plain(kernel)(*given, other)
        assert one == pytest.approx(other, abs=1e-6)  # a normal is a difference of 1e-5 m


@FEW
@given(st.integers(0, 999), st.floats(0.02, 0.08), st.floats(0.1, 1.0))
def test_force_of_a_pinch_agrees_with_its_formula(seed: int, width: float, friction: float) -> None:
    """Friction force and moment form an ellipsoid; each pad bears half of the axial force."""
    rng = np.random.default_rng(seed)
    forces = rng.normal(0.0, 5.0, (9, 3))
    offset = rng.normal(0.0, 0.02, 3)
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    turning = rng.normal(0.0, 0.1, (9, 3))
    moments = np.cross(offset, forces) + turning
    flat = np.eye(3) - np.outer(axis, axis)
    sliding = 0.5 * np.linalg.norm(forces @ flat, axis=1)
    sliding = sliding + np.linalg.norm(moments @ flat, axis=1) / width
    twisting = 0.5 * np.abs(moments @ axis) / 0.005
    expected = np.hypot(sliding, twisting) / friction + 0.5 * np.abs(forces @ axis)
    given = (offset, axis, width, 0.005, friction)
    assert pinching_forces(forces, *given, turning) == pytest.approx(expected, rel=1e-9)
    assert plain(pinch)(forces, turning, *given) == pytest.approx(expected, rel=1e-9)


@settings(max_examples=4, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(primitives(), poses(), poses())
def test_clearance_is_the_least_distance_of_all_points(
    solid: Solid, pose: Pose, tool: Pose
) -> None:
    """It is exact if positive; otherwise only its sign counts."""
    tool = Pose(0.2 * tool.position, tool.quaternion)
    fingers = finger_points(JAW, 0.0)
    palm = palm_points(JAW)
    sides = np.repeat((1.0, -1.0, 0.0), (len(fingers) // 2, len(fingers) // 2, len(palm)))
    moving = np.column_stack((np.vstack((fingers, palm)), sides))
    widths = np.array([[JAW.widest_opening, 0.03]])
    row = np.array([[*tool.position, *tool.quaternion]])
    at = np.vstack([finger_points(JAW, width) for width in widths[0]] + [palm])
    near = Pose(0.2 * pose.position, pose.quaternion)
    least = float(solid.distance(near.inverse.apply(tool.apply(at))).min())
    for kernel in (lower_clearances, plain(lower_clearances)):
        clearances = np.array([0.5])
        kernel(*solid.form, near.matrix, row, widths, moving, -1e-4, clearances)
        if least < -1e-4:
            assert clearances[0] < -1e-4
        else:
            assert clearances[0] == pytest.approx(min(least, 0.5), abs=1e-12)


def test_abstract_solid_has_no_form() -> None:
    with pytest.raises(NotImplementedError):
        _ = Solid().form
    assert Box(np.full(3, 0.02)).reach(np.array((1, 0, 0))) == pytest.approx(0.02)
