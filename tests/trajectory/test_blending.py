"""Lines with blended corners: near the corners, smooth, and straight elsewhere."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.trajectory.paths import CartesianPath, blended

START = Pose.from_rpy((0.5, 0.1, 0.7), (0.1, 0.2, 0.3))

steps = st.tuples(*[st.floats(-0.3, 0.3)] * 3).filter(lambda step: math.hypot(*step) > 0.05)


def corners(moves: list[tuple[float, float, float]]) -> list[Pose]:
    poses = [START]
    for move in moves:
        last = poses[-1]
        poses.append(Pose(last.position + np.array(move), last.quaternion))
    return poses


def distance_to_lines(points: Matrix, poses: list[Pose]) -> Vector:
    """Distance of each point from the nearest of the straight lines between the poses."""
    nearest = np.full(len(points), np.inf)
    for one, two in itertools.pairwise(poses):
        step = two.position - one.position
        fraction = np.clip((points - one.position) @ step / (step @ step), 0.0, 1.0)
        foot = one.position + fraction[:, None] * step
        nearest = np.minimum(nearest, np.linalg.norm(points - foot, axis=1))
    return nearest


def turns(path: CartesianPath) -> Vector:
    """Angles between the steps of a path, rad."""
    step = np.diff(path.positions, axis=0)
    step /= np.linalg.norm(step, axis=1)[:, None]
    cosines = (step[1:] * step[:-1]).sum(axis=1)
    angles: Vector = np.arccos(np.clip(cosines, -1.0, 1.0))
    return angles


@given(st.lists(steps, min_size=1, max_size=5), st.floats(0.002, 0.2))
def test_path_has_exact_ends_and_cuts_corners_within_the_radius(
    moves: list[tuple[float, float, float]], radius: float
) -> None:
    poses = corners(moves)
    path = blended(poses, radius)
    assert path.start.distance(poses[0]) < 1e-12
    assert path.end.distance(poses[-1]) < 1e-12
    assert distance_to_lines(path.positions, poses).max() < radius
    for pose in poses[1:-1]:
        assert np.linalg.norm(path.positions - pose.position, axis=1).min() < radius


def test_path_is_straight_only_outside_of_the_radius() -> None:
    poses = corners([(0.3, 0.0, 0.0), (0.0, 0.3, 0.0)])
    path = blended(poses, 0.05)
    from_corner = np.linalg.norm(path.positions - poses[1].position, axis=1)
    deviation = distance_to_lines(path.positions, poses)
    assert deviation[from_corner > 0.0501].max() < 1e-12
    assert deviation[from_corner < 0.03].max() > 0.005


def test_blended_corner_is_smooth_and_its_cut_proportional_to_the_radius() -> None:
    poses = corners([(0.3, 0.0, 0.0), (0.0, 0.3, 0.0)])
    assert turns(blended(poses, 0.05)).max() < 0.15
    for radius in (0.1, 0.05, 0.01):
        path = blended(poses, radius)
        cut = np.linalg.norm(path.positions - poses[1].position, axis=1).min()
        assert 0.1 * radius < cut < 0.2 * radius


def test_orientation_changes_evenly_along_lines_and_blends_at_corners() -> None:
    """A quarter turn on the first line, none on the second: no step rotates faster than that."""
    turned = START @ Pose.from_rpy((0.3, 0.0, 0.0), (0.0, 0.0, math.pi / 2))
    beyond = Pose(turned.position + np.array((0.0, 0.0, 0.3)), turned.quaternion)
    path = blended([START, turned, beyond], 0.05)
    lengths = np.linalg.norm(np.diff(path.positions, axis=0), axis=1)
    angles = np.array([a.angle(b) for a, b in zip(path.poses, path.poses[1:], strict=False)])
    rate = (math.pi / 2) / 0.3
    assert (angles / np.maximum(lengths, 1e-9)).max() < 1.05 * rate
    assert angles.sum() == pytest.approx(math.pi / 2, abs=0.1)
    assert path.end.angle(beyond) < 1e-6


def test_rotation_in_place_is_a_path() -> None:
    turned = START @ Pose.from_rpy((0.0, 0.0, 0.0), (0.5, 0.0, 0.0))
    path = blended([START, turned], 0.02)
    assert path.length == pytest.approx(0.0, abs=1e-12)
    assert path.end.angle(turned) < 1e-6


def test_single_or_repeated_pose_is_refused() -> None:
    with pytest.raises(Failure, match="two poses"):
        blended([START], 0.02)
    with pytest.raises(Failure, match="pose 2 repeats") as caught:
        blended([START, START, corners([(0.1, 0, 0)])[1]], 0.02)
    assert caught.value.code == "INVALID_TARGET"


@pytest.mark.parametrize("radius", [-1.0, math.nan])
def test_radius_below_zero_is_refused(radius: float) -> None:
    """It led a meter out of the way."""
    with pytest.raises(Failure, match="blend radius must be 0 m or more"):
        blended(corners([(0.3, 0.0, 0.0), (0.0, 0.3, 0.0)]), radius)
