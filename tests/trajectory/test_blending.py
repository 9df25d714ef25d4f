"""Lines whose corners are rounded: near the corners, smooth, and straight elsewhere."""

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
    """Of each point from the nearest of the straight lines between the poses."""
    nearest = np.full(len(points), np.inf)
    for one, two in itertools.pairwise(poses):
        way = two.position - one.position
        share = np.clip((points - one.position) @ way / (way @ way), 0.0, 1.0)
        foot = one.position + share[:, None] * way
        nearest = np.minimum(nearest, np.linalg.norm(points - foot, axis=1))
    return nearest


def turns(path: CartesianPath) -> Vector:
    """Angles between the steps of a path, rad."""
    way = np.diff(path.positions, axis=0)
    way /= np.linalg.norm(way, axis=1)[:, None]
    cosines = (way[1:] * way[:-1]).sum(axis=1)
    angles: Vector = np.arccos(np.clip(cosines, -1.0, 1.0))
    return angles


@given(st.lists(steps, min_size=1, max_size=5), st.floats(0.002, 0.2))
def test_the_ends_are_met_and_the_corners_cut_by_no_more_than_the_radius(
    moves: list[tuple[float, float, float]], radius: float
) -> None:
    poses = corners(moves)
    path = blended(poses, radius)
    assert path.start.distance(poses[0]) < 1e-12
    assert path.end.distance(poses[-1]) < 1e-12
    assert distance_to_lines(path.positions, poses).max() < radius
    for pose in poses[1:-1]:
        assert np.linalg.norm(path.positions - pose.position, axis=1).min() < radius


def test_outside_of_the_radius_the_path_is_straight_and_inside_it_is_not() -> None:
    poses = corners([(0.3, 0.0, 0.0), (0.0, 0.3, 0.0)])
    path = blended(poses, 0.05)
    away = np.linalg.norm(path.positions - poses[1].position, axis=1)
    off = distance_to_lines(path.positions, poses)
    assert off[away > 0.0501].max() < 1e-12
    assert off[away < 0.03].max() > 0.005


def test_a_rounded_corner_has_no_kink_and_a_small_radius_cuts_little() -> None:
    poses = corners([(0.3, 0.0, 0.0), (0.0, 0.3, 0.0)])
    assert turns(blended(poses, 0.05)).max() < 0.15
    for radius in (0.1, 0.05, 0.01):
        path = blended(poses, radius)
        cut = np.linalg.norm(path.positions - poses[1].position, axis=1).min()
        assert 0.1 * radius < cut < 0.2 * radius


def test_orientations_turn_evenly_along_a_line_and_blend_at_corners() -> None:
    """A quarter turn on the first line, none on the second: no step turns faster than the first."""
    turned = START @ Pose.from_rpy((0.3, 0.0, 0.0), (0.0, 0.0, math.pi / 2))
    beyond = Pose(turned.position + np.array((0.0, 0.0, 0.3)), turned.quaternion)
    path = blended([START, turned, beyond], 0.05)
    ways = np.linalg.norm(np.diff(path.positions, axis=0), axis=1)
    angles = np.array([a.angle(b) for a, b in zip(path.poses, path.poses[1:], strict=False)])
    rate = (math.pi / 2) / 0.3
    assert (angles / np.maximum(ways, 1e-9)).max() < 1.05 * rate
    assert angles.sum() == pytest.approx(math.pi / 2, abs=0.1)
    assert path.end.angle(beyond) < 1e-6


def test_a_turn_on_the_spot_has_a_length() -> None:
    turned = START @ Pose.from_rpy((0.0, 0.0, 0.0), (0.5, 0.0, 0.0))
    path = blended([START, turned], 0.02)
    assert path.length == pytest.approx(0.0, abs=1e-12)
    assert path.end.angle(turned) < 1e-6


def test_what_is_no_path_is_refused() -> None:
    with pytest.raises(Failure, match="two poses"):
        blended([START], 0.02)
    with pytest.raises(Failure, match="pose 2 repeats") as caught:
        blended([START, START, corners([(0.1, 0, 0)])[1]], 0.02)
    assert caught.value.code == "INVALID_TARGET"
